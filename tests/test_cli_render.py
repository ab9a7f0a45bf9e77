"""`svv render`: which file contains which view. The scene is a ball whose exact picture is known."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from PIL import Image

from svv.cli import app as cli
from svv.core.geometry.cameras import Camera, CameraRig, look_at, orbit_cameras
from svv.errors import BadInput, Progress, silent
from svv.io.pictures.output import EMPTY_REGION, to_bytes
from tests.movies import frames_of


@dataclass(frozen=True)
class Rendering:
    rgba: np.ndarray
    depth: np.ndarray
    region: np.ndarray


@dataclass(frozen=True)
class Region:
    colour: tuple[float, float, float]
    edited_colour: tuple[float, float, float] | None = None
    opacity: float = 1.0
    hidden: bool = False


class Ball:
    """A ball of radius 1 at (5, 0, 0): red above y = 0 (region 0), green below (region 1)."""

    centre = np.array([5.0, 0.0, 0.0])
    regions = (Region((1.0, 0.0, 0.0)), Region((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)))
    rig: ClassVar = CameraRig((5.0, 0.0, 0.0), 4.0, np.pi / 4)
    rendered: ClassVar[list[Camera]] = []
    networks, stroked, layers, still = ("base", "pcn"), (), (), True
    regions_with_strokes = ()

    def to_bytes(self, whole: bool = True) -> bytes:
        return b"a ball"

    def render(
        self, camera: Camera, network: str | None = None, background: None = None, progress: Progress = silent
    ) -> Rendering:
        if network == "styled":
            raise BadInput("This scene has no styled network.")
        self.rendered.append(camera)
        origins, directions = camera.rays()
        offset = origins - self.centre
        along = (offset * directions).sum(-1)
        inside = along**2 - (offset**2).sum(-1) + 1.0
        depth = np.where(inside > 0, -along - np.sqrt(np.maximum(inside, 0)), np.nan)
        upper = (origins + depth[..., None] * directions)[..., 1] > 0
        region = np.where(inside > 0, np.where(upper, 0, 1), -1)
        rgba = np.where(upper[..., None], (1.0, 0, 0, 0.5), (0, 1.0, 0, 0.5)) * (region >= 0)[..., None]
        progress(1.0, "")
        return Rendering(rgba, depth.astype(np.float32), region.astype(np.int16))

    def value_image(self, camera: Camera, network: str | None = None) -> None:
        """It keeps no values."""


@pytest.fixture
def svv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Run `svv render` on the ball in an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("svv.cli.render.load", lambda path, device=None: Ball())

    def run(*arguments: str) -> None:
        cli.app(["render", "ball.svv", *arguments], prog_name="svv", standalone_mode=False)

    return run


def picture(path: str) -> np.ndarray:
    return np.asarray(Image.open(path))


def test_a_single_view_is_the_front_and_transparent(svv: Callable[..., None]) -> None:
    svv("--size", "60", "--out", "a.png")
    image = picture("a.png")
    assert image.shape == (60, 60, 4)
    np.testing.assert_array_equal(image[20, 30], [255, 0, 0, 128])
    np.testing.assert_array_equal(image[40, 30], [0, 255, 0, 128])
    assert image[0, 0, 3] == 0


def test_a_background_makes_it_opaque(svv: Callable[..., None]) -> None:
    svv("--size", "60", "--background", "white", "--out", "a.png")
    image = picture("a.png")
    assert image.shape == (60, 60, 3)
    np.testing.assert_array_equal(image[0, 0], [255, 255, 255])
    np.testing.assert_allclose(image[20, 30], [255, 128, 128], atol=1)


def test_an_orbit_is_the_path_around_the_scene(svv: Callable[..., None]) -> None:
    svv("--orbit", "5", "--size", "40x30", "--out", "frames")
    cameras = orbit_cameras(5, Ball.centre, 4.0, np.pi / 4, 40)
    files = sorted(Path("frames").iterdir())
    assert [file.name for file in files] == [f"{i:04d}.png" for i in range(5)]
    for file, camera in zip(files, cameras, strict=True):
        np.testing.assert_array_equal(picture(str(file)), to_bytes(Ball().render(camera.resized(40, 30)).rgba))


@pytest.mark.parametrize("what", ["rgba", "depth", "region"])
def test_frames_that_are_there_are_not_rendered_again(what: str, svv: Callable[..., None]) -> None:
    arguments = ("--orbit", "5", "--size", "40x30", "--what", what, "--out", "frames")
    svv(*arguments)
    whole = {file.name: file.read_bytes() for file in Path("frames").iterdir()}
    Path("frames/0001.png").unlink()
    Path("frames/0002.png").write_bytes(b"not a picture")
    Image.new("RGBA", (40, 30)).save("frames/0003.png")  # a picture of something else
    Ball.rendered.clear()
    svv(*arguments)
    assert len(Ball.rendered) == 3
    assert {file.name: file.read_bytes() for file in Path("frames").iterdir()} == whole
    svv(*arguments, "--background", "white")
    assert len(Ball.rendered) == 8


def test_depth_and_regions_as_pictures(svv: Callable[..., None]) -> None:
    svv("--size", "60", "--what", "depth", "--out", "d.png")
    svv("--size", "60", "--what", "region", "--out", "r.png")
    with Image.open("d.png") as written:
        near = float(written.info["svv:near"])
    depth, region = picture("d.png"), Image.open("r.png")
    assert depth.dtype == np.uint16
    assert near == pytest.approx(3.0, abs=0.01)
    indices = np.asarray(region)
    np.testing.assert_array_equal(depth == 0, indices == EMPTY_REGION)
    assert indices[20, 30] == 0
    assert indices[40, 30] == 1
    assert region.convert("RGB").getpixel((30, 40)) == (0, 255, 0)  # the edited colour


def test_a_camera_file_places_the_view(svv: Callable[..., None]) -> None:
    camera = {"camera_to_world": look_at((5.0, 9.0, 0.0), (5.0, 0.0, 0.0)).tolist(), "fov": 40}
    Path("c.json").write_text(json.dumps(camera))
    svv("--camera", "c.json", "--size", "50x40", "--out", "a.png")
    image = picture("a.png")  # from above only the red half shows
    assert image.shape == (40, 50, 4)
    assert (image[image[..., 3] > 0] == [255, 0, 0, 128]).all()


def test_a_file_of_several_cameras_gives_as_many_pictures(svv: Callable[..., None]) -> None:
    poses = [look_at((5.0 + x, 0.0, 9.0), (5.0, 0.0, 0.0)).tolist() for x in (0.0, 3.0, 6.0)]
    told = {"fov": 40, "frames": [{"camera_to_world": pose} for pose in poses]}
    Path("keys.json").write_text(json.dumps(told))
    keys = ("--camera", "keys.json", "--size", "32")
    svv(*keys, "--out", "each")
    svv(*keys, "--path", "5", "--out", "path")
    each, path = (sorted(Path(name).iterdir()) for name in ("each", "path"))
    assert (len(each), len(path)) == (3, 5)
    for number, frame in enumerate(each):
        svv(*keys, "--frame", str(number), "--out", "one.png", "--supersample", "1")
        np.testing.assert_array_equal(picture("one.png"), picture(str(frame)))
        np.testing.assert_array_equal(picture(str(path[2 * number])), picture(str(frame)))
    svv(*keys, "--path", "7", "--out", "path.mp4")
    assert len(frames_of("path.mp4")) == 7
    svv(*keys, "--out", "each.mp4")
    assert len(frames_of("each.mp4")) == 3
    refused = {
        ("--out", "one.png"): "3 views: choose one with --frame",
        ("--frame", "3", "--out", "one.png"): "no view 3: its views are 0 to 2",
        ("--path", "9", "--out", "one.png"): "A path has many views",
        ("--path", "9", "--frame", "1", "--out", "f"): "--frame or --path, not both",
    }
    for options, told_so in refused.items():
        with pytest.raises(BadInput, match=told_so):
            svv(*keys, *options)
    with pytest.raises(BadInput, match="--path needs views to go through"):
        svv("--path", "9", "--out", "f")


def test_views_by_angles_are_pictures_and_the_keys_of_a_path(svv: Callable[..., None]) -> None:
    svv("--view", "0,0", "--size", "60", "--out", "front.png")
    svv("--size", "60", "--out", "middle.png")
    np.testing.assert_array_equal(picture("front.png"), picture("middle.png"))
    keys = ("--view", "0,0", "--view", "90,30", "--view", "180,0", "--size", "60", "--supersample", "1")
    Ball.rendered.clear()
    svv(*keys, "--out", "each")
    svv(*keys, "--path", "5", "--out", "path")
    front, right = Ball.rendered[:2]
    to_right, up = front.camera_to_world[:3, 0], front.camera_to_world[:3, 1]
    beside = np.linalg.norm(front.position - Ball.centre) * (3**0.5 / 2 * to_right + 0.5 * up)
    np.testing.assert_allclose(right.position - Ball.centre, beside, atol=1e-9)
    for number in range(3):
        np.testing.assert_array_equal(picture(f"each/{number:04d}.png"), picture(f"path/{2 * number:04d}.png"))
    wrong = {
        ("--view", "0,0", "--orbit", "4", "--out", "f"): "--orbit or --view, not both",
        ("--view", "0,0", "--camera", "c.json", "--out", "f"): "--view or --camera, not both",
        ("--view", "0,0", "--path", "4", "--out", "f"): "several --view AZ,EL",
        ("--view", "0,0", "--view", "9,9", "--out", "one.png"): "holds one view",
        ("--view", "0,91", "--out", "one.png"): "from -90 to 90",
    }
    for options, said in wrong.items():
        with pytest.raises(BadInput, match=said):
            svv(*options)


def test_a_vti_holds_all_three(svv: Callable[..., None]) -> None:
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader

    svv("--size", "20x10", "--out", "a.vti")
    reader = vtkXMLImageDataReader()
    reader.SetFileName("a.vti")
    reader.Update()
    image = reader.GetOutput()
    assert image.GetDimensions() == (20, 10, 1)
    assert [image.GetPointData().GetArrayName(i) for i in range(3)] == ["RGBA", "Depth", "Region"]
    assert image.GetPointData().GetArray("Region").GetTuple1(10 + 20 * 7) == 0  # above the middle: counted upwards


@pytest.mark.parametrize("what", ["rgba", "depth", "region"])
def test_a_movie_has_every_frame(svv: Callable[..., None], what: str) -> None:
    svv("--orbit", "4", "--size", "64", "--what", what, "--out", "m.mp4")
    frames = frames_of("m.mp4")
    assert frames.shape == (4, 64, 64, 3)
    for frame in frames:
        assert frame[:4].mean() > 250  # white around the ball
        assert frame[32, 32].min() < 200


def test_what_cannot_be_rendered_is_one_sentence(svv: Callable[..., None]) -> None:
    with pytest.raises(BadInput, match="no styled network"):
        svv("--network", "styled", "--out", "a.png")
    with pytest.raises(BadInput, match="folder does not exist"):
        svv("--out", "none/a.png")
    with pytest.raises(BadInput, match="no camera file"):
        svv("--camera", "none.json", "--out", "a.png")
    Path("c.json").write_text(json.dumps({"camera_to_world": np.eye(4).tolist(), "fov": 30}))
    with pytest.raises(BadInput, match=r"\.png or \.vti"):
        svv("--camera", "c.json", "--out", "a.jpg")
    assert [path.name for path in Path().iterdir()] == ["c.json"]
