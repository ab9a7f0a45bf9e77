"""Sheets of samples along rays (:mod:`svv.core.rays.sheets`), compiled with numba for the CPU.

Letters: R rays, S samples, G regions, K sheets.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.rays.sheets import LEAST


@njit(parallel=True, cache=True)
def count_sheets(position, start, count, region, apart, number):  # type: ignore[no-untyped-def]
    """Count the sheets on each ray. ``apart`` (G,); ``number`` (R,) receives the counts."""
    for r in prange(len(start)):
        last = np.full(len(apart), -1, np.int64)
        found = 0
        for j in range(start[r], start[r] + count[r]):
            k = region[j]
            if apart[k] > 0.0:
                found += _parted(position, last[k], j, apart[k])
                last[k] = j
        number[r] = found


@njit(cache=True)
def _parted(position, i, j, apart):  # type: ignore[no-untyped-def]
    """Return 1 if sample j begins another sheet than sample i, the last of its region on its ray (-1 for none)."""
    if i < 0:
        return 1
    away = 0.0
    for f in range(3):
        d = np.float64(position[j, f]) - np.float64(position[i, f])
        away += d * d
    return 1 if away > apart * apart else 0


@njit(parallel=True, cache=True)
def sheets(position, sigma, skipped, step, start, count, region, apart, first, own, where):  # type: ignore[no-untyped-def]
    """Compute the sheet of each sample, ``own`` (S,), and the mean position of each sheet, ``where`` (K, 3).

    ``first`` (R,): number of each ray's first sheet. Weights follow from ``sigma`` and ``skipped`` (S,) as in
    :mod:`svv.core.rays.compositing`.
    """
    for r in prange(len(start)):
        last = np.full(len(apart), -1, np.int64)
        found, left = first[r] - 1, 1.0
        begin = first[r]
        most = begin
        for j in range(start[r], start[r] + count[r]):
            left *= np.exp(-skipped[j])
            through = np.exp(-sigma[j] * step)
            weight = left * (1.0 - through) + LEAST
            left *= through
            k = region[j]
            if apart[k] <= 0.0:
                own[j] = -1
                continue
            if _parted(position, last[k], j, apart[k]) == 1:
                found += 1
                own[j] = found
                where[found, 0], where[found, 1], where[found, 2], where[found, 3] = 0.0, 0.0, 0.0, 0.0
            else:
                own[j] = own[last[k]]
            last[k] = j
            s = own[j]
            most = max(most, s + 1)
            where[s, 3] += weight
            for f in range(3):
                where[s, f] += weight * position[j, f]
        for s in range(begin, most):
            for f in range(3):
                where[s, f] /= where[s, 3]


@njit(parallel=True, cache=True)
def cover(sheet, covered, colour):  # type: ignore[no-untyped-def]
    """Lay the paint of sheets over the colours of their samples, in place.

    ``sheet`` (S,): sheet of each sample, -1 for none; ``covered`` (K, 4): colour times coverage, and coverage, of each
    sheet; ``colour`` (S, 3).
    """
    for j in prange(len(sheet)):
        s = sheet[j]
        if s >= 0:
            left = np.float32(1.0) - covered[s, 3]
            for c in range(3):
                colour[j, c] = covered[s, c] + left * colour[j, c]
