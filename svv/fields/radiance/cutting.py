"""Samples of rays through a scene that is cut open, or in which regions are hidden.

What cuts of all regions leave of a ray is one piece or several; cuts of some regions divide it further. The first
sample of a piece lies right behind its beginning, so that faces are sharp, and nothing that was cut off ends a ray.
Letters: R rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from svv.core.geometry.cuts import Cut, divide_rays
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, Rays, march
from svv.kernels.types import UNSURE, Left, Samples


@dataclass(frozen=True)
class OpenCells:
    """The cells of a scene in which some regions are cut off or hidden."""

    there: Occupancy
    """Those in which something may be left."""
    kept: Tensor
    """Cells in which nothing is cut off or hidden, on the device that renders. (X, Y, Z) bool"""

    @cached_property
    def distance(self) -> Tensor:
        """How far rays may leap, where it is unsure what is shown: see :attr:`svv.kernels.types.Left.distance`."""
        distance = self.there.distance_on(self.kept.device).clamp(max=UNSURE - 1)
        distance.view(8, -1)[:, ((distance[0] == 0) & ~self.kept).flatten().nonzero()[:, 0]] = UNSURE
        return distance


@torch.no_grad()
def march_uncut(
    rays: Rays, occupancy: Occupancy, density: SparseLattice | None, how: Marching, cuts: Sequence[Cut],
    opened: OpenCells | None,
) -> Samples:  # fmt: skip
    """Sample the parts of rays that no cut of all regions takes away, as :func:`march` does.

    Cuts, in world units, of some regions only, and hidden regions, are left to who knows the regions of the samples;
    ``opened`` are the cells for these. Only what is certainly shown ends a ray. Each sample lies inside or outside of
    every cut.
    """
    if not cuts and opened is None:
        return march(rays, occupancy, density, how)
    begin, end = rays.origins[:, :0], rays.origins[:, :0]
    if cuts:
        begin, end = divide_rays([cut.in_box(occupancy.box) for cut in cuts], rays.origins, rays.directions)
    if opened is None:
        return march(rays, occupancy, density, how, left=Left(begin, end))
    return march(rays, opened.there, density, how, left=Left(begin, end, opened.distance))
