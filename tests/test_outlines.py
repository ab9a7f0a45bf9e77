"""Outlines: laws of the lines drawn for shapes whose depth is known, and the edit that turns them on."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, label, map_coordinates

from svv.core.geometry.cameras import Camera, look_at
from svv.core.images.outlines import CREASE_WIDTH, Pen, outlined
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.io import scene_file
from svv.options.editing import OUTLINE_COLOUR, OUTLINE_WIDTH
from tests.cube import cube_camera, cube_paint, cube_scene

Images = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int16]]

BLACK = Pen(1.0, OUTLINE_WIDTH, (0.0, 0.0, 0.0))
FOV = 0.5
AWAY = 4.0


def camera(size: int) -> Camera:
    return Camera(look_at((0.0, 0.0, AWAY), (0.0, 0.0, 0.0)), FOV, size, size)


def images(distances: Sequence[NDArray[np.float64]], alphas: Sequence[float] | None = None) -> Images:
    """White shapes, each a region, of which each ray sees the first; distances are inf where a ray misses."""
    stack = np.stack(distances)
    first, depth = stack.argmin(axis=0), stack.min(axis=0)
    hit = np.isfinite(depth)
    rgba = np.ones((*depth.shape, 4), np.float32)
    rgba[..., 3] = np.where(hit, np.asarray(alphas or [1.0] * len(distances))[first], 0.0)
    return rgba, np.where(hit, depth, np.nan).astype(np.float32), np.where(hit, first, -1).astype(np.int16)


def sphere(size: int, centre: Sequence[float] = (0.0, 0.0, 0.0), radius: float = 0.5) -> NDArray[np.float64]:
    origins, directions = camera(size).rays()
    toward = np.asarray(centre) - origins
    along = (toward * directions).sum(-1)
    inside = radius**2 - ((toward - along[..., None] * directions) ** 2).sum(-1)
    return np.where(inside > 0.0, along - np.sqrt(np.maximum(inside, 0.0)), np.inf)


def plane(size: int, normal: Sequence[float], offset: float = 0.0) -> NDArray[np.float64]:
    origins, directions = camera(size).rays()
    return (offset - origins @ np.asarray(normal)) / (directions @ np.asarray(normal))


def ink(shapes: Images, pen: Pen = BLACK, count: int | None = None) -> NDArray[np.float64]:
    """How much ink there is in each pixel, of black over white."""
    size = len(shapes[1])
    pens = [pen] * (count or int(shapes[2].max()) + 1)
    rgba, depth, region = outlined(*shapes, pens, camera(size).pixel_at, 1.0)
    np.testing.assert_array_equal(region >= 0, rgba[..., 3] > 0.0)
    np.testing.assert_array_equal(np.isfinite(depth), region >= 0)
    return np.asarray(1.0 - (rgba[..., :3].mean(axis=2) * rgba[..., 3] + 1.0 - rgba[..., 3]), np.float64)


def rim(size: int, radius: float = 0.5) -> float:
    """Radius of a sphere's silhouette in pixels."""
    return camera(size).focal * radius / np.sqrt(AWAY**2 - radius**2)


def across(image: NDArray[np.float64], size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Width (integral of the ink) and radius (its mean) of a ring, for 180 directions from the middle."""
    angle = np.radians(np.arange(0.0, 360.0, 2.0))[:, None]
    r = np.arange(0.7 * rim(size), 1.3 * rim(size), 0.25)
    middle = 0.5 * (size - 1)
    profile = map_coordinates(image, [middle + r * np.sin(angle), middle + r * np.cos(angle)], order=1)
    width = profile.sum(axis=1) * 0.25
    return width, (profile * r).sum(axis=1) / profile.sum(axis=1)


@pytest.mark.parametrize("size", [400, 800])
@pytest.mark.parametrize("width", [2.0, 5.0])
def test_a_sphere_has_one_closed_ring_at_its_rim(size: int, width: float) -> None:
    image = ink(images([sphere(size)]), Pen(1.0, width, (0.0, 0.0, 0.0)))
    asked = width * size / 800
    found, radius = across(image, size)
    assert np.abs(found - asked).max() < max(0.5, 0.3 * asked) and abs(found.mean() - asked) < 0.15 * asked
    assert np.abs(radius - rim(size)).max() < 1.0
    assert label(image > 0.2 * min(asked, 1.0), np.ones((3, 3)))[1] == 1
    y, x = np.mgrid[:size, :size] - 0.5 * (size - 1)
    assert image[np.abs(np.hypot(x, y) - rim(size)) > 0.5 * asked + 3.0].max() == 0.0


def test_half_the_resolution_gives_half_the_pixels_of_width() -> None:
    pen = Pen(1.0, 6.0, (0.0, 0.0, 0.0))
    large, small = (across(ink(images([sphere(size)]), pen), size)[0].mean() for size in (800, 400))
    assert small == pytest.approx(0.5 * large, rel=0.08)


def test_spheres_that_overlap_have_a_line_between() -> None:
    size = 800
    front, back = sphere(size, (0.3, 0.0, 0.6), 0.35), sphere(size, (-0.15, 0.0, 0.0), 0.45)
    one = np.minimum(front, back)  # as one region: only depth tells them apart
    image = ink(images([one]))
    both = np.isfinite(back) & ~np.isfinite(front)
    edge = np.isfinite(front) & np.isfinite(back) & (np.roll(both, 1, axis=1) | np.roll(both, -1, axis=1))
    covered = np.array([image[r - 2 : r + 3, c - 2 : c + 3].max() for r, c in zip(*np.nonzero(edge), strict=True)])
    assert edge.sum() > 80 and (covered > 0.8).mean() > 0.97


def test_regions_at_one_depth_have_a_line_between() -> None:
    depth = plane(400, (0.0, 0.0, 1.0))
    left, right = depth.copy(), depth.copy()
    left[:, 200:], right[:, :200] = np.inf, np.inf
    image = ink(images([left, right]))
    np.testing.assert_allclose(image.sum(axis=1)[5:-5], 0.5 * OUTLINE_WIDTH, atol=0.3)
    assert image[:, :195].max() == image[:, 205:].max() == 0.0


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.8, 0.0, 0.6), (0.6, 0.7, 0.39), (0.0, 0.95, 0.31)])
def test_a_plane_has_no_line_whatever_its_slant(normal: tuple[float, float, float]) -> None:
    assert ink(images([plane(400, normal)])).max() == 0.0


def test_the_edges_of_a_cube_are_thinner_than_its_silhouette() -> None:
    """Seen along its diagonal: three edges meet in the middle, and six are the silhouette."""
    size, half = 800, 0.45
    turn = np.radians([90.0, 210.0, 330.0])
    axes = np.stack([np.sqrt(2 / 3) * np.cos(turn), np.sqrt(2 / 3) * np.sin(turn), np.full(3, np.sqrt(1 / 3))], axis=1)
    origins, directions = camera(size).rays()
    near, far = np.full((size, size), -np.inf), np.full((size, size), np.inf)
    for axis in axes:
        speed, start = directions @ axis, origins @ axis
        a, b = (-half - start) / speed, (half - start) / speed
        near, far = np.maximum(near, np.minimum(a, b)), np.minimum(far, np.maximum(a, b))
    image = ink(images([np.where(near < far, near, np.inf)]))
    middle = size // 2
    reach = camera(size).focal * half / AWAY
    crease = image[middle + int(0.5 * reach), middle - 20 : middle + 20].sum()
    opposite = image[middle - int(0.5 * reach), middle - 20 : middle + 20].sum()
    outside = image[middle, : middle - 40].sum()
    assert {crease > 0.0, opposite > 0.0} == {True, False}, "three edges of six are seen"
    assert max(crease, opposite) == pytest.approx(CREASE_WIDTH * OUTLINE_WIDTH, rel=0.25) and outside == pytest.approx(
        OUTLINE_WIDTH, rel=0.25
    )


def test_noise_of_depth_makes_no_dots() -> None:
    size, step = 800, 1 / 170
    rng = np.random.default_rng(1)
    shapes = images([sphere(size)])
    for smooth in (0.7, 2.0):
        noise = gaussian_filter(rng.normal(size=(size, size)), smooth)
        noisy = (shapes[0], (shapes[1] + noise * (step / 3 / noise.std())).astype(np.float32), shapes[2])
        y, x = np.mgrid[:size, :size] - 0.5 * (size - 1)
        inside = np.hypot(x, y) < rim(size) - 6.0
        assert ink(noisy)[inside].mean() < 1e-4


def test_fog_has_no_lines_and_translucent_things_faint_ones() -> None:
    size = 400
    y, x = (np.mgrid[:size, :size] - 0.5 * (size - 1)) / size
    depth = (AWAY + 0.3 * np.sin(25.0 * x) * np.cos(31.0 * y)).astype(np.float32)
    rgba = np.ones((size, size, 4), np.float32)
    rgba[..., 3] = 0.7 * np.exp(-12.0 * (x**2 + y**2))
    fog = outlined(rgba, depth, np.zeros((size, size), np.int16), [BLACK], camera(size).pixel_at, 1.0)
    np.testing.assert_array_equal(fog[0], rgba)
    faint, full = (ink(images([sphere(size)], [alpha])).max() for alpha in (0.4, 1.0))
    assert 0.1 < faint < 0.5 * full


def test_lines_follow_what_they_outline() -> None:
    """Moved by a pixel, a sphere has the same lines there; moved by parts of one, nearly the same."""
    size = 400
    shapes = images([sphere(size)])
    moved = tuple(np.roll(image, 1, axis=1) for image in shapes)
    np.testing.assert_allclose(ink(moved), np.roll(ink(shapes), 1, axis=1), atol=1e-5)  # type: ignore[arg-type]
    pixel = AWAY / camera(size).focal
    frames = [ink(images([sphere(size, (part * pixel, 0.0, 0.0))])) for part in (0.0, 0.25, 0.5)]
    drawn = frames[0].sum()
    assert all(np.abs(b - a).sum() < 0.45 * drawn for a, b in pairwise(frames))
    np.testing.assert_allclose([frame.sum() for frame in frames], drawn, rtol=0.02)


def test_a_region_without_a_pen_has_lines_only_where_another_has_one() -> None:
    size = 400
    shapes = images([sphere(size, (-0.4, 0.0, 0.0), 0.3), sphere(size, (0.4, 0.0, 0.0), 0.3)])
    red, none = Pen(0.5, 4.0, (1.0, 0.0, 0.0)), Pen(0.0, 4.0, (0.0, 1.0, 0.0))
    rgba = outlined(*shapes, [red, none], camera(size).pixel_at, 1.0)[0]
    np.testing.assert_array_equal(rgba[:, size // 2 :], shapes[0][:, size // 2 :])
    beyond = (shapes[2] < 0) & (rgba[..., 3] > 0.0)
    np.testing.assert_allclose(rgba[beyond][:, :3], [[1.0, 0.0, 0.0]] * int(beyond.sum()), atol=1e-6)
    assert rgba[beyond][:, 3].max() == pytest.approx(0.5, abs=0.01)


def test_without_strength_or_anything_to_see_images_are_the_same() -> None:
    shapes = images([sphere(64)])
    assert all(
        a is b
        for a, b in zip(
            outlined(*shapes, [Pen(0.0, 2.0, OUTLINE_COLOUR)], camera(16).pixel_at, 1.0),
            shapes,
            strict=True,
        )
    )
    empty = images([np.full((64, 64), np.inf)])
    assert all(a is b for a, b in zip(outlined(*empty, [BLACK], camera(16).pixel_at, 1.0), empty, strict=True))


@pytest.mark.parametrize("size", [1, 2, 7, 24])
def test_images_of_any_size_are_drawn_on(size: int) -> None:
    image = ink(images([sphere(size, (0.1, 0.0, 0.0), 0.9)]), count=1)
    assert image.min() > -1e-6 and image.max() <= 1.0


# --- the edit ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fused", [True, False])
def test_a_scene_without_outlines_is_as_it_was_to_the_bit(fused: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not fused:
        monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda _: None)
    cube = cube_scene()
    plain, inked = cube.render(cube_camera(200)), cube.with_outline(1.0).render(cube_camera(200))
    off = cube.with_outline(1.0).with_outline(0.0).render(cube_camera(200))
    for name in ("rgba", "depth", "region"):
        np.testing.assert_array_equal(getattr(off, name), getattr(plain, name))
    assert np.abs(inked.rgba - plain.rgba).max() > 0.1
    base = cube.with_outline(1.0).render(cube_camera(200), "base").rgba
    np.testing.assert_array_equal(base, cube.render(cube_camera(200), "base").rgba)


def test_paint_is_outlined_and_backgrounds_lie_below() -> None:
    cube = cube_scene()
    painted = cube.painted(cube_paint(cube, 1), {0: "oil", 1: "oil", 2: "oil"}, {}, "oil").with_outline(1.0, width=6.0)
    alone, over = painted.render(cube_camera(200)).rgba, painted.render(cube_camera(200), None, (1.0, 1.0, 1.0)).rgba
    np.testing.assert_allclose(over[..., :3], alone[..., :3] * alone[..., 3:] + 1.0 - alone[..., 3:], atol=1e-6)
    assert over[..., :3].min() < 0.2


def test_the_edit_is_undone_kept_in_files_and_absent_from_older_ones(tmp_path: Path) -> None:
    cube = cube_scene()
    scene = cube.with_outline(0.5).with_outline(width=4.0).with_outline(None, 1, colour=(0.2, 0.0, 0.0))
    scene = scene.with_outline(0.0, 2)
    said = [step.what for step in scene.history.past]
    assert said == ["outline 0.5", "outline, 4 px wide", "outline, of #330000", "outline 0"]
    assert [r.outline for r in scene.regions] == [0.5, 0.5, 0.0]
    assert [r.outline_width for r in scene.regions] == [4.0] * 3
    assert [r.outline_colour for r in scene.regions] == [OUTLINE_COLOUR, (0.2, 0.0, 0.0), OUTLINE_COLOUR]
    scene.save(tmp_path / "new.svv")
    again = Scene.load(tmp_path / "new.svv")
    assert (again.regions, again.history) == (scene.regions, scene.history)
    assert again.undone().undone().undone().undone().regions == cube.regions == again.reset().regions
    header, arrays = cube.to_arrays()
    new = ("outline", "outline_width", "outline_colour")
    header["regions"] = [{k: v for k, v in r.items() if k not in new} for r in header["regions"]]
    scene_file.write_scene_file(tmp_path / "old.svv", header, arrays)
    assert Scene.load(tmp_path / "old.svv").regions == cube.regions
    assert cube.with_outline(width=3.0).regions[0].outline == 1.0, "a width alone is seen"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"strength": 1.5}, "between 0 and 1"), ({"strength": float("nan")}, "between 0 and 1"),
        ({"width": 0.0}, "wider than 0"), ({"width": 40.0}, "at most 16"), ({"width": float("nan")}, "wider than 0"),
        ({"colour": (2.0, 0.0, 0.0)}, "red, green and blue"), ({"colour": (0.0, 0.0)}, "red, green and blue"),
    ],
)  # fmt: skip
def test_outlines_that_cannot_be_are_one_sentence(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        cube_scene().with_outline(**arguments)  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="no region 7"):
        cube_scene().with_outline(1.0, 7)
