"""Classified volumes: they attenuate rays as the ray caster does, and training starts from them."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.cli import app as cli
from svv.core.geometry.box import Box
from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION, OPAQUE_LOG_EXTINCTION
from svv.core.volumes.classified import ClassifiedVolume, ValueRange
from svv.dvr.draw.classify import classified
from svv.dvr.draw.frame import set_stage
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array, set_geometry
from svv.errors import BadInput, Cancelled, silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, RayCaster, composite, march
from svv.io.views.viewset import CLASSIFIED, ViewSet, read_classified
from svv.kernels.dispatch import CPU
from svv.train.base.first_extinction import begin, first_occupancy
from svv.train.base.reconstruct import Reconstruction
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import train_scene
from svv.train.run import loop
from svv.train.run.config import PRESETS, ReconstructSettings
from tests.nightly import nightly
from tests.stirred_volume import stirred_transfer_function, stirred_volume


def alpha_of(extinction: ClassifiedVolume, camera) -> np.ndarray:  # type: ignore[no-untyped-def]
    """What a view's alpha is if the extinction is all there is. (H, W)"""
    occupancy = Occupancy(extinction.box, 32, extinction.occupied(32, 0.01))
    lattice = SparseLattice(occupancy.occupied, 32, (extinction.cells,), 1)
    with torch.no_grad():
        values = extinction.at_vertices(lattice.vertices_of_level(0, occupancy.occupied, 32), extinction.cells)
        lattice.table.copy_(torch.from_numpy(values)[:, None])
    rays = RayCaster([camera], occupancy.box, CPU).view(0)
    samples = march(rays, occupancy, lattice, Marching(0.5 / extinction.cells, least_weight=0.0, stop=20.0))
    _, transmittance, _ = composite(samples, samples.sigma, torch.zeros(len(samples), 1))
    return 1.0 - transmittance.numpy().reshape(camera.height, camera.width)


@pytest.mark.parametrize(
    "turn",
    nightly(["as it is", "turned, stretched and far away", "mirrored"], "turned, stretched and far away"),
    ids=["plain", "turned", "mirrored"],
)
def test_it_dims_rays_as_the_ray_caster_does(turn: str) -> None:
    image = stirred_volume(48)
    if turn != "as it is":
        c, s = np.cos(0.5), np.sin(0.5)
        axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) * (3e-3, 4e-3, 5e-3)
        if turn == "mirrored":
            axes[:, 0] *= -1.0
        set_geometry(image, axes, np.array([100.0, -7.0, 3.0]))
    views, _ = make_views(image, stirred_transfer_function(), n=4, size=96, mapper="cpu", step=0.125)
    assert views.classified is not None
    for camera, drawn in zip(views.cameras, views.images, strict=True):
        error = alpha_of(views.classified, camera) - drawn[..., 3] / 255.0
        assert np.sqrt(np.square(error).mean()) < 0.03
        assert abs(error.mean()) < 0.012  # averaged shells hide a little more


def slab(opacity: float, unit: float) -> tuple[vtkImageData, TransferFunction]:
    image = from_array(np.full((9, 9, 9), 1.0, np.float32) + np.eye(9, dtype=np.float32) * 1e-3, (0.5,) * 3, (0.0,) * 3)
    return image, TransferFunction(((0, 1, 1, 1), (2, 1, 1, 1)), ((0, opacity, 0.5, 0), (2, opacity, 0.5, 0)), unit)


@given(st.floats(0.01, 0.99), st.floats(0.1, 10.0))
def test_a_uniform_volume_has_the_extinction_of_its_opacity(opacity: float, unit: float) -> None:
    """-ln(1 - a) / u, in 1 / box unit."""
    extinction = classified(set_stage(*slab(opacity, unit)))
    expected = np.log(-np.log(1.0 - opacity) / unit * extinction.box.size)
    np.testing.assert_allclose(
        extinction.exponent, np.clip(expected, EMPTY_LOG_EXTINCTION, OPAQUE_LOG_EXTINCTION), atol=5e-3
    )


@pytest.mark.parametrize("opaque", [3.0, 300.0, 1e5])
def test_haze_of_another_colour_is_a_range_of_its_own(opaque: float) -> None:
    """However opaque a core is, it shows no more than all of what a ray meets."""
    blue, orange = (0.1, 0.2, 0.9), (1.0, 0.6, 0.1)
    z, y, x = (np.indices((24, 24, 24)) - 11.5) / 24
    values = np.clip(2.5 - 5.0 * np.sqrt(x * x + y * y + z * z), 0.0, 1.0)  # 1 in the middle, 0 near the faces
    extinction = ((0.0, 0.0), (0.1, 0.0), (0.2, 0.5), (0.8, 0.5), (0.81, opaque), (1.0, opaque))  # 1 / box unit
    opacities = tuple((v, 1.0 - np.exp(-s / 23.0), 0.5, 0.0) for v, s in extinction)
    tf = TransferFunction(((0.0, *blue), (0.8, *blue), (0.81, *orange), (1.0, *orange)), opacities, 1.0)
    found = classified(set_stage(from_array(values.astype(np.float32), (1.0,) * 3, (0.0,) * 3), tf)).ranges
    assert len(found) == 2
    np.testing.assert_allclose([r.colour for r in found], [blue, orange], atol=0.15)


def test_little_that_is_opaque_is_a_range_beside_much_haze() -> None:
    """A ramp of opacities, as ParaView's default: a bone in a body that fills the volume."""
    z, y, x = (np.indices((32, 32, 32)) - 15.5) / 32
    values = 0.1 + 0.1 * x + 0.8 * (np.sqrt(x * x + y * y + z * z) < 0.1)
    tf = TransferFunction(
        ((0.0, 0.1, 0.2, 0.9), (1.0, 0.9, 0.2, 0.1)), ((0.0, 0.0, 0.5, 0.0), (1.0, 1.0, 0.5, 0.0)), 1.0
    )
    found = classified(set_stage(from_array(values.astype(np.float32), (1.0,) * 3, (0.0,) * 3), tf)).ranges
    assert len(found) >= 2 and found[-1].low > 0.3


def test_a_range_between_two_voxels_is_seen() -> None:
    """A jump across a narrow visible range leaves a thin shell, whose optical depth is the mean over the values."""
    values = np.zeros((16, 16, 16), np.float32)
    values[8:] = 1.0
    opacities = ((0, 0, 0.5, 0), (0.45, 0, 0.5, 0), (0.5, 0.9, 0.5, 0), (0.55, 0, 0.5, 0), (1, 0, 0.5, 0))
    tf = TransferFunction(((0, 1, 1, 1), (1, 1, 1, 1)), opacities, 1.0)
    extinction = classified(set_stage(from_array(values, (1.0,) * 3, (0.0,) * 3), tf))
    line = np.exp(extinction.exponent[8, 8].astype(float)).sum() / extinction.cells
    known = np.linspace(0, 1, 10001)
    assert line == pytest.approx(np.trapezoid(-np.log1p(-tf.opacity_at(known)), known), rel=0.1)


@given(
    st.sampled_from([4, 8, 16]), st.sampled_from([4, 8, 16]), st.integers(0, 2**31),
    st.tuples(*[st.floats(0.2, 1.0)] * 2),
)  # fmt: skip
def test_occupied_cells_are_those_with_a_visible_vertex(
    grid: int, cells: int, seed: int, sides: tuple[float, float]
) -> None:
    box = Box((0.0, 0.0, 0.0), 1.0, (1.0, *sides))
    shape = np.ceil(np.array(box.extent) * grid - 1e-6).astype(int) + 1
    exponent = np.where(np.random.default_rng(seed).random(shape) < 0.05, 2.0, EMPTY_LOG_EXTINCTION).astype(np.float16)
    volume = ClassifiedVolume(box, grid, exponent, np.zeros(shape, np.uint8), (ValueRange(0.0, 1.0, (1.0, 0.0, 0.0)),))
    found = volume.occupied(cells, 1.0)
    expected = np.zeros_like(found)
    side = max(grid, cells)
    for fine in np.ndindex(*(n * side // cells for n in found.shape)):
        corners = [tuple(c * grid // side + np.array(d)) for c in [np.array(fine)] for d in np.ndindex(2, 2, 2)]
        if any(all(a < b for a, b in zip(c, shape)) and exponent[c] > 0 for c in corners):
            expected[tuple(np.array(fine) * cells // side)] = 1
    np.testing.assert_array_equal(found, expected)


@pytest.fixture(scope="module")
def views() -> tuple[ViewSet, ViewSet]:
    train, test = make_views(stirred_volume(32), stirred_transfer_function(), n=20, size=96, test=3, mapper="cpu")
    assert test is not None
    return train, test


def test_it_is_written_and_read_with_the_views(views: tuple[ViewSet, ViewSet], tmp_path: Path) -> None:
    train, _ = views
    train.write(tmp_path)
    again = ViewSet.read(tmp_path).classified
    assert again is not None and train.classified is not None
    assert (again.box, again.cells) == (train.classified.box, train.classified.cells)
    np.testing.assert_array_equal(again.exponent, train.classified.exponent)

    replace(train, classified=None).write(tmp_path)  # other views over it: the old file must not speak for them
    assert ViewSet.read(tmp_path).classified is None

    train.write(tmp_path)
    (tmp_path / CLASSIFIED).unlink()
    assert ViewSet.read(tmp_path).classified is None


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nonsense", b"\x93NUMPY"])
def test_a_damaged_file_is_named(views: tuple[ViewSet, ViewSet], tmp_path: Path, content: bytes) -> None:
    views[0].write(tmp_path)
    (tmp_path / CLASSIFIED).write_bytes(content)
    with pytest.raises(BadInput, match=CLASSIFIED):
        ViewSet.read(tmp_path)


def test_training_begins_with_it(views: tuple[ViewSet, ViewSet]) -> None:
    train, field, settings = views[0], PRESETS["draft"].field, ReconstructSettings(cells=32)
    assert train.classified is not None
    occupancy, reason = first_occupancy(train, settings, field, silent)
    assert "volume" in reason
    field = replace(field, resolutions=(8, 16, 32))
    work = Reconstruction(train, begin(train, occupancy, field, settings, 0, silent)[0], field, settings)
    density = work.field.density
    assert density is not None and density.resolutions == (64,)
    vertices = density.vertices_of_level(0, occupancy.occupied, occupancy.cells)
    places = torch.from_numpy(density.places_of_level(0, occupancy.occupied, occupancy.cells))
    expected = train.classified.at_vertices(vertices, 64)
    np.testing.assert_allclose(density(places)[:, 0].detach(), expected, atol=1e-4)


@pytest.mark.slow
def test_it_helps(views: tuple[ViewSet, ViewSet]) -> None:
    """The same few steps with it and without, from a fog."""
    train, test = views
    short = replace(
        PRESETS["draft"], reconstruct=ReconstructSettings(iterations=120, rays=1024, cells=32, tomography=False),
        recolour=replace(PRESETS["draft"].recolour, iterations=1),
    )  # fmt: skip
    with_it, _ = train_scene(train, short)
    without, _ = train_scene(replace(train, classified=None), short)
    scores = [evaluate_scene(scene, test, "base").psnr for scene in (with_it, without)]
    assert scores[0] > scores[1] + 0.3


@pytest.mark.slow
@pytest.mark.parametrize("alone", [pytest.param(False, marks=pytest.mark.slow), True])
def test_the_command_says_what_it_learned_from(
    views: tuple[ViewSet, ViewSet], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, alone: bool
) -> None:
    for each, split in zip(views, ("train", "test"), strict=True):
        each.write(tmp_path, split)
    report = tmp_path / "report.json"
    words = ["svv", "train", str(tmp_path), "--out", str(tmp_path / "a.svv"), "--preset", "draft"]
    words += ["--time-limit", "1", "--json", str(report)] + ["--views-only"] * alone
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    first = json.loads(report.read_text())["notes"][0]
    assert ("visual hull" in first) == alone and ("volume" in first) != alone
    words = ["svv", "evaluate", str(tmp_path / "a.svv"), "--views", str(tmp_path), "--json", str(report)]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    scores = json.loads(report.read_text())
    assert len(scores["region_overlap"]) == 3
    assert all(0.0 <= part <= 1.0 for part in scores["region_overlap"])


def test_a_classified_volume_that_the_views_do_not_name_is_none_of_theirs(
    views: tuple[ViewSet, ViewSet], tmp_path: Path
) -> None:
    assert read_classified(tmp_path) is None
    views[0].write(tmp_path)
    assert read_classified(tmp_path) is not None
    file = tmp_path / "transforms_train.json"
    content = json.loads(file.read_text())
    del content["svv_classified"]
    file.write_text(json.dumps(content))
    assert read_classified(tmp_path) is None
    file.write_text("no JSON")
    with pytest.raises(BadInput, match="make the views again"):
        read_classified(tmp_path)


@pytest.mark.slow
def test_a_stopped_training_goes_on_to_the_same_scene(views: tuple[ViewSet, ViewSet], tmp_path: Path) -> None:
    """Before the step is halved and after."""
    train, _ = views
    short = replace(
        PRESETS["draft"], reconstruct=ReconstructSettings(iterations=60, rays=512, cells=32, prune_every=10),
        recolour=replace(PRESETS["draft"].recolour, iterations=2),
    )  # fmt: skip
    whole, _ = train_scene(train, short)
    for stop_at in (0.2, 0.6):
        file = tmp_path / f"{stop_at}.checkpoint"

        def stop(fraction: float, _: str, limit: float = stop_at) -> None:
            if fraction > limit:
                raise Cancelled

        with pytest.MonkeyPatch.context() as patch:
            for name in ("SHOW_EVERY", "SAVE_EVERY"):
                patch.setattr(loop, name, 0.0)
            with pytest.raises(Cancelled):
                train_scene(train, short, progress=stop, checkpoint=file)
        again, _ = train_scene(train, short, checkpoint=file)
        for name, value in whole.base.state_dict().items():
            torch.testing.assert_close(again.base.state_dict()[name], value, msg=name)


def test_a_fog_that_is_hardly_there_is_looked_at() -> None:
    """Where the most there is lies below what pruning drops, that is what the scene is made of."""
    image = from_array(np.linspace(0, 1, 4096, dtype=np.float32).reshape(16, 16, 16), (1.0,) * 3, (0.0,) * 3)
    tf = TransferFunction(((0, 1, 1, 1), (1, 1, 1, 1)), ((0, 0.0, 0.5, 0), (1, 0.3, 0.5, 0)), 100.0)
    views, _ = make_views(image, tf, n=6, size=32, mapper="cpu")
    occupancy, _ = first_occupancy(views, ReconstructSettings(cells=32), PRESETS["draft"].field, silent)
    assert occupancy.fraction > 0.5


def hazy(depth: float) -> ViewSet:
    """Views of an opaque ball in a ball of haze that is three times as wide, ``depth`` being that of a box of haze."""
    r = np.sqrt(np.square(np.indices((64, 64, 64)) / 31.5 - 1.0).sum(axis=0))
    image = from_array(np.select([r < 0.3, r < 0.9], [1.0, 0.5]).astype(np.float32), (1 / 63,) * 3, (0.0,) * 3)
    faint = 1.0 - np.exp(-depth)
    opacity = [(0, 0), (0.35, 0), (0.4, faint), (0.6, faint), (0.85, 1 - 1e-9), (1, 1 - 1e-9)]
    colours = [(0, 0.9, 0.6, 0.2), (0.6, 0.9, 0.6, 0.2), (0.8, 0.2, 0.4, 0.9)]
    views, _ = make_views(
        image, TransferFunction(colours, [(x, y, 0.5, 0.0) for x, y in opacity], 1.0), n=9, size=64, rescale=False
    )
    return views


@pytest.mark.parametrize("cell", [2.5, 0.3], ids=["usual steps", "short steps"])
def test_haze_around_something_opaque_stays(cell: float) -> None:
    """Of a larger volume, haze with an alpha of a third vanished without a word, of this one with a seventh."""
    views, draft = hazy(0.16), PRESETS["draft"]
    short = replace(
        draft,
        reconstruct=replace(draft.reconstruct, iterations=20, rays=256, cells=32, prune_every=5, pixels_a_cell=cell),
        recolour=replace(draft.recolour, iterations=2, rays=256),
    )
    scene, report = train_scene(views, short)
    drawn = np.stack([scene.render(camera).rgba[..., 3] for camera in views.cameras]) * 255.0
    haze = (views.images[..., 3] > 5) & (views.images[..., 3] < 60)
    assert haze.mean() > 0.1
    np.testing.assert_allclose(drawn[haze].mean(), views.images[..., 3][haze].mean(), rtol=0.03)
    assert not any("too faint" in note for note in report["notes"])


@pytest.mark.parametrize(("factor", "stays"), [(0.7, True), (0.3, False)])
def test_haze_just_above_the_limit_stays_when_training_makes_it_fainter(factor: float, stays: bool) -> None:
    train, field, settings = (
        hazy(0.075),
        replace(PRESETS["draft"].field, resolutions=(8, 16, 32)),
        ReconstructSettings(cells=32),
    )
    occupancy, _ = first_occupancy(train, settings, field, silent)
    work = Reconstruction(train, begin(train, occupancy, field, settings, 0, silent)[0], field, settings)
    assert work.field.density is not None
    with torch.no_grad():
        work.field.density.table.add_(float(np.log(factor)))
    work.prune(grow=False)
    assert (work.occupancy.fraction > 0.95 * occupancy.fraction) == stays


def test_haze_that_is_left_out_is_told() -> None:
    _, reason = first_occupancy(hazy(0.05), ReconstructSettings(cells=32), PRESETS["draft"].field, silent)
    assert re.search("[1-9][0-9]*% of the visible pixels show only haze that is too faint", reason)


def test_a_volume_of_one_value_is_not_empty() -> None:
    image = from_array(np.full((9, 9, 9), 1.0, np.float32), (0.5,) * 3, (0.0,) * 3)
    extinction = classified(set_stage(image, slab(0.5, 1.0)[1]))
    assert extinction.exponent.min() > 0.0


@pytest.mark.parametrize(
    "change",
    [
        {"cells": np.array(0)}, {"cells": np.array(48)}, {"size": np.array(-1.0)}, {"size": np.array(np.nan)},
        {"exponent": np.zeros((3, 3, 3), np.float16)}, {"exponent": np.full((65, 65, 65), np.nan, np.float16)},
        {"extent": np.array([1.0, 2.0, 1.0])},
    ],
    ids=["no cells", "odd cells", "turned inside out", "nowhere", "another grid", "not numbers", "too wide"],
)  # fmt: skip
def test_a_file_that_says_what_cannot_be_is_named(
    views: tuple[ViewSet, ViewSet], tmp_path: Path, change: dict[str, np.ndarray]
) -> None:
    views[0].write(tmp_path)
    with np.load(tmp_path / CLASSIFIED) as arrays:
        content = {k: arrays[k] for k in arrays.files}
    np.savez_compressed(tmp_path / CLASSIFIED, **(content | change))
    with pytest.raises(BadInput, match=CLASSIFIED):
        ViewSet.read(tmp_path)


def test_views_without_it_leave_no_file_of_others(views: tuple[ViewSet, ViewSet], tmp_path: Path) -> None:
    train, test = views
    train.write(tmp_path)
    test.write(tmp_path, "test")
    assert (tmp_path / CLASSIFIED).exists()
    replace(train, classified=None).write(tmp_path)
    assert not (tmp_path / CLASSIFIED).exists()


@pytest.mark.slow
def test_what_is_hardly_seen_is_not_pruned_away() -> None:
    """Of views with an alpha of 6 at most, nothing was left, and nothing said so."""
    z, y, x = np.indices((16, 16, 16)) - 7.5
    ball = np.clip(1.2 - np.sqrt(x * x + y * y + z * z) / 8.0, 0.0, 1.0).astype(np.float32)
    faint = TransferFunction([(0.0, 0.9, 0.7, 0.2)], [(0.0, 0.0, 0.5, 0.0), (0.3, 0.002, 0.5, 0.0)], 1.0)
    views, _ = make_views(from_array(ball), faint, n=8, size=32, rescale=False)
    assert 0 < views.images[..., 3].max() <= 8
    draft = PRESETS["draft"]
    short = replace(
        draft,
        reconstruct=replace(draft.reconstruct, iterations=250),
        recolour=replace(draft.recolour, iterations=20),
    )
    scene, _ = train_scene(views, short)
    drawn = np.stack([scene.render(camera).rgba[..., 3] for camera in views.cameras]) * 255.0
    assert drawn.mean() > 0.5 * views.images[..., 3].mean()
