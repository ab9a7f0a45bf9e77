"""A default transfer function for a volume, from its histogram."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.differences import above
from svv.dvr.draw.appearance import Appearance
from svv.dvr.functions.bumps import HUES
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import check_precision, to_array
from svv.errors import BadInput

BINS = 256
"""Number of bins of the histogram."""


def default_transfer_function(image: vtkImageData) -> TransferFunction:
    """Return a transfer function with two visible ranges of a volume's histogram.

    The histogram is cut into three classes (Otsu 1979: the cuts that leave the least variance within the classes).
    The most frequent class is the background; of the other two, the class nearer to it gets a translucent bump and the
    farther one a nearly opaque bump.

    Raises:
        BadInput: All voxels have the same value.
    """
    values = to_array(image)
    low, high = float(values.min()), float(values.max())
    check_precision(values)
    if not high > low:
        raise BadInput(f"All voxels have the value {low:.12g}: there is nothing to show.")
    counts = _histogram(values, low, high, Appearance.of(image).blank)
    first, second = _otsu(counts)
    cuts = [low, *(low + (high - low) * ((cut + 1) / BINS) for cut in (first, second)), high]
    sizes = [counts[: first + 1].sum(), counts[first + 1 : second + 1].sum(), counts[second + 1 :].sum()]
    background = int(np.argmax(sizes))
    near, far = {0: (1, 2), 1: (0, 2), 2: (1, 0)}[background]
    opacities: list[tuple[float, float, float, float]] = []
    colours: list[tuple[float, float, float, float]] = []
    for i in range(3):
        peak = {near: 0.1, far: 0.7, background: 0.0}[i]
        width = cuts[i + 1] - cuts[i]
        hue = HUES[0] if i == far else HUES[1]
        left, right = cuts[i] + 0.02 * width, cuts[i + 1] - 0.02 * width
        rise, fall = cuts[i] + 0.3 * width, cuts[i + 1] - 0.3 * width
        # A class at the end of the range stays visible up to that end: the extreme values are its core, not a border.
        opacities += [(left, peak * (i == 0), 0.5, 0.0), (rise, peak, 0.5, 0.0)]
        opacities += [(fall, peak, 0.5, 0.0), (right, peak * (i == 2), 0.5, 0.0)]
        colours += [(left, *hue), (right, *hue)]
    return TransferFunction(tuple(colours), tuple(opacities), None, "two ranges of the histogram")


def _histogram(
    values: NDArray[np.number], low: float, high: float, blank: NDArray[np.bool_] | None
) -> NDArray[np.int64]:
    """Count the values that are not blanked in equal bins. (BINS,)

    NumPy would do so in the type of the values, which may be too coarse.
    """
    counts = np.zeros(BINS, np.int64)
    for z, layer in enumerate(values):  # in float64, but never the whole volume at once
        slab = layer.ravel() if blank is None else layer[~blank[z]]
        number = (above(slab, low) * (BINS / (high - low))).astype(np.int64)
        counts += np.bincount(np.clip(number, 0, BINS - 1), minlength=BINS)
    return counts


def _otsu(counts: NDArray[np.int64]) -> tuple[int, int]:
    """Return the two bins after which to cut a histogram into the three classes that differ most."""
    weight = np.concatenate([[0.0], np.cumsum(counts, dtype=np.float64)])
    moment = np.concatenate([[0.0], np.cumsum(counts * np.arange(len(counts), dtype=np.float64))])

    def between(start: NDArray[np.intp], stop: NDArray[np.intp]) -> NDArray[np.float64]:
        share = weight[stop] - weight[start]
        return (moment[stop] - moment[start]) ** 2 / np.maximum(share, 1e-12)

    first, second = np.triu_indices(len(counts) - 1, k=1)
    zero, last = np.zeros_like(first), np.full_like(first, len(counts))
    score = between(zero, first + 1) + between(first + 1, second + 1) + between(second + 1, last)
    best = score >= score.max() * (1 - 1e-9)  # all cuts within an empty stretch are equal: take the middle one
    return int(first[best].mean()), int(second[best].mean())
