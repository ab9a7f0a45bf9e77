"""Cuts that move: planes and balls between key frames, and from where they cut nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.core.geometry.cuts import Cut
from svv.core.geometry.key_curves import along, directed
from svv.errors import BadInput

Array = NDArray[np.float64]

LITTLE = 1e-6
"""Radius, in sizes of the scene, of a ball that cuts nothing that is seen; and how far a plane stands off."""


class CutTrack:
    """Cuts at times; each is the same shape throughout, at other places. Raises BadInput if it is not.

    Where a key frame has fewer cuts than others, those that it lacks stand where they cut nothing.
    """

    def __init__(self, told: Sequence[tuple[float, Sequence[Cut]]], bounds: ArrayLike, centre: ArrayLike) -> None:
        """Lay the tracks. ``bounds``: corners of the scene (2, 3); ``centre``: what planes turn around (3,)."""
        self._times = [time for time, _ in told]
        self._centre, count = np.asarray(centre, np.float64), max(len(cuts) for _, cuts in told)
        every = [[cuts[k] if k < len(cuts) else None for _, cuts in told] for k in range(count)]
        self._there = every
        self._cuts = [_complete(row, bounds) for row in every]
        for row in self._cuts:
            for k, (one, other) in enumerate(pairwise(row)):
                if _kind(one) != _kind(other):
                    raise BadInput(
                        f"The cuts at {self._times[k]:g} s and {self._times[k + 1]:g} s, {one.describe()} and "
                        f"{other.describe()}, are of different kinds, so there is nothing between them: give both, one "
                        "of them where it cuts nothing."
                    )
        if len(self._times) > 1:
            self.at(
                0.5 * (self._times[0] + self._times[1])
            )  # says now if it is not known which way round a plane turns

    def at(self, time: float) -> tuple[Cut, ...]:
        """Return the cuts at a time."""
        if time in self._times:
            k = self._times.index(time)
            return tuple(row[k] for row in self._there if row[k] is not None)  # type: ignore[misc]
        return tuple(between(row, self._times, time, self._centre) for row in self._cuts)


def between(cuts: Sequence[Cut], times: Sequence[float], time: float, centre: Array) -> Cut:
    """Return a cut of one kind at a time between those of its key frames (K,)."""
    planes = []
    for k in range(len(cuts[0].planes)):
        normals = [cut.planes[k][:3] for cut in cuts]
        offsets = [[cut.planes[k][3] - float(np.dot(cut.planes[k][:3], centre))] for cut in cuts]
        x, y, z = (float(v) for v in directed(normals, times, time, "The plane of a cut"))
        offset = float(along(offsets, times, [time])[0, 0])
        planes.append((x, y, z, offset + float(np.dot((x, y, z), centre))))
    if cuts[0].centre is None:
        return replace(cuts[0], planes=tuple(planes))
    x, y, z, radius = (float(v) for v in along([[*(c.centre or ()), c.radius] for c in cuts], times, [time])[0])
    axis = None
    if cuts[0].axis is not None:
        u, v, w = (float(c) for c in directed([c.axis or () for c in cuts], times, time, "The axis of a cut"))
        axis = u, v, w
    return replace(cuts[0], planes=tuple(planes), centre=(x, y, z), radius=radius, axis=axis)


def nothing_of(cut: Cut, bounds: ArrayLike) -> Cut:
    """Return the cut where it takes nothing away of what lies within bounds (2, 3), moved as little as it must."""
    corners = np.array(list(product(*np.asarray(bounds, np.float64).T)))
    size = float(np.ptp(corners, axis=0).max())
    planes = list(cut.planes)
    for k, (x, y, z, d) in enumerate(planes):
        reach = corners @ np.array([x, y, z])
        if cut.outside:
            planes[k] = x, y, z, min(d, float(reach.min()) - LITTLE * size)
        elif k == 0:
            planes[k] = x, y, z, max(d, float(reach.max()) + LITTLE * size)
    if cut.centre is None:
        return replace(cut, planes=tuple(planes))
    away = corners - np.array(cut.centre)
    if cut.axis is not None:
        axis = np.array(cut.axis)
        away = away - (away @ axis)[:, None] * axis
    far = float(np.linalg.norm(away, axis=1).max()) * (1.0 + LITTLE)
    return replace(cut, planes=tuple(planes), radius=max(far, cut.radius or 0.0) if cut.outside else LITTLE * size)


def _complete(row: Sequence[Cut | None], bounds: ArrayLike) -> list[Cut]:
    """Return the cuts of a row, with those that are missing where the nearest one would cut nothing."""
    there = [k for k, cut in enumerate(row) if cut is not None]
    found = []
    for k, cut in enumerate(row):
        if cut is not None:
            found.append(cut)
        else:
            nearest = row[min(there, key=lambda other: abs(other - k))]
            assert nearest is not None
            found.append(nothing_of(nearest, bounds))
    return found


def _kind(cut: Cut) -> tuple[object, ...]:
    return len(cut.planes), cut.centre is None, cut.axis is None, cut.outside, cut.regions
