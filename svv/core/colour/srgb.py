"""The transfer curve of sRGB (IEC 61966-2-1) for arrays; :mod:`svv.core.colour.oklab` has it for tensors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def linear(rgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return linear light of gamma-encoded sRGB; negative values are scaled as those near 0. (...)

    >>> linear(np.array([0.0, 0.5, 1.0])).round(3).tolist()
    [0.0, 0.214, 1.0]
    """
    return np.where(rgb <= 0.04045, rgb / 12.92, ((np.maximum(rgb, 0.0) + 0.055) / 1.055) ** 2.4)


def encoded(light: NDArray[np.floating]) -> NDArray[np.float64]:
    """Invert :func:`linear`. (...)

    >>> encoded(linear(np.array([0.0, 0.5, 1.0]))).round(3).tolist()
    [0.0, 0.5, 1.0]
    """
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0) ** (1.0 / 2.4) - 0.055)
