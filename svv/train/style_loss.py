"""What a region's render is drawn towards: one style picture, its features and colours, and the loss against them.

The core is NNFM (StyleRF-VolVis, eq. 8) on the features of :mod:`svv.styles.features`. What is added can be turned off
(:data:`PAPER_LOSS`) and answers what goes wrong with NNFM alone: a smooth render stays with the few smooth places of
the style (balanced matching), colours drift (their mean and covariance), and views that disagree about where a stroke
lies average it away (the features' energy, and a start that is painted already and holds the strokes in place).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.core.filling import filled
from svv.core.nnfm import (
    cell_weights,
    colour_statistics,
    energy_loss,
    luminance,
    nnfm_loss,
    statistics_loss,
    total_variation,
)
from svv.styles.features import STRIDE, PatchFeatures
from svv.train.quilt import Guides

LEAST_SHARE = 0.3
"""Share of foreground from which on a cell of the feature map is matched."""


WHOLE, LEAST_CELLS = 0.95, 16
"""Share of foreground from which on a cell counts for the energy, and how many it takes: outlines would spoil it."""

LEAST_DETAIL = 0.01
"""A style's detail is taken to be this part of its mean feature at least, squares of both; paintings have 0.15. A style
darker than a middle grey counts as one. Without it a style of one colour gave losses of 1e8 to 1e10, beside which its
colour counted for nothing."""

FAINTEST = 0.02
"""Opacity from which on a pixel belongs to a region."""


@dataclass(frozen=True)
class StyleLossSettings:
    """Weights and sizes of the style loss."""

    style_size: int = 280
    """Long side in pixels that the style picture is brought to: strokes scale with it. A scene's parts are smaller than
    its views, so strokes for them are smaller than those of a picture as large as a view (400)."""
    larger: float = 1.0
    """By how much the strokes are larger than in other regions: ``style_size`` holds this factor already
    (:func:`svv.train.contrast.stroke_scales`)."""
    largest: float = 3.0
    """How much larger strokes become at most where a region is deep; 1 keeps all at their size."""
    contrast: bool = True
    """Whether paint that is laid gets the contrast at which it is seen as strong as the style
    (:func:`svv.train.contrast.match_contrast`)."""
    balance: float | None = None
    """How strictly all of the style is used (:func:`svv.core.nnfm.nearest`); None is the paper's plain matching."""
    octaves: int = 1
    """Scales of render and style that are matched: 1, or also halves of both (2), and so on."""
    colours: float = 3.0
    """Weight of mean and covariance of the region's colours against the style's."""
    energy: float = 0.0
    """Weight of the strength of each feature against the style's (:func:`svv.core.nnfm.energy_loss`)."""
    variation: float = 8.0
    """Weight of total variation within the region: without it the detail that views disagree about is noise."""
    most_vectors: int = 3000
    """Style vectors kept for matching, drawn at random beyond that."""
    seeded: bool = True
    """Whether a scene is painted with pieces of the style before the matching (:mod:`svv.train.painting`)."""
    guides: Guides = field(default_factory=Guides)
    """What the pieces of that start are chosen by."""
    anchor: float = 0.5
    """Weight of the squared distance to the colours at the start, in a scene: all views share its strokes."""
    along_rays: float = 0.0
    """Weight of the spread of a region's colours along the rays, in a scene
    (:func:`svv.train.stylize.spread_along_rays`): frames agree better, and strokes that only speckle go first."""
    rate: float = 0.02
    """Learning rate of a painting's colours in the matching, in units of them."""
    background: float | None = None
    """Grey level in [0, 1] behind a region's render; None is the luminance of the style's mean colour."""


PAPER_LOSS = StyleLossSettings(style_size=400, colours=0.0, variation=0.0, seeded=False, anchor=0.0)
"""The loss as the paper has it."""

PATCH_LOSS = StyleLossSettings(balance=0.05, energy=3.0, variation=0.0, along_rays=6.0, rate=0.1)
"""What suits patches in a cosine basis (:class:`svv.styles.features.PatchFeatures`), which know no shapes: a smooth
render would stay with the few smooth places of the style."""


def loss_for(network: nn.Module) -> StyleLossSettings:
    """The weights that suit a feature network."""
    return PATCH_LOSS if isinstance(network, PatchFeatures) else StyleLossSettings()


def enlarged(loss: StyleLossSettings, factor: float) -> StyleLossSettings:
    """A loss for strokes that are larger by a factor."""
    return replace(loss, style_size=round(loss.style_size * factor), larger=factor)


class StyleTarget:
    """A style picture made ready to be matched.

    Args:
        network: Frozen feature network: (n, 3, h, w) -> (n, c, h // 4, w // 4).
        style: (3, h, w) sRGB in [0, 1], on the network's device.
        settings: Weights and sizes.
        seed: Of the draw of style vectors and of the shifts of renders.
        mask: (h, w), true where the picture teaches; all of it if not given. Only patches whose centre lies in it are
            matched, mean and covariance are those of its pixels, and the painted start is made of it.
    """

    def __init__(
        self, network: nn.Module, style: Tensor, settings: StyleLossSettings, seed: int = 0, mask: Tensor | None = None
    ) -> None:
        self.network, self.settings = network, settings
        cover = None if mask is None else mask.to(style)[None]
        self.picture = resized(style, settings.style_size)
        share = None if cover is None else resized(cover, settings.style_size)
        self.inside: NDArray[np.bool_] | None = None
        """Where the mask is, at the picture's size; None is everywhere. (h, w)"""
        self.statistics = colour_statistics(self.picture.flatten(1).T, None if share is None else share.flatten())
        if share is not None:
            self.inside = (share[0] >= min(0.5, float(share.max()))).cpu().numpy()
            whole = filled(self.picture.permute(1, 2, 0).cpu().numpy(), self.inside, seed)
            self.picture = torch.from_numpy(whole).permute(2, 0, 1).to(style)
        chosen = settings.background
        self.background = float(luminance(self.statistics[0])) if chosen is None else chosen
        """Grey level in [0, 1] behind the region's render."""
        with torch.no_grad():
            grey = network(style.new_full((1, 3, 24, 24), 0.5))[0, :, 1:-1, 1:-1]
        self._grey = float(grey.mean((1, 2)).square().sum())
        """Square of a middle grey's mean feature."""
        self._generator = torch.Generator().manual_seed(seed)
        self._scales = [self._vectors(style, cover, settings.style_size >> k) for k in range(settings.octaves)]

    def _vectors(self, style: Tensor, cover: Tensor | None, size: int) -> tuple[Tensor, Tensor]:
        """Mean feature (C,) and centred features (M, C) of the style, where its mask is, at one scale."""
        with torch.no_grad():
            # The outermost cells have seen the reflection of the picture in its own rim.
            vectors = self.network(resized(style, size)[None])[0, :, 1:-1, 1:-1].flatten(1).T
            if cover is not None:
                share = F.avg_pool2d(resized(cover, size)[None], STRIDE)[0, 0, 1:-1, 1:-1].flatten()
                # A mask thinner than a cell fills none by half; its best cells speak for it.
                vectors = vectors[share >= min(0.5, float(share.max()))]
        pick = torch.randperm(len(vectors), generator=self._generator)[: self.settings.most_vectors].to(style.device)
        mean = vectors.mean(0)
        return mean, vectors[pick] - mean

    def loss(self, colours: Tensor, mask: Tensor) -> Tensor:
        """Style loss of a render.

        Args:
            colours: The region's colours, composited over ``background``, (3, h, w).
            mask: Its opacity in [0, 1], (h, w).

        Returns:
            A scalar.
        """
        settings = self.settings
        colours, mask = solid(colours, mask, self.background)
        loss = colours.new_zeros(())
        for octave, (mean, vectors) in enumerate(self._scales):
            picture, cover = F.avg_pool2d(colours, 1 << octave), F.avg_pool2d(mask[None], 1 << octave)[0]
            if min(cover.shape) < 5 * STRIDE:
                break
            loss = loss + self._matching(picture, cover, mean, vectors)
        if settings.colours:
            loss = loss + settings.colours * statistics_loss(colours.flatten(1).T, self.statistics, mask.flatten())
        if settings.variation:
            loss = loss + settings.variation * total_variation(colours, mask)
        return loss

    def _matching(self, picture: Tensor, cover: Tensor, mean: Tensor, vectors: Tensor) -> Tensor:
        # Cells stand on a grid of 4 pixels: a shift each time keeps the grid from showing.
        top, left = torch.randint(STRIDE, (2,), generator=self._generator).tolist()
        features = self.network(picture[None, :, top:, left:])[0].flatten(1).T - mean
        weights = cell_weights(cover[top:, left:], STRIDE)
        seen = weights > LEAST_SHARE
        features, weights = features[seen], weights[seen]
        loss = nnfm_loss(features, vectors, weights, self.settings.balance)
        whole = weights > WHOLE
        if self.settings.energy and int(whole.sum()) >= LEAST_CELLS:
            floor = LEAST_DETAIL * max(float(mean.square().sum()), self._grey)
            loss = loss + self.settings.energy * energy_loss(features[whole], vectors, floor=floor)
        return loss


def solid(colours: Tensor, mask: Tensor, background: float) -> tuple[Tensor, Tensor]:
    """A translucent region made opaque: as features see it, its strokes must not drown in the background.

    Its own colour c stays and its opacity m is divided by that of its more opaque parts, m' = min(1, m / m_90%).

    Args:
        colours: m c + (1 - m) background, (3, h, w).
        mask: m in [0, 1], (h, w).
        background: Grey level in [0, 1].

    Returns:
        m' c + (1 - m') background and m'. What is opaque already stays as it is.
    """
    there = mask.detach()[mask > FAINTEST]
    if len(there) == 0:
        return colours, mask
    gain = 1 / mask.clamp_min(float(there.quantile(0.9)))
    return background + (colours - background) * gain, mask * gain


def resized(picture: Tensor, long_side: int) -> Tensor:
    """A picture (3, h, w) brought to a long side in pixels, neither side under 24."""
    height, width = picture.shape[1:]
    factor = long_side / max(height, width)
    size = [max(24, round(height * factor)), max(24, round(width * factor))]
    return F.interpolate(picture[None], size=size, mode="bilinear", antialias=True, align_corners=False)[0].clamp(0, 1)
