"""Transfer functions of one visible range per bump; see :meth:`.TransferFunction.from_bumps`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from svv.dvr.functions.scales import LARGEST_VALUE, MOST_POINTS, Points
from svv.errors import BadInput

HUES = ((0.15, 0.45, 0.95), (1.0, 0.55, 0.15), (0.25, 0.8, 0.4), (0.9, 0.2, 0.5))
"""Colours for ranges that are given without one, in this order."""


def points_of_bumps(bumps: Iterable[Mapping[str, Any]], name: str) -> tuple[Points, Points]:
    """Return the points of the colours and of the opacities."""
    try:
        shapes = sorted(
            (float(b["centre"]), 0.5 * float(b["width"]), float(b["opacity"]), tuple(b.get("colour", ())))
            for b in bumps
        )
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise BadInput(f"Each bump of '{name}' needs the numbers centre, width and opacity.") from None
    if any(not abs(number) <= LARGEST_VALUE for bump in shapes for number in bump[:3]):
        raise BadInput(f"The centres, widths and opacities of the bumps of '{name}' must be finite numbers.")
    if not shapes or min(half for _, half, _, _ in shapes) <= 0:
        raise BadInput(f"'{name}' needs at least one bump, and each bump a width above 0.")
    feet = [(c + side * half) for c, half, _, _ in shapes for side in (-1, 0, 1)]
    between = [0.5 * (a + b) for a, b in pairwise(sorted(feet))]
    values = np.unique(feet + between)
    if len(values) > MOST_POINTS:
        raise BadInput(f"'{name}' has {len(shapes)} bumps, too many: leave some out.")
    with np.errstate(all="ignore"):  # far from a narrow bump, quotients may exceed any number
        height = np.max([h * np.clip(1 - np.abs(values - c) / half, 0, None) for c, half, h, _ in shapes], axis=0)
    height = height.round(12)  # exactly 0 at the foot of a bump, despite rounding errors
    opacities = tuple((float(v), float(o), 0.5, 0.0) for v, o in zip(values, height))
    hues = [colour or HUES[i % len(HUES)] for i, (*_, colour) in enumerate(shapes)]
    centres = [c for c, *_ in shapes]
    edges = [min(feet), *(0.5 * (a + b) for a, b in pairwise(centres)), max(feet)]
    colours = tuple((edge, *hues[i]) for i in range(len(shapes)) for edge in (edges[i], edges[i + 1]))
    return colours, opacities
