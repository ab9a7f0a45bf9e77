"""Which colour of a hand-made palette a point is the most like, for palettes that the images alone would mix up.

Of two similar hues, the weights of eq. 4 (StyleRF-VolVis) could take either and let the offsets do the rest: which one
they take is decided by chance, early in the training. The base network knows the colour of each point well enough
to tell.

Letters: S samples, P palette colours, R ranges of the transfer function.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.classified import ClassifiedVolume
from svv.train.ranges import Owners

HIGHLIGHT = 1.0
"""Weight of the squared grey light that is added to a colour, beside the squared error: light is rather none."""

DOUBT = 0.05
"""Difference of errors (RGB, root of that of the squares) at which a point is told apart with a certainty of 1 - 1/e:
the error of a base network's colours."""


class Likeness:
    """Says which region a point belongs to by its colour, within the ranges of the volume where these are known."""

    looks = True

    def __init__(
        self,
        palette: NDArray[np.floating],
        device: torch.device,
        volume: ClassifiedVolume | None = None,
        member: NDArray[np.bool_] | None = None,
    ) -> None:
        """Take a palette.

        Args:
            palette: Its colours, RGB in [0, 1]. (P, 3)
            device: Where points will be.
            volume: R ranges, where they are known, and
            member: whether each may be part of each region. (R, P)
        """
        self._palette = torch.as_tensor(palette, dtype=torch.float32, device=device)
        self._range = None if volume is None else Owners(volume, np.arange(len(volume.ranges)), device)
        self._member = None if member is None else torch.from_numpy(member).to(device)

    def errors(self, colour: Tensor) -> Tensor:
        """How far colours are from each palette colour, darkened and with grey light added: (S, 3) -> (S, P) squared.

        The minimum over 0 <= a <= 1 and b >= 0 of |c - a P - b (1, 1, 1)|^2 + ``HIGHLIGHT`` b^2, where first a is found
        as if there were no light.
        """
        p = self._palette
        a = ((colour @ p.T) / p.square().sum(1).clamp_min(1e-6)).clamp(0.0, 1.0)  # (S, P)
        for _ in range(2):  # in turn, for both have a closed form
            rest = colour[:, None] - a[..., None] * p
            b = (rest.sum(2) / (3.0 + HIGHLIGHT)).clamp_min(0.0)
            lit = colour[:, None] - b[..., None]
            a = ((lit * p).sum(2) / p.square().sum(1).clamp_min(1e-6)).clamp(0.0, 1.0)
        rest = colour[:, None] - a[..., None] * p - b[..., None]
        return rest.square().sum(2) + HIGHLIGHT * b.square()

    def told(self, weights: Tensor, position: Tensor, colour: Tensor | None) -> tuple[Tensor, Tensor]:
        """Region of points (S,), and the logarithm of its palette weight, as far as the region is certain. (S,)

        Args:
            weights: Palette weights, sum 1. (S, P)
            position: Points of the box. (S, 3)
            colour: What the base network sees there. (S, 3)
        """
        assert colour is not None
        error, allowed = self.errors(colour), torch.ones_like(weights)
        if self._range is not None and self._member is not None:
            may = self._member[self._range.of(position)]
            error, allowed = error.masked_fill(~may, torch.inf), may.to(weights.dtype)
        least, owner = error.min(dim=1)
        others = error.scatter(1, owner[:, None], torch.inf).amin(dim=1)
        sure = 1.0 - torch.exp(-(others - least) / DOUBT**2)
        own = weights.gather(1, owner[:, None])[:, 0]
        return owner, sure * own.log() + (1.0 - sure) * (weights * allowed).sum(dim=1).log()
