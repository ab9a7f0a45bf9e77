"""Cast shadows: as rays to the light have them, the same in every kind of picture, kept like any other edit."""

from __future__ import annotations

import importlib
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from svv.cli import app as cli
from svv.core.colour.light import Lamp
from svv.core.geometry.cameras import Camera, look_at
from svv.errors import BadInput
from svv.fields.scene import shadows
from svv.fields.scene.image import image_kernels_of
from svv.fields.scene.joined import joined, members
from svv.fields.scene.scene import Scene
from svv.fields.scene.shadow_kernels import add_transmittance, carry_inside, transmittance_in_columns
from svv.fields.scene.shadows import cast_shadows, cone
from svv.job.looks.file import from_json, to_json
from svv.job.looks.look import Look
from svv.options.baking import BakeOptions
from svv.options.editing import ShadowEdit
from svv.render.baking.baked import bake
from svv.render.figures.swatches import swatch
from svv.render.web.page import write_html
from tests.cube import cube_camera, cube_paint, cube_scene, faint, hash_cube_scene, lit_cube_scene
from tests.lit_shapes import NOTHING, Floats, factor_of, reference, scene_of, solid
from tests.nightly import nightly

CELLS, SMALL = 96, 32
TOWARDS = np.array([-1.0, 1.5, 0.6])
LIGHT = (-1.0, 1.5, 0.6)


def ball_over_hill(x: Floats) -> Floats:
    hill = np.linalg.norm(x - [0.5, -0.32, 0.5], axis=-1) - 0.55
    return solid(np.minimum(np.linalg.norm(x - [0.45, 0.6, 0.5], axis=-1) - 0.18, hill), CELLS)


def clouds(x: Floats) -> Floats:
    first = np.linalg.norm(x - [0.4, 0.65, 0.5], axis=-1) - 0.2
    return np.asarray(solid(np.minimum(first, np.linalg.norm(x - [0.6, 0.3, 0.45], axis=-1) - 0.25), CELLS, 2.0))


def ball_in_ring(x: Floats) -> Floats:
    p = x - 0.5
    ring = np.hypot(np.hypot(p[..., 0], p[..., 2]) - 0.3, p[..., 1]) - 0.08
    return solid(np.minimum(ring, np.linalg.norm(p, axis=-1) - 0.14), CELLS)


def ball_in_thin_shell(x: Floats) -> Floats:
    away = np.linalg.norm(x - 0.5, axis=-1)
    shell = np.where(np.abs(away - 0.4) < 1.0 / 64.0, 1.8, NOTHING + 24.0)
    return np.maximum(shell, solid(away - 0.15, CELLS))


def fog(x: Floats) -> Floats:
    waves = np.sin(9.0 * x[..., 0] + 1.0) * np.sin(8.0 * x[..., 1]) * np.sin(10.0 * x[..., 2] + 2.0)
    return 0.7 + 1.5 * waves


def camera_above(size: int) -> Camera:
    return Camera(look_at((0.9, 1.2, 2.6), (0.0, 0.0, 0.0)), 0.42, size, size)


@pytest.mark.parametrize(
    ("shape", "size", "directions"),
    [
        pytest.param(clouds, 20, 12, marks=pytest.mark.slow),
        (fog, 8, 12),
        pytest.param(ball_in_ring, 24, 12, marks=pytest.mark.slow),
        pytest.param(ball_in_thin_shell, 20, 12, marks=pytest.mark.slow),
        pytest.param(ball_over_hill, 24, 48, marks=pytest.mark.slow),  # opaque: 12 directions have 40 dB themselves
    ],
)
def test_shadows_are_those_of_rays_to_the_light(shape: Any, size: int, directions: int) -> None:
    scene, camera = scene_of(shape, CELLS), camera_above(size)
    found = factor_of(scene, scene.with_shadow(1.0, LIGHT, 15.0), camera)
    truth = reference(shape, CELLS, camera, TOWARDS, 15.0, directions)
    assert truth.min() < 0.5 < 0.9 < truth.max()
    assert -10.0 * np.log10(np.mean((found - truth) ** 2)) >= 36.0


@cache
def uniform() -> Scene:
    return scene_of(lambda x: np.zeros(x.shape[:-1]), SMALL)


@settings(max_examples=8, deadline=None)
@given(st.tuples(*[st.integers(-100, 100)] * 3).filter(lambda v: any(v)), st.floats(0.1, 1.0))
def test_uniform_matter_dims_by_its_way_to_the_border(direction: tuple[int, ...], extinction: float) -> None:
    towards = np.array(direction) / np.linalg.norm(direction)
    scene = uniform().with_shadow(1.0, direction, 0.0)
    assert scene.base.density is not None
    scene.base.density.table.fill_(float(np.log(extinction)))
    place = np.random.default_rng(0).uniform(0.2, 0.8, (50, 3))
    ends = np.where(towards > 0.0, 1.0 - place, -place) / np.where(towards == 0.0, 1e-9, towards)
    way = np.abs(ends).min(axis=1) - 0.5 * (shadows.NEAR + shadows.FAR) / SMALL
    colour = torch.ones(50, 3)
    cast_shadows(scene, colour, torch.from_numpy(place.astype(np.float32)), "pcn", tuple(towards.tolist()))
    off = SMALL * np.abs(-np.log(colour[:, 0].numpy()) / extinction - way)
    assert np.median(off) < 0.25  # of a cell
    assert off.max() < 2.0  # where the way leaves beside an edge of the box, which is one cell wide


def test_a_column_sums_up_what_lies_between_a_vertex_and_the_light() -> None:
    rng = np.random.default_rng(1)
    field = rng.random((9, 8, 37)).astype(np.float32)  # whole vectors and a rest
    columns, found = np.zeros((8, 9, 37), np.float32), np.zeros(field.shape, np.float32)
    first = np.zeros(2, np.int64)
    transmittance_in_columns(field, 0.0, 0.0, first, np.array([0.0, 0.25], np.float32), columns)
    between = np.cumsum(field, 0)
    wanted = np.zeros_like(field)
    wanted[1:] = 0.25 * field[:-1]
    wanted[2:] += between[:-2]
    np.testing.assert_allclose(np.moveaxis(columns, 0, 1), np.exp(-wanted), rtol=1e-5)
    padded = np.pad(columns, ((0, 1), (0, 0), (0, 1)), constant_values=1.0)
    add_transmittance(padded, 0.0, 0.0, first, np.float32(1.0), found)
    np.testing.assert_allclose(found, np.exp(-wanted), rtol=1e-5)


@pytest.mark.parametrize("direction", [(-0.4, 1.0, 0.27), (0.1, 1.0, 0.6), (0.6, 1.0, -0.6)])
def test_a_shadow_is_as_wide_as_rays_have_it(
    direction: tuple[float, float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shadows, "DEEP", 0)  # of the ground alone
    towards = np.array(direction) / np.linalg.norm(direction)
    at = np.stack(np.meshgrid(*[np.arange(32.0)] * 3, indexing="ij"), -1)
    ball = 4.0 * np.clip(6.5 - np.linalg.norm(at - [15.5, 22.0, 15.5], axis=-1), 0.0, 1.0)
    grid = shadows._Grid(np.zeros(3), 1.0, ball.astype(np.float32), np.ones(ball.shape, np.bool_))
    ground = at[:, :12].reshape(-1, 3)
    depth = [map_coordinates(ball, (ground + way * towards).T, order=1) for way in np.arange(2.0, 45.0, 0.2) + 0.1]
    truth = np.exp(-0.2 * np.sum(depth, axis=0))
    found = shadows._transmittance(grid, towards, 0.0)[:, :12]
    assert (1.0 - found).sum() == pytest.approx((1.0 - truth).sum(), rel=0.025)


def test_an_edge_between_a_bright_and_a_dark_side_stays_sharp() -> None:
    x, y, _ = np.mgrid[:16, :16, :16]

    def carried(matter: Any, light: Any) -> Floats:
        light, clear = light.astype(np.float32), np.where(matter, shadows.LEAST_CLEAR, 1.0).astype(np.float32)
        for _ in range(shadows.DEEP):
            before = light, clear
            light, clear = np.zeros_like(light), np.zeros_like(clear)
            carry_inside(*before, light, clear)
        return np.asarray(light[:, :, 8])

    beam = carried((x < 8) & (y < 8), y >= 8)
    assert beam[1:7, 7].min() > 0.95 and beam[7, 1:7].max() < 0.05 and 0.4 < beam[7, 7] < 0.7
    sheet = carried(y == 8, y > 8)
    np.testing.assert_allclose(sheet[1:15, 8], 0.5, atol=0.01)  # it has no side that is its front


def test_a_smooth_surface_in_the_light_has_no_shadow_of_its_own() -> None:
    shape = lambda x: solid(np.linalg.norm(x - 0.5, axis=-1) - 0.35, 64)  # noqa: E731
    scene = scene_of(shape, 64)
    pose = np.eye(4)
    pose[2, 3] = 3.0
    camera = Camera(pose, 0.3, 96, 96)
    for softness in (0.0, 6.0):
        found = factor_of(scene, scene.with_shadow(1.0, (0.0, 0.3, 1.0), softness), camera)
        y, x = np.mgrid[-47.5:48:1, -47.5:48:1] / 96 * 2 * np.tan(0.15) * 3.0
        z = np.sqrt(np.clip(0.35**2 - x**2 - y**2, 0.0, None))
        facing = (-0.3 * y + z) / 0.35 / np.hypot(1.0, 0.3)
        assert found[facing > 0.35].min() > 0.96


def test_a_cone_has_its_opening_angle() -> None:
    for softness in (0.5, 10.0, 60.0):
        found = cone(np.array([3.0, -1.0, 2.0]), softness)
        away = np.degrees(np.arccos(found @ np.array([3.0, -1.0, 2.0]) / np.sqrt(14.0)))
        assert 0.9 * softness / 2 < away.max() <= softness / 2 + 1e-6
        assert np.allclose(np.linalg.norm(found, axis=1), 1.0)
    assert cone(np.array([0.0, 0.0, 2.0]), 0.0).tolist() == [[0.0, 0.0, 1.0]]


@pytest.mark.parametrize("lit", [False, True])
@pytest.mark.parametrize("painted", [False, True])
def test_kernels_and_plain_torch_agree(lit: bool, painted: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = (lit_cube_scene() if lit else cube_scene()).edited(2, matcap="chalk")
    if painted:
        plain = plain.painted(cube_paint(plain, 1), {0: "oil", 1: "oil"}, {}, "oil").with_stroke_opacity(0.5, 0)
    scene = plain.with_shadow(1.0)
    assert image_kernels_of(scene) is not None
    fast, before = scene.render(cube_camera()), plain.render(cube_camera())
    monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda scene: None)
    np.testing.assert_allclose(fast.rgba, scene.render(cube_camera()).rgba, atol=2e-3)
    np.testing.assert_allclose(fast.rgba[..., 3], before.rgba[..., 3], atol=1e-5)
    assert (before.rgba - fast.rgba)[..., :3].max() > 0.02 and (before.rgba - fast.rgba).min() > -2e-3


def arriving(scene: Scene, network: str = "pcn") -> NDArray[np.float32]:
    """What remains of white at some places."""
    place = torch.rand(200, 3, generator=torch.Generator().manual_seed(1))
    colour = torch.ones(200, 3)
    x, y, z = scene.lamp.casting.towards(np.eye(3)).tolist()
    cast_shadows(scene, colour, place, network, (x, y, z))
    return np.asarray(colour[:, 0].numpy())


def test_amounts_lie_between_none_and_all(cube: Scene) -> None:
    full = arriving(cube.with_shadow(1.0))
    np.testing.assert_allclose(arriving(cube.with_shadow(0.4)), 0.6 + 0.4 * full, atol=1e-6)
    assert 0.0 <= full.min() < 0.9 and full.max() <= 1.0
    plain = cube.render(cube_camera()).rgba
    np.testing.assert_array_equal(cube.with_shadow(0.5).with_shadow(0.0).render(cube_camera()).rgba, plain)


def test_what_is_hidden_cut_away_or_faint_casts_less() -> None:
    scene = cube_scene().with_shadow(1.0, (0.0, 1.0, 0.0))
    first = arriving(scene)
    assert (arriving(faint(scene)) > first - 0.01).all() and arriving(faint(scene)).mean() > first.mean() + 0.02
    np.testing.assert_allclose(arriving(scene.hidden(0, 1, 2)), 1.0, atol=1e-6)
    np.testing.assert_array_equal(arriving(scene), first)
    assert arriving(scene.hidden(1)).mean() > first.mean()
    assert (arriving(scene.cut("y>20%")) >= first - 1e-6).all() and arriving(scene.cut("y>5%")).min() > 0.95
    own = arriving(scene.cut("0=y>-50%", "1=y>-50%"))
    np.testing.assert_allclose(own, arriving(scene.hidden(0, 1)), atol=1e-5)
    assert scene.base.density is not None
    scene.base.density.table.sub_(4.0)
    assert arriving(scene).mean() > first.mean(), "another extinction is noticed"


def test_opacity_that_follows_strokes_casts_as_much_as_is_seen() -> None:
    scene = cube_scene()
    paint = cube_paint(scene, 1)
    paint.encoding.randomize(40.0, torch.Generator().manual_seed(1))
    painted = scene.painted(paint, dict.fromkeys(range(3), "oil"), {}, "oil").with_shadow(1.0)
    followed = painted.with_stroke_opacity(1.0)
    whole, less = (shadows._grid(one, "styled").depth for one in (painted, followed))
    assert (less <= whole + 1e-6).all() and less.sum() < 0.98 * whole.sum()
    assert not np.array_equal(arriving(followed, "styled"), arriving(painted, "styled"))
    np.testing.assert_array_equal(arriving(followed, "pcn"), arriving(painted, "pcn"))


def test_shadows_stay_in_the_world_or_follow_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    computed: list[Floats] = []
    real = shadows._transmittance

    def counted(grid: Any, towards: Floats, softness: float) -> Floats:
        computed.append(towards)
        return real(grid, towards, softness)

    monkeypatch.setattr(shadows, "_transmittance", counted)
    scene = cube_scene()
    rig = scene.rig
    for camera in rig.orbit(4, 16):
        scene.with_shadow(0.5, (1.0, 2.0, 0.0)).render(camera)
    assert len(computed) == 1
    computed.clear()
    for camera in rig.orbit(3, 16):
        scene.with_shadow(0.5, (-30.0, 40.0)).render(camera)
        axes = camera.camera_to_world[:3, :3]
        right, up, back = (computed[-1] @ axes).tolist()
        assert np.degrees([np.arctan2(right, back), np.arcsin(up)]) == pytest.approx([-30.0, 40.0], abs=1e-6)
    assert len(computed) == 3
    assert scene.with_shadow(0.5).while_moving().lamp.shadow_softness == 0.0, "quickly, for each frame"
    assert scene.with_shadow(0.5, (0, 1, 0)).while_moving().lamp.shadow_softness > 0.0


def test_the_light_of_shadows_is_the_one_that_was_moved_unless_another_is_given() -> None:
    assert Lamp(shadow=1.0).casting.azimuth < 0.0 < Lamp(shadow=1.0).casting.elevation
    assert Lamp(20.0, 30.0, shadow=1.0).casting.azimuth == 20.0
    assert Lamp(direction=(0, 1, 0), shadow=1.0, shadow_light=(5.0, 6.0)).casting.elevation == 6.0
    assert Lamp(shadow=1.0).shadows_follow and not Lamp(direction=(0, 1, 0), shadow=1.0).shadows_follow
    lit = lit_cube_scene().with_shadow(0.6, (3, 0, 0), 9.0).with_light(10, 20, intensity=2.0)
    assert lit.lamp == Lamp(10.0, 20.0, intensity=2.0, shadow=0.6, shadow_softness=9.0, shadow_light=(3.0, 0.0, 0.0))


@pytest.mark.parametrize("apart", [False, True])
def test_members_of_a_joined_scene_shade_each_other(apart: bool) -> None:
    lid = scene_of(lambda x: solid(np.abs(x[..., 1] - 0.8) - 0.06, SMALL), SMALL)
    floor = scene_of(lambda x: solid(x[..., 1] - 0.3, SMALL), SMALL)
    if apart:  # in a box of its own
        box = replace(floor.occupancy.box, low=(-0.41, -0.45, -0.41), size=0.8)
        floor = replace(floor, occupancy=replace(floor.occupancy, box=box))
    both = joined([lid, floor]).with_shadow(1.0, (0.0, 1.0, 0.0), 0.0)
    _, below = members(both)
    colour, place = torch.ones(1, 3), torch.tensor([[0.5, 0.45, 0.5]])
    cast_shadows(below, colour, place, "pcn", (0.0, 1.0, 0.0))
    assert float(colour.max()) < 0.05
    colour = torch.ones(1, 3)
    cast_shadows(members(both.hidden(0))[1], colour, place, "pcn", (0.0, 1.0, 0.0))
    assert float(colour.min()) > 0.99
    view = Camera(look_at((0.3, -0.05, 3.0), (0.0, -0.1, 0.0)), 0.4, 24, 24)
    lighter = both.with_shadow(0.0).render(view).rgba[..., :3] - both.render(view).rgba[..., :3]
    assert lighter.max() > 0.5 and lighter.min() > -1e-3


def test_it_is_an_edit_kept_in_file_history_and_look(cube: Scene, tmp_path: Path) -> None:
    scene = cube.with_shadow(0.7, (-1, 2, 1), 12.0)
    assert [step.what for step in scene.history.past] == ["shadows 0.7 by a light 12 degrees wide, from -1, 2, 1"]
    scene.save(tmp_path / "a.svv")
    assert Scene.load(tmp_path / "a.svv").lamp == scene.lamp
    assert "shadows" in scene.info() and "shadows" not in cube.info()
    look = Look(**vars(from_json(to_json(Look.of(scene)), "it")))
    assert look.applied(cube).scene.lamp == scene.lamp
    assert look.applied(hash_cube_scene()).notes == (
        "The shadows of the look were left out, because this scene's extinction is in a hash grid.",
    )
    assert scene.undone().lamp == cube.lamp and scene.reset().lamp == Lamp() and scene.undone().redone() == scene
    assert not [name for name in cube.lamp.to_json() if "shadow" in name], "older versions read scenes without them"
    told = to_json(Look.of(scene))
    told["lamp"]["shadow"] = 2.0
    with pytest.raises(BadInput, match="Shadows must lie between 0, none, and 1"):
        from_json(told, "it")


def test_what_cannot_be_is_refused(cube: Scene) -> None:
    for amount in (-0.1, 1.5, float("nan")):
        with pytest.raises(BadInput, match="Shadows must lie between 0, none, and 1"):
            cube.with_shadow(amount)
    with pytest.raises(BadInput, match="softness of shadows must lie between 0 and 60 degrees"):
        cube.with_shadow(softness=90.0)
    for light in ((0.0, 0.0, 0.0), (1.0,), (np.nan, 0.0, 1.0)):
        with pytest.raises(BadInput, match="Light cannot come from"):
            cube.with_shadow(light=light)
    with pytest.raises(BadInput, match="azimuth must lie between"):
        cube.with_shadow(light=(200.0, 0.0))
    for scene in (hash_cube_scene(), joined([cube, hash_cube_scene()])):
        with pytest.raises(BadInput, match=r"This scene's shadow cannot be computed, .* in a hash grid"):
            scene.with_shadow(0.5)
    with pytest.raises(BadInput, match="in a hash grid"):
        joined([cube.with_shadow(0.5), hash_cube_scene()])
    with pytest.raises(BadInput, match="A baked volume holds shadows only"):
        bake(cube.with_shadow(0.5), BakeOptions(resolution=16))


@pytest.mark.parametrize("light", ["baked", "none"])
def test_a_baked_volume_has_them(cube: Scene, light: Any) -> None:
    options = BakeOptions(resolution=16, light=light)
    plain, dark = (bake(scene, options).rgba for scene in (cube, cube.with_shadow(1.0, (0, 1, 0))))
    seen = plain[..., 3] > 0
    np.testing.assert_array_equal(plain[..., 3], dark[..., 3])
    change = plain[..., :3][seen].astype(int) - dark[..., :3][seen]
    assert change.max() > 20 and change.mean() > 2.0 and change.min() >= -1


@pytest.mark.parametrize("painted", nightly([False, True], True))
def test_the_page_shows_them_as_the_renderer_does(open_page: Any, balls: Scene, tmp_path: Path, painted: bool) -> None:
    plain = balls
    if painted:
        plain = balls.painted(cube_paint(balls, 1), dict.fromkeys(range(len(balls.regions)), "oil"), {}, "oil")
    scene = plain.with_shadow(1.0, (1.0, 0.7, 0.5))
    write_html(tmp_path / "page.html", scene, "shadows")
    opened = open_page(tmp_path / "page.html", size=(400, 300))
    opened.ready()
    camera = scene.rig.orbit(181, 96, frames=[90])[0]
    assert opened.psnr(scene, camera) > max(28.0, opened.psnr(plain, camera) + 3.0)
    right = opened.page.get_by_label("Shadows from the right of the camera, in degrees")
    assert right.get_attribute("aria-valuetext") == "fixed", "a direction in the world is no angle to the camera"
    right.fill("70")
    assert right.get_attribute("aria-valuetext") == "70°"


def test_a_swatch_is_a_sphere_in_the_open(cube: Scene) -> None:
    plain, dark = (swatch(s, 0, cube_camera(64), "pcn", 24, 20.0) for s in (cube, cube.with_shadow(1.0)))
    assert plain is not None and dark is not None
    np.testing.assert_array_equal(plain, dark)


def test_the_command(cube: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cube.save("a.svv")

    def run(*arguments: str) -> Lamp:
        cli.app(["edit", *arguments, "--out", "b.svv"], prog_name="svv", standalone_mode=False)
        return Scene.load("b.svv").lamp

    assert run("a.svv", "--shadow", "0.6") == Lamp(shadow=0.6)
    assert run("b.svv", "--shadow-light", "-20,30") == Lamp(shadow=0.6, shadow_light=(-20.0, 30.0))
    assert run("b.svv", "--shadow-softness", "0") == Lamp(shadow=0.6, shadow_softness=0.0, shadow_light=(-20.0, 30.0))
    assert run("b.svv", "--shadow-light", "own").shadow_light is None
    assert run("a.svv", "--shadow-light", "1,2,3") == Lamp(shadow=0.7, shadow_light=(1.0, 2.0, 3.0))
    assert run("b.svv", "--undo") == Lamp()
    with pytest.raises(BadInput, match="--shadow-light needs two angles"):
        run("a.svv", "--shadow-light", "left")


def test_the_panel_asks_for_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("vtkmodules", reason="the reader of filters needs VTK: install svv[standalone]")
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "docs"))
    importlib.import_module("generated")._decorated()  # stands in for ParaView
    groups, editing = (importlib.import_module(f"svv.pv.{name}") for name in ("panel.groups", "work.editing"))

    def asked(**values: object) -> ShadowEdit:
        found: ShadowEdit = editing.edit_in({**groups.EDITS, **values}).shadow
        return found

    world, beside = groups.IN_WORLD, groups.BESIDE
    assert not asked() and not asked(ShadowSoftness=20.0, ShadowFrom=world), "nothing without an amount"
    assert asked(Shadow=0.5) == ShadowEdit(0.5)
    assert asked(Shadow=0.5, ShadowFrom=beside) == ShadowEdit(0.5, (-35.0, 40.0))
    assert asked(Shadow=1.0, ShadowFrom=world, ShadowSoftness=20.0) == ShadowEdit(1.0, (-1.0, 2.0, 1.0), 20.0)
