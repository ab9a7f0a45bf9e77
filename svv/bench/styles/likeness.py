"""Similarity of a painted picture to its style, by all available figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.bench.styles.judge_features import figures
from svv.bench.styles.path import LEAST_ALPHA
from svv.bench.styles.statistics import StyleJudge
from svv.train.config import StylizeSettings
from svv.train.lpips import Lpips
from svv.train.style_loss import StyleLossSettings, resized

CAPTION = {"neighbours": "neighbours", "contrast": "contrast"}
"""Figures that are shown under a picture's name on sheets -> their names there."""

FIGURES = 3
"""To be raised when the meaning of a figure changes; saved figures are then measured again."""


@dataclass(frozen=True)
class Judge:
    """A style at the size of the pictures that are compared with it."""

    style: Tensor
    """Picture of the style, in [0, 1]. (3, h, w)"""
    lines: StyleJudge


def judge_of(style: NDArray[np.floating], long_side: int, network: Lpips | None) -> Judge:
    """Scale a style (h, w, 3) in [0, 1] for pictures of a given long side: its strokes become as large as painted."""
    painted = round(long_side * StyleLossSettings().style_size / StylizeSettings().style_size)
    wanted = resized(torch.from_numpy(np.asarray(style, np.float32)).permute(2, 0, 1), painted)
    return Judge(wanted, StyleJudge(wanted.permute(1, 2, 0).numpy(), network))


def painted_figures(colours: NDArray[np.floating], alpha: NDArray[np.floating], judge: Judge) -> dict[str, float]:
    """Return all figures of a picture over its opaque pixels, or over the more opaque half of a translucent picture.

    Args:
        colours: Straight colours, sRGB in [0, 1]. (h, w, 3)
        alpha: Opacity that selects the pixels, the same for all pictures that are compared. (h, w)
        judge: The style.

    Returns:
        :func:`svv.bench.styles.judge_features.figures` without the background's, and
        :meth:`svv.bench.styles.statistics.StyleJudge.figures`; empty if nothing is visible.
    """
    seen = alpha >= LEAST_ALPHA
    if not seen.any():
        return {}
    mask = (alpha >= min(0.9, float(np.median(alpha[seen])))).astype(np.float32)
    picture = torch.from_numpy(np.ascontiguousarray(colours, np.float32)).permute(2, 0, 1)
    found = figures(picture, torch.from_numpy(mask), judge.style, 0.0)
    found.pop("background")
    return {**judge.lines.figures(colours, mask), **found}


def caption(values: Mapping[str, Any]) -> str:
    """Format the figures of :data:`CAPTION` in one line."""
    return "  ".join(f"{title} {values[name]:.2f}" for name, title in CAPTION.items() if values.get(name) is not None)
