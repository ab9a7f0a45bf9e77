"""Pixels of a view set from which training rays are drawn: what is visible, and its immediate surroundings."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from svv.io.views.viewset import ViewSet
from svv.measure import trim_memory, usable_cpus
from svv.train.run.pixels_kernels import BLOCK, draw, find, list_pixels

MARGIN = 9
"""Side in pixels of the square by which the visible part of an image is dilated: its outline must be learned, too."""

STEPS = 8
"""Number of steps of contrast that are told apart."""

Place = tuple[slice, slice]


class Pixels:
    """The pixels, drawn evenly or by their contrast.

    To draw silhouettes, edges and thin lines more often and count them less (importance sampling) leaves less noise.
    """

    def __init__(self, views: ViewSet) -> None:
        """Find the pixels of all views, and their contrast."""
        self._size = size = views.images.shape[1] * views.images.shape[2]

        def steps_of(image: NDArray[np.uint8]) -> tuple[Place, NDArray[np.uint8]]:
            near = maximum_filter(image[..., 3] > 0, MARGIN)
            place = rows, columns = slice(*_ends(near.any(axis=1))), slice(*_ends(near.any(axis=0)))
            step = np.minimum(contrast(image[rows, columns]) * STEPS, STEPS - 1).astype(np.uint8)
            step[~near[place]] = STEPS
            return place, step

        def list_view(number: int) -> None:
            (place, step), whole = found[number], np.full(views.images.shape[1:3], STEPS, np.uint8)
            whole[place] = step
            list_pixels(whole.ravel(), first[number], self._low, groups[:, number])

        # Steps are kept in bytes and indices go to their places: lists of them would take three times the memory.
        with ThreadPoolExecutor(usable_cpus()) as pool:
            found = list(pool.map(steps_of, views.images))
            counts = np.array([np.bincount(step.ravel(), minlength=STEPS + 1)[:STEPS] for _, step in found])
            first = np.cumsum(counts.T).reshape(STEPS, -1).T - counts
            self._low, groups = np.empty(counts.sum(), np.uint16), np.zeros((STEPS, len(views), -(-size // BLOCK)), int)
            list(pool.map(list_view, range(len(views))))
            found.clear()
        self._starts = np.concatenate([[0], np.cumsum(groups)])
        trim_memory()
        self.counts: NDArray[np.int64] = counts.sum(axis=0)
        """Number of pixels of each step of contrast. (STEPS,)"""

    def __len__(self) -> int:
        """Return the number of pixels of all views that may be drawn."""
        return len(self._low)

    def ranked(self, ranks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the flat indices among all views of pixels with these ranks, by steps of contrast. (R,) -> (R,)"""
        out = np.empty(len(ranks), np.int64)
        find(ranks, self._low, self._starts, self._size, STEPS, out)
        return out

    @property
    def index(self) -> NDArray[np.int64]:
        """Flat indices of all pixels, by steps of contrast: four times the memory of what is kept of them. (N,)"""
        return self.ranked(np.arange(len(self)))

    def drawn(
        self, generator: np.random.Generator, count: int, by_contrast: float = 0.0
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Return flat indices of pixels, drawn by contrast in part, and weights of an unbiased mean. (count,) each"""
        share, ends, first = steps_to_draw(self.counts, by_contrast)
        pixels, weight = np.empty(count, np.int64), np.empty(count, np.float32)
        draw(generator.random(count), share, ends, first, self._low, self._starts, self._size, pixels, weight)
        return pixels, weight


def steps_to_draw(
    counts: NDArray[np.integer], by_contrast: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return how steps of contrast with ``counts`` (STEPS,) pixels are drawn, a fraction of these by contrast.

    That is how much the pixels of each step are drawn, relative to drawing evenly (STEPS,); where each step begins if
    each pixel counts as much as it is drawn; and where it begins among all, both with the end (STEPS + 1,).
    """
    middle = (np.arange(STEPS) + 0.5) / STEPS
    mean = (counts * middle).sum() / counts.sum()
    share = 1.0 - by_contrast + by_contrast * middle / mean
    ends = np.concatenate([[0.0], np.cumsum(counts * share)])
    return share, ends, np.concatenate([[0.0], np.cumsum(counts)])


def contrast(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return how much each pixel and its eight neighbours differ, in [0, 1]: (H, W, 4) straight RGBA -> (H, W)

    The square root of the distance in premultiplied RGBA between the largest and smallest levels of 3 x 3 pixels.
    """
    shown, alpha = image.astype(np.uint16), image[..., 3]
    shown *= alpha[..., None]
    shown //= 255
    shown[..., 3] = alpha
    highest = lowest = shown.astype(np.uint8)
    for axis in (0, 1):
        highest = _of_neighbours(np.maximum, highest, axis)
        lowest = _of_neighbours(np.minimum, lowest, axis)
    spread = (highest - lowest).astype(np.float32)
    # Whole numbers, of which float32 makes no error: their sum is the same in any order, so on any CPU.
    total = np.square(spread, out=spread) @ np.ones(4, np.float32)
    return np.sqrt(np.sqrt(total) / np.float32(510.0))


def _ends(filled: NDArray[np.bool_]) -> tuple[int, int]:
    """Return where the first and the last True of (N,) are, the last one exclusive; (0, 0) if there is none."""
    return (int(filled.argmax()), len(filled) - int(filled[::-1].argmax())) if filled.any() else (0, 0)


def _of_neighbours(choose: np.ufunc, levels: NDArray[np.uint8], axis: int) -> NDArray[np.uint8]:
    """Return the largest or smallest of each level and its two neighbours along an axis."""
    out = levels.copy()
    before, after = (np.s_[:-1], np.s_[1:]) if axis == 0 else (np.s_[:, :-1], np.s_[:, 1:])
    choose(out[before], levels[after], out=out[before])
    choose(out[after], levels[before], out=out[after])
    return out


_KNOWN: WeakKeyDictionary[ViewSet, Pixels] = WeakKeyDictionary()


def pixels_of(views: ViewSet) -> Pixels:
    """Return the pixels of a view set, which are found once."""
    if views not in _KNOWN:
        _KNOWN[views] = Pixels(views)
    return _KNOWN[views]
