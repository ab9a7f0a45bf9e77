"""Colours as text, '#rrggbb', without the libraries that other modules of colour need."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def to_hex(rgb: NDArray[np.floating] | Sequence[float]) -> str:
    """Return an RGB colour as '#rrggbb', rounded and clamped to [0, 1]."""
    return "#" + bytes(np.rint(np.clip(rgb, 0, 1) * np.float64(255)).astype(np.uint8)).hex()
