"""The preset ``best``: finer cells, as many as memory holds, and every sample of an image."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from svv.core.geometry.box import Box
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.phong import softened_extinction
from svv.fields.scene.model import JOINED_WEIGHT
from svv.io.views.viewset import ViewSet
from svv.options.making import PRESET_NAMES
from svv.train.base.resolutions import affordable_field, fitted_field
from svv.train.palette import regions_from_views
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS
from svv_bench.chart.figures import DASHES, MARKERS
from svv_bench.chart.plan import SECONDS
from tests.balls import SHORT, balls_views

BEST = PRESETS["best"]
FEW = replace(
    BEST,
    field=SHORT.field,
    reconstruct=replace(BEST.reconstruct, iterations=40, rays=512, samples=4096, cells=32, prune_every=10),
    recolour=replace(BEST.recolour, iterations=20, rays=512, samples=4096),
)
FIELD = FieldSettings(resolutions=(16, 32, 64))


def half_full(cells: int) -> Occupancy:
    """A box of which one half is occupied."""
    occupied = np.zeros((cells,) * 3, np.uint8)
    occupied[: cells // 2] = 1
    return Occupancy(Box((0.0, 0.0, 0.0), 1.0, (1.0, 1.0, 1.0)), cells, occupied)


@pytest.fixture(scope="module")
def views() -> ViewSet:
    return balls_views()


def test_every_preset_has_its_place_on_the_chart() -> None:
    assert tuple(SECONDS) == tuple(MARKERS) == tuple(DASHES) == PRESET_NAMES


def test_its_cells_are_finer_than_those_of_the_default(views: ViewSet) -> None:
    box = half_full(32).box
    usual, _ = fitted_field(FieldSettings(), views.cameras, box)
    fine, reason = fitted_field(FieldSettings(), views.cameras, box, BEST.reconstruct)
    assert fine.resolutions[: len(usual.resolutions)] == usual.resolutions
    assert fine.resolutions[-1] >= 2 * usual.resolutions[-1]
    assert f"under {BEST.reconstruct.pixels_a_cell:g} pixels" in reason


@pytest.mark.parametrize(("most", "left"), [(64**3 // 2, (16, 32, 64)), (64**3 // 2 - 1, (16, 32)), (1, (16,))])
def test_levels_that_memory_cannot_hold_are_left_out(most: int, left: tuple[int, ...]) -> None:
    settings = replace(BEST.reconstruct, most_vertices=most)
    field, reason = affordable_field(FIELD, half_full(32), settings)
    assert field.resolutions == left
    assert (reason is None) == (left == FIELD.resolutions)
    if reason is not None:
        assert f"cells of {left[-1]} are the finest" in reason


@pytest.mark.slow
def test_a_known_density_becomes_finer_and_images_use_every_sample(views: ViewSet) -> None:
    scene, report = train_scene(views, FEW)
    coarse, _ = train_scene(views, replace(FEW, reconstruct=replace(FEW.reconstruct, refine_known=False)))
    assert scene.base.density is not None and coarse.base.density is not None
    assert scene.base.density.resolutions == (2 * coarse.base.density.resolutions[0],)
    assert (scene.stride, scene.joined) == (1.0, BEST.recolour.joined)
    assert scene.joined < JOINED_WEIGHT
    assert any("every sample" in note for note in report["notes"])
    assert report["preset"] == "best"


def test_regions_are_found_on_a_grid_that_memory_holds(views: ViewSet, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is worked on whole, not only where something is visible: 512 cells would take five gigabytes."""
    grids: list[int] = []
    whole = softened_extinction

    def softened(density: SparseLattice, occupancy: Occupancy, cells: int) -> Any:
        grids.append(cells)
        return whole(density, occupancy, cells)

    monkeypatch.setattr(regions_from_views, "softened_extinction", softened)
    monkeypatch.setattr(regions_from_views, "MOST_CELLS", 16)
    scene, _ = train_scene(views, FEW)
    assert grids == [16] and scene.settings.resolutions[-1] > 16
    assert scene.regions
