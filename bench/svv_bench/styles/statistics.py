"""Similarity of two pictures in style: by AlexNet's activations, their statistics and neighbours, and by lines.

No painting is trained on these figures, so they can judge paintings made with other features.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from svv.errors import BadInput
from svv.train.lpips import MIN_SIZE, Lpips
from svv_bench.styles.lines import LEAST_PIXELS, StyleLines, interior, shuffled


@dataclass(frozen=True)
class Statistics:
    """Mean and standard deviation of each channel in AlexNet's five layers."""

    means: tuple[Tensor, ...]
    """Means per layer: (64,), (192,), (384,), (256,), (256,)."""
    deviations: tuple[Tensor, ...]
    """Standard deviations per layer, of the same shapes."""


NEIGHBOURS = 1
"""Layer, from 0, whose activations are matched to their nearest: in conv2, places are 8 pixels apart and see 51."""

WHOLE, LEAST_PLACES = 0.8, 8
"""Least share of a place that must be inside the mask, and least number of such places."""

Layers = list[tuple[Tensor, Tensor]]
"""Activations (channels, places) of each layer, and the fraction of each place that the mask covers (places,)."""


@torch.no_grad()
def style_activations(
    network: Lpips, picture: NDArray[np.floating], mask: NDArray[np.floating | np.bool_] | None = None
) -> Layers:
    """Return AlexNet's activations after each ReLU.

    Pixels outside the mask have no influence: before the network sees them, they get the mean colour of those inside.

    Args:
        network: Network from :func:`svv.train.lpips.load_lpips`; its heads are not used.
        picture: Picture in sRGB, in [0, 1], at least 31 x 31 pixels. (h, w, 3)
        mask: Where the picture counts, bool or in [0, 1]; all of it by default. (h, w)

    Raises:
        BadInput: The picture is too small, or the mask is empty or has another size.
    """
    if picture.ndim != 3 or picture.shape[2] != 3 or min(picture.shape[:2]) < MIN_SIZE:
        raise BadInput(f"Statistics of a style need a picture in colour of at least {MIN_SIZE} x {MIN_SIZE} pixels.")
    cover = np.ones(picture.shape[:2]) if mask is None else np.asarray(mask, np.float64)
    if cover.shape != picture.shape[:2] or cover.sum() <= 0:
        raise BadInput("The mask must have the picture's size and cover some of it.")
    inside = np.average(picture.reshape(-1, 3), axis=0, weights=cover.ravel())
    filled = np.where(cover[..., None] > 0, picture, 0) * cover[..., None] + inside * (1 - cover[..., None])
    x = torch.from_numpy(filled.astype(np.float32)).permute(2, 0, 1)[None] * 2 - 1
    share = torch.from_numpy(cover.astype(np.float32))[None]
    found = []
    for activation in network.activations(x.to(network.shift.device)):
        height, width = activation.shape[2:]
        covered = F.adaptive_avg_pool2d(share, (height, width)).to(activation)
        found.append((activation[0].flatten(1), covered.flatten()))
    return found


def style_statistics(layers: Layers) -> Statistics:
    """Return mean and deviation of each channel (Huang and Belongie 2017, eq. 5 and 6), weighted by coverage."""
    means, deviations = [], []
    for activation, covered in layers:
        weight = covered / covered.sum()
        mean = (activation * weight).sum(1)
        means.append(mean)
        deviations.append(((activation - mean[:, None]).square() * weight).sum(1).sqrt())
    return Statistics(tuple(means), tuple(deviations))


def statistics_distance(a: Statistics, b: Statistics) -> float:
    """Return the distance of two pictures' statistics, >= 0, and 0 if they are equal.

    sum over the layers of |mean_a - mean_b| + |deviation_a - deviation_b|, Euclidean lengths
    (Huang and Belongie 2017, eq. 13, there with VGG-19's layers).
    """
    pairs = [*zip(a.means, b.means, strict=True), *zip(a.deviations, b.deviations, strict=True)]
    return float(sum((x - y).norm() for x, y in pairs))


def places_of(layers: Layers) -> Tensor:
    """Return the activations of layer :data:`NEIGHBOURS` at places inside the mask. (places, channels)"""
    activation, covered = layers[NEIGHBOURS]
    return activation[:, covered > WHOLE].T


def neighbours_distance(a: Tensor, style: Tensor) -> float:
    """Return the mean cosine distance of places to their nearest in the style, plus that in reverse, in [0, 4].

    The first shows whether the picture has anything that the style lacks, the second whether the picture has all of the
    style (both directions as in Simakov et al. 2008, with features). The style's mean is subtracted from activations.

    Args:
        a: Activations of the picture. (places, channels)
        style: Activations of the style. (places, channels)
    """
    mean = style.mean(0)
    likeness = F.normalize(a - mean, dim=1) @ F.normalize(style - mean, dim=1).T
    return float(2.0 - likeness.amax(1).mean() - likeness.amax(0).mean())


class StyleJudge:
    """Comparison of pictures with one style by figures that nothing is trained on.

    Args:
        style: Style in sRGB, in [0, 1], scaled to give its strokes the wanted size. (h, w, 3)
        network: Network from :func:`svv.train.lpips.load_lpips`; if it is None, or the style is smaller than 31 x 31
            pixels, only lines are compared.
    """

    def __init__(self, style: NDArray[np.floating], network: Lpips | None) -> None:
        self.network = network = network if min(style.shape[:2]) >= MIN_SIZE else None
        self.lines = StyleLines.of(style)
        if network is not None:
            own, noise = style_activations(network, style), style_activations(network, shuffled(style))
            self.own, self.places = style_statistics(own), places_of(own)
            # Shuffling does not change a style of one colour: its distance from the noise is 0.
            self.unit = max(statistics_distance(self.own, style_statistics(noise)), 1e-6)
            self.far = max(neighbours_distance(places_of(noise), self.places), 1e-6)

    def figures(
        self, picture: NDArray[np.floating], mask: NDArray[np.floating | np.bool_] | None = None
    ) -> dict[str, float]:
        """Return distances of a picture from the style: 0 if equal, about 1 for white noise of the style's colours.

        Args:
            picture: Picture in sRGB, in [0, 1]. (h, w, 3)
            mask: Where the picture counts, bool or opacity; all of it by default. (h, w)

        Returns:
            ``neighbours`` and ``adain``: :func:`neighbours_distance` and the distance of the statistics of AlexNet's
            layers, both relative to that of noise (left out without a network); ``lines`` and its parts, see
            :meth:`svv_bench.styles.lines.StyleLines.distances`. Empty if too little of the picture is inside the mask.
        """
        inside = np.ones(picture.shape[:2], bool) if mask is None else np.asarray(mask) > 0.9
        if interior(inside).sum() < LEAST_PIXELS:
            return {}
        found = self.lines.distances(picture, inside)
        if self.network is None or min(picture.shape[:2]) < MIN_SIZE:
            return found
        layers = style_activations(self.network, picture, inside)
        found = {"adain": statistics_distance(self.own, style_statistics(layers)) / self.unit, **found}
        if len(places := places_of(layers)) >= LEAST_PLACES:
            found = {"neighbours": neighbours_distance(places, self.places) / self.far, **found}
        return found
