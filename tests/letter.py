"""An L of four values off the centre, which no exchange or reversal of axes leaves as it is."""

from __future__ import annotations

import numpy as np

SPACING = (1.5, 2.0, 3.0)
ORIGIN = (10.0, 20.0, 30.0)


def letter() -> np.ndarray:
    """Values from 0 to 200. (14, 18, 22)"""
    values = np.zeros((14, 18, 22))
    values[3, 4, 5:13], values[3, 5:9, 5], values[4:6, 4, 5], values[6:8, 4, 5] = 200, 150, 100, 50
    return values
