"""How near a painted picture comes to its style, by all figures that there are."""

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
"""Figures that stand under a picture's name on sheets, and what they are called there."""

FIGURES = 3
"""To be raised when a figure changes its meaning: those that were kept are then taken anew."""


@dataclass(frozen=True)
class Judge:
    """A style at the size of the pictures that are compared with it."""

    style: Tensor
    """(3, h, w) in [0, 1]"""
    lines: StyleJudge


def judge_of(style: NDArray[np.floating], long_side: int, network: Lpips | None) -> Judge:
    """A style (h, w, 3) in [0, 1] as it is compared with pictures of a long side: its strokes as large as in paint."""
    painted = round(long_side * StyleLossSettings().style_size / StylizeSettings().style_size)
    wanted = resized(torch.from_numpy(np.asarray(style, np.float32)).permute(2, 0, 1), painted)
    return Judge(wanted, StyleJudge(wanted.permute(1, 2, 0).numpy(), network))


def painted_figures(colours: NDArray[np.floating], alpha: NDArray[np.floating], judge: Judge) -> dict[str, float]:
    """All figures of a picture, over its opaque pixels; of a translucent one, over the more opaque half.

    Args:
        colours: Straight, sRGB in [0, 1]. (h, w, 3)
        alpha: Opacity that says where it counts, the same for all pictures that are compared. (h, w)
        judge: Of the style.

    Returns:
        :func:`svv.bench.styles.judge_features.figures` without the background's, and
        :meth:`svv.bench.styles.statistics.StyleJudge.figures`; nothing where nothing is seen.
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
    """The figures of :data:`CAPTION` in one line."""
    return "  ".join(f"{title} {values[name]:.2f}" for name, title in CAPTION.items() if values.get(name) is not None)
