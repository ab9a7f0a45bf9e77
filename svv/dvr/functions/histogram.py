"""A default transfer function for a volume, from its histogram."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.differences import above
from svv.core.interval_text import interval_text
from svv.dvr.functions.bumps import HUES
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance
from svv.dvr.read.grids import check_precision, to_array
from svv.errors import BadInput

BINS = 256
"""Number of bins of the histogram."""

MOST_BEYOND = 0.001
"""Largest fraction of voxels that may be outliers at one end; never fewer than the longest side has, such as those of
a dead pixel of a detector."""

GAP = 5
"""Distance of outliers from the other values, in the width of these."""

FILL, FILL_GAP = 999.0, 1000.0
"""Least magnitude of a fill value, alone and relative to that of all other values."""

TRIED, VISIBLE, FEW = 100_000, 0.1, 0.01
"""Voxels that are looked up; part of a function's largest opacity from which they count as shown; few of them."""

MOST_OF_SIDES = 0.6
"""Part of the voxels at a volume's sides from which one class is what surrounds the object, however much that fills."""


@dataclass(frozen=True)
class UsualRange:
    """The range of a volume's values without outliers; see :func:`usual_range`."""

    low: float
    high: float
    ends: tuple[float, float]
    """Smallest and largest of all values."""
    beyond: int
    """Number of voxels beyond the range."""
    count: int
    """Number of voxels."""

    def __str__(self) -> str:
        """Say in a sentence without its end how many voxels lie beyond the range."""
        some = [f"{end:.6g}" for end, usual in zip(self.ends, (self.low, self.high), strict=True) if end != usual]
        return (
            f"{self.beyond:,} {'voxel' if self.beyond == 1 else 'voxels'} of {self.count:,} "
            f"({'at' if self.beyond == len(some) else 'as far as'} {' and '.join(some)}) "
            f"{'lies' if self.beyond == 1 else 'lie'} far beyond the others, which run from "
            f"{interval_text(self.low, self.high)}"
        )


def usual_range(image: vtkImageData) -> UsualRange | None:
    """Return the range of a volume's values without outliers, such as hot voxels and fill values; None if it has none.

    Outliers lie beyond a gap of ``GAP`` times the width of all other values, are few (``MOST_BEYOND``), and nowhere
    fill a cell: a small bright object does. Any number of voxels are outliers if they have one value, whose magnitude
    is ``FILL_GAP`` times that of all others. The other voxels have more than one value.
    """
    values, blank = to_array(image), Appearance.of(image).blank
    count = values.size if blank is None else int(values.size - blank.sum())
    most = max(MOST_BEYOND * count, *values.shape)
    low, high = ends = _ends(values, blank)
    while high > low:
        rest = _ends(values, blank, *_inner(values, blank, (low, high), most))
        if rest == (low, high) or not rest[1] > rest[0]:
            break
        low, high = rest
    if (low, high) == ends:
        return None
    inside = (values >= low) & (values <= high)
    return UsualRange(low, high, ends, count - int((inside if blank is None else inside & ~blank).sum()), count)


def _inner(
    values: NDArray[np.number], blank: NDArray[np.bool_] | None, ends: tuple[float, float], most: float
) -> tuple[float, float]:
    """Return limits around the values from end to end that are no outliers: the ends, or what lies in the gap."""
    low, high = ends
    counts = _histogram(values, low, high, blank)
    start, stop = _around_core(counts, most)
    inner = low + (high - low) * (start / BINS), low + (high - low) * (stop / BINS)
    if (start, stop) != (0.0, BINS) and not _fills_a_cell(values, blank, inner):
        return inner
    if np.count_nonzero(counts) <= 3:
        for fill, others in ((high, (low, np.nextafter(high, low))), (low, (np.nextafter(low, high), high))):
            largest = max(map(abs, _ends(values, blank, *others)))
            if abs(fill) >= max(FILL, FILL_GAP * largest):
                return others
    return ends


def _around_core(counts: NDArray[np.int64], most: float) -> tuple[float, float]:
    """Return places in a histogram, in bins, between its core and outliers, in the middle of the gap; else its ends."""
    from_left, from_right = np.cumsum(counts), np.cumsum(counts[::-1])
    first, last = int(np.argmax(from_left > most)), BINS - 1 - int(np.argmax(from_right > most))
    filled = np.flatnonzero(counts)
    while True:
        far = GAP * (last - first + 1)
        left, right = filled[filled < first], filled[filled > last]
        if left.size and first - left[-1] - 1 <= far:
            first = int(left[-1])
        elif right.size and right[0] - last - 1 <= far:
            last = int(right[0])
        else:
            return (
                0.5 * float(left[-1] + 1 + first) if left.size else 0.0,
                0.5 * float(last + 1 + right[0]) if right.size else float(BINS),
            )


def _fills_a_cell(values: NDArray[np.number], blank: NDArray[np.bool_] | None, inner: tuple[float, float]) -> bool:
    """Return whether all corners of some cell lie beyond the inner values."""
    beyond = (values < inner[0]) | (values > inner[1])
    if blank is not None:
        beyond &= ~blank
    for axis in range(3):
        beyond = np.moveaxis(beyond, axis, 0)
        beyond = np.moveaxis(beyond[1:] & beyond[:-1], 0, axis)
    return bool(beyond.any())


def _ends(
    values: NDArray[np.number], blank: NDArray[np.bool_] | None, low: float = -np.inf, high: float = np.inf
) -> tuple[float, float]:
    """Return the smallest and largest value in [low, high] that is not blanked; nothing is between them if none is."""
    ends = [np.inf, -np.inf]
    for z, layer in enumerate(values):  # never the whole volume at once
        slab = layer.ravel() if blank is None else layer[~blank[z]]
        slab = slab[(slab >= low) & (slab <= high)]
        if slab.size:
            ends = [min(ends[0], float(slab.min())), max(ends[1], float(slab.max()))]
    return ends[0], ends[1]


def describe_stretching(image: vtkImageData, usual: UsualRange, tf: TransferFunction) -> str | None:
    """Say that a function stretched over all values shows hardly any voxel, or nearly all, because of outliers.

    None if it does not, or would just as well without them.

    Args:
        image: The volume.
        usual: The range of its values without outliers.
        tf: The function, not stretched yet.
    """
    values = to_array(image).ravel()
    values = values[:: max(1, len(values) // TRIED)].astype(np.float64)

    def shown(low: float, high: float) -> float:
        opacities = tf.fitted(low, high, rescale=True).opacity_at(values)
        return float((opacities > VISIBLE * max(point[1] for point in tf.opacities)).mean())

    now, then = shown(*usual.ends), shown(usual.low, usual.high)
    if not (now < FEW and now < then) and not (now > 1.0 - FEW and now > then):
        return None
    return (
        f"{usual}. Stretched over all of them, '{tf.name}' shows {now:.2%} of the voxels, over the others it would "
        f'show {then:.2%}: give it "Points" at values of the data, or replace what lies beyond.'
    )


def describe_default_range(usual: UsualRange) -> str:
    """Say that the default transfer function is made without outliers."""
    return (
        f"{usual}: the default transfer function is made for those, and what is beyond has the colour and opacity of "
        "their ends."
    )


def default_transfer_function(image: vtkImageData, usual: UsualRange | None = None) -> TransferFunction:
    """Return a transfer function with two visible ranges of a volume's histogram.

    If ``usual`` is given (:func:`usual_range`), it is made for that range; values beyond have the colours and opacities
    of its ends. The histogram is cut into three classes (Otsu 1979: the cuts that leave the least variance within the
    classes). The background is the class of most voxels at the volume's sides, or the most frequent class if none has
    ``MOST_OF_SIDES``; of the other two, the class nearer to it gets a translucent bump and the farther one a nearly
    opaque bump. Raises BadInput if all voxels have the same value.
    """
    values = to_array(image)
    low, high = (float(values.min()), float(values.max())) if usual is None else (usual.low, usual.high)
    check_precision(values)
    if not high > low:
        raise BadInput(f"All voxels have the value {low:.12g}: there is nothing to show.")
    blank = Appearance.of(image).blank
    counts = _histogram(values, low, high, blank)
    first, second = _otsu(counts)
    cuts = [low, *(low + (high - low) * ((cut + 1) / BINS) for cut in (first, second)), high]
    sizes, at_sides = (
        np.add.reduceat(one, (0, first + 1, second + 1)) for one in (counts, _at_sides(values, low, high, blank))
    )
    surrounds = at_sides.max() > MOST_OF_SIDES * at_sides.sum()
    background = int(np.argmax(at_sides if surrounds else sizes))
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
    """Count the values from low to high that are not blanked in equal bins. (BINS,)

    NumPy would do so in the type of the values, which may be too coarse.
    """
    counts = np.zeros(BINS, np.int64)
    for z, layer in enumerate(values):  # in float64, but never the whole volume at once
        slab = layer.ravel() if blank is None else layer[~blank[z]]
        slab = slab[(slab >= low) & (slab <= high)]
        number = (above(slab, low) * (BINS / (high - low))).astype(np.int64)
        counts += np.bincount(np.clip(number, 0, BINS - 1), minlength=BINS)
    return counts


def _at_sides(
    values: NDArray[np.number], low: float, high: float, blank: NDArray[np.bool_] | None
) -> NDArray[np.int64]:
    """Return the histogram of the voxels at the six sides of a volume; those at edges count once a side. (BINS,)"""
    counts = np.zeros(BINS, np.int64)
    for axis in range(3):
        ends = [0, -1]
        counts += _histogram(np.take(values, ends, axis), low, high, None if blank is None else blank.take(ends, axis))
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
