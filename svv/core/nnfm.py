"""Nearest-neighbour feature matching (NNFM) and the colour statistics around it.

The loss of StyleRF-VolVis (eq. 8; Zhang et al. 2022, ARF, eq. 1): each feature vector of a render moves towards the
feature vector of the style that is most like it. Pure torch: where the features come from is not known here.

Letters: N feature vectors of the render, M of the style, C channels each.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

VECTORS_AT_A_TIME = 2048
"""Render vectors compared with all of the style at a time: bounds the table of similarities to so many times M."""


@torch.no_grad()
def nearest(features: Tensor, style: Tensor, balance: float | None = None, chunk: int = VECTORS_AT_A_TIME) -> Tensor:
    """Index of the style vector that each feature vector of the render is matched with.

    Without ``balance`` it is the one with the smallest cosine distance d_ij. A smooth render then finds the few smooth
    places of the style and stays smooth. With it, a style vector that some vector of the render is close to already is
    less wanted, in proportion: j = argmin_j d_ij / (balance + min_l d_lj) (Granot et al. 2022, GPNN, eq. 2).

    Args:
        features: (N, C).
        style: (M, C).
        balance: > 0; small asks for all of the style, large is as good as none.
        chunk: Rows compared at a time; changes memory, not the result.

    Returns:
        Indices into ``style``, (N,) int64.
    """
    directions = F.normalize(style, dim=1).T
    parts = F.normalize(features, dim=1).split(chunk)
    if balance is None:
        return torch.cat([(rows @ directions).argmax(1) for rows in parts])
    closest = torch.stack([(rows @ directions).amax(0) for rows in parts]).amax(0)  # (M,) cosines
    wanted = 1 / (balance + 1 - closest)
    return torch.cat([((1 - rows @ directions) * wanted).argmin(1) for rows in parts])


def nnfm_loss(
    features: Tensor,
    style: Tensor,
    weights: Tensor | None = None,
    balance: float | None = None,
    chunk: int = VECTORS_AT_A_TIME,
) -> Tensor:
    """Mean over the render of the cosine distance to its nearest of the style (StyleRF-VolVis, eq. 8).

    L = sum_i w_i (1 - f_i . s_j / (|f_i| |s_j|)) / sum_i w_i,  j = nearest(i)

    Differentiable in both arguments; the gradient of a minimum is that of the entry which attains it.

    Args:
        features: Vectors of the render, (N, C).
        style: Vectors of the style, (M, C).
        weights: How much each vector counts, >= 0, (N,); equal if not given. All zero gives a loss of 0.
        balance: Of :func:`nearest`; the paper has none.
        chunk: Rows compared at a time; changes memory, not the result.

    Returns:
        Loss in [0, 2], a scalar.
    """
    if len(features) == 0:
        return features.sum()
    distance = 1 - F.cosine_similarity(features, style[nearest(features, style, balance, chunk)], dim=1)
    if weights is None:
        return distance.mean()
    return (distance * weights).sum() / weights.sum().clamp_min(torch.finfo(weights.dtype).eps)


def energy_loss(features: Tensor, style: Tensor, weights: Tensor | None = None, floor: float = 0.0) -> Tensor:
    """How much stronger or weaker each feature is in the render than in the style.

    L = sum_c (r_c - s_c)^2 / max(sum_c s_c^2, floor),  r_c and s_c the root mean squares over render and style

    A cosine does not see the length of vectors: a render may fade to a blur while every direction is right. With a
    frequency basis this is a comparison of power spectra.

    Args:
        features: Centred vectors of the render, (N, C).
        style: Centred vectors of the style, (M, C).
        weights: >= 0, (N,); equal if not given.
        floor: A style of one colour has no detail to compare with: its share of the loss would know no bounds.

    Returns:
        A scalar >= 0; 1 for a render without any detail.
    """
    share = torch.ones_like(features[:, 0]) if weights is None else weights
    eps = torch.finfo(features.dtype).eps
    mean_square = (share @ features.square()) / share.sum().clamp_min(eps)
    wanted = style.square().mean(0).sqrt()
    return ((mean_square + eps).sqrt() - wanted).square().sum() / wanted.square().sum().clamp_min(max(floor, eps))


def cell_weights(mask: Tensor, stride: int = 4) -> Tensor:
    """Share of foreground in each cell of a feature map.

    Args:
        mask: Opacity of the render in [0, 1], (h, w); h and w are cut to multiples of the stride, as pooling does.
        stride: Pixels a cell is wide.

    Returns:
        Weights in [0, 1], (h // stride * (w // stride),), in the order of ``features.flatten(2)``.
    """
    return F.avg_pool2d(mask[None, None], stride).flatten()


def total_variation(image: Tensor, mask: Tensor | None = None) -> Tensor:
    """Mean squared difference of neighbouring pixels, where both are foreground.

    Args:
        image: (c, h, w).
        mask: Weight of each pixel in [0, 1], (h, w); everything counts if not given.

    Returns:
        A scalar >= 0.
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
    """Relative luminance of an sRGB colour: L = 0.2126 R^2.2 + 0.7152 G^2.2 + 0.0722 B^2.2 (StyleRF-VolVis, sec. 3.4).

    The result is linear light and is used as it is: applying the power to it again is a mistake.

    Args:
        colour: (..., 3) in [0, 1]; values outside are clamped first.

    Returns:
        (...,) in [0, 1].
    """
    return (colour.clamp(0, 1) ** 2.2 @ colour.new_tensor([0.2126, 0.7152, 0.0722])).clamp(0, 1)


def colour_statistics(colours: Tensor, weights: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Mean (3,) and covariance (3, 3) of colours (N, 3), each counted with its weight (N,) >= 0."""
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
    """The linear map of colours that gives them the target's mean and covariance (ARF, sec. 3.3).

    A = C_t^1/2 C_s^-1/2, b = m_t - A m_s; apply as ``colours @ A.T + b``.

    Args:
        source: Mean and covariance of the colours to be changed (:func:`colour_statistics`).
        target: Mean and covariance that they get.
        floor: Added to every variance, so that a flat source is not blown up; 1e-4 is a deviation of 0.01.

    Returns:
        A (3, 3) and b (3,).
    """
    matrix = _power(target[1], 0.5, floor) @ _power(source[1], -0.5, floor)
    return matrix, target[0] - matrix @ source[0]


def statistics_loss(colours: Tensor, target: tuple[Tensor, Tensor], weights: Tensor | None = None) -> Tensor:
    """Squared difference of mean and of covariance (as deviations) between colours (N, 3) and a target.

    Keeps a stylized region to the colours of its style where features alone would let them drift.

    Args:
        colours: (N, 3) in [0, 1].
        target: Mean (3,) and covariance (3, 3) of the style.
        weights: (N,) >= 0.

    Returns:
        A scalar >= 0.
    """
    mean, covariance = colour_statistics(colours, weights)
    # Covariances are of the fourth order in deviations: the scale keeps both terms alike for any contrast.
    scale = target[1].diagonal().sum().clamp_min(1e-3)
    return (mean - target[0]).square().sum() + (covariance - target[1]).square().sum() / scale
