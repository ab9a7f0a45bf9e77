"""Pictures and movies on disk: they are read back as written."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.errors import BadInput, Cancelled
from svv.io.pictures.output import (
    EMPTY_REGION,
    depth_picture,
    region_picture,
    to_bytes,
    write_depth_png,
    write_mp4,
    write_png,
    write_region_png,
    write_vti,
)
from tests.browser import program
from tests.movies import firefox, frames_of, shown_by, tags_of

H, W = 5, 7


@pytest.fixture
def view() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    depth = rng.uniform(3.0, 9.0, (H, W)).astype(np.float32)
    region = rng.integers(0, 3, (H, W)).astype(np.int16)
    depth[1], region[1] = np.nan, -1
    return rng.random((H, W, 4)).astype(np.float32), depth, region


def test_levels_are_rounded_and_clamped() -> None:
    assert to_bytes([-0.1, 0.0, 0.499 / 255, 0.501 / 255, 1.0, 2.0, np.nan]).tolist() == [
        0,
        0,
        0,
        1,
        255,
        255,
        0,
    ]


def test_png_comes_back(tmp_path: Path, view: tuple[np.ndarray, ...]) -> None:
    write_png(tmp_path / "a.png", view[0])
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), to_bytes(view[0]))
    write_png(tmp_path / "a.png", to_bytes(view[0]))
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png")), to_bytes(view[0]))
    write_png(tmp_path / "b.png", view[0][..., :3])
    with Image.open(tmp_path / "b.png") as written:
        assert written.mode == "RGB"


def test_depth_png_gives_the_depth_back_to_a_65534th_of_its_range(tmp_path: Path, view: tuple[np.ndarray, ...]) -> None:
    depth = view[1]
    near, far = write_depth_png(tmp_path / "d.png", depth)
    picture = Image.open(tmp_path / "d.png")
    levels = np.asarray(picture).astype(np.float64)
    assert (near, far) == (float(picture.info["svv:near"]), float(picture.info["svv:far"]))
    np.testing.assert_array_equal(levels == 0, np.isnan(depth))
    back = np.where(levels == 0, np.nan, near + (levels - 1) / 65534 * (far - near))
    np.testing.assert_allclose(back, depth, atol=0.5001 * (far - near) / 65534)


@pytest.mark.parametrize("value", [np.nan, 4.0])
def test_depth_png_of_an_empty_and_of_a_flat_view(tmp_path: Path, value: float) -> None:
    write_depth_png(tmp_path / "d.png", np.full((H, W), value))
    levels = np.asarray(Image.open(tmp_path / "d.png"))
    assert (levels == (0 if np.isnan(value) else 1)).all()


def test_region_png_keeps_the_indices_and_shows_the_colours(tmp_path: Path, view: tuple[np.ndarray, ...]) -> None:
    region, colours = view[2], np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    write_region_png(tmp_path / "r.png", region, colours)
    picture = Image.open(tmp_path / "r.png")
    np.testing.assert_array_equal(np.asarray(picture), np.where(region < 0, EMPTY_REGION, region))
    shown = np.asarray(picture.convert("RGBA"))
    np.testing.assert_array_equal(shown[..., 3] == 0, region < 0)
    np.testing.assert_array_equal(shown[region >= 0][:, :3], to_bytes(colours)[region[region >= 0]])
    np.testing.assert_array_equal(to_bytes(region_picture(region, colours))[region >= 0], shown[region >= 0])
    assert (region_picture(region, colours)[region < 0] == 0).all()


def test_depth_picture_is_darkest_in_front(view: tuple[np.ndarray, ...]) -> None:
    picture = depth_picture(view[1], 3.0, 9.0)
    np.testing.assert_array_equal(picture[..., 3] == 0, np.isnan(view[1]))
    np.testing.assert_allclose(depth_picture([[3.0, 6.0, 9.0]], 3.0, 9.0)[0, :, 0], [0.1, 0.475, 0.85], atol=1e-6)


def test_vtk_reads_a_vti_as_it_was(tmp_path: Path, view: tuple[np.ndarray, ...]) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader

    rgba, depth, region = view
    write_vti(tmp_path / "v.vti", rgba, depth, region)
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(tmp_path / "v.vti"))
    reader.Update()
    image = reader.GetOutput()
    data = image.GetPointData()
    assert image.GetDimensions() == (W, H, 1)
    assert data.GetScalars().GetName() == "RGBA"

    def array(name: str) -> np.ndarray:
        values = vtk_to_numpy(data.GetArray(name))
        return np.flipud(values.reshape(H, W, *values.shape[1:]))  # VTK's row 0 is the bottom one

    for name, expected in (("RGBA", to_bytes(rgba)), ("Depth", depth), ("Region", region)):
        assert array(name).dtype == expected.dtype
        np.testing.assert_array_equal(array(name), expected)


def test_a_movie_has_the_frames_that_went_in(tmp_path: Path) -> None:
    greys = [40, 120, 200]
    write_mp4(tmp_path / "m.mp4", (np.full((33, 47, 3), grey, np.uint8) for grey in greys), fps=10)
    frames = frames_of(tmp_path / "m.mp4")
    assert frames.shape == (len(greys), 34, 48, 3)  # odd sizes grow by one
    for frame, grey in zip(frames, greys, strict=True):
        np.testing.assert_allclose(frame.mean(), grey, atol=3)
    assert [p.name for p in tmp_path.iterdir()] == ["m.mp4"]


SATURATED = np.array(
    [[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]], [[0, 255, 255], [255, 0, 255], [250, 35, 99], [128] * 3]],
    np.uint8,
)
"""Colours that are off by up to 39 levels where a movie is read by another matrix than it was written by. (2, 4, 3)"""

SIZES = ((61, 41), (200, 200), (800, 800), (1920, 1080))
"""Widths and heights of movies: odd ones, and on both sides of the 720 rows from which Chromium guesses otherwise."""


@pytest.fixture(scope="module")
def patches(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Movies of the saturated colours, two rows of four."""
    folder = tmp_path_factory.mktemp("movies")
    for width, height in SIZES:
        frame = SATURATED[np.arange(height) * 2 // height][:, np.arange(width) * 4 // width]
        write_mp4(folder / f"{width}.mp4", [frame] * 6, fps=10)
    return [folder / f"{width}.mp4" for width, _ in SIZES]


def assert_colours_of_frames(shown: list[np.ndarray]) -> None:
    """Within 3 levels in the middle of each patch; what an odd size grows by repeats the last row and column."""
    for (width, height), frame in zip(SIZES, shown, strict=True):
        assert frame.shape == (height + height % 2, width + width % 2, 3)
        rows, columns = np.array([1, 3]) * height // 4, np.array([1, 3, 5, 7]) * width // 8
        off = np.abs(frame[np.ix_(rows, columns)].astype(int) - SATURATED)
        assert off.max() <= 3, (width, height, off.max((0, 1)))
        for beyond, last in ((frame[height:, columns], SATURATED[1]), (frame[rows, width:], SATURATED[:, 3:])):
            assert np.abs(beyond.astype(int) - last).max(initial=0) <= 3


def test_a_movie_is_tagged_with_the_colours_that_it_has(patches: list[Path]) -> None:
    for movie in patches:  # sRGB's primaries and transfer function; BT.601's matrix and limited range, as converted
        assert tags_of(movie) == {"primaries": 1, "transfer": 13, "matrix": 6, "full range": 0}
    assert_colours_of_frames([frames_of(movie)[3] for movie in patches])


@pytest.mark.skipif(program() is None, reason="no browser here; Debian: sudo apt-get install chromium")
def test_chromium_shows_a_movie_in_the_colours_of_its_frames(patches: list[Path]) -> None:
    assert_colours_of_frames(shown_by(str(program()), patches))


@pytest.mark.slow  # Chromium's test holds the same law, and Firefox is installed by hand
@pytest.mark.skipif(firefox() is None, reason="no Firefox here; Debian: sudo apt-get install firefox-esr")
def test_firefox_shows_a_movie_in_the_colours_of_its_frames(patches: list[Path]) -> None:
    assert_colours_of_frames(shown_by(str(firefox()), patches))


def test_a_movie_without_frames_or_place_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="at least one frame"):
        write_mp4(tmp_path / "m.mp4", [])
    with pytest.raises(BadInput, match="folder does not exist"):
        write_mp4(tmp_path / "no" / "m.mp4", [np.zeros((16, 16, 3), np.uint8)])


def test_a_cancelled_movie_leaves_nothing(tmp_path: Path) -> None:
    def frames() -> Iterator[np.ndarray]:
        yield np.zeros((16, 16, 3), np.uint8)
        raise Cancelled

    with pytest.raises(Cancelled):
        write_mp4(tmp_path / "m.mp4", frames())
    assert list(tmp_path.iterdir()) == []


def test_a_movie_without_its_encoder_is_refused_and_everything_else_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)  # an import of it fails from here on
    frames = [np.zeros((4, 4, 3), np.uint8)]
    with pytest.raises(BadInput, match="pip install imageio-ffmpeg"):
        write_mp4(tmp_path / "a.mp4", frames)
    assert list(tmp_path.iterdir()) == []
    write_png(tmp_path / "a.png", frames[0])
    assert (tmp_path / "a.png").exists()


def test_a_vti_is_written_without_vtk(tmp_path: Path) -> None:
    script = (
        "import sys; sys.modules['vtkmodules'] = None; sys.modules['vtk'] = None\n"
        "import numpy as np; from svv.io.pictures.output import write_vti\n"
        f"write_vti({str(tmp_path / 'a.vti')!r}, np.ones((2, 3, 4)), np.ones((2, 3)), np.zeros((2, 3)))\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
    assert b'WholeExtent="0 2 0 1 0 0"' in (tmp_path / "a.vti").read_bytes()
