"""View sets: they are read back bit for bit, sets of other programs are accepted, and bad ones are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from svv.core.geometry.cameras import Camera, sphere_cameras
from svv.errors import BadInput, Cancelled
from svv.io.pictures.gamma import as_srgb
from svv.io.views.view_meta import ViewMeta
from svv.io.views.viewset import ViewSet, files_of
from tests.test_gamma import png

META = ViewMeta(bounds=((0, 1, 2), (3, 4, 5)), other={"of": "the test"})


def views(n: int = 4, width: int = 6, height: int = 5, seed: int = 0, fov: float = 0.7) -> ViewSet:
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 256, (n, height, width, 4), dtype=np.uint8)
    cameras = [c.resized(width, height) for c in sphere_cameras(max(n, 3), rng.normal(size=3), 3.3, fov, 8)[:n]]
    return ViewSet(tuple(cameras), images, tuple(f"r_{i:04d}" for i in range(n)), META)


def same(a: ViewSet, b: ViewSet) -> bool:
    poses = [(p.camera_to_world == q.camera_to_world).all() for p, q in zip(a.cameras, b.cameras, strict=True)]
    angles = [p.fov_x == q.fov_x for p, q in zip(a.cameras, b.cameras, strict=True)]
    return bool(np.array_equal(a.images, b.images) and all(poses) and all(angles)) and a.names == b.names


def save(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)


def foreign(folder: Path, images: list[np.ndarray], suffix: str = ".png", **keys: object) -> None:
    """A set as other programs write it: no key of ours, file_path without suffix, images anywhere."""
    cameras = sphere_cameras(max(len(images), 3), (0, 0, 0), 4, 0.5, 8)
    frames = []
    for i, (image, camera) in enumerate(zip(images, cameras)):
        save(folder / "train" / f"r_{i}{suffix}", image)
        frames.append({"file_path": f"./train/r_{i}", "transform_matrix": (camera.camera_to_world + 1e-8).tolist()})
    data = {"camera_angle_x": 0.5, "frames": frames, **keys}
    (folder / "transforms_train.json").write_text(json.dumps(data))


def rgba(n: int = 3, size: int = 8) -> list[np.ndarray]:
    return list(np.random.default_rng(1).integers(0, 256, (n, size, size, 4), dtype=np.uint8))


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(n=st.integers(3, 6), width=st.integers(1, 9), height=st.integers(1, 9), seed=st.integers(0, 99))
def test_round_trip_is_bit_exact(tmp_path: Path, n: int, width: int, height: int, seed: int) -> None:
    written = views(n, width, height, seed)
    written.write(tmp_path / "set")
    read = ViewSet.read(tmp_path / "set")
    assert same(written, read)
    assert read.meta == written.meta


def test_cameras_of_different_angles_survive(tmp_path: Path) -> None:
    first = views()
    cameras = tuple(Camera(c.camera_to_world, 0.3 + 0.1 * i, 6, 5) for i, c in enumerate(first.cameras))
    written = ViewSet(cameras, first.images, first.names)
    written.write(tmp_path, "test")
    assert same(written, ViewSet.read(tmp_path, "test"))


def test_progress_runs_to_one_and_may_stop_the_work(tmp_path: Path) -> None:
    told: list[float] = []
    views().write(tmp_path, progress=lambda fraction, label: told.append(fraction))
    assert told == sorted(told) and told[-1] == 1.0

    def stop(fraction: float, label: str) -> None:
        raise Cancelled

    before = sorted(p.name for p in tmp_path.rglob("*"))
    with pytest.raises(Cancelled):
        views(9, seed=3).write(tmp_path, progress=stop)
    with pytest.raises(Cancelled):
        ViewSet.read(tmp_path, progress=stop)
    assert sorted(p.name for p in tmp_path.rglob("*")) == before
    assert same(ViewSet.read(tmp_path), views())  # what was there is untouched


def test_a_smaller_set_leaves_no_images_of_the_larger_one(tmp_path: Path) -> None:
    views(6).write(tmp_path)
    save(tmp_path / "train" / "notes.png", rgba()[0])
    views(4).write(tmp_path)
    names = sorted(p.name for p in (tmp_path / "train").iterdir())
    assert names == ["notes.png", *(f"r_{i:04d}.png" for i in range(4))]


def test_other_peoples_sets_are_read_as_they_are(tmp_path: Path) -> None:
    images = rgba()
    foreign(tmp_path, images)
    read = ViewSet.read(tmp_path)
    np.testing.assert_array_equal(read.images, images)
    assert read.names == ("r_0", "r_1", "r_2") and read.meta == ViewMeta()


def test_suffix_in_file_path_and_equal_names_in_two_folders(tmp_path: Path) -> None:
    foreign(tmp_path, rgba())
    data = json.loads((tmp_path / "transforms_train.json").read_text())
    save(tmp_path / "b" / "r_0.png", rgba()[2])
    data["frames"][2]["file_path"] = "b/r_0.png"
    (tmp_path / "transforms_train.json").write_text(json.dumps(data))
    read = ViewSet.read(tmp_path)
    assert read.names == ("train_r_0", "train_r_1", "b_r_0")
    np.testing.assert_array_equal(read.images[2], rgba()[2])


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_without_alpha_a_uniform_background_is_empty_and_said(tmp_path: Path, suffix: str) -> None:
    image = np.full((40, 40, 3), (250, 250, 250), np.uint8)
    image[10:30, 12:28] = (20, 90, 200)
    foreign(tmp_path, [image] * 3, suffix)
    read = ViewSet.read(tmp_path)
    expected = np.zeros((40, 40), np.uint8)
    expected[10:30, 12:28] = 255
    np.testing.assert_array_equal(read.images[0, ..., 3], expected)
    assert read.meta.assumed is not None
    assert "no alpha" in read.meta.assumed and "(250, 250, 250)" in read.meta.assumed


def test_without_alpha_and_background_is_refused(tmp_path: Path) -> None:
    foreign(tmp_path, [image[..., :3] for image in rgba(size=20)])
    with pytest.raises(BadInput, match="no alpha"):
        ViewSet.read(tmp_path)


def test_some_images_without_alpha_are_refused(tmp_path: Path) -> None:
    images = rgba()
    foreign(tmp_path, [images[0], images[1][..., :3], images[2]])
    with pytest.raises(BadInput, match="has alpha and"):
        ViewSet.read(tmp_path)


def test_grey_with_alpha_becomes_rgba(tmp_path: Path) -> None:
    images = [image[..., :2].copy() for image in rgba()]
    foreign(tmp_path, images)
    read = ViewSet.read(tmp_path)
    np.testing.assert_array_equal(read.images[0, ..., 0], images[0][..., 0])
    np.testing.assert_array_equal(read.images[0, ..., 3], images[0][..., 1])


def spoil_json(key: str, value: object) -> object:
    def spoil(folder: Path) -> None:
        data = json.loads((folder / "transforms_train.json").read_text())
        data["frames"][1][key] = value
        (folder / "transforms_train.json").write_text(json.dumps(data))

    return spoil


def truncate(folder: Path) -> None:
    path = folder / "train" / "r_1.png"
    path.write_bytes(path.read_bytes()[:-40])


BAD = {
    "missing frames": (lambda f: [(f / "train" / f"r_{k}.png").unlink() for k in (0, 1)], "2 of the 3 pictures"),
    "a picture twice": (spoil_json("file_path", "train/r_0.png"), r"train/r_0.png twice, the second time in frame 2"),
    "degrees": (spoil_json("camera_angle_x", 30.0), r"if these are degrees, write 0.523599"),
    "mirrored": (spoil_json("transform_matrix", np.diag([-1, 1, 1, 1]).tolist()), r"mirrors \(its determinant is -1"),
    "scaled": (spoil_json("transform_matrix", np.diag([2, 2, 2, 1]).tolist()), "it is scaled by 2: divide"),
    "transposed": (
        spoil_json("transform_matrix", [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [1, 2, 3, 1]]),
        "it is transposed",
    ),
    "truncated PNG": (truncate, "truncated or not an image"),
    "no image": (lambda f: (f / "train" / "r_1.png").write_text("x"), "truncated or not an image"),
    "another size": (lambda f: save(f / "train" / "r_1.png", rgba(1, 5)[0]), "the same size"),
    "16-bit grey": (lambda f: save(f / "train" / "r_1.png", np.ones((8, 8), np.uint16)), "8-bit RGBA"),
    "no json": (lambda f: (f / "transforms_train.json").unlink(), "There is no"),
    "broken json": (lambda f: (f / "transforms_train.json").write_text("{"), "not valid JSON"),
    "no frames": (lambda f: (f / "transforms_train.json").write_text("{}"), "list of frames"),
    "no rotation": (spoil_json("transform_matrix", np.diag([2, 1, 1, 1]).tolist()), "rotation"),
    "no matrix": (spoil_json("transform_matrix", "x"), "4x4"),
    "no angle": (spoil_json("camera_angle_x", None), "camera_angle_x"),
    "no path": (spoil_json("file_path", None), "without file_path"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_sets_are_refused_with_one_sentence(tmp_path: Path, case: str) -> None:
    spoil, words = BAD[case]
    foreign(tmp_path, rgba())
    spoil(tmp_path)  # type: ignore[operator]
    with pytest.raises(BadInput, match=words) as caught:
        ViewSet.read(tmp_path)
    assert "\n" not in str(caught.value)


def test_missing_pictures_are_left_out_and_counted(tmp_path: Path) -> None:
    foreign(tmp_path, rgba(7))
    (tmp_path / "train" / "r_2.png").unlink()
    read = ViewSet.read(tmp_path)
    assert read.names == ("r_0", "r_1", "r_3", "r_4", "r_5", "r_6")
    assert read.meta.assumed == "1 of the 7 listed pictures could not be found and are left out: ./train/r_2."
    assert len(files_of(tmp_path, "train")) == 7  # and the JSON file


@pytest.mark.parametrize("suffix", [".JPG", ".PNG", ".webp", ".WEBP", ""])
def test_pictures_of_any_suffix(tmp_path: Path, suffix: str) -> None:
    foreign(tmp_path, rgba())
    for file in (tmp_path / "train").iterdir():
        kind = {".JPG": "JPEG", "": "PNG"}.get(suffix, suffix[1:].upper())
        flat = np.full((8, 8, 3), 9, np.uint8)
        flat[3:5, 3:5] = 200
        Image.fromarray(flat).save(file.with_suffix(suffix), kind)
        if suffix != ".png":
            file.unlink()
    assert ViewSet.read(tmp_path).names == ("r_0", "r_1", "r_2")


def test_the_file_itself_may_be_given(tmp_path: Path) -> None:
    foreign(tmp_path, rgba())
    file = tmp_path / "transforms_train.json"
    assert np.array_equal(ViewSet.read(file).images, ViewSet.read(tmp_path).images)
    assert ViewSet.read(file.rename(tmp_path / "mine.json")).names == ("r_0", "r_1", "r_2")
    with pytest.raises(BadInput, match=r"There is no .*transforms_test\.json"):
        ViewSet.read(tmp_path / "mine.json", "test")


def test_alpha_of_255_everywhere_is_none(tmp_path: Path) -> None:
    images = [np.full((40, 40, 4), 255, np.uint8) for _ in range(3)]
    for k, image in enumerate(images):
        image[10 : 20 + k, 12:30, :3] = 40
    foreign(tmp_path, images)
    read = ViewSet.read(tmp_path)
    assert np.array_equal(read.images[..., 3] == 255, np.stack(images)[..., 0] == 40)
    assert read.meta.assumed is not None and "no alpha but 255 everywhere" in read.meta.assumed


def translucent(brightness: float, fade: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """A picture whose alpha falls off towards its edge, straight and multiplied by alpha."""
    alpha = np.rint(fade * np.clip(300 - 8 * np.hypot(*(np.indices((80, 80)) - 40)), 0, 255))
    colour = brightness * np.array([250.0, 180.0, 60.0])
    straight = np.dstack([np.broadcast_to(np.rint(colour), (80, 80, 3)), alpha]).astype(np.uint8)
    return straight, np.dstack([np.rint(colour * alpha[..., None] / 255), alpha]).astype(np.uint8)


@pytest.mark.parametrize("brightness", [1.0, 0.5, 0.1, 0.0])
@pytest.mark.parametrize("fade", [1.0, 0.6])
def test_colours_multiplied_by_alpha_are_divided_by_it(brightness: float, fade: float, tmp_path: Path) -> None:
    """Taken as they are, they make what is translucent too dark."""
    straight, multiplied = translucent(brightness, fade)
    for folder, image in ((tmp_path / "straight", straight), (tmp_path / "multiplied", multiplied)):
        foreign(folder, [image] * 3)
        read = ViewSet.read(folder)
        assert np.array_equal(read.images[0, ..., 3], image[..., 3])
        if folder.name == "multiplied" and brightness > 0:
            assert 'write "alpha": "straight" beside "frames"' in str(read.meta.assumed)
            again = read.images[0, ..., :3] * (image[..., 3:] / 255.0)
            assert np.abs(again - image[..., :3]).max() <= 0.51
            opaque = image[..., 3] > 100
            assert np.abs(read.images[0].astype(int) - straight)[opaque].max() <= 2
        else:
            assert np.array_equal(read.images[0], image) and read.meta.assumed is None


def test_dark_views_stay_straight_with_a_word_and_files_say_otherwise(tmp_path: Path) -> None:
    """Colours of 12 at an alpha of 12 and more: never above it, but they do not grow with it, either."""
    image, _ = translucent(0.048)
    image[image[..., 3] < 12] = 0
    _, multiplied = translucent(1.0)
    foreign(tmp_path / "dark", [image] * 3)
    read = ViewSet.read(tmp_path / "dark")
    assert np.array_equal(read.images[0], image)
    said = 'dark and straight; if they are multiplied by alpha, write "alpha": "premultiplied"'
    assert said in str(read.meta.assumed)
    foreign(tmp_path / "told", [image] * 3, alpha="premultiplied")
    told = ViewSet.read(tmp_path / "told")
    assert told.meta.assumed is None and told.images[0, 40, 40, 0] == 12 and told.images[0, 10, 40, 0] > 24
    foreign(tmp_path / "kept", [multiplied] * 3, alpha="straight")
    kept = ViewSet.read(tmp_path / "kept")
    assert kept.meta.assumed is None and np.array_equal(kept.images[0], multiplied)
    foreign(tmp_path / "odd", [image] * 3, alpha="associated")
    with pytest.raises(BadInput, match='alpha must be "straight" or "premultiplied"'):
        ViewSet.read(tmp_path / "odd")


def test_alpha_of_0_or_255_is_the_same_either_way(tmp_path: Path) -> None:
    image = np.zeros((40, 40, 4), np.uint8)
    image[10:30, 10:30] = 90, 40, 20, 255
    for name, keys in (("auto", {}), ("premultiplied", {"alpha": "premultiplied"})):
        foreign(tmp_path / name, [image] * 3, **keys)
        read = ViewSet.read(tmp_path / name)
        assert np.array_equal(read.images[0], image) and read.meta.assumed is None


def test_linear_views_are_told_and_divided_where_they_were_multiplied(tmp_path: Path) -> None:
    """Of a linear picture, light was multiplied by alpha, not levels of sRGB."""
    straight, multiplied = translucent(0.5)
    foreign(tmp_path, [multiplied] * 3)
    for file in (tmp_path / "train").iterdir():
        png(file, multiplied)
    read = ViewSet.read(tmp_path)
    assert "3 of the 3 images are linear" in str(read.meta.assumed) and "premultiplied" in str(read.meta.assumed)
    right = 255.0 * as_srgb(straight[..., :3] / 255.0, 1.0)
    assert np.abs(read.images[0, ..., :3] - right)[straight[..., 3] > 128].max() < 4.0


def test_a_logo_in_a_corner_leaves_the_background_uniform(tmp_path: Path) -> None:
    images = [np.zeros((40, 40, 3), np.uint8) for _ in range(3)]
    for image in images:
        image[15:25, 15:25], image[:6, :9] = 90, 200
    foreign(tmp_path, images)
    assert ViewSet.read(tmp_path).images[:, 30, 30, 3].max() == 0


def test_two_views_are_too_few_to_train_on(tmp_path: Path) -> None:
    foreign(tmp_path, rgba(2))
    with pytest.raises(BadInput, match="at least 3"):
        ViewSet.read(tmp_path)


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(BadInput, match="file"):
        views().write(tmp_path / "file")


def test_a_set_whose_parts_do_not_fit_is_refused() -> None:
    good = views()
    for cameras, images, names in (
        (good.cameras[:-1], good.images, good.names),
        (good.cameras, good.images, ("a",) * 4),
        (good.cameras, good.images[:, :-1], good.names),
        (good.cameras, good.images.astype(np.float32), good.names),
        ((), good.images[:0], ()),
    ):
        with pytest.raises(BadInput):
            ViewSet(cameras, images, names)


def test_take_picks_views() -> None:
    picked = views().take([2, 0])
    assert picked.names == ("r_0002", "r_0000") and len(picked) == 2
    np.testing.assert_array_equal(picked.images[0], views().images[2])
