"""A view set on a GPU, where it stays: training rays, the visual hull and the first extinction all read its pixels."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import max_pool2d

from svv.io.views.viewset import ViewSet
from svv.train.run.pixels import MARGIN, STEPS

MOST_OF_GPU = 0.125
"""Share of a GPU's memory that views may take there; larger sets stay in the CPU's, which then draws the rays."""

AT_A_TIME = 1 << 21
"""Pixels whose contrast is computed together: their levels in single precision and their neighbours' take 100 MB."""


@dataclass(frozen=True)
class ViewsThere:
    """Pixels of a view set on a GPU, and which of them training rays are drawn from."""

    levels: Tensor
    """Straight RGBA of all views, uint8. (N, H, W, 4)"""
    index: Tensor
    """Flat indices of the pixels to draw from, by steps of contrast: :attr:`svv.train.run.pixels.Pixels.index`. (P,)"""
    counts: NDArray[np.int64]
    """Number of pixels of each step of contrast. (STEPS,)"""

    @property
    def alpha(self) -> Tensor:
        """Alpha of all views, uint8. (N, H, W)"""
        return self.levels[..., 3]


_THERE: WeakKeyDictionary[ViewSet, dict[torch.device, ViewsThere | None]] = WeakKeyDictionary()


def views_on(views: ViewSet, device: torch.device) -> ViewsThere | None:
    """Return a view set's pixels on a GPU, moved and sorted once; None on the CPU, or beyond :data:`MOST_OF_GPU`."""
    if device.type != "cuda":
        return None
    known = _THERE.setdefault(views, {})
    if device not in known:
        known[device] = _moved(views, device)
    return known[device]


def _moved(views: ViewSet, device: torch.device) -> ViewsThere | None:
    images = views.images
    room = MOST_OF_GPU * torch.cuda.get_device_properties(device).total_memory
    if images.nbytes > room or images.size // 4 > np.iinfo(np.int32).max:
        return None
    levels = torch.from_numpy(np.ascontiguousarray(images)).to(device)
    index, counts = sorted_by_contrast(levels)
    return None if images.nbytes + 4 * len(index) > room else ViewsThere(levels, index, counts)


def sorted_by_contrast(levels: Tensor) -> tuple[Tensor, NDArray[np.int64]]:
    """Return what :class:`svv.train.run.pixels.Pixels` finds, from levels (N, H, W, 4) uint8 on any device.

    Flat indices of the pixels near something visible by steps of contrast, int32 (P,), and the number of each (STEPS,).
    """
    views, height, width = levels.shape[:3]
    each: list[list[Tensor]] = [[] for _ in range(STEPS)]
    some = max(1, AT_A_TIME // (height * width))
    for first in range(0, views, some):
        step = _steps(levels[first : first + some]).flatten()
        for number, found in enumerate(each):
            found.append((step == number).nonzero()[:, 0].int() + first * height * width)
    whole = [torch.cat(found) for found in each]
    return torch.cat(whole), np.array([len(found) for found in whole])


def _steps(levels: Tensor) -> Tensor:
    """Return each pixel's step of contrast, STEPS where nothing is near: (n, H, W, 4) -> (n, H, W) uint8."""
    alpha = levels[..., 3:].int()
    shown = torch.div(levels[..., :3].int() * alpha, 255, rounding_mode="floor")
    planes = torch.cat([shown, alpha], dim=3).permute(0, 3, 1, 2).float()
    spread = max_pool2d(planes, 3, 1, 1) + max_pool2d(-planes, 3, 1, 1)
    contrast = (spread.square().sum(dim=1).sqrt() / 510.0).sqrt()
    near = max_pool2d((planes[:, 3:] > 0).float(), MARGIN, 1, MARGIN // 2)[:, 0] > 0
    return torch.where(near, (contrast * STEPS).clamp(max=STEPS - 1), float(STEPS)).byte()
