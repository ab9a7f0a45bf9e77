"""Sections: the faces of cuts as flat washes, hatched, and with a line around them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.ndimage import binary_dilation, maximum_filter
from typer.testing import CliRunner

from svv.cli.app import app
from svv.core.geometry.cameras import Camera
from svv.core.images.edges import VIEW
from svv.errors import BadInput, silent
from svv.fields.scene.images import _draw
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.fields.scene.sections import HATCH_WIDTH, flat_colours, hatching, with_lines
from tests.cube import cube_camera, cube_paint, cube_scene, hash_cube_scene, lit_cube_scene

FACE = "z>30%"
"""A cut whose face looks into the camera."""

MIDDLE = (slice(10, 14), slice(10, 14))


def dense(scene: Scene) -> Scene:
    """The scene, so opaque that a face hides what is behind it."""
    for region in range(len(scene.regions)):
        scene = scene.edited(region, opacity=200.0)
    return scene


def turned(camera: Camera) -> Camera:
    """The camera on the other side, from where the face is hidden."""
    return replace(camera, camera_to_world=np.diag([-1.0, 1.0, -1.0, 1.0]) @ camera.camera_to_world)


@pytest.mark.parametrize("make", [cube_scene, lit_cube_scene, hash_cube_scene])
def test_a_flat_face_has_the_unlit_colours_of_its_regions(make: Callable[[], Scene]) -> None:
    scene = dense(make()).edited(1, colour=(0.3, 0.9, 0.9)).cut(FACE)
    plain, flat = (one.render(cube_camera(), "pcn") for one in (scene, scene.with_section("flat")))
    colours = flat_colours(scene, "pcn").numpy()
    np.testing.assert_allclose(colours[1], (0.3, 0.9, 0.9), atol=1e-6)
    shown = colours[flat.region[MIDDLE]]
    near = np.abs(flat.rgba[MIDDLE][..., :3] - shown).max(axis=2)
    assert np.median(near) < 0.02
    assert np.median(np.abs(plain.rgba[MIDDLE][..., :3] - shown).max(axis=2)) > 0.05


def test_a_section_changes_colours_at_faces_alone() -> None:
    scene = cube_scene().cut("x>50%")
    for camera in (cube_camera(), turned(cube_camera())):
        plain, hatched = (one.render(camera, "pcn") for one in (scene, scene.with_section("hatched")))
        for name in ("depth", "region"):
            np.testing.assert_array_equal(getattr(plain, name), getattr(hatched, name))
        np.testing.assert_allclose(plain.rgba[..., 3], hatched.rgba[..., 3], atol=1e-6)
    behind, scene = turned(cube_camera()), dense(cube_scene()).cut("z>95%")
    plain, flat = (one.render(behind, "pcn") for one in (scene, scene.with_section("flat", line=4.0)))
    np.testing.assert_allclose(plain.rgba, flat.rgba, atol=2e-3)
    uncut = cube_scene().with_section("flat", line=3.0)
    np.testing.assert_array_equal(
        uncut.render(cube_camera(), "pcn").rgba, cube_scene().render(cube_camera(), "pcn").rgba
    )


def test_faces_of_cuts_of_regions_are_those_of_cuts_of_all() -> None:
    """Also of translucent regions, whose lines would be jagged if samples did not begin at the face."""
    scene, camera = cube_scene().with_section("flat", line=6.0), replace(cube_camera(), width=80, height=80)
    for region in range(3):
        scene = scene.edited(region, opacity=0.3)
    shares = []
    for text in ("plane:0,0,0.1:0.3,0.2,1", "0,1,2=plane:0,0,0.1:0.3,0.2,1"):
        shares.append(torch.zeros(80 * 80))
        _draw(scene.cut(text), camera, "pcn", silent, shares[-1])
    assert float(shares[0].max()) > 0.3
    torch.testing.assert_close(shares[1], shares[0], atol=0.01, rtol=0.0)


def test_only_the_regions_named_have_sections() -> None:
    scene = dense(cube_scene()).cut(FACE)
    plain, one = (s.render(cube_camera(), "pcn") for s in (scene, scene.with_section("flat", 1)))
    changed = np.abs(plain.rgba - one.rgba).max(axis=2) > 0.03
    assert changed.any() and (plain.region[changed] == 1).mean() > 0.9
    assert one.rgba.shape == plain.rgba.shape and scene.with_section("flat", 1).undone().regions == scene.regions


def test_a_painted_face_has_the_commonest_colour_of_the_paint() -> None:
    scene = dense(cube_scene())
    network = cube_paint(scene, 2)
    regions = tuple(replace(region, style="ink") for region in scene.regions)
    painted = replace(scene, styled=network, regions=regions)
    full = flat_colours(painted, "styled")
    assert full.shape == (3, 3) and bool(((full >= 0.0) & (full <= 1.0)).all())
    half = flat_colours(painted.with_strength(0.5), "styled")
    torch.testing.assert_close(half, 0.5 * (full + flat_colours(scene, "pcn")))
    alone = flat_colours(painted.with_strength(0.0), "styled")
    torch.testing.assert_close(alone, flat_colours(scene, "pcn"))


def test_hatched_lines_cover_their_share_and_stay_in_the_world() -> None:
    generator = torch.Generator().manual_seed(0)
    for face in range(3):
        position = torch.rand(20000, 3, generator=generator)
        position[:, face] = 0.5
        for region in range(5):
            ink = hatching(position, torch.full((len(position),), region))
            assert 0.0 <= float(ink.min()) and float(ink.max()) <= 1.0
            assert float(ink.mean()) == pytest.approx(HATCH_WIDTH, abs=0.03)
    one, other = (hatching(position, torch.full((len(position),), region)) for region in (0, 1))
    assert float((one - other).abs().mean()) > 0.2  # neighbours differ


@pytest.mark.parametrize("width", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("strength", [1.0, 0.5])
def test_a_line_is_as_long_as_the_border_of_its_face(width: float, strength: float) -> None:
    """Its ink is that of a band of this width around a disc, at any size of image."""
    region = dense(cube_scene()).with_section("flat", line=width).regions[0]
    for size in (400, 800):
        row, column = np.mgrid[:size, :size] + 0.5
        away = np.hypot(row - size / 2, column - size / 2)
        share = strength * np.clip(0.3 * size - away + 0.5, 0.0, 1.0).astype(np.float32)
        rgba = np.zeros((size, size, 4), np.float32)
        rgba[..., 3] = 1.0
        rgba[..., :3] = 1.0
        drawn = with_lines(rgba, share, np.zeros((size, size), np.int16), [region], VIEW)
        ink = float((1.0 - drawn[..., 0]).sum() / (1.0 - region.outline_colour[0]))
        assert ink == pytest.approx(2.0 * np.pi * 0.3 * size * width * size / VIEW, rel=0.15)
        assert float(drawn[size // 2, size // 2].min()) == 1.0


@pytest.mark.parametrize("width", [2.0, 4.0])
def test_spots_of_a_face_have_no_lines_but_holes_have(width: float) -> None:
    """Bones are dense here and thin there: their faces' shares vary by half from cell to cell."""
    size, region = 800, dense(cube_scene()).with_section("flat", line=width).regions[0]
    y, x = np.mgrid[:size, :size]
    away, hole = np.hypot(y - 400, x - 400), np.hypot(y - 400, x - 300)
    spots = np.random.default_rng(0).random((size // 4, size // 4), np.float32).repeat(4, 0).repeat(4, 1)
    share = np.where((away < 240) & (hole > 30), 0.6 - 0.3 * spots, 0.0).astype(np.float32)
    rgba = np.ones((size, size, 4), np.float32)
    ink = 1.0 - with_lines(rgba, share, np.zeros((size, size), np.int16), [region], VIEW)[..., 0]
    assert float(ink[(away < 220) & (hole > 50)].max()) == 0.0
    near = maximum_filter(ink, 9)
    assert float(near[np.abs(away - 240) < 1].min()) > 0.5 and float(near[np.abs(hole - 30) < 1].min()) > 0.5


def test_a_line_surrounds_the_face_in_a_picture() -> None:
    scene = dense(cube_scene()).cut(FACE)
    camera = replace(cube_camera(), width=200, height=200)
    plain, lined = (one.render(camera, "pcn", (1.0, 1.0, 1.0)) for one in (scene, scene.with_section(line=6.0)))
    ink = np.abs(plain.rgba - lined.rgba).max(axis=2) > 0.2
    border = np.hypot(*np.gradient(plain.region.astype(float))) > 0.0
    assert ink.any() and not (ink & ~binary_dilation(border, iterations=4)).any()
    assert (ink & border).sum() > 0.7 * border.sum()
    without = scene.with_section(line=0.0).render(camera, "pcn", (1.0, 1.0, 1.0))
    np.testing.assert_array_equal(without.rgba, plain.rgba)


def test_joined_scenes_show_sections() -> None:
    both = joined([dense(cube_scene(0)), dense(cube_scene(1))]).cut(FACE)
    plain, flat = (one.render(cube_camera(), "pcn").rgba for one in (both, both.with_section("flat", line=2.0)))
    assert np.abs(plain - flat)[MIDDLE].max() > 0.05


def test_sections_are_in_the_file_and_the_history(tmp_path: Path) -> None:
    path, out = tmp_path / "scene.svv", tmp_path / "out.svv"
    cube_scene().cut(FACE).save(path)
    done = CliRunner().invoke(
        app, ["edit", str(path), "--section", "hatched", "--section-line", "2", "--out", str(out)]
    )
    assert done.exit_code == 0, done.output
    there = Scene.load(out)
    assert {r.section for r in there.regions} == {"hatched"} and {r.section_line for r in there.regions} == {2.0}
    assert {r.section for r in there.undone().regions} == {"learned"}
    assert {r.section for r in there.reset().regions} == {"learned"}


@pytest.mark.parametrize("given", [{"section": "oil"}, {"line": -1.0}, {"line": 17.0}, {"line": float("nan")}])
def test_what_is_no_section_is_refused(given: dict[str, object]) -> None:
    with pytest.raises(BadInput):
        cube_scene().with_section(**given)
    with pytest.raises(BadInput, match="no region 7"):
        cube_scene().with_section("flat", 7)
