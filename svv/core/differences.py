"""Differences of values that are large for their range, such as a pressure of 101325 Pa and its changes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def above(values: NDArray[np.generic], origin: float) -> NDArray[np.float64]:
    """Return values less a number, exactly also for integers that double precision cannot hold. Same shape"""
    if values.dtype.kind in "iu" and values.dtype.itemsize == 8:  # modulo 2^64, as differences are small
        return (values.astype(np.uint64) - np.uint64(int(origin) % 2**64)).view(np.int64).astype(np.float64)
    return np.asarray(values.astype(np.float64) - origin)
