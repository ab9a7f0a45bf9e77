"""Finer features where a volume's normals turn within a cell: never for smooth volumes, nor where no pixel shows it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from svv.core.colour.shading import Shading
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.errors import silent
from svv.io.views.viewset import ViewSet
from svv.train.base.finer_features import finer_for_normals, interpolation_error
from svv.train.base.first_extinction import Beginning, begin, first_occupancy
from svv.train.base.resolutions import fitted_field
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS

DRAFT = PRESETS["draft"]
TF = TransferFunction([(0.0, 0.9, 0.6, 0.3)], [(0.0, 0.0, 0.5, 0.0), (0.4, 0.0, 0.5, 0.0), (0.6, 1.0, 0.5, 0.0)], 0.02)
SIDE = 64


def drawn(ripples: float, size: int = 160) -> ViewSet:
    """Views of a ball whose surface has ripples of five voxels, ``ripples`` voxels high."""
    x, y, z = (np.indices((SIDE,) * 3) - (SIDE - 1) / 2.0) / SIDE
    wave = np.sin(2.0 * np.pi * SIDE / 5.0 * x) * np.sin(2.0 * np.pi * SIDE / 5.0 * y) * ripples / SIDE
    value = 0.5 + 8.0 * (0.3 + wave - np.sqrt(x * x + y * y + z * z))
    image = from_array(np.clip(value, 0.0, 1.0).astype(np.float32), (1.0 / SIDE,) * 3, (0.0,) * 3)
    return make_views(image, TF, n=6, size=size, rescale=False)[0]


def begun(views: ViewSet, least: float) -> tuple[Beginning, int, str | None]:
    """Where training starts with cells of ``least`` pixels, the finest cells it decides on, and what it says."""
    settings = replace(DRAFT.reconstruct, pixels_a_cell=least)
    occupancy, _ = first_occupancy(views, settings, DRAFT.field, silent)
    field, _ = fitted_field(DRAFT.field, views.cameras, occupancy.box, settings)
    beginning, _ = begin(views, occupancy, field, settings, 0, silent)
    finer, reason = finer_for_normals(field, views, beginning, settings)
    assert (reason is None) == (finer == field)
    return beginning, finer.resolutions[-1], reason


def test_ripples_get_a_level_more_and_a_smooth_ball_none() -> None:
    cells = [begun(drawn(ripples), 4.0) for ripples in (0.0, 0.6)]
    assert [finest for _, finest, _ in cells] == [16, 32]
    assert cells[1][2] is not None and "dB: 32 cells" in cells[1][2]


def test_the_error_falls_with_the_cells() -> None:
    views = drawn(0.6)
    beginning = begun(views, 4.0)[0]
    assert views.classified is not None and views.classified.values is not None
    errors = [interpolation_error(cells, views, beginning, views.classified.values) for cells in (8, 16, 32, 64)]
    assert all(finer < 0.8 * coarser for coarser, finer in pairwise(errors)) and 0.0 < errors[-1] < errors[0] < 1


@pytest.mark.parametrize("case", ["too few pixels", "no shading", "no values", "no volume", "hardly any diffuse light"])
def test_nothing_is_added_where_it_would_not_be_seen(case: str) -> None:
    views = drawn(0.6, size=24 if case == "too few pixels" else 160)
    assert views.classified is not None
    if case == "no values":
        views = replace(views, classified=replace(views.classified, values=None))
    elif case == "no volume":
        views = replace(views, classified=None)
    elif case == "no shading":
        views = replace(views, meta=replace(views.meta, shading=None))
    elif case == "hardly any diffuse light":
        views = replace(views, meta=replace(views.meta, shading=Shading(ambient=1.0, diffuse=0.02)))
    _, finest, reason = begun(views, 2.5 if case == "too few pixels" else 4.0)
    assert finest == 16 and reason is None


def test_a_training_says_so() -> None:
    short = replace(
        DRAFT,
        reconstruct=replace(DRAFT.reconstruct, iterations=10, rays=256, pixels_a_cell=4.0),
        recolour=replace(DRAFT.recolour, iterations=4, rays=256),
    )
    scene, report = train_scene(drawn(0.6), short)
    assert scene.settings.resolutions + scene.settings.finer == (16, 32)
    assert sum("normals turn within these cells" in note for note in report["notes"]) == 1
