"""The mapping between a volume's world and the box in which everything is trained and rendered.

A volume's visible part lies in a box whose longest side is 1: positions in it are box coordinates, lengths box units.
The mapping is a shift and a uniform scale, in float64, because a world may be 1e-9 or 1e6 units wide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.errors import BadInput


@dataclass(frozen=True)
class Box:
    """An axis-aligned box in the world.

    ``low`` is its lowest corner and ``size`` its longest side, both in world units; ``extent`` holds its sides in box
    units, in (0, 1], the longest being 1.
    """

    low: tuple[float, float, float]
    size: float
    extent: tuple[float, float, float]

    @classmethod
    def of_bounds(cls, low: ArrayLike, high: ArrayLike) -> Box:
        """Return the box between two world corners (3,); BadInput unless they are finite and enclose a volume."""
        a, b = np.asarray(low, np.float64), np.asarray(high, np.float64)
        sides = b - a
        if not (np.isfinite(a).all() and np.isfinite(b).all() and (sides > 0).all()):
            raise BadInput(f"The bounds {a.tolist()} to {b.tolist()} enclose no volume: give the lower corner first.")
        size = float(sides.max())
        x, y, z = (float(v) for v in np.maximum(sides / size, 1e-3))
        return cls((float(a[0]), float(a[1]), float(a[2])), size, (x, y, z))

    def to_box(self, points: ArrayLike) -> NDArray[np.float64]:
        """Convert world points (..., 3) to box coordinates (..., 3)."""
        return (np.asarray(points, np.float64) - self.low) / self.size

    def to_world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Convert box coordinates (..., 3) to world points (..., 3)."""
        return np.asarray(points, np.float64) * self.size + self.low

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corners in world units. (2, 3)"""
        return self.to_world(np.stack([np.zeros(3), np.asarray(self.extent)]))
