"""Measures against a known truth, for colours of a palette and regions of an image, and limits of failure.

Letters: T true ranges, F regions found.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from svv.core.colour.colour import colour_differences

Array = NDArray[np.float64]

FOREGROUND_DROP = 3.0
"""Loss of foreground PSNR (:func:`foreground_lost`), in dB, above which a run is "blurred"."""

LEAST_OVERLAP = 0.7
"""Mean intersection over union of the regions with the truth below which a run has "wrong regions"."""

MOST_COLOUR = 10.0
"""Mean CIEDE2000 of the palette above which a run has "wrong colours": a clearly different colour."""

MOST_STYLE = 20.0
"""CIEDE2000 between the mean colours of painted regions and of their style above which a run is "off its style"."""

MOST_SPREAD = 1.0
"""Standard deviation of the foreground PSNR over the seeds, in dB, above which a case is "unsteady"."""

MOST_LOST = 0.5
"""Loss of foreground PSNR by saving, in dB, above which a run is "lost in the file"."""


def palette_error(found: NDArray[np.floating], truth: NDArray[np.floating]) -> float:
    """Return the mean CIEDE2000 from the true colours (T, 3) to the palette (F, 3), F >= 1, in the best assignment.

    The assignment is one to one. If the palette is the shorter, the remaining true colours are compared with the
    nearest palette colour.
    """
    cost = colour_differences(truth, found)
    errors = cost.min(axis=1)
    rows, columns = linear_sum_assignment(cost)
    errors[rows] = cost[rows, columns]
    return float(errors.mean())


def overlaps(truth: NDArray[np.integer], shown: NDArray[np.integer], ranges: int, regions: int) -> Array:
    """Compute the intersection over union of each true class with each region over all pixels of some views.

    Args:
        truth: Class of each pixel, -1 empty, -2 unknown (left out).
        shown: Region of each pixel, -1 empty. Same shape as ``truth``.
        ranges: Number of true classes T.
        regions: Number of regions F.

    Returns:
        Intersection over union, in [0, 1]. (T, F)
    """
    known = truth >= -1
    t, s = truth[known].astype(np.int64), shown[known].astype(np.int64)
    both = np.bincount((t + 1) * (regions + 1) + s + 1, minlength=(ranges + 1) * (regions + 1))
    table = both.reshape(ranges + 1, regions + 1).astype(np.float64)
    union = table.sum(axis=1, keepdims=True) + table.sum(axis=0, keepdims=True) - table
    return np.asarray((table / np.maximum(union, 1.0))[1:, 1:])


def matched(overlap: Array) -> list[float]:
    """Return the overlap of each true class with its region in the best one-to-one assignment; 0 without one. (T,)"""
    result = np.zeros(len(overlap))
    rows, columns = linear_sum_assignment(-overlap)
    result[rows] = overlap[rows, columns]
    return [float(v) for v in result]


def foreground_lost(measures: dict[str, Any], easy: float | None) -> float | None:
    """Return what a run lost of the foreground PSNR that it could have, in dB; None if it was not measured.

    It could have that of the easy case, unless the volume's own DVR with more rays a pixel (``dvr_foreground``) has
    less: then the views' jagged edges allow no more.

    Args:
        measures: Measures of the run.
        easy: Mean foreground PSNR of the easy case with the same preset, in dB.
    """
    foreground, finer = measures.get("psnr_foreground"), measures.get("dvr_foreground")
    if foreground is None or easy is None:
        return None
    return float(min(easy, easy if finer is None else finer) - foreground)


def failures(measures: dict[str, Any], easy: float | None) -> list[str]:
    """Return the failures of one run in words; the limits are the constants of this module.

    Args:
        measures: Measures of the run (:data:`svv_bench.stability.cases.Measures`), missing or None if not measured.
        easy: Mean foreground PSNR of the easy case with the same preset, in dB.
    """
    if measures.get("crash"):
        return ["crash"]
    if measures.get("finite") is False:
        return ["not finite"]
    found = []
    if measures.get("refused") is False:
        found.append("not refused")
    blurred, regions = foreground_lost(measures, easy), measures.get("regions")
    if blurred is not None and blurred > FOREGROUND_DROP:
        found.append("blurred")
    if regions is not None and regions != measures["ranges"]:
        found.append(f"{regions} regions for {measures['ranges']}")
    limits: Sequence[tuple[str, float, float, str]] = (
        ("overlap", -1.0, -LEAST_OVERLAP, "wrong regions"),
        ("colour_error", 1.0, MOST_COLOUR, "wrong colours"),
        ("style_error", 1.0, MOST_STYLE, "off its style"),
        ("lost", 1.0, MOST_LOST, "lost in the file"),
    )
    for key, sign, most, word in limits:
        value = measures.get(key)
        if value is not None and sign * value > most:
            found.append(word)
    if measures.get("in_gamut") is False:
        found.append("out of gamut")
    return found
