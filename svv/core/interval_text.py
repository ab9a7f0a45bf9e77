"""Intervals of numbers as text."""

from __future__ import annotations

import math


def interval_text(low: float, high: float, digits: int = 4) -> str:
    """Return an interval as ``low to high``, with as many digits >= ``digits`` as tell both ends apart.

    Example:
        >>> interval_text(0.25, 1.0), interval_text(101325.21834, 101325.70114)
        ('0.25 to 1', '101325.218 to 101325.701')
    """
    largest, width = max(abs(low), abs(high)), high - low
    if math.isfinite(width) and 0 < width < largest:
        digits = min(17, digits + math.floor(math.log10(largest) - math.log10(width)))
    return f"{low:.{digits}g} to {high:.{digits}g}"
