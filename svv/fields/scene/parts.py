"""Parts: connected pieces of regions that were split off by a click and are regions of their own.

A sample's region is the palette colour of its largest weight; a split divides a region by place. Cells of the box
belong to zones, and a table says for each zone to which region each palette colour belongs there. Zones divide the
space between pieces half way, so that soft edges, haze and faint mixtures belong to a piece as well. (With a region's
number in each cell, those on the border of two regions would leave shells of a hidden part behind.)

Letters: S samples, P palette colours, Z zones, N parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.fields.scene.region import Region
from svv.io.files.keyed_results import digest

if TYPE_CHECKING:
    import torch
    from torch import Tensor

MOST_ZONES = 256
"""Maximum number of zones, whose numbers are bytes."""

FINEST = 4
"""Maximum number of cells of zones along a side of a cell of the occupancy."""


@dataclass(frozen=True, eq=False)
class Parts:
    """Where the parts of regions are. Numbers of parts follow those of the palette's regions."""

    cells: int
    """Cells of ``zone`` per box unit; a multiple of those of the occupancy."""
    zone: NDArray[np.uint8]
    """Zone of each cell of the box. (X, Y, Z)"""
    inside: NDArray[np.bool_]
    """Whether each zone is inside each part's territory. (Z, N)"""
    active: int = 0
    """Number of parts whose splits were not undone: the first ones."""
    _moved: dict[torch.device, tuple[Tensor, Tensor]] = field(default_factory=dict, init=False, repr=False)
    """Zones and their table on the devices where they were used."""

    def __post_init__(self) -> None:
        if self.zone.max(initial=0) >= len(self.inside) or not 0 < len(self.inside) <= MOST_ZONES:
            raise ValueError("the zones of parts do not fit their table")
        if not 0 <= self.active <= self.inside.shape[1]:
            raise ValueError("the parts of regions do not fit their table")

    @cached_property
    def digest(self) -> str:
        """Hash of the zones and of their table."""
        return digest(self.cells, self.zone, self.inside)

    def regions_at(self, position: Tensor, colours: int, parents: Sequence[int]) -> Tensor:
        """Return the region to which each of P palette colours belongs at box coordinates. (S, 3) -> (S, P) int64

        ``parents``: region that each active part was split from.
        """
        import torch

        if position.device not in self._moved:
            table = table_of(self.inside[:, : self.active], colours, parents)
            self._moved[position.device] = (
                torch.from_numpy(self.zone.ravel()).to(position.device),
                torch.from_numpy(table).to(position.device),
            )
        zone, regions = self._moved[position.device]
        _, height, depth = self.zone.shape
        cell = (position * self.cells).to(torch.int32)  # coordinates are never negative
        ends = [n - 1 for n in self.zone.shape]
        x, y, z = (cell[:, axis].clamp_(0, end) for axis, end in enumerate(ends))
        return regions[zone[(x * height + y) * depth + z].int()]

    def with_part(self, territory: NDArray[np.bool_]) -> Parts:
        """Return the parts with one more after the active ones, in the cells of a territory (X, Y, Z).

        Undone ones are dropped. Raises OverflowError if there would be more than :data:`MOST_ZONES` zones.
        """
        code = 2 * self.zone.astype(np.int32) + territory
        present = np.flatnonzero(np.bincount(code.ravel(), minlength=2))
        rows = np.column_stack([self.inside[present // 2, : self.active], present % 2 > 0])
        inside, number = np.unique(rows, axis=0, return_inverse=True)
        if len(inside) > MOST_ZONES:
            raise OverflowError(f"{len(inside)} zones do not fit a byte")
        names = np.zeros(present[-1] + 1, np.uint8)
        names[present] = number.ravel()
        return Parts(self.cells, names[code], inside, self.active + 1)

    def without_undone(self) -> Parts | None:
        """Return the parts without those whose splits were undone; None if there is no other."""
        return replace(self, inside=self.inside[:, : self.active]) if self.active else None


def no_parts(shape: Sequence[int], cells: int) -> Parts:
    """Return parts without any, in a grid of this shape."""
    return Parts(cells, np.zeros(shape, np.uint8), np.zeros((1, 0), bool))


def table_of(inside: NDArray[np.bool_], colours: int, parents: Sequence[int]) -> NDArray[np.int64]:
    """Return the region of each of P palette colours in each zone. (Z, P)

    ``inside`` (Z, N): whether each zone is inside each part's territory; ``parents``: region that each part was split
    from: a palette's, or an earlier part's.
    """
    table = np.tile(np.arange(colours), (len(inside), 1))
    for number, parent in enumerate(parents):
        table[(table == parent) & inside[:, number, None]] = colours + number
    return table


def counted(parts: Parts | None, regions: Sequence[Region], layer: int) -> Parts | None:
    """Return parts of which as many are active as there are among the regions of a scene's layer."""
    active = sum(region.layer == layer and region.part_of is not None for region in regions)
    return parts if parts is None or parts.active == active else replace(parts, active=active)
