"""What a region's render is drawn towards: one style picture, its features and colours, and the loss against them.

The core is NNFM (StyleRF-VolVis, eq. 8) on the features of :mod:`svv.train.features`. Around it stand terms that the paper
does not have, small, and off where their weight is 0: the way back from style to render (against repeating one
corner of the style), colour statistics (against drift) and total variation (against noise).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from svv.core.nnfm import (
    cell_weights,
    colour_statistics,
    covering_loss,
    luminance,
    nnfm_loss,
    statistics_loss,
    total_variation,
)
from svv.train.features import STRIDE, StyleFeatures


@dataclass(frozen=True)
class StyleLossSettings:
    """Weights and sizes of the style loss."""

    style_size: int = 400
    """Long side in pixels that the style picture is brought to: strokes scale with it."""
    octaves: int = 1
    """Scales of the style that are offered to the matching: 1, or also a half (2)."""
    centred: bool = True
    """Subtract the style's mean feature before directions are compared."""
    covering: float = 0.0
    """Weight of the way back: style vectors look for their nearest in the render."""
    colours: float = 0.0
    """Weight of mean and covariance of the region's colours against the style's."""
    variation: float = 0.0
    """Weight of total variation within the region."""
    most_vectors: int = 6000
    """Style vectors kept for matching, drawn at random beyond that."""


class StyleTarget:
    """A style picture made ready to be matched.

    Args:
        network: Frozen feature network.
        style: (3, h, w) sRGB in [0, 1].
        settings: Weights and sizes.
        seed: Of the draw of style vectors.
    """

    def __init__(self, network: StyleFeatures, style: Tensor, settings: StyleLossSettings, seed: int = 0) -> None:
        self.network, self.settings = network, settings
        style = resized(style, settings.style_size)
        pixels = style.flatten(1).T
        self.statistics = colour_statistics(pixels)
        self.background = float(luminance(self.statistics[0]))
        """Grey level in [0, 1] behind the region's render: the luminance of the style's mean colour."""
        scales = [style] + [resized(style, settings.style_size >> k) for k in range(1, settings.octaves)]
        with torch.no_grad():
            # The outermost cells have seen the reflection of the picture in its own rim.
            maps = [network(scale[None])[0, :, 1:-1, 1:-1].flatten(1).T for scale in scales]
        vectors = torch.cat(maps)
        self.mean = vectors.mean(0) if settings.centred else torch.zeros_like(vectors[0])
        pick = torch.randperm(len(vectors), generator=torch.Generator().manual_seed(seed))
        self.vectors = vectors[pick[: settings.most_vectors]] - self.mean  # (M, C)

    def loss(self, colours: Tensor, mask: Tensor) -> Tensor:
        """Style loss of a render.

        Args:
            colours: The region's colours, composited over ``background``, (3, h, w).
            mask: Its opacity in [0, 1], (h, w).

        Returns:
            A scalar.
        """
        settings = self.settings
        features = self.network(colours[None])[0].flatten(1).T - self.mean
        weights = cell_weights(mask, STRIDE)
        seen = weights > 0.1
        features, weights = features[seen], weights[seen]
        loss = nnfm_loss(features, self.vectors, weights)
        if settings.covering:
            loss = loss + settings.covering * covering_loss(features, self.vectors[: 2 * len(features)], weights)
        if settings.colours:
            loss = loss + settings.colours * statistics_loss(colours.flatten(1).T, self.statistics, mask.flatten())
        if settings.variation:
            loss = loss + settings.variation * total_variation(colours, mask)
        return loss


def resized(picture: Tensor, long_side: int) -> Tensor:
    """A picture (3, h, w) brought to a long side in pixels, neither side under 16."""
    height, width = picture.shape[1:]
    factor = long_side / max(height, width)
    size = [max(16, round(height * factor)), max(16, round(width * factor))]
    return F.interpolate(picture[None], size=size, mode="bilinear", antialias=True, align_corners=False)[0].clamp(0, 1)
