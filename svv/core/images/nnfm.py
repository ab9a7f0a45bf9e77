"""Nearest-neighbour feature matching (NNFM) and related colour statistics.

The loss of StyleRF-VolVis (eq. 8; Zhang et al. 2022, ARF, eq. 1): each feature vector of a render moves towards the
most similar one of the style. Letters: N feature vectors of the render, M of the style, C channels each.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from svv.core.colour.colour import LUMA

VECTORS_AT_A_TIME = 2048
"""Number of render vectors compared at a time; limits the table of similarities to this many rows of M."""


@torch.no_grad()
def nearest(features: Tensor, style: Tensor, chunk: int = VECTORS_AT_A_TIME) -> Tensor:
    """Return the index of the style vector (M, C) at the smallest cosine distance of each vector of the render. (N,)

    ``chunk``: rows compared at a time, which affects memory, not the result.
    """
    directions = F.normalize(style, dim=1).T
    parts = F.normalize(features, dim=1).split(chunk)
    return torch.cat([(rows @ directions).argmax(1) for rows in parts])


def nnfm_loss(features: Tensor, style: Tensor, weights: Tensor | None = None, chunk: int = VECTORS_AT_A_TIME) -> Tensor:
    """Return the mean cosine distance in [0, 2] of a render to its nearest style vectors (StyleRF-VolVis, eq. 8).

    L = sum_i w_i (1 - f_i . s_j / (|f_i| |s_j|)) / sum_i w_i, j = nearest(i)

    ``features``: (N, C), ``style``: (M, C). Differentiable in both; the gradient of a minimum is that of the entry that
    attains it. ``weights`` >= 0 (N,) are equal if not given; all zero gives a loss of 0. ``chunk``: as for
    :func:`nearest`.
    """
    if len(features) == 0:
        return features.sum()
    distance = 1 - F.cosine_similarity(features, style[nearest(features, style, chunk)], dim=1)
    if weights is None:
        return distance.mean()
    return (distance * weights).sum() / weights.sum().clamp_min(torch.finfo(weights.dtype).eps)


def cell_weights(mask: Tensor, stride: int = 4) -> Tensor:
    """Return the share of foreground in each cell of a feature map, in the order of ``features.flatten(2)``.

    ``mask`` (h, w): opacity in [0, 1], cropped to multiples of the ``stride``, a cell's width in pixels, as in pooling.
    """
    return F.avg_pool2d(mask[None, None], stride).flatten()


def total_variation(image: Tensor, mask: Tensor | None = None) -> Tensor:
    """Return the mean squared difference >= 0 of neighbouring pixels of an image (c, h, w) that are both foreground.

    ``mask`` (h, w): weight of each pixel in [0, 1]; all count if not given.
    """
    across = (image[:, :, 1:] - image[:, :, :-1]).square().mean(0)
    down = (image[:, 1:] - image[:, :-1]).square().mean(0)
    if mask is None:
        return across.mean() + down.mean()
    both_across, both_down = mask[:, 1:] * mask[:, :-1], mask[1:] * mask[:-1]
    eps = torch.finfo(image.dtype).eps
    return (across * both_across).sum() / both_across.sum().clamp_min(eps) + (
        down * both_down
    ).sum() / both_down.sum().clamp_min(eps)


def luminance(colour: Tensor) -> Tensor:
    """Return L = 0.2126 R^2.2 + 0.7152 G^2.2 + 0.0722 B^2.2 of sRGB (..., 3) (StyleRF-VolVis, sec. 3.4). (...,)

    Colours are clamped first. The result is linear light; do not apply the power to it again.
    """
    return (colour.clamp(0, 1) ** 2.2 @ colour.new_tensor(LUMA)).clamp(0, 1)


def colour_statistics(colours: Tensor, weights: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Return the mean (3,) and covariance (3, 3) of colours (N, 3) with weights (N,) >= 0, equal by default."""
    share = torch.ones_like(colours[:, 0]) if weights is None else weights
    share = share / share.sum().clamp_min(torch.finfo(colours.dtype).tiny)
    mean = share @ colours
    offset = colours - mean
    return mean, offset.T @ (offset * share[:, None])


def _power(covariance: Tensor, exponent: float, floor: float) -> Tensor:
    values, vectors = torch.linalg.eigh(covariance)
    return vectors @ torch.diag(values.clamp_min(0).add(floor) ** exponent) @ vectors.T


def colour_transfer(
    source: tuple[Tensor, Tensor], target: tuple[Tensor, Tensor], floor: float = 1e-4
) -> tuple[Tensor, Tensor]:
    """Return the affine map that gives colours the target's mean and covariance (ARF, sec. 3.3), A (3, 3) and b (3,).

    A = C_t^1/2 C_s^-1/2, b = m_t - A m_s; apply it as ``colours @ A.T + b``. Both are from :func:`colour_statistics`;
    ``floor`` is added to every variance to avoid amplifying a flat source: 1e-4 is a standard deviation of 0.01.
    """
    matrix = _power(target[1], 0.5, floor) @ _power(source[1], -0.5, floor)
    return matrix, target[0] - matrix @ source[0]


def statistics_loss(colours: Tensor, target: tuple[Tensor, Tensor], weights: Tensor | None = None) -> Tensor:
    """Return the squared difference >= 0 of mean and covariance (as deviations) between colours (N, 3) and a target.

    It keeps a stylized region to the colours of its style, which could drift with features alone. ``target``: mean (3,)
    and covariance (3, 3); ``weights`` >= 0 (N,) are equal if not given.
    """
    mean, covariance = colour_statistics(colours, weights)
    # The squared covariance is of fourth order in deviations: the scale keeps both terms comparable at any contrast.
    scale = target[1].diagonal().sum().clamp_min(1e-3)
    return (mean - target[0]).square().sum() + (covariance - target[1]).square().sum() / scale
