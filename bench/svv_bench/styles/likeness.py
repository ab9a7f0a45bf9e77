"""Similarity of a painted picture to its style, by all available figures.

Besides those of :mod:`svv_bench.styles.statistics`: sliced Wasserstein distances of pixels and of patches without their
mean, and the orientations of edges.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from svv.train.lpips import Lpips
from svv.train.paint.pieces import PieceSettings, resized
from svv.train.run.config import StylizeSettings
from svv_bench.styles.path import LEAST_ALPHA
from svv_bench.styles.statistics import StyleJudge

CAPTION = {"neighbours": "neighbours", "contrast": "contrast"}
"""Figures that are shown under a picture's name on sheets -> their names there."""

FIGURES = 3
"""To be raised when the meaning of a figure changes; saved figures are then measured again."""

DIRECTIONS = 128
"""Number of random projections of a sliced Wasserstein distance."""


@dataclass(frozen=True)
class Judge:
    """A style at the size of the pictures that are compared with it."""

    style: Tensor
    """Picture of the style, in [0, 1]. (3, h, w)"""
    lines: StyleJudge


def judge_of(style: NDArray[np.floating], long_side: int, network: Lpips | None) -> Judge:
    """Scale a style (h, w, 3) in [0, 1] for pictures of a given long side: its strokes become as large as painted."""
    painted = round(long_side * PieceSettings().size / StylizeSettings().style_size)
    wanted = resized(torch.from_numpy(np.asarray(style, np.float32)).permute(2, 0, 1), painted)
    return Judge(wanted, StyleJudge(wanted.permute(1, 2, 0).numpy(), network))


def painted_figures(colours: NDArray[np.floating], alpha: NDArray[np.floating], judge: Judge) -> dict[str, float]:
    """Return all figures of a picture over its opaque pixels, or over the more opaque half of a translucent picture.

    Args:
        colours: Straight colours, sRGB in [0, 1]. (h, w, 3)
        alpha: Opacity that selects the pixels, the same for all pictures that are compared. (h, w)
        judge: The style.

    Returns:
        :func:`figures` and
        :meth:`svv_bench.styles.statistics.StyleJudge.figures`; empty if nothing is visible.
    """
    seen = alpha >= LEAST_ALPHA
    if not seen.any():
        return {}
    mask = (alpha >= min(0.9, float(np.median(alpha[seen])))).astype(np.float32)
    picture = torch.from_numpy(np.ascontiguousarray(colours, np.float32)).permute(2, 0, 1)
    return {**judge.lines.figures(colours, mask), **figures(picture, torch.from_numpy(mask), judge.style)}


def caption(values: Mapping[str, Any]) -> str:
    """Format the figures of :data:`CAPTION` in one line."""
    return "  ".join(f"{title} {values[name]:.2f}" for name, title in CAPTION.items() if values.get(name) is not None)


def sliced_wasserstein(a: Tensor, b: Tensor) -> float:
    """Return the mean distance of sorted projections of two sets of vectors (N, C), (M, C) (Rabin et al. 2011)."""
    generator = torch.Generator().manual_seed(0)
    directions = F.normalize(torch.randn(a.shape[1], DIRECTIONS, generator=generator), dim=0)
    at = torch.linspace(0, 1, 257)
    return float((torch.quantile(a @ directions, at, 0) - torch.quantile(b @ directions, at, 0)).abs().mean())


def patches(picture: Tensor, mask: Tensor | None = None, side: int = 5) -> Tensor:
    """Return at most 20,000 patches without their mean that lie completely in the foreground. (N, 3 side^2)"""
    columns = F.unfold(picture[None], side)[0].T
    if mask is not None:
        columns = columns[F.unfold(mask[None, None], side)[0].amin(0) > 0.9]
    columns = columns[:: max(1, len(columns) // 20_000)].unflatten(1, (3, -1))
    return (columns - columns.mean(2, keepdim=True)).flatten(1)


def orientations(picture: Tensor, mask: Tensor | None = None) -> Tensor:
    """Return a histogram (12,) of the directions of grey gradients, weighted by their length."""
    grey = picture.mean(0)
    dy, dx = (grey[2:, 1:-1] - grey[:-2, 1:-1]) / 2, (grey[1:-1, 2:] - grey[1:-1, :-2]) / 2
    length = torch.hypot(dx, dy)
    if mask is not None:
        length = length * (-F.max_pool2d(-mask[None], 3, 1)[0] > 0.9)
    part = ((torch.atan2(dy, dx) / torch.pi) % 1 * 12).long().clamp(0, 11)
    histogram = torch.bincount(part.flatten(), length.flatten(), 12)
    return histogram / histogram.sum().clamp_min(1e-9)


def figures(picture: Tensor, mask: Tensor, style: Tensor) -> dict[str, float]:
    """Return distances of a picture's foreground from a style, best at 0; ``contrast`` and ``chroma`` are best at 1."""
    inside = mask > 0.9
    shown = picture.flatten(1).T[inside.flatten()]
    result = {"colour": sliced_wasserstein(shown, style.flatten(1).T)}
    for octave in range(3):
        small, cover, there = (F.avg_pool2d(x, 1 << octave) if octave else x for x in (picture, mask[None], style))
        found, wanted = patches(small, cover[0]), patches(there)
        if len(found) < 30:
            break
        spread = wanted.square().mean().sqrt().clamp_min(1e-3)
        result[f"patches 1/{1 << octave}"] = sliced_wasserstein(found / spread, wanted / spread)
        if octave == 0:
            result["contrast"] = float(found.square().mean().sqrt() / spread)
            chroma = [x.unflatten(1, (3, -1)) for x in (found, wanted)]
            noise = [(c - c.mean(1, keepdim=True)).square().mean().sqrt() for c in chroma]
            result["chroma"] = float(noise[0] / noise[1].clamp_min(1e-3))
    result["orientation"] = float((orientations(picture, mask) - orientations(style)).abs().sum() / 2)
    return result
