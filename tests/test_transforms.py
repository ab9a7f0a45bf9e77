"""Files transforms.json of other programs: their intrinsics, lenses, masks and lists of files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from svv.core.geometry.cameras import Camera, look_at, sphere_cameras
from svv.errors import BadInput
from svv.io.views.camera_file import read_camera
from svv.io.views.lenses import Lens, rectify
from svv.io.views.transforms import transforms_file
from svv.io.views.viewset import ViewSet, files_of
from svv.job.source import ViewSource
from tests.balls import two_balls
from tests.nightly import nightly

SIZE = (48, 36)
"""Width and height of the images."""
POSES = [c.camera_to_world for c in sphere_cameras(5, (0.0, 0.0, 0.0), 4.0, 0.5, 8)]
NERFSTUDIO: dict[str, Any] = {
    "camera_model": "OPENCV", "w": 48, "h": 36, "fl_x": 80.0, "fl_y": 80.0, "cx": 22.5, "cy": 19.0,
    "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "applied_transform": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]],
    "ply_file_path": "sparse_pc.ply",
}  # fmt: skip


def nerfstudio_camera(k: int = 0) -> Camera:
    return Camera(POSES[k], 2 * np.arctan(24 / 80.0), *SIZE, None, (22.5, 19.0))


def write_set(folder: Path, scene: dict[str, Any] = NERFSTUDIO, frames: dict[str, Any] | None = None) -> None:
    """A set of five views of two balls, as nerfstudio lays it out: one file, and a folder ``images``."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    listed = []
    for k, pose in enumerate(POSES):
        name = f"images/frame_{k + 1:05d}.png"
        Image.fromarray(two_balls(nerfstudio_camera(k))).save(folder / name)
        listed.append({"file_path": name, "transform_matrix": pose.tolist(), "colmap_im_id": k, **(frames or {})})
    (folder / "transforms.json").write_text(json.dumps({**scene, "frames": listed}))


def changed(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = json.loads((folder / "transforms.json").read_text())
    change(content)
    (folder / "transforms.json").write_text(json.dumps(content))


def assert_same_rays(camera: Camera, expected: Camera) -> None:
    assert (camera.width, camera.height) == (expected.width, expected.height)
    for part, truth in zip(camera.rays(), expected.rays(), strict=True):
        np.testing.assert_allclose(part, truth, atol=1e-12)


def test_a_set_of_nerfstudio_is_read_as_it_comes(tmp_path: Path) -> None:
    write_set(tmp_path)
    views = ViewSet.read(tmp_path)
    assert views.names[0] == "frame_00001" and views.meta.assumed is None and len(views) == 5
    for k, camera in enumerate(views.cameras):
        assert_same_rays(camera, nerfstudio_camera(k))
        np.testing.assert_array_equal(views.images[k], two_balls(nerfstudio_camera(k)))
    assert len(ViewSource(tmp_path).identity()["files"]) == 6
    with pytest.raises(BadInput, match="There is no"):
        ViewSet.read(tmp_path, "test")


@pytest.mark.parametrize(
    ("scene", "frames"),
    [
        ({}, {k: NERFSTUDIO[k] for k in ("w", "h", "fl_x", "fl_y", "cx", "cy")}),  # per frame
        ({**NERFSTUDIO, "fl_x": 5.0, "cx": 0.0}, {"fl_x": 80.0, "cx": 22.5}),  # a frame's own count
        ({k: 2 * NERFSTUDIO[k] for k in ("w", "h", "fl_x", "fl_y", "cx", "cy")}, {}),  # images since reduced
        ({**NERFSTUDIO, "camera_angle_x": 0.1, "camera_angle_y": 0.1, "aabb_scale": 16}, {}),  # instant-ngp gives both
        ({"camera_angle_x": 2 * np.arctan(24 / 80.0), "cx": 22.5, "cy": 19.0}, {}),
        ({"camera_angle_y": 2 * np.arctan(18 / 80.0), "cx": 22.5, "cy": 19.0}, {}),
        ({"fl_x": 5.0, "cx": 22.5, "cy": 19.0}, {"camera_angle_x": 2 * np.arctan(24 / 80.0)}),
    ],
)
def test_intrinsics_say_the_same_in_many_ways(scene: dict[str, Any], frames: dict[str, Any], tmp_path: Path) -> None:
    write_set(tmp_path, scene, frames)
    for k, camera in enumerate(ViewSet.read(tmp_path).cameras):
        assert_same_rays(camera, nerfstudio_camera(k))


@pytest.mark.parametrize("scene", [{"span_x": 2.0}, {"fl_x": 24.0, "fl_y": 24.0}, {"fl_x": 48.0, "w": 96, "h": 72}])
def test_parallel_cameras_are_read(scene: dict[str, Any], tmp_path: Path) -> None:
    for model in ("ORTHOPHOTO", "orthographic"):
        write_set(tmp_path, {"camera_model": model, **scene})
        for camera, pose in zip(ViewSet.read(tmp_path).cameras, POSES, strict=True):
            assert_same_rays(camera, Camera.orthographic(pose, 2.0, *SIZE))


def test_a_matrix_may_lack_its_last_row(tmp_path: Path) -> None:
    write_set(tmp_path)
    changed(tmp_path, lambda c: c["frames"][0].update(transform_matrix=POSES[0][:3].tolist()))
    assert_same_rays(ViewSet.read(tmp_path).cameras[0], nerfstudio_camera())


spans = st.none() | st.floats(0.01, 100.0)
centres = st.none() | st.tuples(st.floats(-99, 99), st.floats(-99, 99))


@settings(max_examples=25, deadline=None)
@given(kinds=st.lists(st.tuples(st.floats(0.1, 2.0), spans, centres), min_size=3, max_size=5))
def test_any_cameras_are_the_same_after_writing(
    kinds: list[tuple[float, float | None, tuple[float, float] | None]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("views")
    cameras = [
        Camera(pose, fov, 6, 4, None, centre) if span is None else Camera.orthographic(pose, span, 6, 4, centre)
        for pose, (fov, span, centre) in zip(POSES, kinds, strict=False)
    ]
    names = tuple(f"r_{k}" for k in range(len(cameras)))
    ViewSet(tuple(cameras), np.full((len(cameras), 4, 6, 4), 9, np.uint8), names).write(folder)
    for k, (camera, written) in enumerate(zip(ViewSet.read(folder).cameras, cameras, strict=True)):
        assert camera.identity[1:] == written.identity[1:]
        np.testing.assert_array_equal(camera.camera_to_world, written.camera_to_world)
        single = read_camera(folder / "transforms_train.json", (6, 4), k)
        assert single.identity[1:] == written.identity[1:]


def test_lists_of_files_part_the_set(tmp_path: Path) -> None:
    write_set(tmp_path)
    changed(tmp_path, lambda c: c.update(test_filenames=["images/frame_00002.png"]))
    assert len(ViewSet.read(tmp_path)) == 4
    assert ViewSet.read(tmp_path, "test").names == ("frame_00002",)
    assert transforms_file(tmp_path, "val") is None and len(files_of(tmp_path, "test")) == 2
    changed(tmp_path, lambda c: c.update(train_filenames=[f"images/frame_0000{k}.png" for k in (1, 3, 4)]))
    assert ViewSet.read(tmp_path).names == ("frame_00001", "frame_00003", "frame_00004")


def test_a_mask_is_the_alpha_of_a_photograph(tmp_path: Path) -> None:
    write_set(tmp_path)
    (tmp_path / "masks").mkdir()
    draw = np.random.default_rng(0)

    def give(content: dict[str, Any]) -> None:
        for k, frame in enumerate(content["frames"]):
            image = two_balls(nerfstudio_camera(k))
            photo = np.where(image[..., 3:] > 0, image[..., :3], draw.integers(0, 255, (36, 48, 3))).astype(np.uint8)
            frame |= {"file_path": f"images/{k}.jpg", "mask_path": f"masks/{k}.png"}
            Image.fromarray(photo).save(tmp_path / frame["file_path"], quality=100)
            Image.fromarray(image[..., 3]).save(tmp_path / frame["mask_path"])

    changed(tmp_path, give)
    views = ViewSet.read(tmp_path)
    np.testing.assert_array_equal(views.images[2, ..., 3], two_balls(nerfstudio_camera(2))[..., 3])
    assert len(files_of(tmp_path, "train")) == 11
    changed(tmp_path, lambda c: [frame.pop("mask_path") for frame in c["frames"]])
    with pytest.raises(BadInput, match="mask_path"):
        ViewSet.read(tmp_path)


def test_images_whose_frames_state_their_sizes_may_differ(tmp_path: Path) -> None:
    write_set(tmp_path, {}, {k: NERFSTUDIO[k] for k in ("w", "h", "fl_x", "fl_y", "cx", "cy")})

    def enlarge(content: dict[str, Any]) -> None:
        frame = content["frames"][1]
        large = replace(nerfstudio_camera(1).resized(96, 72))
        Image.fromarray(two_balls(large)).save(tmp_path / frame["file_path"])
        frame |= {k: 2 * frame[k] for k in ("w", "h", "fl_x", "fl_y", "cx", "cy")}

    changed(tmp_path, enlarge)
    views = ViewSet.read(tmp_path)
    assert_same_rays(views.cameras[1], nerfstudio_camera(1))
    assert views.meta.assumed is not None and "48 x 36" in views.meta.assumed
    assert np.abs(views.images[1, ..., 3] - two_balls(nerfstudio_camera(1))[..., 3].astype(float)).mean() < 6.0
    changed(tmp_path, lambda c: c["frames"][1].pop("w"))
    with pytest.raises(BadInput, match="same size, unless"):
        ViewSet.read(tmp_path)


# --- lenses ----------------------------------------------------------------------------------------------------------

LENSES: dict[str, dict[str, Any]] = {
    "radial": {"k1": -0.12, "k2": 0.02},
    "barrel and tangential": {"k1": 0.15, "p1": 0.01, "p2": -0.008},
    "fisheye": {"camera_model": "OPENCV_FISHEYE", "k1": 0.03, "k2": -0.004},
    "instant-ngp's fisheye": {"is_fisheye": True, "k1": 0.02},
    "tall pixels": {"fl_y": 96.0},
}


def pattern(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A smooth picture as a function of direction (x / z, y / z), opaque and translucent in parts. (..., 4) uint8"""
    waves = [0.5 + 0.4 * np.sin(a * x + b * y + c) for a, b, c in ((9, 2, 0), (-3, 8, 1), (5, 5, 2), (2, -3, 3))]
    return np.rint(255 * np.stack(waves, -1)).astype(np.uint8)


def directions_in(lens: Lens) -> tuple[np.ndarray, np.ndarray]:
    """The direction that every pixel of a distorted image shows, by inverting its model by fixed-point iteration."""
    column, row = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    u, v = column.copy(), row.copy()
    for _ in range(60):
        at = lens.seen_at(u, v, lens.focal[0])
        u, v = u + (column - at[0]), v + (row - at[1]) * lens.focal[0] / lens.focal[1]
    np.testing.assert_allclose(lens.seen_at(u, v, lens.focal[0]), (column, row), atol=1e-6)
    return (u - lens.centre[0]) / lens.focal[0], (v - lens.centre[1]) / lens.focal[0]


@pytest.mark.parametrize("name", nightly(LENSES, *list(LENSES)[-2:]))
def test_distorted_images_are_those_of_a_pinhole_afterwards(name: str, tmp_path: Path) -> None:
    told = {**NERFSTUDIO, "w": 240, "h": 180, "fl_x": 300.0, "fl_y": 300.0, "cx": 110.0, "cy": 95.0, **LENSES[name]}
    fisheye = "fisheye" in name
    radial = (told["k1"], told["k2"], 0.0, 0.0)
    focal = (300.0, 300.0 if "fl_y" not in LENSES[name] else 360.0)
    told["fl_y"] = focal[1]
    lens = Lens(240, 180, focal, (110.0, 95.0), radial, (told["p1"], told["p2"]), fisheye)
    write_set(tmp_path, told)
    for file in (tmp_path / "images").iterdir():
        Image.fromarray(pattern(*directions_in(lens))).save(file)
    views = ViewSet.read(tmp_path)
    assert views.meta.assumed is not None and "distortion" in views.meta.assumed
    camera = views.cameras[0]
    local = camera.rays()[1] @ POSES[0][:3, :3]
    truth = pattern(local[..., 0] / -local[..., 2], -local[..., 1] / -local[..., 2])
    # Interpolation errs by a few levels, nowhere more than a wrong model would: a pixel is 7 levels here.
    assert np.abs(views.images[0].astype(float) - truth).max() < 3.0
    assert camera.focal < 1.3 * max(focal)


@given(
    st.tuples(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1)), st.tuples(st.floats(20, 300), st.floats(20, 300)),
    st.tuples(st.floats(0, 40), st.floats(0, 30)), st.booleans(),
)  # fmt: skip
def test_a_rectified_image_shows_nothing_from_outside(
    radial: tuple[float, float], focal: tuple[float, float], centre: tuple[float, float], fisheye: bool
) -> None:
    lens = Lens(40, 30, focal, centre, (*radial, 0.0, 0.0), fisheye=fisheye)
    try:
        new = lens.rectified
    except BadInput:
        return
    column, row = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    edge = np.ones((30, 40), bool)
    edge[1:-1, 1:-1] = False
    u, v = lens.seen_at(column[edge], row[edge], new)
    assert ((u >= 0) & (u <= 40) & (v >= 0) & (v <= 30)).all()
    assert rectify(np.full((30, 40, 4), 200, np.uint8), lens).min() >= 199


BAD: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "a panorama": (lambda c: c.update(camera_model="EQUIRECTANGULAR"), "EQUIRECTANGULAR is not supported"),
    "no focal length": (lambda c: [c.pop(k) for k in ("fl_x", "fl_y")], "camera_angle_x must be a number"),
    "a negative one": (lambda c: c.update(fl_x=-3.0), "positive"),
    "text": (lambda c: c.update(cx="left"), "numbers"),
    "another width": (lambda c: c.update(w=20), "w and h say"),
    "no width": (lambda c: c.update(w=0), "w must be"),
    "an angle of no image": (lambda c: c["frames"][1].update(camera_angle_x=4.0), "between 0 and pi"),
    "not a number": (lambda c: c.update(cy=float("nan")), "finite"),
    "a span without a model": (lambda c: c["frames"][1].update(span_x=2.0), "ORTHOPHOTO"),
    "no span": (lambda c: [c.update(camera_model="ORTHOPHOTO"), c.pop("fl_x")], "span_x"),
    "a span of nothing": (lambda c: c.update(camera_model="ORTHOPHOTO", span_x=0), "span_x"),
    "too strong a lens": (lambda c: c.update(k1=1e6), "too strong"),
    "a lens that folds": (lambda c: c.update(k1=-900.0), "too strong"),
    "one mask": (lambda c: c["frames"][1].update(mask_path="images/frame_00001.png"), "without mask_path"),
    "no mask": (lambda c: [f.update(mask_path="m.png") for f in c["frames"]], "no such file"),
    "lists of nothing": (lambda c: c.update(train_filenames=7), "train_filenames"),
    "lists of others": (lambda c: c.update(train_filenames=["x.png"]), "no views"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_read_is_refused_in_one_sentence(case: str, tmp_path: Path) -> None:
    change, words = BAD[case]
    write_set(tmp_path)
    changed(tmp_path, change)
    with pytest.raises(BadInput, match=words) as caught:
        ViewSet.read(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_mask_of_another_size_is_refused(tmp_path: Path) -> None:
    write_set(tmp_path)
    for k in range(5):
        Image.fromarray(two_balls(nerfstudio_camera(k))[..., :3]).save(tmp_path / f"images/frame_{k + 1:05d}.png")
    Image.fromarray(np.ones((8, 8), np.uint8)).save(tmp_path / "m.png")
    changed(tmp_path, lambda c: [f.update(mask_path="m.png") for f in c["frames"]])
    with pytest.raises(BadInput, match="make them the same size"):
        ViewSet.read(tmp_path)


def test_a_single_camera_may_be_orthographic(tmp_path: Path) -> None:
    matrix = look_at((3.0, 1.0, 2.0), (0.0, 0.0, 0.0))
    (tmp_path / "c.json").write_text(json.dumps({"camera_to_world": matrix.tolist(), "span_x": 2.5}))
    assert_same_rays(read_camera(tmp_path / "c.json", (8, 6)), Camera.orthographic(matrix, 2.5, 8, 6))
    write_set(tmp_path)
    assert_same_rays(read_camera(tmp_path / "transforms.json", frame=3), nerfstudio_camera(3).resized(800, 600))


def test_the_edge_of_a_huge_image_is_looked_at_in_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lens is what it is at any number of pixels: the same at 65,536 as at 1,024, and for as little work."""
    seen: list[int] = []
    whole = Lens.seen_at

    def counted(lens: Lens, column: np.ndarray, row: np.ndarray, focal: float) -> tuple[np.ndarray, np.ndarray]:
        seen.append(column.size)
        return whole(lens, column, row, focal)

    monkeypatch.setattr(Lens, "seen_at", counted)
    found = [Lens(n, n, (n, n), (0.5 * n, 0.5 * n), (0.1, 0, 0, 0), (0.001, 0)).rectified / n for n in (1024, 65536)]
    assert found[0] == pytest.approx(found[1], rel=2e-3)
    assert max(seen) <= 33 * 4 * 2048
