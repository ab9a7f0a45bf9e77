"""Baked volumes: the transmittance of the scene, its edits, and files that VTK reads."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

from svv.cli.app import app
from svv.core.geometry.cameras import Camera, look_at
from svv.core.volumes.opacity_code import (
    CODES,
    LEAST_LOG_DEPTH,
    MOST_LOG_DEPTH,
    codes_of,
    depths,
    most_of,
    most_with,
    opacity_points,
)
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput, Cancelled, silent
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import write_volume
from svv.options.baking import BakeOptions
from svv.render.baking.baked import Baker, bake, baked
from svv.render.baking.baked_volume import OPACITY, UNIT_DISTANCE, BakedVolume, halved, write_baked
from svv.render.baking.baking_kernels import extend_colours
from svv.render.baking.voxels import Grid
from tests.baked_views import BakedCaster
from tests.cube import cube_camera, cube_paint, cube_scene, lit_cube_scene
from tests.solid_ball import solid_ball

HALF_A_CODE = 0.5 * (MOST_LOG_DEPTH - LEAST_LOG_DEPTH) / (CODES - 1)
"""Error of an optical depth's logarithm in eight bits."""


def parallel(size: int = 29) -> Camera:
    """A camera whose rays run along z through the points of the ball's grid."""
    return Camera.orthographic(look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)), size / 32, size, size)


def unlit(scene: Scene) -> Scene:
    for region in range(len(scene.regions)):
        scene = scene.edited(region, lighting=0.0)
    return scene


def along_z(codes: np.ndarray, step: float, unit: float, most: float) -> np.ndarray:
    """Transmittance of each column of a volume whose codes are interpolated linearly. (Z, Y, X) -> (Y, X)"""
    between = np.linspace(0.0, len(codes) - 1, 8 * (len(codes) - 1) + 1)
    low = np.minimum(between.astype(int), len(codes) - 2)
    part = (between - low)[:, None, None]
    fine = codes[low] * (1 - part) + codes[low + 1] * part
    depth = np.interp(fine, np.arange(CODES + 1), depths(most)) * step / unit / 8
    return np.exp(-depth.sum(axis=0))


# --- codes ----------------------------------------------------------------------------------------------------------


@given(st.floats(LEAST_LOG_DEPTH, MOST_LOG_DEPTH))
def test_a_code_means_the_depth_that_it_was_made_from(log: float) -> None:
    (code,) = codes_of(np.array([log], np.float32), MOST_LOG_DEPTH)
    assert abs(np.log(depths(MOST_LOG_DEPTH)[code]) - log) <= HALF_A_CODE * 1.001


def test_codes_end_where_eight_bits_do() -> None:
    assert codes_of(np.array([-np.inf, -50.0, 50.0], np.float32), MOST_LOG_DEPTH).tolist() == [0, 0, 255]
    points = np.array(opacity_points(MOST_LOG_DEPTH))
    assert np.array_equal(points[:, 0], np.arange(256)) and points[0, 1] == 0.0 and points[255, 1] > 0.99999
    assert (np.diff(points[:, 1]) > 0).all()
    assert -np.expm1(-200 * depths(0.0)[1]) < 1 / 256  # what is left out is invisible across 200 unit distances


@given(st.floats(LEAST_LOG_DEPTH + 1.0, MOST_LOG_DEPTH))
def test_the_densest_point_has_the_last_code(log: float) -> None:
    most = most_of(np.array([-np.inf, LEAST_LOG_DEPTH, log], np.float32))
    assert codes_of(np.array([log], np.float32), most).tolist() == [255]
    assert most_with(opacity_points(most)[-1][1]) == pytest.approx(most, rel=1e-5)
    assert most_of(np.array([], np.float32)) == most_of(np.array([-np.inf], np.float32)) == LEAST_LOG_DEPTH + 1.0


# --- volumes --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("densest", [-1.0, 0.0, 1.5, 5.0])
def test_rays_through_the_volume_keep_the_light_of_the_integral(densest: float) -> None:
    """exp(-integral) of the field, by fine steps, against the same of the interpolated codes."""
    ball = replace(solid_ball(densest), stride=0.1, joined=0.0)
    volume = bake(ball)
    assert volume.grid.resolution == 32 and volume.grid.shape == (29, 29, 29)
    through = along_z(volume.rgba[..., 3].astype(float), volume.grid.spacing, volume.grid.unit_distance, volume.most)
    truth = 1.0 - ball.render(parallel()).rgba[::-1, :, 3]
    assert truth.min() < 0.8
    # Half a code changes an optical depth by 3 %, and so the light by at most 0.03 / e; the rest is at the border.
    assert np.abs(through - truth)[1:-1, 1:-1].max() < 0.02
    assert np.abs(through - truth)[1:-1, 1:-1].mean() < 0.004


@pytest.mark.parametrize("densest", [0.0, 5.0])
def test_vtk_draws_what_we_draw(densest: float) -> None:
    ball = solid_ball(densest)
    camera = Camera.orthographic(look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)), 1.0, 64, 64)
    drawn = BakedCaster(bake(ball)).render(camera).astype(float) / 255
    ours = ball.render(camera).rgba
    # VTK rounds the interpolated code to a whole one.
    assert np.abs(drawn[..., 3] - ours[..., 3]).mean() < 0.01
    inside = ours[..., 3] > 0.2
    assert np.abs(drawn[..., :3] - ours[..., :3])[inside].max() < 0.04


@pytest.mark.parametrize("hide", [(), (0,), (0, 1, 2)])
def test_ranges_are_those_of_the_bytes(hide: tuple[int, ...]) -> None:
    cube = cube_scene()
    volume = bake(cube.hidden(*hide) if hide else cube)
    flat = volume.rgba.reshape(-1, 4).astype(np.float64)
    ends, lengths = volume.ranges
    assert np.array_equal(ends, np.stack([flat.min(axis=0), flat.max(axis=0)], axis=1))
    found = np.linalg.norm(flat, axis=1)
    assert lengths == pytest.approx((found.min(), found.max()))


def test_the_grid_is_as_fine_as_the_scene_unless_asked_otherwise() -> None:
    ball = solid_ball()
    assert bake(ball, BakeOptions()).grid.resolution == 32
    assert bake(ball, BakeOptions(resolution=100)).grid.resolution == 96
    assert bake(ball, BakeOptions(resolution=31)).grid.resolution == 16
    small = bake(ball, BakeOptions(memory=5e-5))
    assert small.grid.resolution == 16 and small.rgba.nbytes <= 50_000
    coarse = small.grid
    low, high = np.array(coarse.origin), np.array(coarse.origin) + coarse.spacing * (np.array(coarse.shape) - 1)
    assert (low >= -0.5).all() and (high <= 0.5).all() and (high - low > 0.8).all()


def test_places_are_those_of_the_world() -> None:
    ball = solid_ball()
    moved = replace(
        ball, occupancy=replace(ball.occupancy, box=replace(ball.occupancy.box, low=(9.5, -2.0, 3.0), size=20.0))
    )
    here, there = bake(ball), bake(moved)
    assert np.array_equal(here.rgba, there.rgba)
    assert np.allclose(np.subtract(there.grid.origin, (9.5, -2.0, 3.0)), 20.0 * (np.array(here.grid.origin) + 0.5))
    assert there.grid.spacing == pytest.approx(20.0 * here.grid.spacing)


# --- edits, paint and light -------------------------------------------------------------------------------------------


def test_edits_act_as_in_images() -> None:
    cube, baker = cube_scene(), Baker()
    plain = baker.bake(cube, BakeOptions())
    matter = baker._matter
    regions = np.zeros(plain.rgba.shape[:3], int)
    assert matter is not None
    regions.ravel()[matter[1].place] = matter[1].region.numpy()

    def factors(volume: BakedVolume) -> np.ndarray:
        """What a volume's extinction is to the plain one's; at the two that VTK needs to be empty, nothing."""
        before, after = (depths(v.most)[v.rgba[..., 3]] for v in (plain, volume))
        assert (before == 0).sum() <= 2
        return np.divide(after, before, out=np.ones_like(after), where=(before > 0) & (after > 0))

    hidden = baker.bake(cube.hidden(1), BakeOptions())
    assert (hidden.rgba[regions != 1, 3] > 0).mean() > 0.99
    assert np.abs(np.log(factors(hidden)[regions != 1])).max() <= 2 * HALF_A_CODE
    left = depths(hidden.most)[hidden.rgba[regions == 1, 3]]
    assert left.max() < 0.25 * depths(hidden.most)[hidden.rgba[..., 3]].max()  # a soft edge
    thinned = baker.bake(cube.edited(0, opacity=0.25), BakeOptions())
    asked = np.where(regions == 0, 0.25, 1.0)
    wrong = np.abs(np.log(factors(thinned) / asked)) > 2 * HALF_A_CODE
    assert wrong.sum() <= 2
    red = baker.bake(cube.edited(2, colour=(1.0, 0.0, 0.0)), BakeOptions())
    assert np.array_equal(red.rgba[..., 3], plain.rgba[..., 3])
    changed = (red.rgba.astype(int) - plain.rgba)[regions == 2]
    assert changed[:, 0].mean() > 5 and changed[:, 1].mean() < -5
    assert baker._matter is matter  # edits look nothing up again
    assert np.array_equal(baker.bake(cube, BakeOptions()).rgba, plain.rgba)
    only = bake(cube, BakeOptions(regions=(1,)))
    assert np.array_equal(only.rgba, baker.bake(cube.isolated(1), BakeOptions()).rgba)
    assert (only.rgba[regions == 1, 3] > 0).mean() > 0.99


def test_a_coarser_volume_is_a_filtered_one() -> None:
    """A block of one extinction has it again inside; a sheet one fine voxel thick is not lost, wherever it lies."""
    fine, coarse = Grid(16, (17,) * 3, (0,) * 3, (0.0,) * 3, 0.5), Grid(8, (9,) * 3, (0,) * 3, (0.0,) * 3, 1.0)
    rgba = np.full((17, 17, 17, 4), (200, 100, 50, 255), np.uint8)
    whole = BakedVolume(rgba, fine, 1.5, (np.array([[0.0, 255.0]] * 4), (0.0, 510.0)))
    block = halved(whole, coarse)
    per_length = [depths(v.most)[255] / v.grid.unit_distance for v in (whole, block)]
    assert per_length[0] == pytest.approx(per_length[1], rel=1e-5)
    assert (block.rgba[1:-1, 1:-1, 1:-1] == (200, 100, 50, 255)).all()
    for layer in (7, 8):  # between two coarse points, and on one
        rgba[..., 3] = 0
        rgba[:, :, layer, 3] = 255
        sheet = halved(whole, coarse)
        roots = np.sqrt(depths(sheet.most)[sheet.rgba[4, 4, :, 3]] / sheet.grid.unit_distance)
        assert 2.0 * roots.sum() == pytest.approx(per_length[0] ** 0.5, rel=0.01)
        assert (sheet.rgba[4, 4, sheet.rgba[4, 4, :, 3] > 0, :3] == (200, 100, 50)).all()


def test_a_scene_is_filtered_for_coarser_grids() -> None:
    ball = solid_ball()
    fine, coarse = bake(ball), bake(ball, BakeOptions(resolution=16))
    assert np.array_equal(coarse.rgba, halved(fine, coarse.grid).rgba)


@pytest.mark.parametrize("edited", [False, True])
def test_colours_are_those_of_images_without_light(edited: bool) -> None:
    cube = unlit(cube_scene())
    cube = cube.painted(cube_paint(cube, 1), {0: "brush"}, {}).with_strength(0.7)
    if edited:
        cube = cube.edited(1, colour=(0.9, 0.9, 0.1)).with_stroke_opacity(0.5)
    drawn = BakedCaster(bake(cube, BakeOptions(resolution=64)), 0.25).render(cube_camera(48)).astype(float) / 255
    ours = cube.render(cube_camera(48)).rgba
    seen = (ours[..., 3] > 0.05) & (drawn[..., 3] > 0.05)
    assert seen.mean() > 0.1
    assert np.abs(drawn - ours)[seen].mean() < 0.03


@pytest.mark.parametrize("make", [cube_scene, lit_cube_scene])
def test_baked_light_is_the_mean_over_where_a_point_is_seen_from(make) -> None:  # type: ignore[no-untyped-def]
    scene = make()
    flat, lit = bake(scene), bake(scene, BakeOptions(light="baked"))
    assert np.array_equal(flat.rgba[..., 3], lit.rgba[..., 3])
    assert (flat.rgba[..., :3] != lit.rgba[..., :3]).any()
    assert np.array_equal(bake(unlit(scene), BakeOptions(light="baked")).rgba, flat.rgba)  # lighting 0 is flat
    views = [cube_camera(), Camera(look_at((3.0, 0.0, 0.0), (0.0, 0.0, 0.0)), 0.5, 24, 24)]
    errors = {True: 0.0, False: 0.0}
    for light, volume in ((True, lit), (False, flat)):
        for camera in views:
            ours, drawn = scene.render(camera).rgba, BakedCaster(volume).render(camera) / 255
            seen = ours[..., 3] > 0.2
            errors[light] += float(np.abs(ours - drawn)[seen, :3].mean())
    assert errors[True] < errors[False]


def test_light_that_comes_from_one_side_stays_there() -> None:
    scene = lit_cube_scene().with_light(direction=(0.0, 0.0, 1.0))
    lit = bake(scene, BakeOptions(light="baked")).rgba
    other = bake(scene.with_light(direction=(0.0, 1.0, 0.0)), BakeOptions(light="baked")).rgba
    assert (lit[..., :3] != other[..., :3]).any()


def test_empty_points_have_the_colour_beside_them() -> None:
    rgba = np.zeros((5, 5, 5, 4), np.uint8)
    rgba[2, 2, 2] = (200, 100, 0, 80)
    rgba[2, 2, 3] = (100, 200, 10, 80)
    rgba[0, 0, 0] = (9, 9, 9, 0)  # what a hidden region has left
    extend_colours(rgba, np.arange(125))
    assert rgba[2, 2, 1].tolist() == [200, 100, 0, 0] and rgba[2, 1, 2].tolist() == [150, 150, 5, 0]
    assert rgba[2, 2, 2].tolist() == [200, 100, 0, 80] and rgba[0, 0, 0].tolist() == [9, 9, 9, 0]
    volume = bake(solid_ball()).rgba
    shown = torch.from_numpy(volume[..., 3] > 0)
    beside = torch.nn.functional.max_pool3d(shown[None].float(), 3, 1, 1)[0].bool().numpy()
    grey = (volume[..., :3] == volume[14, 14, 14, :3]).all(axis=-1)
    assert 0.1 < beside.mean() < 1.0 and (~grey & beside).sum() <= 2 < (~grey).sum()


def test_a_visible_region_ends_half_way_to_a_hidden_one() -> None:
    """As much lies between a visible point and a hidden one as if the half beside the visible one were full."""
    ball = solid_ball(0.0)
    assert ball.palette_network is not None
    two = replace(ball, regions=ball.regions * 2)
    baker = Baker()
    whole = baker.bake(ball, BakeOptions())
    assert baker._matter is not None
    right = torch.from_numpy((baker._matter[1].place % 29) > 14).long()  # the points of larger x are another region
    parted = replace(baker._matter[1], region=right)
    half = baked(two.hidden(1), parted, None, "pcn", BakeOptions(), silent)
    row = depths(half.most)[half.rgba[14, 14, :, 3]]
    assert row[14] > 0 and (row[16:] == 0).all()
    fine = np.interp(np.linspace(14, 16, 2001), np.arange(29), half.rgba[14, 14, :, 3].astype(float))
    between = np.interp(fine, np.arange(CODES + 1), depths(half.most)).mean() * 2 / row[14]
    assert between == pytest.approx(0.5, abs=0.06)
    assert half.rgba[14, 14, 15, :3].tolist() == half.rgba[14, 14, 14, :3].tolist()
    kept = depths(whole.most)[whole.rgba[14, 14, :15, 3]]
    assert np.allclose(row[:15], kept, rtol=3 * HALF_A_CODE)


def test_everything_hidden_is_an_empty_volume() -> None:
    cube = cube_scene()
    volume = bake(cube.hidden(0, 1, 2))
    assert volume.empty


# --- files ----------------------------------------------------------------------------------------------------------


def read(path: Path):  # type: ignore[no-untyped-def]
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def test_vtk_reads_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svv.io.pictures.output.VTK_BLOCK", 10_000)  # several blocks, the last one smaller
    volume = bake(solid_ball())
    preset = write_baked(tmp_path / "ball.vti", volume)
    image = read(tmp_path / "ball.vti")
    assert image.GetDimensions() == volume.grid.shape
    assert image.GetOrigin() == pytest.approx(volume.grid.origin) and image.GetSpacing() == pytest.approx((1 / 32,) * 3)
    scalars = image.GetPointData().GetScalars()
    assert scalars.GetName() == "RGBA" and np.array_equal(vtk_to_numpy(scalars), volume.rgba.reshape(-1, 4))
    fields = image.GetFieldData()
    assert fields.GetArray(UNIT_DISTANCE).GetTuple(0) == (volume.grid.unit_distance,)
    assert np.array_equal(vtk_to_numpy(fields.GetArray(OPACITY)), np.array(opacity_points(volume.most)))
    function = TransferFunction.read(preset)
    assert function.unit_distance == volume.grid.unit_distance
    assert [(v, o) for v, o, *_ in function.opacities] == list(opacity_points(volume.most))
    assert len(json.loads(preset.read_text())) == 1  # as ParaView imports it


@pytest.mark.parametrize("content", [5, 10, 11])
def test_blocks_of_any_size_are_read(content: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svv.io.pictures.output.VTK_BLOCK", 10)
    numbers = np.arange(content, dtype=np.uint8).reshape(1, 1, content)
    write_volume(tmp_path / "a.vti", {'<a> & "b"': numbers}, (1, 2, 3), (0.1, 0.2, 0.3), {"x": np.array([[1 / 3]])})
    image = read(tmp_path / "a.vti")
    scalars = image.GetPointData().GetScalars()
    assert scalars.GetName() == '<a> & "b"' and vtk_to_numpy(scalars).tolist() == list(range(content))
    assert image.GetFieldData().GetArray("x").GetValue(0) == 1 / 3


def test_command(tmp_path: Path) -> None:
    scene = tmp_path / "cube.svv"
    cube_scene().save(scene)
    run = CliRunner().invoke
    out = tmp_path / "cube.vti"
    done = run(app, ["export", str(scene), "--out", str(out), "--regions", "0,2", "--light", "baked"])
    assert done.exit_code == 0 and "9 x 9 x 9 points" in done.output
    assert read(out).GetDimensions() == (9, 9, 9) and (tmp_path / "cube.json").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "a.obj"], "NAME.cdb, a volume NAME.vti or NAME.vdb, or splats"),
        (["--out", "a.vti", "--regions", "7"], "no region 7"),
        (["--out", "a.vti", "--network", "base"], "bake a scene with a palette"),
        (["--out", "a.vti", "--network", "styled"], "no network 'styled'"),
        (["--out", "a.vti", "--memory", "0.001"], None),
        (["--out", "nowhere/a.vti"], "folder does not exist"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], words: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    cube_scene().save("cube.svv")
    done = CliRunner().invoke(app, ["export", "cube.svv", *arguments])
    if words is None:
        assert done.exit_code == 0
        return
    assert isinstance(done.exception, BadInput) and words in str(done.exception)
    assert {path.name for path in tmp_path.iterdir()} == {"cube.svv"}


def test_too_little_memory_and_nothing_visible_are_said(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="allow it more memory"):
        bake(solid_ball(), BakeOptions(memory=1e-8))
    with pytest.raises(BadInput, match="Nothing in the scene is visible"):
        write_baked(tmp_path / "a.vti", bake(solid_ball().hidden(0)))
    assert not list(tmp_path.iterdir())


def test_it_can_be_stopped(tmp_path: Path) -> None:
    def stop(fraction: float, label: str) -> None:
        assert 0.0 <= fraction <= 1.0
        if label == "colouring":
            raise Cancelled

    with pytest.raises(Cancelled):
        bake(solid_ball(), BakeOptions(), stop)
