"""Other ways to stylize an orbit's frames as pictures, without a field, for comparison with ours.

They match the features of the other rivals (:mod:`svv_bench.styles.rivals`), as often, and have no regions or light.

- **frame by frame** (as Gatys et al. 2016): every frame is optimised independently of all others.
- **video** (ReReVST-like; Ruder, Dosovitskiy & Brox 2016): a frame starts from the previous one, warped along the exact
  flow, and is kept close to it where the flow is valid.
- **AdaIN** (Huang & Belongie 2017): mean and deviation of each channel of the features become the style's. Instead of
  using their decoder, the pixels are optimised.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.core.images.nnfm import cell_weights, colour_statistics, colour_transfer, total_variation
from svv.styles.features import STRIDE, VggFeatures
from svv.train.match.style_loss import LEAST_SHARE, StyleLossSettings, StyleTarget, solid
from svv.train.paint.styled_views import RIM

HELD = 100.0
"""Weight of the mean squared difference to the warped previous frame."""

WARPED_STEPS = 0.5
"""Fraction of a frame's steps for a frame that starts from the previous one, which is painted already."""

STATISTICS = 10.0
"""Weight of mean and deviation relative to the loss on features, whose weight is 1."""

LEAST_DETAIL = 0.01
"""Lower bound of a style's squared detail, as a fraction of its squared mean feature; paintings have 0.15. Without it,
a style of one colour gives an unbounded loss."""

FORMS = {"adain": 2}
"""To be raised when a mode paints otherwise; frames that are kept are then painted again."""

LEAST_VARIANCE = 1e-5
"""Term added to the variance of a channel before dividing by it."""


@dataclass(frozen=True)
class Before:
    """The previous frame, warped to the current one."""

    colours: NDArray[np.floating]
    """Straight colours in [0, 1], NaN where nothing arrived. (h, w, 3)"""
    valid: NDArray[np.bool_]
    """Whether a pixel's colour is reliable because both frames show it. (h, w)"""


def frame_alone(
    rgba: NDArray[np.floating], network: nn.Module, style: Tensor, loss: StyleLossSettings, steps: int, seed: int
) -> NDArray[np.float32]:
    """Optimise one image, straight alpha (h, w, 4) in [0, 1], towards a style (3, h, w); its alpha does not change."""
    # A new target per frame gives all of them the same random shifts.
    target = StyleTarget(network, style, loss, seed)
    return _painted(rgba, lambda colours, mask, _: stylized(colours, mask, target, steps))


def frame_after(
    rgba: NDArray[np.floating], before: Before, network: nn.Module, style: Tensor, loss: StyleLossSettings,
    steps: int, seed: int, held: float = HELD,
) -> NDArray[np.float32]:  # fmt: skip
    """Optimise one image of a sequence as :func:`frame_alone` does, but starting from, and close to, the previous one.

    A temporal loss is added to the style loss: the mean squared difference to the warped frame over the pixels where it
    is valid (Ruder, Dosovitskiy & Brox 2016, the short-term loss). Parts that the previous frame does not show start as
    in a separate frame.

    Args:
        rgba: The unstyled frame, straight alpha, in [0, 1]. (h, w, 4)
        before: The previous stylized frame, warped to this one.
        network: Feature network.
        style: Style picture, in [0, 1]. (3, h, w)
        loss: Settings of the style loss.
        steps: Steps of a separate frame, of which this one takes the fraction ``WARPED_STEPS``.
        seed: Seed of the style's vectors and of the shifts.
        held: Weight of the temporal loss.

    Returns:
        The stylized frame, with the alpha of ``rgba``. (h, w, 4)
    """
    target = StyleTarget(network, style, loss, seed)

    def paint(colours: Tensor, mask: Tensor, part: tuple[slice, slice]) -> Tensor:
        warped = torch.from_numpy(np.asarray(before.colours[part], np.float32)).permute(2, 0, 1)
        valid = torch.from_numpy(before.valid[part]) * mask
        arrived = warped.isfinite().all(0)
        warped = torch.where(arrived, warped, with_style_colours(colours, mask, target))

        def wanted(picture: Tensor) -> Tensor:
            moved = ((picture - warped).square().mean(0) * valid).sum() / valid.sum().clamp_min(1.0)
            return style_loss(picture, mask, target) + held * moved

        return optimised(warped, mask, wanted, max(1, round(WARPED_STEPS * steps)))

    return _painted(rgba, paint)


def frame_of_statistics(
    rgba: NDArray[np.floating], network: nn.Module, style: Tensor, loss: StyleLossSettings, steps: int, seed: int
) -> NDArray[np.float32]:
    """Optimise one image to have the frame's features with the style's statistics; see :func:`frame_alone`.

    Pixels are optimised towards features t = sigma_s (f_c - mu_c) / sigma_c + mu_s (AdaIN, eq. 8), where f_c are the
    original features of the frame, and towards mean mu_s and deviation sigma_s of the features (ibid., eq. 13; as style
    losses: Li et al. 2017, Demystifying neural style transfer). Only the style size and the total variation of ``loss``
    are used; the latter replaces the decoder's knowledge of pictures.

    With VGG-16, relu1_1 and relu2_1 must have the style's mean and deviation, too, as in AdaIN's style loss (ibid.; its
    relu4_1 is not among the weights used here): without them, hues drift from the style's.
    """
    target = StyleTarget(network, style, loss, seed)

    def paint(colours: Tensor, mask: Tensor, part: tuple[slice, slice]) -> Tensor:
        wanted = partial(StatisticsLoss(target, colours, mask).loss, mask=mask)
        return optimised(with_style_colours(colours, mask, target), mask, wanted, steps)

    return _painted(rgba, paint)


class StatisticsLoss:
    """AdaIN's content and style loss of a frame.

    Args:
        target: The style.
        colours: Straight colours of the unstyled frame. (3, h, w)
        mask: Opacity of the frame. (h, w)
    """

    def __init__(self, target: StyleTarget, colours: Tensor, mask: Tensor) -> None:
        self.target = target
        with torch.no_grad():
            style = target.network(target.picture[None])[0, :, 1:-1, 1:-1].flatten(1).T
            self.statistics = statistics_of(style, torch.ones_like(style[:, 0]))
            features, weights = self.features(colours, mask)
            (mean, deviation), (wanted, spread) = statistics_of(features, weights), self.statistics
            self.features_wanted = spread * (features - mean) / deviation + wanted
            early = [maps[0].flatten(1).T for maps in early_maps(target.network, target.picture[None])]
            self.early = [statistics_of(maps, torch.ones_like(maps[:, 0])) for maps in early]
        self.scale = _scale(wanted, spread)
        """Scale that makes losses of all kinds of features equally large."""

    def features(self, colours: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Return features (N, C) of cells, and their weights (N,)."""
        seen, cover = self._seen(colours, mask)
        weights = cell_weights(cover, STRIDE)
        return self.target.network(seen[None])[0].flatten(1).T, weights * (weights > LEAST_SHARE)

    def _seen(self, colours: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        behind = self.target.background
        return solid(colours * mask + behind * (1 - mask), mask, behind)

    def early_loss(self, colours: Tensor, mask: Tensor) -> Tensor:
        """Return the loss on mean and deviation of VGG-16's early layers, a scalar; 0 for other networks."""
        seen, cover = self._seen(colours, mask)
        losses = [seen.new_zeros(())]
        for level, (maps, wanted) in enumerate(zip(early_maps(self.target.network, seen[None]), self.early)):
            weights = cell_weights(cover, 1 << level)
            found = statistics_of(maps[0].flatten(1).T, weights * (weights > LEAST_SHARE))
            losses.append(_apart(found, wanted) / _scale(*wanted))
        return torch.stack(losses).sum()

    def loss(self, picture: Tensor, mask: Tensor) -> Tensor:
        """Return the loss of straight colours (3, h, w), a scalar."""
        features, weights = self.features(picture, mask)
        total = weights.sum().clamp_min(1e-6)
        content = ((features - self.features_wanted).square().sum(1) * weights).sum() / total
        style = _apart(statistics_of(features, weights), self.statistics) / self.scale + self.early_loss(picture, mask)
        smooth = self.target.settings.variation * total_variation(picture, mask)
        return content / self.scale + STATISTICS * style + smooth


def early_maps(network: nn.Module, image: Tensor) -> list[Tensor]:
    """Return relu1_1 (n, 64, h, w) and relu2_1 (n, 128, h // 2, w // 2) of images (n, 3, h, w) in [0, 1].

    Returns:
        The maps; none if the network is not VGG-16.
    """
    if not isinstance(network, VggFeatures):
        return []
    (first, second), (third, _) = network.layers[:2]
    one = torch.relu(first((image - network.mean) / network.deviation))
    return [one, torch.relu(third(F.max_pool2d(torch.relu(second(one)), 2)))]


def _apart(found: tuple[Tensor, Tensor], wanted: tuple[Tensor, Tensor]) -> Tensor:
    """Return the squared distance of means and of deviations, a scalar."""
    return torch.stack([(a - b).square().sum() for a, b in zip(found, wanted, strict=True)]).sum()


def _scale(mean: Tensor, deviation: Tensor) -> Tensor:
    """Return the squared detail of features with these statistics (C,), a scalar."""
    return deviation.square().sum().clamp_min(LEAST_DETAIL * float(mean.square().sum()) + LEAST_VARIANCE)


def statistics_of(features: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Return mean and deviation of each channel, both (C,), of features (N, C) with weights (N,)."""
    share = weights / weights.sum().clamp_min(1e-6)
    mean = share @ features
    return mean, (share @ (features - mean).square() + LEAST_VARIANCE).sqrt()


def _painted(
    rgba: NDArray[np.floating], paint: Callable[[Tensor, Tensor, tuple[slice, slice]], Tensor]
) -> NDArray[np.float32]:
    """Paint an image's colours in the bounding rectangle of what is visible; its alpha does not change.

    ``paint`` is called with colours (3, h, w), opacity (h, w) and the rows and columns of the rectangle.
    """
    result = np.array(rgba, np.float32)
    seen = np.argwhere(result[..., 3] > 0)
    if not len(seen):
        return result
    (top, left), (bottom, right) = (seen.min(0) - RIM).clip(min=0), seen.max(0) + RIM + 1
    part = slice(top, bottom), slice(left, right)
    cut = torch.from_numpy(result[part].copy()).permute(2, 0, 1)
    result[(*part, slice(3))] = paint(cut[:3], cut[3], part).permute(1, 2, 0).numpy()
    return result


def stylized(colours: Tensor, mask: Tensor, target: StyleTarget, steps: int, rate: float = 0.03) -> Tensor:
    """Optimise the colours (3, h, w) of a view towards a style; its opacity (h, w) does not change."""
    loss = partial(style_loss, mask=mask, target=target)
    return optimised(with_style_colours(colours, mask, target), mask, loss, steps, rate)


def with_style_colours(colours: Tensor, mask: Tensor, target: StyleTarget) -> Tensor:
    """Give colours (3, h, w) with opacity (h, w) the mean and covariance of the style's, to start a frame from."""
    matrix, offset = colour_transfer(colour_statistics(colours.flatten(1).T, mask.flatten()), target.statistics, 1e-3)
    return (torch.einsum("dc,chw->dhw", matrix, colours) + offset[:, None, None]).clamp(0.02, 0.98)


def style_loss(picture: Tensor, mask: Tensor, target: StyleTarget) -> Tensor:
    """Return the style loss of straight colours (3, h, w) with opacity (h, w), over the style's background."""
    return target.loss(picture * mask + target.background * (1 - mask), mask)


def optimised(start: Tensor, mask: Tensor, loss: Callable[[Tensor], Tensor], steps: int, rate: float = 0.03) -> Tensor:
    """Minimize a loss of colours (3, h, w) in [0, 1] with Adam, from a start.

    The change is a pyramid of five levels, as a radiance field has features at several resolutions. ``mask`` (h, w)
    weights the penalty on colours outside [0, 1], which the loss does not see.
    """
    size = mask.shape
    levels = [torch.zeros(1, 3, *(-(-n >> k) + 1 for n in size)).requires_grad_() for k in range(5)]
    optimizer = torch.optim.Adam(levels, rate)

    def picture() -> Tensor:
        return start + sum(F.interpolate(level, size=size, mode="bilinear")[0] for level in levels)

    for _ in range(steps):
        now = picture()
        outside = ((now - now.clamp(0, 1)).square() * mask).mean()
        total = loss(now.clamp(0, 1)) + 10 * outside
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
    return picture().detach().clamp(0, 1)
