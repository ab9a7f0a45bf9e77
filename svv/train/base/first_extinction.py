"""What is known before the first step of training: where something may be visible, and a first extinction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from svv.core.rays.extinction import MOST_LOG_EXTINCTION
from svv.core.volumes.classified import ClassifiedVolume, ValueGrid
from svv.errors import BadInput, Progress
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, FieldSettings
from svv.fields.radiance.occupancy import (
    FAINTEST,
    Occupancy,
    carve,
    largest_in,
    least_extinction,
    pruned_extinction,
)
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU, kernels_of
from svv.train.base.left_out import prune_unseen, say_left_out
from svv.train.base.tomography import TomographyThere, extinction_from
from svv.train.run import ranks
from svv.train.run.checkpoint import Arrays
from svv.train.run.config import ReconstructSettings
from svv.train.run.views_there import views_on

MOST_CELLS = 256
"""Maximum number of cells along the longest side of an extinction reconstructed from views."""

FAINT_PRUNE_LEAST = 0.0007
"""Optical depth per step below which a cell is pruned where a tomography of translucent views found the extinction: it
is exact enough for a skin of 1 % in boxes without empty corners, whose steps are short."""

KNOWN_CELLS = 4
"""Maximum number of cells of an extinction that the volume tells, per cell of the finest features. Twice as many as
elsewhere gain 1.4 dB for a stent and 2 dB for an embryo."""

POINTS_AT_A_TIME = 1 << 18
"""Number of points whose extinction a network computes together."""


@dataclass(frozen=True)
class Beginning:
    """Where training starts."""

    occupancy: Occupancy
    """Cells that may hold something visible."""
    density: SparseLattice | None = None
    """Log extinction on the vertices of the occupied cells, one level; None if nothing is known about it."""
    measured: bool = False
    """Whether the log extinction was reconstructed from the views; otherwise it is the volume's."""
    values: ValueGrid | None = None
    """Values of the volume, if the scene is to be a function of them."""

    @classmethod
    def from_arrays(cls, occupancy: Occupancy, cells: int, arrays: Arrays) -> Beginning:
        """Return a beginning that the views told, from the result of :meth:`to_arrays`; ``cells`` per box unit."""
        density = SparseLattice(occupancy.occupied, occupancy.cells, (cells,), 1).requires_grad_(False)
        density.table.copy_(torch.from_numpy(arrays["table"].copy()))
        return cls(occupancy, density, measured=True)

    def to_arrays(self) -> Arrays:
        """Return the occupied cells and the log extinction, for a checkpoint."""
        assert self.density is not None
        return {"occupied": self.occupancy.occupied, "table": self.density.table.detach().numpy().copy()}


def first_occupancy(
    views: ViewSet, settings: ReconstructSettings, field: FieldSettings, progress: Progress, device: torch.device = CPU
) -> tuple[Occupancy, str]:
    """Return the initial occupancy and its reason: the visible part of the volume, or the visual hull of the views.

    Raises BadInput if no point is visible in all views, or they show nothing.
    """
    progress(0.0, "where to look")
    known = known_volume(views, settings, field)
    if known is None:
        there = None if kernels_of(device.type).TOMOGRAPHY is None else views_on(views, device)
        alpha = views.images[..., 3] if there is None else there.alpha
        occupancy = carve(alpha, views.cameras, settings.cells)
        reason = f"the visual hull of {len(views.cameras)} views fills {occupancy.fraction:.1%} of the box"
    else:
        if not views.images[..., 3].any():
            raise BadInput(
                "The views show nothing, although their volume has something to show: draw larger views, or choose "
                "higher opacities."
            )
        least = least_extinction(FAINTEST, float(np.exp(np.float64(known.exponent.max()))))
        occupied = known.occupied(settings.cells, least)
        occupancy = Occupancy(known.box, settings.cells, occupied)
        reason = (
            "the extinction is that of the volume and its transfer function, which fill "
            f"{occupancy.fraction:.1%} of the box; training refines it{say_left_out(views, occupancy)}"
        )
    progress(1.0, "where to look")
    return occupancy, reason


def begin(
    views: ViewSet,
    occupancy: Occupancy,
    field: FieldSettings,
    settings: ReconstructSettings,
    seed: int,
    progress: Progress,
    limit: float | None = None,
    device: torch.device = CPU,
) -> tuple[Beginning, str | None]:
    """Return where training starts, and how the extinction was found if the views had to tell.

    That ends after about ``limit`` seconds; ``seed`` is its seed, and ``progress`` is called several times a second.
    """
    known, finest = known_volume(views, settings, field), 2 * field.resolutions[-1]
    if known is not None:
        cells = min(KNOWN_CELLS * field.resolutions[-1], known.cells)
        density = SparseLattice(occupancy.occupied, occupancy.cells, (cells,), 1)
        with torch.no_grad():
            for rows, vertices in density.pieces_of_level(0, occupancy.occupied, occupancy.cells):
                density.table[rows, 0] = torch.from_numpy(known.at_vertices(vertices, cells))
        return Beginning(occupancy, density), None
    if field.encoding != "lattice" or not settings.tomography:
        return Beginning(occupancy), None

    def without_empty(lattice: SparseLattice, where: Occupancy, grow: bool) -> Occupancy:
        corners, device = lattice.resolutions[-1] <= where.cells, lattice.table.device
        extinction = largest_extinction(lambda points: lattice(points)[:, 0], where, device, corners=corners)
        least = least_extinction(pruned_extinction(FAINT_PRUNE_LEAST, 1.0 / finest), float(extinction.max()))
        left = prune_unseen(views, where, extinction, least, grow)
        return left if left.occupied.any() else where

    kernels = kernels_of(device.type).TOMOGRAPHY
    work = None if kernels is None else TomographyThere(views, occupancy, seed, kernels, device)
    density, left, reason = extinction_from(
        views, occupancy, min(finest, MOST_CELLS), without_empty, seed, progress, limit, work
    )
    reason = f"{reason}, in {left.fraction:.1%} of the box; training refines it{say_left_out(views, left, occupancy)}"
    return Beginning(left, density, measured=True), reason


def known_volume(views: ViewSet, settings: ReconstructSettings, field: FieldSettings) -> ClassifiedVolume | None:
    """Return the volume that initializes the density, if the views include it and the field is a lattice."""
    return views.classified if settings.use_volume and field.encoding == "lattice" else None


@torch.no_grad()
def largest_extinction(
    exponent: Callable[[Tensor], Tensor],
    occupancy: Occupancy,
    device: torch.device,
    shared: bool = False,
    corners: bool = False,
    lattice: SparseLattice | None = None,
) -> Tensor:
    """Return the largest extinction at 27 points of each occupied cell, in raster order.

    ``exponent`` is its logarithm (S,) at points (S, 3). Ranks that call this together (``shared``) each look at a part.
    The 8 ``corners`` are enough where the exponent is interpolated between them. If it is that of a ``lattice``, the
    vertices of this tell instead where they can (:meth:`svv.fields.radiance.encodings.SparseLattice.largest_in_cells`),
    and corners are enough where it has no vertex within a cell.
    """
    corners = corners or (lattice is not None and max(lattice.resolutions) <= occupancy.cells)
    corner = occupancy.occupied_on(device).nonzero()

    def largest(some: Tensor) -> Tensor:
        found = None if lattice is None else lattice.largest_in_cells(some, occupancy.cells)
        if found is None:
            return largest_in(exponent, some, occupancy, corners)
        return found.clamp_(max=MOST_LOG_EXTINCTION).exp_()

    if shared and ranks.many():
        part, whole = ranks.part(len(corner)), torch.zeros(len(corner), device=device)
        whole[part] = largest(corner[part])
        return ranks.summed(whole)
    return largest(corner)


def log_extinction(field: BaseField, points: Tensor) -> Tensor:
    """Return a field's log extinction at points of the box: (S, 3) -> (S,)."""
    if field.density is not None:
        return field.density(points).sum(dim=1)
    assert field.density_mlp is not None
    return torch.cat([field.density_mlp(field.encoding(p))[:, 0] for p in points.split(POINTS_AT_A_TIME)])
