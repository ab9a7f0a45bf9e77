"""Whether values fall into two groups with a gap between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from skimage.filters import threshold_otsu

BINS_OF_LEAST = 6
"""Number of bins of the histogram per smallest distance of two groups."""

BINS_ASIDE = 30
"""Number of bins on either side of the median; values beyond are left out."""

BLUR = 1.5
"""Standard deviation in bins of the Gaussian that smooths the histogram."""

LEAST_SHARE = 0.02
"""Share of the smaller group below which it is not one."""

DEPTH = 0.3
"""Height of the gap relative to the smaller group's peak above which the two are one."""

PARTS = 1024
"""Number of parts into which a range is divided in the search for a quantile."""


def weighted_quantile(values: NDArray[np.floating], weights: NDArray[np.floating], part: float) -> float:
    """Return the value of N > 0 up to which a ``part`` in [0, 1] of their weights >= 0 (N,) lie.

    Only the values of one of many equal parts of their range are sorted: the part in which the quantile lies.
    """
    low, high = float(values.min()), float(values.max())
    if not high > low:
        return low
    place = ((values - low) / (high - low) * PARTS).astype(np.int64).clip(max=PARTS - 1)
    below = np.cumsum(np.bincount(place, weights, PARTS))
    goal = part * below[-1]
    here = min(int(np.searchsorted(below, goal)), int(place.max()))
    mine = place == here
    order = np.argsort(values[mine], kind="stable")
    upto = (below[here - 1] if here else 0.0) + np.cumsum(weights[mine][order], dtype=np.float64)
    return float(values[mine][order[min(int(np.searchsorted(upto, goal)), len(order) - 1)]])


def gap_of(values: NDArray[np.floating], weights: NDArray[np.floating], least: float) -> float | None:
    """Return the value at the bottom of the gap between two groups of N values, or None if they are one group.

    Otsu's method (1979) finds a division of any histogram, by weights >= 0 (N,), so the peaks on both sides must be at
    least ``least`` > 0 apart, and the histogram must fall to :data:`DEPTH` of the lower one between them.
    """
    if not len(values) or weights.sum() <= 0:
        return None
    median, side = weighted_quantile(values, weights, 0.5), least / BINS_OF_LEAST
    first, last = median - (BINS_ASIDE - 0.5) * side, median + (BINS_ASIDE + 0.5) * side
    held, edges = np.histogram(values, 2 * BINS_ASIDE, (first, last), weights=weights)
    middles = 0.5 * (edges[1:] + edges[:-1])
    if np.count_nonzero(held) < 2:
        return None
    # The first bin of the upper group.
    cut = int(np.searchsorted(middles, threshold_otsu(hist=(held, middles)), side="right"))
    share = held[:cut].sum() / held.sum()
    if not LEAST_SHARE <= share <= 1.0 - LEAST_SHARE:
        return None
    smooth = gaussian_filter1d(held.astype(np.float64), BLUR, mode="constant")
    # Not of the smooth one: beside the cut, what is smeared from a large group may be higher than a small one.
    low, high = int(held[:cut].argmax()), cut + int(held[cut:].argmax())
    bottom = low + int(smooth[low : high + 1].argmin())
    if middles[high] - middles[low] < least or smooth[bottom] > DEPTH * min(smooth[low], smooth[high]):
        return None
    return float(middles[bottom])
