"""How alike two pictures are in manner: by AlexNet's activations, their statistics and their neighbours, and by lines.

No style is trained on either here, so both can judge what was painted with other features.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from svv.core.lines import LEAST_PIXELS, StyleLines, interior, shuffled
from svv.errors import BadInput
from svv.train.lpips import MIN_SIZE, Lpips


@dataclass(frozen=True)
class Statistics:
    """Mean and standard deviation of each channel, a pair for each of AlexNet's five layers."""

    means: tuple[Tensor, ...]
    """(64,), (192,), (384,), (256,), (256,)"""
    deviations: tuple[Tensor, ...]
    """As many."""


NEIGHBOURS = 1
"""The layer whose activations look for their nearest, from 0: of conv2, places are 8 pixels apart and see 51."""

WHOLE, LEAST_PLACES = 0.8, 8
"""Share of a place that must be inside to be one, and how many it takes."""

Layers = list[tuple[Tensor, Tensor]]
"""Of each layer the activations (channels, places), and how much of each place the mask covers (places,)."""


@torch.no_grad()
def style_activations(
    network: Lpips, picture: NDArray[np.floating], mask: NDArray[np.floating | np.bool_] | None = None
) -> Layers:
    """AlexNet's activations after each ReLU.

    What lies outside the mask does not count: it is given the mean colour of what lies inside before the network sees
    it.

    Args:
        network: :func:`svv.train.lpips.load_lpips`; its heads are not used.
        picture: (h, w, 3) sRGB in [0, 1], 31 x 31 pixels or more.
        mask: (h, w) in [0, 1] or bool: where the picture counts; all of it by default.

    Raises:
        BadInput: a picture that is too small, or a mask that is empty or of another size.
    """
    if picture.ndim != 3 or picture.shape[2] != 3 or min(picture.shape[:2]) < MIN_SIZE:
        raise BadInput(f"Statistics of a style need a picture of {MIN_SIZE} x {MIN_SIZE} pixels or more in colour.")
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
    """Mean and deviation of each channel (Huang and Belongie 2017, eq. 5 and 6); a place weighs what is covered."""
    means, deviations = [], []
    for activation, covered in layers:
        weight = covered / covered.sum()
        mean = (activation * weight).sum(1)
        means.append(mean)
        deviations.append(((activation - mean[:, None]).square() * weight).sum(1).sqrt())
    return Statistics(tuple(means), tuple(deviations))


def statistics_distance(a: Statistics, b: Statistics) -> float:
    """Distance of two pictures' statistics, >= 0 and 0 for equal ones.

    sum over the layers of |mean_a - mean_b| + |deviation_a - deviation_b|, Euclidean lengths
    (Huang and Belongie 2017, eq. 13, there with VGG-19's layers).
    """
    pairs = [*zip(a.means, b.means, strict=True), *zip(a.deviations, b.deviations, strict=True)]
    return float(sum((x - y).norm() for x, y in pairs))


def places_of(layers: Layers) -> Tensor:
    """The activations of :data:`NEIGHBOURS` at places that lie inside. (places, channels)"""
    activation, covered = layers[NEIGHBOURS]
    return activation[:, covered > WHOLE].T


def neighbours_distance(a: Tensor, style: Tensor) -> float:
    """Mean cosine distance of each place to its nearest in the style, plus that of the style's to theirs, from 0 to 4.

    The first says whether there is anything that the style has not, the second whether all of the style is there
    (both ways as Simakov et al. 2008, in features). Activations are taken about the style's mean.

    Args:
        a: Of the picture. (places, channels)
        style: Of the style. (places, channels)
    """
    mean = style.mean(0)
    likeness = F.normalize(a - mean, dim=1) @ F.normalize(style - mean, dim=1).T
    return float(2.0 - likeness.amax(1).mean() - likeness.amax(0).mean())


class StyleJudge:
    """Compares pictures with one style, in what nothing here is trained on.

    Args:
        style: (h, w, 3) sRGB in [0, 1], at the scale at which it is compared: strokes as large as they should be.
        network: :func:`svv.train.lpips.load_lpips`; None, or a style under 31 x 31 pixels: lines alone are compared.
    """

    def __init__(self, style: NDArray[np.floating], network: Lpips | None) -> None:
        self.network = network = network if min(style.shape[:2]) >= MIN_SIZE else None
        self.lines = StyleLines.of(style)
        if network is not None:
            own, noise = style_activations(network, style), style_activations(network, shuffled(style))
            self.own, self.places = style_statistics(own), places_of(own)
            # A style of one colour is its own noise.
            self.unit = max(statistics_distance(self.own, style_statistics(noise)), 1e-6)
            self.far = max(neighbours_distance(places_of(noise), self.places), 1e-6)

    def figures(
        self, picture: NDArray[np.floating], mask: NDArray[np.floating | np.bool_] | None = None
    ) -> dict[str, float]:
        """How far a picture is from the style; 0 is equal, about 1 white noise of the style's colours.

        Args:
            picture: (h, w, 3) sRGB in [0, 1].
            mask: (h, w), bool or opacity: where the picture counts; all of it by default.

        Returns:
            ``neighbours`` and ``adain``: :func:`neighbours_distance`, and distance of the statistics of AlexNet's
            layers, in units of noise's (without a network they are left out); ``lines`` and its parts, see
            :meth:`svv.core.lines.StyleLines.distances`. Nothing for a picture of which too little lies inside the mask.
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
