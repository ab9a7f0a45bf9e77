"""The three types in which the brick marcher keeps values, and the mapping of all others to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.core.differences import above

FINE = 1000.0
"""Largest ratio of float32 values to their range at which they are kept: they resolve 1/10000 of the range."""


@dataclass(frozen=True)
class Numbers:
    """A mapping of values: kept = gain * (value - origin).

    One and two bytes are kept as they are, or moved into the unsigned range. Everything else becomes float32; wide
    integers, doubles, and floats that differ little for their size are scaled such that the transfer function's values
    lie in [0, 1], where float32 is fine.
    """

    dtype: np.dtype[np.generic]
    """Type of the kept values: uint8, uint16 or float32."""
    gain: float
    """Factor."""
    origin: float
    """Value that becomes 0; subtracted first, it leaves differences of large values accurate."""

    @classmethod
    def of(cls, dtype: np.dtype[np.generic], low: float, high: float) -> Numbers:
        """Return the mapping for a type, and for a transfer function that shows values from ``low`` to ``high``."""
        if dtype.itemsize <= 2 and dtype.kind in "ui":
            bits = 8 * dtype.itemsize
            return cls(np.dtype(f"u{dtype.itemsize}"), 1.0, -float(1 << (bits - 1)) if dtype.kind == "i" else 0.0)
        if dtype == np.float32 and max(abs(low), abs(high)) <= FINE * (high - low):
            return cls(dtype, 1.0, 0.0)
        gain = 1.0 / (high - low) if high > low else 1.0
        return cls(np.dtype(np.float32), gain, low)

    def converted(self, values: NDArray[np.generic]) -> NDArray[np.generic]:
        """Return values in the kept type."""
        if self.dtype.kind == "u":
            return (
                values
                if values.dtype == self.dtype
                else (values.astype(np.int32) - int(self.origin)).astype(self.dtype)
            )
        if values.dtype == self.dtype and (self.gain, self.origin) == (1.0, 0.0):
            return values
        return np.asarray(self.gain * above(values, self.origin), np.float32)

    def mapped(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return numbers such as the limits of a range in the kept scale, as float64."""
        return self.gain * (np.asarray(values, np.float64) - self.origin)
