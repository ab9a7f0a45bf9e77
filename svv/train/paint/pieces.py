"""Pictures whose pieces are laid on regions (:mod:`svv.train.paint.quilt`): their size, mask and mean colour."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from svv.core.images.filling import filled
from svv.train.paint.ink import Style
from svv.train.paint.quilt import Guides


@dataclass(frozen=True)
class PieceSettings:
    """How pictures are laid in pieces."""

    size: int = 280
    """Long side in pixels to which a picture and its strokes are scaled: below that of views (400), as regions are."""
    largest: float = 3.0
    """Maximum factor on strokes in deep regions (``contrast.stroke_scales``); 1 keeps all at their size."""
    contrast: bool = True
    """Whether paint gets the contrast with which it appears as strong as the style (``contrast.match_contrast``)."""
    guides: Guides = field(default_factory=Guides)
    """Weights by which the pieces are chosen."""


@dataclass(frozen=True, eq=False)
class PieceStyle:
    """A picture at the size at which it appears on a region."""

    picture: Tensor
    """The picture, sRGB in [0, 1]; outside the mask, it is filled with texture from inside. (3, h, w)"""
    inside: NDArray[np.bool_] | None
    """True for the part to learn from; None for all of it. (h, w)"""
    mean: Tensor
    """Mean colour of that part. (3,)"""
    larger: float
    """Factor by which strokes are larger than in other regions, already included in the picture's size."""
    guides: Guides
    """Weights by which the pieces are chosen."""


def piece_style(
    picture: Style, mask: NDArray[np.bool_] | None, settings: PieceSettings, larger: float = 1.0, seed: int = 0,
    device: torch.device | None = None,
) -> PieceStyle:  # fmt: skip
    """Prepare a picture (H, W, 3), sRGB in [0, 1], larger by a factor; its mask (H, W) is the part to learn from."""
    values = np.ascontiguousarray(picture, np.float32)  # torch does not accept mirrored views of arrays
    size = round(settings.size * larger)
    scaled = resized(torch.from_numpy(values).permute(2, 0, 1), size)
    if mask is None:
        return PieceStyle(scaled.to(device), None, scaled.mean((1, 2)).to(device), larger, settings.guides)
    share = resized(torch.from_numpy(mask[None].astype(np.float32)), size)[0]
    mean = (scaled * share).sum((1, 2)) / share.sum()
    # A mask thinner than a pixel fills half of none; its fullest pixels are used instead.
    inside = (share >= min(0.5, float(share.max()))).numpy()
    whole = torch.from_numpy(filled(scaled.permute(1, 2, 0).numpy(), inside, seed)).permute(2, 0, 1)
    return PieceStyle(whole.to(device), inside, mean.to(device), larger, settings.guides)


def resized(picture: Tensor, long_side: int) -> Tensor:
    """Return a picture (3, h, w) scaled to a long side in pixels, with neither side below 24."""
    height, width = picture.shape[1:]
    factor = long_side / max(height, width)
    size = [max(24, round(height * factor)), max(24, round(width * factor))]
    return F.interpolate(picture[None], size=size, mode="bilinear", antialias=True, align_corners=False)[0].clamp(0, 1)
