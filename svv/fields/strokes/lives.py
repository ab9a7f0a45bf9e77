"""The lives of strokes in a series of time steps: laid once, moved with the matter, born and removed.

From the painted step, strokes are followed to both ends of the series. One whose matter is gone, or that is stretched
too far, is removed; where a surface is left bare, a copy of a stroke that lies near is set down. They grow and shrink
over a few steps. A place counts as bare only from well beyond the largest gap of the painting, and a stroke as gone
only if it is so twice in a row, so that nothing comes and goes. Letters: K points of strokes, N strokes, B places.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.core.strokes.strokes import Strokes, joined
from svv.fields.strokes.advected import Field, Laid, Places, Points, advected, landed, unit

GROWN = 3
"""Steps in which a stroke grows or shrinks."""

GONE = 0.8
"""Distance of a stroke from the surface of its value from which its matter is gone, in widths."""

STRETCHED = 2.0
"""Length of a stroke, in those it was laid with, from which it is removed; as it is if it is crumpled as much."""

BARE, LEAST_BARE = 3.0, 0.7
"""Distance to the nearest stroke from which a surface is bare: in medians of the painting's own, and in widths."""

WAS_BARE = 0.7
"""Distance from which a place of the painting was bare already, relative to that from which it is bare later: gaps that
are nearly wide enough would otherwise be filled as soon as anything moves."""

SAME = 0.5
"""Distance of a place from the surface in the painted step below which it was part of it, in widths."""

DONORS = 24
"""Number of nearest strokes among which the one is chosen that is copied."""

MOST_BORN = 4.0
"""Largest number of strokes that are born, relative to those that were painted."""


@dataclass(frozen=True, eq=False)
class Lives:
    """Strokes of one region in all time steps."""

    own: NDArray[np.int64]
    """First and last step of each stroke of the painting. (N, 2)"""
    born: Strokes | None = None
    """Strokes that were laid later, each at its own step; None if there are none."""
    when: NDArray[np.int64] | None = None
    """Step at which each of these was laid, its first and its last. (M, 3)"""

    def are_within(self, steps: int) -> bool:
        """Return whether all strokes are laid and live at a series' steps 0 to ``steps`` - 1."""
        given = [self.own] if self.when is None else [self.own, self.when]
        return all(bool(((0 <= told) & (told < steps)).all()) for told in given)

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays of a scene's file."""
        found: dict[str, NDArray[np.generic]] = {"alive": self.own.astype(np.uint16)}
        if self.born is not None and self.when is not None:
            found |= {f"born.{key}": array for key, array in self.born.packed().items()}
            found["born.when"] = self.when.astype(np.uint16)
        return found

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[np.generic]], count: int) -> Lives | None:
        """Invert :meth:`to_arrays`; None if there are none. Raises KeyError or ValueError if they do not fit."""
        if "alive" not in arrays:
            return None
        own = np.asarray(arrays["alive"]).astype(np.int64)
        born = {key.removeprefix("born."): a for key, a in arrays.items() if key.startswith("born.")}
        if own.shape != (count, 2):
            raise ValueError("the lives of strokes do not fit them")
        if not born:
            return cls(own)
        strokes, when = Strokes.unpacked(born), np.asarray(born["when"]).astype(np.int64)
        if when.shape != (len(strokes), 3):
            raise ValueError("the lives of strokes do not fit them")
        return cls(own, strokes, when)


@dataclass(frozen=True, eq=False)
class Stage:
    """What strokes need to know about a series; positions are box coordinates."""

    count: int
    """Number of steps."""
    painted: int
    """The step that was painted."""
    field: Callable[[int], Field]
    """The values of a step."""
    matter: Callable[[int], Places]
    """Where the matter at places of a step was in the painted one."""

    def laid(self, strokes: Strokes, step: int) -> Laid:
        """Return strokes that are laid at a step."""
        return Laid.on(strokes, self.field(step), self.matter(step))


def at_step(strokes: Strokes, lives: Lives | None, stage: Stage, step: int) -> Strokes:
    """Return the strokes of a region at a step: those that live, each as large as it is then."""
    own = np.tile([0, stage.count - 1], (len(strokes), 1)) if lives is None else lives.own
    groups = [(strokes, stage.painted, own)]
    if lives is not None and lives.born is not None and lives.when is not None:
        for laid in np.unique(lives.when[:, 0]):
            here = (lives.when[:, 0] == laid) & (lives.when[:, 1] <= step) & (step <= lives.when[:, 2])
            if here.any():
                groups.append((chosen(lives.born, here), int(laid), lives.when[here, 1:]))
    laid = [(begun, stage.laid(group, begun), ends) for group, begun, ends in groups]
    return living(laid, step, stage.count, stage.field(step), stage.matter(step))


def living(
    groups: Sequence[tuple[int, Laid, NDArray[np.int64]]], step: int, count: int, field: Field, matter: Places
) -> Strokes:  # fmt: skip
    """Return the strokes that live at a step of ``count``, each as large as it is then.

    ``groups``: of the strokes laid at each step, the painted one first: the step, the strokes, and the first and the
    last step of each (N, 2). Those that live at the first or the last step of all have always lived, or always will.
    ``matter``: where the matter at places of the step was in the painted one.
    """
    left: list[Strokes] = []
    for laid, group, ends in groups:
        size = _size(ends, step, count)
        if size.any() or not left:
            moved = group.strokes if laid == step else advected(group, field, matter)[0]
            left.append(moved if size.min() == 1.0 else chosen(_narrow(moved, size), size > 0.0))
    if any(map(len, left)):
        return joined([one for one in left if len(one)])
    return chosen(_narrow(moved, np.full(len(moved), 1e-3)), np.arange(len(moved)) == 0)


def lived(strokes: Strokes, stage: Stage, seed: int) -> Lives:
    """Follow the strokes of a region from the painted step to both ends of the series."""
    flock = Flock(strokes, stage.field(stage.painted), (stage.painted, stage.count), seed)
    for steps in (range(stage.painted + 1, stage.count), range(stage.painted - 1, -1, -1)):
        for step in steps:
            flock.advance(step, stage.field(step), stage.matter(step))
    return flock.lives()


@dataclass(eq=False)
class _Group:
    """Strokes that were laid at one step, as they are followed one way."""

    begun: int
    laid: Laid
    ends: NDArray[np.int64]
    """First and last step of each stroke. (N, 2)"""
    doubt: NDArray[np.bool_]
    """Which of them were gone at the step before. (N,)"""


class Flock:
    """Strokes of a region that are followed both ways from the painted step, one step after the other."""

    def __init__(
        self, strokes: Strokes, painted: Field, steps: tuple[int, int], seed: int, later: int = 0
    ) -> None:  # fmt: skip
        """Begin with the painting of some values, at the first of ``steps``; the second is their number.

        ``later``: steps that a stroke lives on after it was found to be gone, where it is shown before.
        """
        self.painted, self.count = steps
        self.seed, self.later = seed, later
        self._bare = _Bare(strokes, painted)
        own, laid = np.tile([0, self.count - 1], (len(strokes), 1)), Laid.on(strokes, painted)
        self._ways = {way: [_Group(self.painted, laid, own, np.zeros(len(own), bool))] for way in (1, -1)}
        self.reached = {1: self.painted, -1: self.painted}
        """The farthest steps that are known."""

    def advance(self, step: int, field: Field, matter: Places) -> None:
        """Let strokes be born and removed at a step beyond those that are known.

        If steps are left out, it is not known when in between they were, and nothing that could flicker was shown: a
        stroke is gone at once, unless nothing at all is visible, and one that is born has begun to grow before.
        """
        way = 1 if step > self.painted else -1
        end, last = (1, self.count - 1) if way > 0 else (0, 0)
        before, self.reached[way] = self.reached[way], step
        flock, alive, place = self._ways[way], [], self._bare.surface(field)
        far = abs(step - before) > 1 and len(place) > 0
        for group in flock:
            moved, off = advected(group.laid, field, matter)
            gone, there = _gone(group.laid.strokes, moved, off), group.ends[:, end] == last
            removed = there & gone & (group.doubt | far)
            group.ends[removed, end] = before + way * (1 + self.later)
            group.doubt = gone
            if (there & ~removed).any():
                alive.append(chosen(moved, there & ~removed))
        if sum(len(group.ends) for group in flock) > (1.0 + MOST_BORN) * len(flock[0].ends):
            return
        generator = np.random.default_rng([self.seed, step])
        new = self._bare.covered(place, joined(alive) if alive else None, (field, matter), generator)
        if new is not None:
            first = step - way * min(abs(step - before) - 1, GROWN - 1)
            ends = np.tile([first, last] if way > 0 else [last, first], (len(new), 1))
            flock.append(_Group(step, Laid.on(new, field, matter), ends, np.zeros(len(new), bool)))

    def at(self, step: int, field: Field, matter: Places) -> Strokes:
        """Return the strokes that live at a step that is known, or between such steps."""
        groups = [(-1, group.laid, group.ends) for group in self._every()]
        return living(groups, step, self.count, field, matter)

    def lives(self) -> Lives:
        """Return the lives of the strokes as far as they are known."""
        first, *born = self._every()
        if not born:
            return Lives(first.ends)
        when = [np.column_stack([np.full(len(group.ends), group.begun), group.ends]) for group in born]
        return Lives(first.ends, joined([group.laid.strokes for group in born]), np.concatenate(when))

    def _every(self) -> list[_Group]:
        return [*self._ways[1], *self._ways[-1][1:]]


def chosen(strokes: Strokes, which: NDArray[np.bool_]) -> Strokes:
    """Return some of the strokes. (N,)"""
    points = which[strokes.stroke]
    of_points = {"where", "normal", "radius", "inner", "outer"}
    found: dict[str, Any] = {
        f.name: getattr(strokes, f.name)[points if f.name in of_points else which]
        for f in fields(Strokes)
        if f.name != "start"
    }
    start = np.concatenate([[0], np.cumsum(np.diff(strokes.start)[which])]).astype(np.int64)
    return Strokes(**found, start=start)


def _size(ends: NDArray[np.int64], step: int, count: int) -> NDArray[np.floating]:
    """Return how large strokes are at a step, from 0 to 1: they grow and shrink at the ends of their lives. (N,)"""
    first, last = ends.T
    age = np.where(first > 0, step - first + 1, GROWN)
    left = np.where(last < count - 1, last - step + 1, GROWN)
    return np.asarray(np.minimum(age, left).clip(0, GROWN) / GROWN)


def _narrow(strokes: Strokes, size: NDArray[np.floating]) -> Strokes:
    radius = strokes.radius * np.maximum(size, 1e-3)[strokes.stroke].astype(np.float32)
    return replace(strokes, radius=np.asarray(radius, np.float32))


def _gone(laid: Strokes, moved: Strokes, off: Points) -> NDArray[np.bool_]:
    """Return which strokes have left their surface, or are stretched too far. (N,)"""
    far = np.add.reduceat(off, laid.start[:-1]) / np.diff(laid.start) > GONE * laid.unit
    stretched = moved.length > STRETCHED * np.maximum(laid.length, laid.unit)
    crumpled = STRETCHED * moved.length < laid.length
    return np.asarray(far | stretched | crumpled)


class _Bare:
    """Sets down copies of strokes where a surface has become bare."""

    def __init__(self, strokes: Strokes, painted: Field) -> None:
        from scipy.spatial import cKDTree

        self.field, self.width, self.painted = painted, strokes.unit, strokes
        where = strokes.where.astype(np.float64)
        self.level = float(np.median(painted.at(where)))
        self.tree, self.far = cKDTree(where), LEAST_BARE * self.width
        own = self.surface(painted)
        if len(own):
            self.far = max(self.far, BARE * float(np.median(self.tree.query(own)[0])))

    def surface(self, field: Field) -> Points:
        """Return places on the surface of a field, at most one in each cube of a third of a width. (B, 3)"""
        from skimage.measure import marching_cubes

        if not field.values.min() < self.level < field.values.max():
            return np.zeros((0, 3))
        found = marching_cubes(field.values, self.level)[0] / field.cells + field.origin
        _, first = np.unique((found / (self.width / 3.0)).astype(np.int64), axis=0, return_index=True)
        return np.asarray(found[np.sort(first)], np.float64)

    def covered(
        self, place: Points, living: Strokes | None, now: tuple[Field, Places], generator: np.random.Generator
    ) -> Strokes | None:  # fmt: skip
        """Return strokes for those places of a surface (B, 3) that are bare among strokes that live; None if none are.

        ``now``: the values of now, and where the matter was in the painted step.
        """
        from scipy.spatial import cKDTree

        if living is not None and len(place):
            place = place[cKDTree(living.where).query(place)[0] > self.far]
        if not len(place):
            return None
        # What lay bare in the painting stays so: nobody sees it.
        was = now[1](place)
        painted, width = self.field, self.width
        surface = landed(was, np.full(len(was), self.level), painted, width)
        steep = np.linalg.norm(painted.slope(surface), axis=1)
        off = np.abs(painted.at(surface) - self.level) / np.maximum(steep, 1e-3)
        there = (off < SAME * width) & (np.linalg.norm(surface - was, axis=1) < SAME * width)
        place = place[~(there & (self.tree.query(surface)[0] > WAS_BARE * self.far))]
        return self._copied(place, self.painted if living is None else living, now[0], generator)

    def _copied(
        self, place: Points, living: Strokes, field: Field, generator: np.random.Generator
    ) -> Strokes | None:  # fmt: skip
        """Return copies of strokes that lie near, one after the other where it is still bare."""
        from scipy.spatial import cKDTree

        middle = (living.start[:-1] + living.start[1:]) // 2
        # Outwards is towards lower values, or, around what is hollow, towards higher ones: as in the living strokes.
        upwards = field.slope(living.where[middle].astype(np.float64))
        facing = -1.0 if float((unit(upwards) * living.normal[middle]).sum()) < 0.0 else 1.0
        normal = unit(facing * field.slope(place))
        tree, count = cKDTree(living.where[middle]), min(DONORS, len(living))
        covered, found = np.zeros(len(place), bool), []
        near = cKDTree(place) if len(place) else None
        for number in generator.permutation(len(place)):
            if covered[number] or near is None:
                continue
            choice = np.atleast_1d(tree.query(place[number], count)[1])
            donor = int(choice[generator.integers(0, count)])
            one = _copy(living, donor, place[number], normal[number], generator)
            for reached in near.query_ball_point(one.where.astype(np.float64), 0.8 * self.far):
                covered[reached] = True
            covered[number] = True
            found.append(one)
        if not found:
            return None
        new = joined(found)
        where = landed(new.where.astype(np.float64), np.full(len(new.where), self.level), field, self.width)
        upright = unit(facing * field.slope(where))
        return replace(new, where=where.astype(np.float32), normal=upright.astype(np.float32))


def _copy(
    strokes: Strokes, donor: int, place: Points, normal: Points, generator: np.random.Generator
) -> Strokes:  # fmt: skip
    """Return a stroke as it lies, at another place with another normal."""
    one = chosen(strokes, np.arange(len(strokes)) == donor)
    middle = len(one.where) // 2
    up = one.normal[middle].astype(np.float64)
    ahead = one.frames[0][middle].astype(np.float64)
    turned = ahead - (ahead @ normal) * normal
    if np.linalg.norm(turned) < 0.2:
        turned = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
    turned /= np.linalg.norm(turned)
    old = np.stack([ahead, np.cross(up, ahead), up])
    new = np.stack([turned, np.cross(normal, turned), normal])
    turn = new.T @ old
    away = (one.where - one.where[middle]).astype(np.float64)
    return replace(
        one,
        where=(place + away @ turn.T).astype(np.float32), normal=(one.normal @ turn.T).astype(np.float32),
        seed=generator.integers(0, 1024, 1),
    )  # fmt: skip
