"""Extinction around each vertex of a grid of values, and the range that contributes most of it.

Letters: K known values, V voxels; sigma is extinction in 1 / box unit.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION, OPAQUE_LOG_EXTINCTION
from svv.measure import usable_cpus

Array = NDArray[np.float64]

AVERAGING_WIDTH = 1.0
"""Width of the averaging in cells, found by comparing transmittances along rays with the ray caster's alpha."""


def averaged(
    values: NDArray[np.float32], known: Array, sigma: Array, starts: list[int], exact: tuple[Array, Array] | None
) -> tuple[NDArray[np.float16], NDArray[np.uint8]]:
    """Return the log of the mean extinction around each vertex, and the range that gives most of it. (X, Y, Z) each

    Where the values cross a range of the function between two vertices, sampling the extinction at the vertices would
    miss it or hit it by chance. It is therefore averaged over the values within a cell around the vertex, by means of
    its integral over the values (as in pre-integrated classification, Engel et al. 2001).

    Values (Z, Y, X) are NaN outside the volume, where the extinction is 0; known values (K,) ascend, and ``starts`` has
    the index of the first one of each range. ``exact`` holds values and their extinction if there are none between
    those of neighbours, so that nothing is averaged (:func:`as_voxels_are`). (N,), (N,)
    """
    borders = known[starts[1:]]
    if exact is not None:
        return _looked_up(values, *exact, borders)
    low, high = known[0], known[-1]
    integral = integral_of(known, sigma)
    first, width = varying(known, sigma)
    # No values lie below the first or above the last known one, but a volume may have a single value.
    lit = np.concatenate([[False], sigma[:1] > 0, (sigma[1:] > 0) | (sigma[:-1] > 0), sigma[-1:] > 0, [False]])
    edges = np.concatenate([[-np.inf], known, [np.inf]])[lit[1:] != lit[:-1]]
    exponent = np.full(values.shape[::-1], EMPTY_LOG_EXTINCTION, np.float16)
    owner = np.empty(values.shape[::-1], np.uint8)

    def average(k: int) -> None:
        layer = values[k]
        slope = np.gradient(values[max(k - 1, 0) : k + 2], axis=0)[min(k, 1)]
        squared = np.square(np.nan_to_num(slope))
        for axis in (0, 1):
            squared += np.square(np.nan_to_num(np.gradient(layer, axis=axis)))
        # So wide that differences of the integral are accurate.
        least = np.maximum(1e-4 * width, 1e-9 * np.abs(np.nan_to_num(layer) - first))
        half = np.maximum(0.5 * AVERAGING_WIDTH * np.sqrt(squared), least)
        start, stop = np.clip(layer - half, low, high), np.clip(layer + half, low, high)
        own = np.minimum(np.searchsorted(borders, layer, side="right"), len(borders))  # NaN gets the last range
        passed = np.searchsorted(edges, start)
        shown = np.nonzero((passed % 2 == 1) | (passed != np.searchsorted(edges, stop)))
        start, stop = start[shown], stop[shown]
        inside = np.interp(stop, known, integral) - np.interp(start, known, integral)
        spread = stop - start
        here = np.interp(layer[shown], known, sigma)  # for a volume of a single value, whose spread is 0
        found = np.where(spread > 0, inside / np.where(spread > 0, spread, 1.0), here)
        exponent[:, :, k].T[shown] = np.log(np.clip(found, np.exp(EMPTY_LOG_EXTINCTION), np.exp(OPAQUE_LOG_EXTINCTION)))
        across = np.searchsorted(borders, start) < np.searchsorted(borders, stop)
        chosen = tuple(index[across] for index in shown)
        own[chosen] = _heaviest(start[across], stop[across], own[chosen], known, sigma, starts)
        owner[:, :, k] = own.T

    with ThreadPoolExecutor(usable_cpus()) as threads:  # NumPy releases the interpreter's lock
        list(threads.map(average, range(len(values))))
    return exponent, owner


def _looked_up(
    values: NDArray[np.float32], known: Array, sigma: Array, borders: Array
) -> tuple[NDArray[np.float16], NDArray[np.uint8]]:
    """Return what :func:`averaged` does where each vertex has the value of a voxel."""
    exponent = np.empty(values.shape[::-1], np.float16)
    owner = np.empty(values.shape[::-1], np.uint8)
    least, most = np.exp(EMPTY_LOG_EXTINCTION), np.exp(OPAQUE_LOG_EXTINCTION)
    for k, layer in enumerate(values):
        found = np.nan_to_num(np.interp(layer, known, sigma))
        exponent[:, :, k] = np.log(np.clip(found, least, most)).T
        owner[:, :, k] = np.minimum(np.searchsorted(borders, layer, side="right"), len(borders)).T
    return exponent, owner


def _heaviest(
    start: Array, stop: Array, own: NDArray[np.intp], known: Array, sigma: Array, starts: list[int]
) -> NDArray[np.intp]:
    """Return the range that contributes most extinction between two values; ``own`` if there is none. (V,)"""
    parts = np.empty((len(starts), len(start)))
    numbers = np.arange(len(known))
    for i, (a, b) in enumerate(pairwise([*starts, len(known)])):
        integral = integral_of(known, np.where((numbers >= a) & (numbers < b), sigma, 0.0))
        parts[i] = np.interp(stop, known, integral) - np.interp(start, known, integral)
    return np.where(parts.max(axis=0) > 0, parts.argmax(axis=0), own)


def integral_of(known: Array, sigma: Array) -> Array:
    """Return the integral of the extinction over the values, accurate from where that begins to vary. (K,)"""
    part = 0.5 * (sigma[1:] + sigma[:-1]) * np.diff(known)
    start = int(np.searchsorted(known, varying(known, sigma)[0]))
    return np.concatenate([-np.cumsum(part[:start][::-1])[::-1], [0.0], np.cumsum(part[start:])])


def varying(known: Array, function: Array) -> tuple[float, float]:
    """Return the value from which a function (K,) or (K, C) of the known values varies, and the width over which."""
    rows = function.reshape(len(known), -1)
    changes = np.flatnonzero((np.abs(np.diff(rows, axis=0)) > 1e-9 * np.abs(rows).max(axis=0)).any(axis=1))
    first, last = (changes[0], changes[-1] + 1) if len(changes) else (0, -1)
    return float(known[first]), float(known[last] - known[first])
