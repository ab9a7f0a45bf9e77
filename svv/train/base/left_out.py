"""Pixels that show something although their rays meet no occupied cell: what pruning must not add to."""

from __future__ import annotations

from torch import Tensor

from svv.fields.radiance.occupancy import FAINTEST, Occupancy
from svv.fields.radiance.rendering import RayCaster
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU

COMPARED = 3
"""Number of views that are looked at."""

SHOWN = 3
"""Alpha of a pixel, of 255, from which it shows something."""

MISSED = 0.01
"""Part of the pixels that show something which may see no occupied cell without a word, or get to by pruning."""


def missed(views: ViewSet, occupancy: Occupancy) -> float:
    """Return the part of the pixels that show something, of a few views, whose rays meet no occupied cell."""
    shown, without = 0, 0
    for k in range(0, len(views), max(1, len(views) // COMPARED)):
        left = views.images[k, ..., 3].ravel() >= SHOWN
        shown += int(left.sum())
        left[RayCaster([views.cameras[k]], occupancy.box, CPU).in_sight(occupancy).numpy()] = False
        without += int(left.sum())
    return without / max(shown, 1)


def say_left_out(views: ViewSet, occupancy: Occupancy, before: Occupancy | None = None) -> str:
    """Return what is to be said, behind a sentence, of pixels that see no occupied cell, or did ``before``."""
    part = missed(views, occupancy) - (0.0 if before is None else missed(views, before))
    if part < MISSED:
        return ""
    return f"; {part:.0%} of the visible pixels show only haze that is too faint to be kept, and stay empty"


def prune_unseen(views: ViewSet, occupancy: Occupancy, extinction: Tensor, least: float, grow: bool) -> Occupancy:
    """Return the occupancy without cells whose extinction is below ``least``, or as it is where pixels need them.

    Haze around something opaque has little extinction, but pixels that show nothing else. Arguments as for
    :meth:`svv.fields.radiance.occupancy.Occupancy.pruned`.
    """
    if least <= FAINTEST:
        return occupancy.pruned(extinction, least, grow)
    # Twice as much: of haze around the limit, patches would stay.
    needed = missed(views, occupancy.pruned(extinction, 2.0 * least, grow)) > missed(views, occupancy) + MISSED
    return occupancy if needed else occupancy.pruned(extinction, least, grow)
