"""How the extinction of a scene follows from its volume's values; see :mod:`svv.train.base.extinction_table`."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True, eq=False)
class ValueFunction:
    """The extinction of a scene as a function of value and slope."""

    interval: tuple[float, float]
    """What the values 0 and 1 are in the volume."""
    visible: tuple[float, float]
    """Smallest and largest visible value, counted from 0 to 1."""
    size: float
    """Box unit of the extinctions, world units."""
    table: Tensor
    """Logarithms of the extinction, in 1 / box unit. (T,)"""
