"""Differences of values that are large for their range, such as a pressure of 101325 Pa and its changes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def above(values: NDArray[np.generic], origin: float) -> NDArray[np.float64]:
    """Return values less a number, exactly also for integers that double precision cannot hold. Same shape"""
    rough = np.asarray(values.astype(np.float64) - origin)
    if values.dtype.kind not in "iu" or values.dtype.itemsize < 8:
        return rough
    whole = math.floor(origin)  # modulo 2^64, which tells small differences
    exact = (values.astype(np.uint64) - np.uint64(whole % 2**64)).view(np.int64).astype(np.float64) - (origin - whole)
    return np.where(np.abs(rough) < 2.0**62, exact, rough)
