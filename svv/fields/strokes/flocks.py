"""Strokes of a painting while a series is shown, in any order: they live as far as has been shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from svv.core.strokes.strokes import Strokes
from svv.fields.strokes.advected import Field, Places
from svv.fields.strokes.lives import GROWN, Flock, Lives

FAR = 1 << 20
"""Number of the painted step: there are as many on both sides, for nobody knows how many will be shown."""

Alive = Callable[[Strokes, int, Field, Field, Places], Strokes]
"""Strokes as painted, their region, the values that were painted, those of now, and where the matter of now was in the
painted step -> the strokes that live now."""


class Flocks:
    """Strokes of all regions.

    The first time that a time is shown which lies beyond all others, strokes are born and removed; whenever one is
    shown again, or one in between, those that live then are shown. A stroke that has gone is shown for as long as it
    takes to shrink, for nobody knew before that it would go.
    """

    def __init__(self, painted: float, times: Sequence[float] = ()) -> None:
        """Begin with the painting at a time of a series.

        ``times``: those of the series; if none are known, each that is shown beyond the others is the next one.
        """
        self.painted, self._times = painted, sorted({*times, painted}) if times else [painted]
        self._grows = not times
        self._known: dict[Strokes, Flock] = {}

    def at(self, time: float) -> Alive:
        """Return what gives the strokes at a time."""
        if self._grows and not self._times[0] <= time <= self._times[-1]:
            self._times = sorted([*self._times, time])
        near = np.abs(np.subtract.outer([time, self.painted], self._times)).argmin(axis=1)
        step = FAR + int(near[0] - near[1])

        def alive(strokes: Strokes, region: int, painted: Field, now: Field, matter: Places) -> Strokes:
            if strokes not in self._known:
                self._known[strokes] = Flock(strokes, painted, (FAR, 2 * FAR + 1), region, GROWN - 2)
            flock = self._known[strokes]
            if not flock.reached[-1] <= step <= flock.reached[1]:
                flock.advance(step, now, matter)
            return flock.at(step, now, matter)

        return alive

    def lives(self) -> list[Lives]:
        """Return the lives of each region's strokes as far as they are known; the painted step has the number FAR."""
        return [flock.lives() for flock in self._known.values()]
