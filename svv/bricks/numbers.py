"""The three types in which the brick marcher keeps values, and the mapping of all others to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Numbers:
    """A mapping of values: kept = gain * value + offset.

    One and two bytes are kept as they are, or moved into the unsigned range. Everything else becomes float32; wide
    integers and doubles are scaled such that the transfer function's values lie in [0, 1], where float32 is fine.
    """

    dtype: np.dtype[Any]
    """Type of the kept values: uint8, uint16 or float32."""
    gain: float
    """Factor."""
    offset: float
    """Summand."""

    @classmethod
    def of(cls, dtype: np.dtype[Any], low: float, high: float) -> Numbers:
        """Return the mapping for a type, and for a transfer function that shows values from ``low`` to ``high``."""
        if dtype.itemsize <= 2 and dtype.kind in "ui":
            bits = 8 * dtype.itemsize
            return cls(np.dtype(f"u{dtype.itemsize}"), 1.0, float(1 << (bits - 1)) if dtype.kind == "i" else 0.0)
        if dtype == np.float32:
            return cls(dtype, 1.0, 0.0)
        gain = 1.0 / (high - low) if high > low else 1.0
        return cls(np.dtype(np.float32), gain, -gain * low)

    def converted(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values in the kept type."""
        if values.dtype == self.dtype:
            return values
        if self.dtype.kind == "u":
            return np.asarray(values.astype(np.int32) + int(self.offset)).astype(self.dtype)
        return np.asarray(values.astype(np.float64) * self.gain + self.offset, np.float32)

    def mapped(self, values: Any) -> Any:
        """Return numbers such as the limits of a range in the kept scale, as float64."""
        return np.asarray(values, np.float64) * self.gain + self.offset
