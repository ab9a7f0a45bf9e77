"""Where the matter of a volume that changes in time was when it was painted, found while the volume is played.

So paint moves with the matter, and strokes are born and removed, in a series of which only what is shown is known::

    moving = Moving(volumes[0], scene.values.interval, 0.0)
    for time, volume in enumerate(volumes):
        shown = at_volume(scene, classified_as(volume, tf), time, moving.matter(volume, time), moving.strokes.at(time))
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.differences import above
from svv.core.geometry.displacement import CELLS, Field, came_from, small, smoothed
from svv.dvr.read.grids import index_to_world, to_array
from svv.fields.strokes.flocks import Flocks

MOST_KNOWN = 32
"""Maximum number of times whose displacements are kept."""

Place = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Positions in the world (S, 3) -> where their matter was when it was painted. (S, 3)"""


class Moving:
    """Follows the matter of a volume from one time to another, from the nearest time that is known."""

    def __init__(
        self, image: vtkImageData, interval: tuple[float, float], time: float, times: Sequence[float] = ()
    ) -> None:  # fmt: skip
        """Begin with the volume (:func:`svv.dvr.read.grids.as_volume`) at the ``time`` at which it was painted.

        It shows something between the values of the ``interval``; ``times`` are those of the series, if they are known.
        """
        self.strokes = Flocks(time, times)
        """The strokes of the painting."""
        self.interval, self.world, self.points = interval, index_to_world(image), image.GetDimensions()
        self.painted = time
        self._known: dict[float, tuple[Field, Field | None]] = {time: (self._small(image), None)}

    def matter(self, image: vtkImageData, time: float) -> Place:
        """Return where the matter of the volume at a time was; on another grid than before, it is at rest."""
        if image.GetDimensions() != self.points or not np.allclose(index_to_world(image), self.world):
            return lambda position: position
        if time not in self._known:
            before, earlier = self._known[min(self._known, key=lambda known: abs(known - time))]
            after = self._small(image)
            self._known[time] = after, came_from(before, after, earlier)
            if len(self._known) > MOST_KNOWN:
                del self._known[next(known for known in self._known if known != self.painted)]
        values, moved = self._known[time]
        if moved is None:
            return lambda position: position
        smooth = smoothed(moved)
        factor = (np.array(self.points) - 1) / (np.array(values.shape) - 1)
        axes, origin = self.world[:3, :3] * factor, self.world[:3, 3]

        def place(position: NDArray[np.float64]) -> NDArray[np.float64]:
            cell = np.linalg.solve(axes, (position - origin).T)
            found = np.stack([map_coordinates(axis, cell, order=1, mode="nearest") for axis in smooth])
            return np.asarray(position + (axes @ found).T)

        return place

    def _small(self, image: vtkImageData) -> Field:
        """Return the volume's values as fractions of the interval, on a small grid. (X, Y, Z)"""
        low, high = self.interval
        every = tuple(slice(None, None, max(1, n // (4 * CELLS))) for n in self.points[::-1])
        share = above(to_array(image)[every].transpose(2, 1, 0), low) / (high - low)
        return small(np.clip(np.nan_to_num(share), 0.0, 1.0).astype(np.float32))
