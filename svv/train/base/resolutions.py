"""Levels of lattices that views can resolve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera
from svv.fields.radiance.networks import FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.scene.scene import Scene
from svv.train.run.config import ReconstructSettings, StylizeSettings

USUAL = ReconstructSettings()
"""Settings of most presets."""


def paint_pixel(scene: Scene, settings: StylizeSettings) -> float:
    """Return the side of a pixel of the stylization views at the scene's centre, in box units."""
    return scene.rig.view_width / scene.occupancy.box.size / settings.style_size


def paint_resolutions(field: FieldSettings, cell: float | None, most: int) -> tuple[int, ...]:
    """Return the levels of a lattice for paint: the scene's, and finer ones up to a side of cells (None adds none).

    ``cell`` is that side in box units; ``most`` is the most cells along the longest side of an added level.
    """
    levels = field.resolutions + field.finer
    if field.encoding == "lattice" and cell is not None:
        while 1.0 / levels[-1] > cell and 2 * levels[-1] <= most:
            levels += (2 * levels[-1],)
    return levels


def fitted_field(
    field: FieldSettings, cameras: Sequence[Camera], box: Box, settings: ReconstructSettings = USUAL
) -> tuple[FieldSettings, str]:
    """Return the lattice levels that the views can resolve, and the reason in a sentence.

    Cells of the finest level cover at least ``settings.pixels_a_cell`` pixels of the views, and there are at most
    ``settings.most_cells`` of them along the box; each coarser level has half as many cells, down to 16.
    """
    finest, least = settings.most_cells, settings.pixels_a_cell
    pixel = pixel_in(cameras, box)
    best = 1.0 / (least * pixel)
    levels = [16]
    while levels[-1] * 2 <= min(best, finest):
        levels.append(levels[-1] * 2)
    reason = (
        f"a pixel covers 1/{1 / pixel:.0f} of the box, so the finest of {len(levels)} levels has {levels[-1]} cells: "
        f"{levels[-1] * 2} would be under {least:g} pixels per cell"
        if levels[-1] < finest
        else f"the finest of {len(levels)} levels has {finest} cells, the most this preset allows"
    )
    return FieldSettings(**{**field.to_json(), "resolutions": tuple(levels)}), reason  # type: ignore[arg-type]


def pixel_in(cameras: Sequence[Camera], box: Box) -> float:
    """Return the side of a pixel at the centre of a box, in box units; of several distances, what half resolve."""
    centre = box.bounds.mean(axis=0)
    return float(np.median([c.pixel_at(float(np.linalg.norm(c.position - centre))) for c in cameras]) / box.size)


def affordable_field(
    field: FieldSettings, occupancy: Occupancy, settings: ReconstructSettings
) -> tuple[FieldSettings, str | None]:
    """Return the lattice without the levels that need too much memory, and the reason if there are such levels.

    A level has about as many vertices as occupied cells: few on a surface, hundreds of millions in a fog.
    """
    levels, cells = field.resolutions, int(occupancy.occupied.sum())
    kept = [n for n in levels[1:] if cells * (n / occupancy.cells) ** 3 <= settings.most_vertices]
    if len(kept) == len(levels) - 1:
        return field, None
    fitting = (levels[0], *kept)
    reason = f"cells of {fitting[-1]} are the finest that {settings.most_vertices:,} vertices can hold here"
    return replace(field, resolutions=fitting), reason
