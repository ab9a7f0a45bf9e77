"""How much of a region that views alone tell is likely to be right, from what single rays and pixels say of it.

Letters: S samples, R rays, V vertices, P regions, as in :mod:`svv.train.palette.along_rays`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.kernels.constants import moved
from svv.train.palette.along_rays import Seen, agreement, summed

Array = NDArray[np.float64]

ALWAYS, AGREEMENT, ERROR, TINT, BEHIND = 1.4, 1.1, -9.0, 0.35, -2.0
"""Log odds of what is right: always, and per log odds of the agreement, relative error, logarithm of the tint, and part
of the light in front. Fitted to 138 regions of 40 generated scenes (``campaign.doubtful_regions``, seeds 0 to 79 of
which the quotient by 4 is even), whose true overlaps are known; 174 regions of 56 others tested them.
"""

SUREST = 0.98
"""Agreement above which more does not tell more, nor less below its complement."""

LEAST_TINT = 0.01
"""Angle in radians that is added to a tint: the noise of a region's colour."""

DARKEST = 1e-3
"""Brightness that is added before logarithms are compared."""


@dataclass(frozen=True)
class Evidence:
    """What rays and pixels say of P regions, (P,) each."""

    agreement: Array
    """Intersection over union of a region and what single rays would call it, by light, in [0, 1]."""
    error: Array
    """Error of pixels across their own colours, relative to their brightness, where the region is alone in them."""
    tint: Array
    """Angle in radians between the mean light of its points and its colour."""
    behind: Array
    """Part of the light that other regions in front of it keep away, in [0, 1]."""


def likely_overlap(evidence: Evidence) -> Array:
    """Return how far each region is likely to overlap what it stands for: intersection over union, in [0, 1]. (P,)

    What is behind others and not tinted by them is less likely to be right than what is.

    >>> import numpy as np
    >>> from svv.train.palette.confidence import Evidence, likely_overlap
    >>> clear, doubtful = np.array([0.98, 0.0, 0.02, 0.0]), np.array([0.6, 0.05, 0.02, 0.4])
    >>> likely_overlap(Evidence(*np.stack([clear, doubtful], axis=1))).round(2).tolist()
    [0.99, 0.35]
    """
    sure = np.clip(evidence.agreement, 1.0 - SUREST, SUREST)
    odds = ALWAYS + AGREEMENT * np.log(sure / (1.0 - sure)) + ERROR * evidence.error
    odds += TINT * np.log(evidence.tint + LEAST_TINT) + BEHIND * evidence.behind
    return np.asarray(1.0 / (1.0 + np.exp(-odds)), np.float64)


def agreed_by_brightness(
    seen: Seen, colour: Tensor, looks: Tensor, own: Tensor, alike: NDArray[np.bool_]
) -> Array:  # fmt: skip
    """Return how far the brightness of points in rays agrees with their regions, among those of one hue: [0, 1]. (P,)

    Args:
        seen: What rays see.
        colour: Colour of each sample. (S, 3)
        looks: Sum of the light of each region's points. (P, 3)
        own: Region of each sample. (S,)
        alike: Which regions have one hue; one that is alone in its hue is agreed with. (P, P)
    """
    count = len(alike)
    if not np.triu(alike, 1).any():
        return np.ones(count)
    usual = looks / summed(own, seen.weight, count).clamp(min=1e-12)[:, None]
    here, there = (
        (light.double().clamp(min=0.0).square().sum(dim=1).sqrt() + DARKEST).log() for light in (colour, usual)
    )
    of_hue = moved(alike | np.eye(count, dtype=np.bool_), own.device)[own]
    told = (here[:, None] - there).abs().masked_fill(~of_hue, torch.inf).argmin(dim=1)
    both = summed(own * count + told, seen.weight, count**2).view(count, count).cpu().numpy()
    return agreement(both, np.zeros_like(alike))


def errors_where_alone(seen: Seen, region: Tensor, count: int) -> Array:
    """Return the error of pixels across their own colours, relative to their brightness, for regions (V,). (P,)

    A pixel counts for a region by the square of the region's part in it.
    """
    error = seen.errors(region, seen.light(region, count), 0.0).square().sum(dim=1).sqrt().double()
    part = summed(seen.ray * count + region[seen.vertex], seen.weight, count * len(seen.pixel)).view(-1, count)
    alone = part.square() / part.sum(dim=1, keepdim=True).clamp(min=1e-9)
    bright = seen.pixel.square().sum(dim=1).sqrt().double()
    return np.asarray(((error @ alone) / (bright @ part).clamp(min=1e-12)).cpu().numpy(), np.float64)


def light_in_front(seen: Seen, own: Tensor, count: int) -> Array:
    """Return the mean light that others have in front of a region's points, for regions (S,) of samples. (P,)"""
    first, light = seen.samples.first[seen.ray], []
    for number in range(count):  # one at a time: there may be tens of millions of samples
        mine = own == number
        weight = seen.weight.masked_fill(mine, 0.0)
        others = weight.cumsum(0, dtype=torch.float64).sub_(weight)  # of all rays so far
        others.sub_(others[first])
        weight = seen.weight.masked_fill(~mine, 0.0).double()
        light.append(float(others @ weight) / max(float(weight.sum()), 1e-12))
    return np.asarray(light, np.float64)
