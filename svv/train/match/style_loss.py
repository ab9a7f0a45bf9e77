"""Style target of a region's render: the features and colours of one style picture, and the loss against them.

The core is NNFM (StyleRF-VolVis, eq. 8). Losses on mean and covariance and on total variation are additions.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from svv.core.images.nnfm import (
    cell_weights,
    colour_statistics,
    luminance,
    nnfm_loss,
    statistics_loss,
    total_variation,
)
from svv.styles.features import STRIDE
from svv.train.paint.pieces import resized

LEAST_SHARE = 0.3
"""Fraction of foreground above which a cell of the feature map is matched."""

SEEN_AROUND = 24
"""Distance in pixels up to which features see their surroundings: a conv3_3 of VGG-16 sees 20 pixels to each side."""

FAINTEST = 0.02
"""Opacity above which a pixel belongs to a region."""


@dataclass(frozen=True)
class StyleLossSettings:
    """Weights and sizes of the style loss."""

    style_size: int = 280
    """Long side in pixels to which the picture and its strokes are scaled: below views (400), as regions are."""
    colours: float = 3.0
    """Weight of the loss on the mean and covariance of the region's colours against the style's."""
    variation: float = 8.0
    """Weight of total variation within the region: without it, detail about which views disagree becomes noise."""
    most_vectors: int = 3000
    """Maximum number of style vectors kept for matching; more are sampled at random."""


PAPER_LOSS = StyleLossSettings(style_size=400, colours=0.0, variation=0.0)
"""The loss as in the paper, of the preset ``paper``. The defaults are for the methods that ours is compared with."""


class StyleTarget:
    """A style picture (3, h, w), sRGB in [0, 1], prepared for matching by a frozen feature network.

    The network takes (n, 3, h, w) to (n, c, h // 4, w // 4); ``mask`` (h, w) is the part whose patches and colours
    count.
    """

    def __init__(
        self, network: nn.Module, style: Tensor, settings: StyleLossSettings, seed: int = 0, mask: Tensor | None = None
    ) -> None:
        self.network, self.settings = network, settings
        cover = None if mask is None else mask.to(style)[None]
        self.picture = resized(style, settings.style_size)
        share = None if cover is None else resized(cover, settings.style_size)
        self.statistics = colour_statistics(self.picture.flatten(1).T, None if share is None else share.flatten())
        self.background = float(luminance(self.statistics[0]))
        """Grey level in [0, 1] behind the region's render: the luminance of the style's mean colour."""
        self._generator = torch.Generator().manual_seed(seed)
        self.mean, self.vectors = self._features(share)

    def _features(self, cover: Tensor | None) -> tuple[Tensor, Tensor]:
        """Return the mean feature (C,) and centred features (M, C) of the style within its mask (1, h, w)."""
        with torch.no_grad():
            # The outermost cells depend on the reflection of the picture at its own border.
            vectors = self.network(self.picture[None])[0, :, 1:-1, 1:-1].flatten(1).T
            if cover is not None:
                share = F.avg_pool2d(cover[None], STRIDE)[0, 0, 1:-1, 1:-1].flatten()
                # A mask thinner than a cell does not fill half of any cell; its fullest cells are used instead.
                vectors = vectors[share >= min(0.5, float(share.max()))]
        pick = torch.randperm(len(vectors), generator=self._generator)[: self.settings.most_vectors].to(vectors.device)
        mean = vectors.mean(0)
        return mean, vectors[pick] - mean

    def loss(self, colours: Tensor, mask: Tensor) -> Tensor:
        """Return the style loss of a region's colours over ``background`` (3, h, w) and opacity (h, w), a scalar."""
        settings = self.settings
        colours, mask = solid(colours, mask, self.background)
        loss = self._matching(colours, mask) if min(mask.shape) >= 5 * STRIDE else colours.new_zeros(())
        if settings.colours:
            loss = loss + settings.colours * statistics_loss(colours.flatten(1).T, self.statistics, mask.flatten())
        if settings.variation:
            loss = loss + settings.variation * total_variation(colours, mask)
        return loss

    def _matching(self, picture: Tensor, cover: Tensor) -> Tensor:
        picture, cover = cropped(picture, cover)
        # Cells lie on a grid of 4 pixels: a random shift each time keeps the grid from showing.
        top, left = torch.randint(STRIDE, (2,), generator=self._generator).tolist()
        features = self.network(picture[None, :, top:, left:])[0].flatten(1).T - self.mean
        weights = cell_weights(cover[top:, left:], STRIDE)
        seen = weights > LEAST_SHARE
        return nnfm_loss(features[seen], self.vectors, weights[seen])


def solid(colours: Tensor, mask: Tensor, background: float) -> tuple[Tensor, Tensor]:
    """Return a translucent region made opaque, so that its strokes do not drown in the background of features.

    Of its image m c + (1 - m) background (3, h, w) and opacity m (h, w), the colour c is kept, and m is divided by that
    of its more opaque parts: m' = min(1, m / m_90%).
    """
    there = mask.detach()[mask > FAINTEST]
    if len(there) == 0:
        return colours, mask
    gain = 1 / mask.clamp_min(float(there.quantile(0.9)))
    return background + (colours - background) * gain, mask * gain


def cropped(picture: Tensor, cover: Tensor) -> tuple[Tensor, Tensor]:
    """Crop a region's render (3, h, w) and share of pixels (h, w) to what is matched and what features see around."""
    there = cover.detach() > LEAST_SHARE
    for axis in (0, 1):
        lines = there.any(dim=1 - axis).nonzero()[:, 0]
        if len(lines) == 0:
            return picture, cover
        first = max(0, int(lines[0]) - SEEN_AROUND) // STRIDE * STRIDE  # the grid of cells stays where it is
        length = min(cover.shape[axis], int(lines[-1]) + SEEN_AROUND + 1) - first
        picture, cover = picture.narrow(axis + 1, first, length), cover.narrow(axis, first, length)
    return picture, cover
