"""Scenes that are functions of their volume's values."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.nn.functional import normalize
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.colour.correction import Correction
from svv.core.geometry.box import Box
from svv.core.rays.encodings import spherical_harmonics
from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION
from svv.core.volumes.classified import ValueGrid
from svv.dvr.draw.classify import classified_as
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance, put
from svv.dvr.read.grids import from_array
from svv.errors import BadInput, Cancelled
from svv.fields.following.followed_scene import at_volume
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, FieldSettings, UnrestrictedField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.of_values import Places, features_of
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU
from svv.train.base.extinction_table import ExtinctionTable
from svv.train.correct import correct_palette
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS, Preset, ReconstructSettings, preset
from tests.test_ranges import BLUE, RED, ball, bumps, volume_of

TWO = bumps((0.3, 0.2, 0.1, BLUE), (0.8, 0.3, 0.8, RED))
SHORT = replace(
    preset("draft", "values"), reconstruct=ReconstructSettings(iterations=60, rays=512, cells=32),
    recolour=replace(preset("draft", "values").recolour, iterations=120, rays=512),
)  # fmt: skip


def grid_of(values: np.ndarray, integral: np.ndarray) -> ValueGrid:
    """A grid of values in [0, 1], all of them visible and inside the volume."""
    return ValueGrid(4, (1 + np.rint(65472 * values)).astype(np.uint16), (0.0, 1.0), (0.0, 1.0), integral)


def ramp(slope: float) -> np.ndarray:
    """Values that rise along x by ``slope`` per cell, from 0.2. (5, 5, 5)"""
    return np.broadcast_to(0.2 + slope * np.arange(5.0)[:, None, None], (5, 5, 5))


@pytest.fixture(scope="module")
def both() -> tuple[ViewSet, ViewSet]:
    """Views of a ball, to train on and to test on."""
    image = from_array(ball(24), (2 / 23,) * 3, (-1.0,) * 3)
    train, test = make_views(image, TWO, n=12, test=3, size=64, mapper="cpu")
    assert test is not None
    return train, test


def test_a_classified_volume_keeps_its_values() -> None:
    """At every second vertex where there are two per voxel: the radius tells the value."""
    volume = volume_of(TWO)
    grid = volume.values
    assert grid is not None and grid.cells == volume.cells // 2
    inside = np.argwhere(grid.codes > 0)
    radius = np.linalg.norm(volume.box.to_world(inside / grid.cells), axis=1)
    value = (grid.codes[tuple(inside.T)] - 1) / 65472
    # The visible values run from .2 to .95, and the interval of the grid a tenth of that further, within all values.
    assert np.interp(grid.visible, [0, 1], grid.interval) == pytest.approx((0.2, 0.95), abs=2e-3)
    low, high = grid.interval
    assert (low, high) == pytest.approx((0.125, 1.0), abs=0.02)
    off = np.abs(low + (high - low) * value - np.clip(1 - radius, low, high))
    assert off.max() < 0.06 and off.mean() < 0.005  # a trilinear cone is blunt at its tip


@given(st.floats(0.01, 0.19), st.floats(0.1, 50.0))
def test_where_the_extinction_is_uniform_the_table_says_so(slope: float, extinction: float) -> None:
    grid = grid_of(ramp(slope), np.linspace(0.0, extinction, 9))
    vertices = np.argwhere(np.ones((9, 9, 9)))
    found = ExtinctionTable(grid, CPU).at(Places(grid, vertices, 8, CPU))
    expected = max(math.log(extinction), EMPTY_LOG_EXTINCTION)
    assert found.numpy() == pytest.approx(np.full(len(found), expected), abs=1e-4)


def test_the_table_starts_with_the_mean_over_the_values_of_a_cell() -> None:
    """A thin shell between two vertices is missed by neither."""
    integral = np.where(np.linspace(0, 1, 4097) < 0.5, 0.0, 3.0)  # all extinction at the value .5
    slope = 0.16
    grid = grid_of(ramp(slope), integral)  # x = 2 has the value .52
    found = ExtinctionTable(grid, CPU).at(Places(grid, np.array([[2, 2, 2], [0, 2, 2]]), 4, CPU))
    assert math.exp(float(found[0])) == pytest.approx(3.0 / slope, rel=0.1)
    assert float(found[1]) == EMPTY_LOG_EXTINCTION


def test_outside_of_the_volume_nothing_is_visible() -> None:
    codes = np.full((5, 5, 5), 30000, np.uint16)
    codes[3:] = 0
    grid = ValueGrid(4, codes, (0.0, 1.0), (0.0, 1.0), np.linspace(0.0, 5.0, 9))
    table, vertices = ExtinctionTable(grid, CPU), np.array([[0, 1, 1], [2, 1, 1], [3, 1, 1], [4, 4, 4]])
    found = table.at(Places(grid, vertices, 4, CPU)).tolist()
    assert found == pytest.approx([math.log(5.0)] * 2 + [EMPTY_LOG_EXTINCTION] * 2, abs=1e-4)


def test_a_step_goes_against_the_gradient_where_it_was_and_nowhere_else() -> None:
    grid = grid_of(ramp(0.1), np.linspace(0.0, 1.0, 9))
    table, places = ExtinctionTable(grid, CPU), Places(grid, np.argwhere(np.ones((5, 5, 5))), 4, CPU)
    before, moved = table.at(places), torch.zeros(125)
    moved[:25] = 1.0  # the vertices at x = 0
    table.step(moved, places, 0.1)
    change = (table.at(places) - before).reshape(5, 25)
    assert (change[0] < -0.05).all()
    assert change[1:].abs().max() < 1e-6


def test_features_are_value_and_normal() -> None:
    grid = replace(grid_of(ramp(0.1), np.linspace(0.0, 1.0, 9)), visible=(0.3, 0.5))
    value, normal = features_of(grid, np.array([[0, 1, 1], [2, 1, 1], [4, 1, 1]]), 4)
    assert value.tolist() == pytest.approx([0.0, 0.5, 1.0], abs=1e-3)
    assert normal == pytest.approx(np.array([[-1.0, 0.0, 0.0]] * 3), abs=2e-3)


def test_the_scene_is_better_than_one_that_learns_its_features(both: tuple[ViewSet, ViewSet], tmp_path: Path) -> None:
    """With the same number of steps, on unseen views; its file gives the same picture."""
    train, test = both
    scene, report = train_scene(train, SHORT)
    learned = replace(SHORT, values=False, recolour=replace(SHORT.recolour, feature_rate=0.02))
    other, _ = train_scene(train, learned, lighting="network")
    assert report["lighting"] == "phong" and "a function of the volume's values" in " ".join(report["notes"])
    ours, theirs = (evaluate_scene(s, test, "pcn").psnr for s in (scene, other))
    assert ours > max(30.0, theirs)
    assert len(scene.regions) == 2 and all(region.values for region in scene.regions)
    scene.save(tmp_path / "a.svv")
    assert evaluate_scene(Scene.load(tmp_path / "a.svv"), test, "pcn").psnr > ours - 1.0


@pytest.mark.parametrize("part", [0.3, pytest.param(0.9, marks=pytest.mark.slow)])
def test_a_stopped_training_goes_on(
    both: tuple[ViewSet, ViewSet], tmp_path: Path, every_step: None, part: float
) -> None:
    """In stage 1, with its table of the extinction, and in stage 2."""
    whole, _ = train_scene(both[0], SHORT)

    def stop(fraction: float, label: str) -> None:
        if fraction >= part:
            raise Cancelled

    with pytest.raises(Cancelled):
        train_scene(both[0], SHORT, stop, checkpoint=tmp_path / "c")
    again, _ = train_scene(both[0], SHORT, checkpoint=tmp_path / "c")
    camera = both[1].cameras[0]
    assert again.render(camera).rgba == pytest.approx(whole.render(camera).rgba, abs=2e-3)


def test_without_values_it_is_refused(both: tuple[ViewSet, ViewSet]) -> None:
    views = both[0]
    assert views.classified is not None
    for lacking in (replace(views, classified=None), replace(views, classified=replace(views.classified, values=None))):
        with pytest.raises(BadInput, match="needs the values of the volume"):
            train_scene(lacking, SHORT)
    with pytest.raises(BadInput, match="needs the values of the volume"):
        train_scene(views, SHORT, views_only=True)


def test_views_without_shading_get_no_light(both: tuple[ViewSet, ViewSet]) -> None:
    meta = both[0].meta
    assert meta.shading is not None
    flat = replace(both[0], meta=replace(meta, shading=replace(meta.shading, ambient=1.0, diffuse=0.0, specular=0.0)))
    scene, report = train_scene(flat, SHORT)
    assert report["lighting"] == "none" and scene.palette_network is not None and scene.palette_network.phong is None


def test_view_sets_keep_the_values(both: tuple[ViewSet, ViewSet], tmp_path: Path) -> None:
    views = both[0]
    views.write(tmp_path)
    assert views.classified is not None and views.classified.values is not None
    again = ViewSet.read(tmp_path).classified
    assert again is not None and again.values is not None
    for name in ("cells", "interval", "visible"):
        assert getattr(again.values, name) == getattr(views.classified.values, name)
    for name in ("codes", "integral"):
        np.testing.assert_array_equal(getattr(again.values, name), getattr(views.classified.values, name))


@pytest.mark.parametrize(
    "bad",
    [
        {"cells": 3},
        {"visible": (0.5, 0.2)},
        {"interval": (1.0, 1.0)},
        {"integral": np.array([1.0, 0.5])},
        {"codes": np.zeros((2, 2, 2), np.int32)},
    ],
)
def test_grids_that_are_no_values_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(BadInput):
        replace(grid_of(ramp(0.1), np.linspace(0.0, 1.0, 9)), **bad)


def test_every_preset_has_a_shorter_schedule_for_values() -> None:
    for name, plain in PRESETS.items():
        chosen: Preset = preset(name, "values")
        assert chosen.values and chosen.field.encoding == "lattice"
        assert chosen.reconstruct.iterations < plain.reconstruct.iterations


def moved_ball(shift: float) -> vtkImageData:
    """The ball, moved along x by a fraction of its radius."""
    axis = np.linspace(-1, 1, 24)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    values = np.clip(1 - np.sqrt((x - shift) ** 2 + y**2 + z**2), 0, 1)
    return from_array(values, (2 / 23,) * 3, (-1.0,) * 3)


@pytest.fixture(scope="module")
def followed(both: tuple[ViewSet, ViewSet]) -> Scene:
    """A trained scene of the ball in the middle."""
    return train_scene(both[0], SHORT)[0]


def tf_of(scene: Scene) -> TransferFunction:
    return TransferFunction.from_dict(scene.made["source"]["tf"])


def test_a_scene_follows_its_volume_without_training(followed: Scene) -> None:
    """On views that show the volume at another time, of which the scene has seen none."""
    image = moved_ball(0.25)
    _, test = make_views(image, TWO, n=3, test=3, size=64, mapper="cpu")
    assert test is not None
    there = at_volume(followed, classified_as(image, tf_of(followed)))
    middle = np.array(followed.occupancy.box.bounds).mean(axis=0)
    assert np.array(there.occupancy.box.bounds).mean(axis=0) - middle == pytest.approx((0.25, 0.0, 0.0), abs=0.15)
    assert evaluate_scene(there, test, "pcn").psnr > 29.0
    assert evaluate_scene(followed, test, "pcn").psnr < 25.0


def test_at_its_own_time_it_stays_the_same(followed: Scene, both: tuple[ViewSet, ViewSet], tmp_path: Path) -> None:
    """From a file, too, and with its edits."""
    edited = followed.edited(0, colour=(0.1, 0.8, 0.2))
    edited.save(tmp_path / "a.svv")
    volume = both[0].classified
    assert volume is not None
    camera = both[1].cameras[0]
    again = at_volume(Scene.load(tmp_path / "a.svv"), volume)
    assert np.abs(again.render(camera).rgba - edited.render(camera).rgba).mean() < 2e-3


def test_paint_stays_where_it_is(followed: Scene) -> None:
    paint = UnrestrictedField(followed.settings, followed.occupancy, direct=True)
    lattice = paint.encoding
    assert isinstance(lattice, SparseLattice)
    where = followed.occupancy.occupied, followed.occupancy.cells
    with torch.no_grad():  # red to the left of the middle, green to the right
        vertices = lattice.vertices_of_level(0, *where)
        right = torch.from_numpy(followed.occupancy.box.to_world(vertices / lattice.resolutions[0])[:, 0] > 0).float()
        lattice.table.copy_(torch.stack([1 - right, right, 0 * right], dim=1))
    painted = followed.painted(paint, {0: "a", 1: "a"}, {})
    there = at_volume(painted, classified_as(moved_ball(0.25), tf_of(followed)))
    assert there.styled is not None and there.variant == painted.variant
    at = torch.tensor(there.occupancy.box.to_box(np.array([[0.0, 0.3, 0.0], [0.5, 0.3, 0.0]])), dtype=torch.float32)
    left, right_one = there.styled(at).tolist()
    assert right_one == pytest.approx([0.0, 1.0, 0.0], abs=1e-4)
    assert left[2] == 0.0


def test_labels_without_values_between_are_refused(tmp_path: Path) -> None:
    """The look-ups interpolated between labels: 29 dB instead of 39, without a word."""
    labels = from_array(ball(24), (2 / 23,) * 3, (-1.0,) * 3)
    put(labels, Appearance(nearest=True))
    make_views(labels, TWO, n=8, size=16, mapper="cpu")[0].write(tmp_path, "train")
    with pytest.raises(BadInput, match=r"'values' interpolates .* choose the encoding 'lattice'"):
        train_scene(ViewSet.read(tmp_path, "train"), SHORT)


@pytest.mark.parametrize("encoding", ["lattice", "values"])
def test_empty_views_of_a_volume_are_refused(both: tuple[ViewSet, ViewSet], encoding: str) -> None:
    """It ended in an IndexError."""
    empty = replace(both[0], images=both[0].images * np.array([1, 1, 1, 0], np.uint8))
    with pytest.raises(BadInput, match="None of the 12 views shows anything"):
        train_scene(empty, "draft", encoding=encoding)


def test_what_cannot_follow_says_why(followed: Scene, both: tuple[ViewSet, ViewSet]) -> None:
    volume = both[0].classified
    assert volume is not None
    with pytest.raises(BadInput, match="--encoding values"):
        at_volume(replace(followed, values=None), volume)
    with pytest.raises(BadInput, match="without its values"):
        at_volume(followed, replace(volume, values=None))
    labels = from_array(ball(24), (2 / 23,) * 3, (-1.0,) * 3)
    put(labels, Appearance(nearest=True))
    with pytest.raises(BadInput, match="choose the encoding 'lattice'"):
        at_volume(followed, classified_as(labels, TWO))
    with pytest.raises(BadInput, match="the data runs from"):
        classified_as(from_array(np.full((8, 8, 8), 0.05), (1.0,) * 3, (0.0,) * 3), tf_of(followed))


@pytest.mark.slow
def test_a_corrected_palette_follows_unless_regions_share_values(
    followed: Scene, both: tuple[ViewSet, ViewSet]
) -> None:
    """Two colours of the same values cannot be told apart by them."""
    train, test = both
    merged, _ = correct_palette(followed, train, Correction(merge=((0, 1),)), "draft")
    assert merged.values is not None and len(merged.regions) == 1
    there = at_volume(merged, classified_as(moved_ball(0.2), tf_of(merged)))
    assert there.render(test.cameras[0]).rgba[..., 3].max() > 0.1
    added, _ = correct_palette(followed, train, Correction(add=((0.2, 0.9, 0.3),)), "draft")
    assert added.values is None
    with pytest.raises(BadInput, match="--encoding values"):
        at_volume(added, classified_as(moved_ball(0.2), tf_of(followed)))


def test_the_base_network_is_told_how_far_a_normal_turns_to_the_ray() -> None:
    """Whatever the direction in space: it need not find the light by itself."""
    occupancy = Occupancy(Box((0.0, 0.0, 0.0), 1.0, (1.0, 1.0, 1.0)), 2, np.ones((2, 2, 2), np.uint8))
    base = BaseField(FieldSettings(resolutions=(2,), facing=True), occupancy).requires_grad_(False)
    first = base.colour_mlp[0]
    assert isinstance(first, torch.nn.Linear)
    first.weight[:, :-2] = 0.0
    normal, ray = (normalize(torch.from_numpy(np.random.default_rng(k).normal(size=(9, 3)))).float() for k in (0, 1))
    cosine = (normal * ray).sum(dim=1)
    along = torch.tensor([[1.0, 0.0, 0.0]]).expand(9, 3)
    turned = torch.stack([0.0 * cosine, cosine.abs(), 0.3 + 0.0 * cosine, 0.2 + 0.0 * cosine], dim=1)
    found = base(torch.cat([torch.zeros(9, 1), normal], dim=1), spherical_harmonics(ray))
    torch.testing.assert_close(found, base(turned, spherical_harmonics(along)), atol=1e-5, rtol=0.0)
    assert found.std(dim=0).min() > 1e-4


def test_normals_are_those_of_differences_from_voxel_to_voxel() -> None:
    """Whatever the grid: here four of its cells are a voxel along x, at which interpolated values have a kink."""
    x, y = np.arange(17), np.arange(5)
    steep = np.interp(x, [0, 4, 8, 12, 16], [0.1, 0.1, 0.2, 0.8, 0.8])
    values = np.broadcast_to((steep[:, None] + 0.02 * y)[..., None], (17, 5, 3))
    codes = (1 + np.rint(65472 * values)).astype(np.uint16)
    edges = ((4.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    grid = ValueGrid(16, codes, (0.0, 1.0), (0.0, 1.0), edges=edges)
    found = features_of(grid, np.array([[8, 2, 1], [10, 2, 1], [12, 0, 1]]), 16)[1]
    slopes = np.array([0.7 / 8, (0.7 + 0.6) / 16, 0.6 / 8])
    expected = -np.stack([slopes, np.full(3, 0.02), np.zeros(3)], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(found, expected, atol=5e-3)
