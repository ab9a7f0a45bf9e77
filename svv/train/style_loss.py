"""Style target of a region's render: the features and colours of one style picture, and the loss against them.

The core is NNFM (StyleRF-VolVis, eq. 8) on the features of :mod:`svv.styles.features`. The additions can be turned off
(:data:`PAPER_LOSS`). They remedy problems of NNFM alone: a smooth render matches only the few smooth places of the
style (balanced matching), colours drift (loss on their mean and covariance), and strokes about whose position views
disagree average out (loss on the features' energy, and a painted start that holds the strokes in place).
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
"""Fraction of foreground above which a cell of the feature map is matched."""

SEEN_AROUND = 24
"""Distance in pixels up to which features see their surroundings: a conv3_3 of VGG-16 sees 20 pixels to each side."""

WHOLE, LEAST_CELLS = 0.95, 16
"""Fraction of foreground above which a cell counts for the energy, and minimum number of such cells: outlines would
distort it."""

LEAST_DETAIL = 0.01
"""Lower bound of a style's squared detail, as a fraction of its squared mean feature; paintings have 0.15. A style
darker than middle grey counts as middle grey. Without the bound, a style of one colour gave losses of 1e8 to 1e10, next
to which its colour had no effect."""

FAINTEST = 0.02
"""Opacity above which a pixel belongs to a region."""


@dataclass(frozen=True)
class StyleLossSettings:
    """Weights and sizes of the style loss."""

    style_size: int = 280
    """Long side in pixels to which the style picture is scaled: strokes scale with it. Parts of a scene are smaller
    than its views, so their strokes are smaller than those of a picture as large as a view (400)."""
    larger: float = 1.0
    """Factor by which strokes are larger than in other regions, already included in ``style_size``
    (:func:`svv.train.contrast.stroke_scales`)."""
    largest: float = 3.0
    """Maximum factor by which strokes become larger in deep regions; 1 keeps all strokes at their size."""
    contrast: bool = True
    """Whether laid paint gets the contrast with which it appears as strong as the style
    (:func:`svv.train.contrast.match_contrast`)."""
    balance: float | None = None
    """How strictly all of the style is used (:func:`svv.core.nnfm.nearest`); None for the paper's plain matching."""
    octaves: int = 1
    """Number of scales at which render and style are matched: each further one halves both."""
    colours: float = 3.0
    """Weight of the loss on the mean and covariance of the region's colours against the style's."""
    energy: float = 0.0
    """Weight of the loss on the strength of each feature against the style's (:func:`svv.core.nnfm.energy_loss`)."""
    variation: float = 8.0
    """Weight of total variation within the region: without it, detail about which views disagree becomes noise."""
    most_vectors: int = 3000
    """Maximum number of style vectors kept for matching; more are sampled at random."""
    seeded: bool = True
    """Whether a scene is painted with pieces of the style before the matching (:mod:`svv.train.painting`)."""
    guides: Guides = field(default_factory=Guides)
    """Weights by which the pieces of that start are chosen."""
    anchor: float = 0.5
    """Weight, in a scene, of the squared distance to the initial colours, whose strokes are common to all views."""
    along_rays: float = 0.0
    """Weight, in a scene, of the spread of a region's colours along rays (:func:`svv.train.stylize.spread_along_rays`):
    frames agree better, and strokes that only cause speckles vanish first."""
    rate: float = 0.02
    """Learning rate of a painting's colours in the matching, in units of colour."""
    background: float | None = None
    """Grey level in [0, 1] behind a region's render; None for the luminance of the style's mean colour."""


PAPER_LOSS = StyleLossSettings(style_size=400, colours=0.0, variation=0.0, seeded=False, anchor=0.0)
"""The loss as in the paper."""

PATCH_LOSS = StyleLossSettings(balance=0.05, energy=3.0, variation=0.0, along_rays=6.0, rate=0.1)
"""The loss for patches in a cosine basis (:class:`svv.styles.features.PatchFeatures`). They know no shapes, so
with plain matching a smooth render would match only the few smooth places of the style."""


def loss_for(network: nn.Module) -> StyleLossSettings:
    """Return the weights that suit a feature network."""
    return PATCH_LOSS if isinstance(network, PatchFeatures) else StyleLossSettings()


def enlarged(loss: StyleLossSettings, factor: float) -> StyleLossSettings:
    """Return the loss for strokes that are larger by ``factor``."""
    return replace(loss, style_size=round(loss.style_size * factor), larger=factor)


class StyleTarget:
    """A style picture prepared for matching.

    Args:
        network: Frozen feature network: (n, 3, h, w) -> (n, c, h // 4, w // 4).
        style: Picture (3, h, w), sRGB in [0, 1], on the network's device.
        settings: Weights and sizes.
        seed: Seed of the random style vectors and of the shifts of renders.
        mask: True for the part to learn from, (h, w); by default all of it. Only patches whose centre lies in it are
            matched, mean and covariance are those of its pixels, and the painted start uses only this part.
    """

    def __init__(
        self, network: nn.Module, style: Tensor, settings: StyleLossSettings, seed: int = 0, mask: Tensor | None = None
    ) -> None:
        self.network, self.settings = network, settings
        cover = None if mask is None else mask.to(style)[None]
        self.picture = resized(style, settings.style_size)
        share = None if cover is None else resized(cover, settings.style_size)
        self.inside: NDArray[np.bool_] | None = None
        """Mask at the picture's size; None for all of it. (h, w)"""
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
        """Squared mean feature of middle grey."""
        self._generator = torch.Generator().manual_seed(seed)
        self._scales = [self._vectors(style, cover, settings.style_size >> k) for k in range(settings.octaves)]

    def _vectors(self, style: Tensor, cover: Tensor | None, size: int) -> tuple[Tensor, Tensor]:
        """Return the mean feature (C,) and centred features (M, C) of the style within its mask, at one scale."""
        with torch.no_grad():
            # The outermost cells depend on the reflection of the picture at its own border.
            vectors = self.network(resized(style, size)[None])[0, :, 1:-1, 1:-1].flatten(1).T
            if cover is not None:
                share = F.avg_pool2d(resized(cover, size)[None], STRIDE)[0, 0, 1:-1, 1:-1].flatten()
                # A mask thinner than a cell does not fill half of any cell; its fullest cells are used instead.
                vectors = vectors[share >= min(0.5, float(share.max()))]
        pick = torch.randperm(len(vectors), generator=self._generator)[: self.settings.most_vectors].to(style.device)
        mean = vectors.mean(0)
        return mean, vectors[pick] - mean

    def loss(self, colours: Tensor, mask: Tensor) -> Tensor:
        """Return the style loss of a render, a scalar.

        Args:
            colours: Colours of the region, composited over ``background``. (3, h, w)
            mask: Opacity of the region, in [0, 1]. (h, w)
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
        picture, cover = cropped(picture, cover)
        # Cells lie on a grid of 4 pixels: a random shift each time keeps the grid from showing.
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
    """Make a translucent region opaque, so that its strokes do not drown in the background when features are computed.

    Its colour c is kept, and its opacity m is divided by that of its more opaque parts: m' = min(1, m / m_90%).

    Args:
        colours: m c + (1 - m) background. (3, h, w)
        mask: Opacity m in [0, 1]. (h, w)
        background: Grey level in [0, 1].

    Returns:
        m' c + (1 - m') background and m'. Opaque parts do not change.
    """
    there = mask.detach()[mask > FAINTEST]
    if len(there) == 0:
        return colours, mask
    gain = 1 / mask.clamp_min(float(there.quantile(0.9)))
    return background + (colours - background) * gain, mask * gain


def cropped(picture: Tensor, cover: Tensor) -> tuple[Tensor, Tensor]:
    """Crop a render to what is matched and what features see around it: a small region costs less than a large one.

    Args:
        picture: The render. (3, h, w)
        cover: Share of the region in its pixels, in [0, 1]. (h, w)

    Returns:
        Both, cropped to the pixels whose share exceeds ``LEAST_SHARE``, and :data:`SEEN_AROUND` more on each side.
    """
    there = cover.detach() > LEAST_SHARE
    for axis in (0, 1):
        lines = there.any(dim=1 - axis).nonzero()[:, 0]
        if len(lines) == 0:
            return picture, cover
        first = max(0, int(lines[0]) - SEEN_AROUND) // STRIDE * STRIDE  # the grid of cells stays where it is
        length = min(cover.shape[axis], int(lines[-1]) + SEEN_AROUND + 1) - first
        picture, cover = picture.narrow(axis + 1, first, length), cover.narrow(axis, first, length)
    return picture, cover


def resized(picture: Tensor, long_side: int) -> Tensor:
    """Return a picture (3, h, w) scaled to a long side in pixels, with neither side below 24."""
    height, width = picture.shape[1:]
    factor = long_side / max(height, width)
    size = [max(24, round(height * factor)), max(24, round(width * factor))]
    return F.interpolate(picture[None], size=size, mode="bilinear", antialias=True, align_corners=False)[0].clamp(0, 1)
