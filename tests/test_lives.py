"""Strokes in a series of time steps: they move with the matter, and are born and removed, but never laid again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from svv.core.strokes.strokes import Strokes, joined, straight_stroke
from svv.fields.strokes.advected import Field
from svv.fields.strokes.flocks import Flocks
from svv.fields.strokes.lives import GROWN, Lives, Stage, at_step, lived
from tests.nightly import nightly

CELLS, STEPS, PAINTED, LEVEL, WIDTH = 40, 9, 4, 0.5, 0.04

Balls = Callable[[float], list[tuple[tuple[float, float, float], float]]]
"""Time in [0, 1] -> centre and radius of every ball."""


def soft(place: np.ndarray, balls: list[tuple[tuple[float, float, float], float]]) -> np.ndarray:
    """The largest of soft balls, 1/2 on their surfaces, at places (..., 3)."""
    values = [0.5 + np.clip((r - np.linalg.norm(place - np.array(c), axis=-1)) / 0.2, -0.5, 0.5) for c, r in balls]
    return np.max(values, axis=0) if values else np.zeros(place.shape[:-1])


def field_of(balls: list[tuple[tuple[float, float, float], float]]) -> Field:
    vertices = np.stack(np.meshgrid(*[np.arange(CELLS + 1) / CELLS] * 3, indexing="ij"), axis=-1)
    return Field(soft(vertices, balls).astype(np.float32), float(CELLS), np.zeros(3))


Motion = Callable[[float], tuple[float, float, float]]


def stage_of(balls: Balls, motion: Motion = lambda time: (0.0, 0.0, 0.0)) -> Stage:
    """A series of balls whose matter has moved as a whole by ``motion`` since the painted step."""
    times = np.linspace(0.0, 1.0, STEPS)

    def matter(step: int) -> Callable[[np.ndarray], np.ndarray]:
        moved = np.array(motion(times[step])) - np.array(motion(times[PAINTED]))
        return lambda place: place - moved

    return Stage(STEPS, PAINTED, cache(lambda step: field_of(balls(times[step]))), matter)


def painted(balls: list[tuple[tuple[float, float, float], float]]) -> Strokes:
    """Short strokes all over the balls, about a width apart."""
    parts = []
    for centre, radius in balls:
        count = int(4 * np.pi * radius**2 / WIDTH**2)
        turn = np.arange(count) + 0.5
        z, angle = 1 - 2 * turn / count, np.pi * (1 + 5**0.5) * turn
        normals = np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)
        for normal in normals:
            ahead = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
            ahead *= WIDTH / np.linalg.norm(ahead)
            middle = np.array(centre) + radius * normal
            ends = [tuple(map(float, middle + sign * ahead)) for sign in (-1, 1)]
            parts.append(straight_stroke(ends[0], ends[1], WIDTH / 2, normal=tuple(map(float, normal)), points=3))
    return joined(parts)


def still(time: float) -> list[tuple[tuple[float, float, float], float]]:
    return [((0.4, 0.5, 0.5), 0.2)]


def moving(time: float) -> list[tuple[tuple[float, float, float], float]]:
    return [((0.3 + 0.3 * time, 0.5, 0.5), 0.2)]


def appears(time: float) -> list[tuple[tuple[float, float, float], float]]:
    return [*still(time), *([((0.75, 0.5, 0.5), 0.05 + 0.1 * time)] if time > 0.7 else [])]


def vanishes(time: float) -> list[tuple[tuple[float, float, float], float]]:
    return [*still(time), *([((0.83, 0.5, 0.5), 0.12)] if time < 0.55 else [])]


def divides(time: float) -> list[tuple[tuple[float, float, float], float]]:
    apart = 0.22 * max(time - 0.5, 0.0)
    return [((0.5, 0.5 - apart, 0.5), 0.17), ((0.5, 0.5 + apart, 0.5), 0.17)]


def grows(time: float) -> list[tuple[tuple[float, float, float], float]]:
    return [((0.5, 0.5, 0.5), 0.12 + 0.2 * time)]


def story(balls: Balls, **motion: Motion) -> tuple[Strokes, Lives, Stage]:
    stage = stage_of(balls, **motion)
    strokes = painted(balls(PAINTED / (STEPS - 1)))
    return strokes, lived(strokes, stage, 0), stage


def test_strokes_of_a_ball_that_moves_go_with_it() -> None:
    strokes, lives, stage = story(moving, motion=lambda time: (0.3 * time, 0.0, 0.0))
    assert lives.born is None and (lives.own == (0, STEPS - 1)).all()
    for step in range(STEPS):
        there = at_step(strokes, lives, stage, step)
        shift = 0.3 * (step - PAINTED) / (STEPS - 1)
        assert np.abs(there.where - strokes.where - np.array([shift, 0, 0])).max() < 0.1 * WIDTH
        assert (there.normal * strokes.normal).sum(1).min() > 0.99
        assert np.array_equal(there.colour, strokes.colour) and np.array_equal(there.seed, strokes.seed)


def test_strokes_stay_on_their_surface_where_the_flow_is_wrong() -> None:
    """The matter is said to be at rest, and the ball grows by half a width in each step."""
    strokes, lives, stage = story(grows)
    for step in range(PAINTED, PAINTED + 3):
        there = at_step(strokes, lives, stage, step)
        off = np.linalg.norm(there.where - 0.5, axis=1) - grows(step / (STEPS - 1))[0][1]
        assert np.abs(off).mean() < 0.2 * WIDTH


def check_covered(there: Strokes, balls: list[tuple[tuple[float, float, float], float]]) -> None:
    for centre, radius in balls:
        normals = np.random.default_rng(0).normal(size=(200, 3))
        surface = np.array(centre) + radius * normals / np.linalg.norm(normals, axis=1, keepdims=True)
        away = cKDTree(there.where).query(surface[soft(surface, balls) < 0.52])[0]
        assert np.quantile(away, 0.97) < 2.5 * WIDTH, centre


@pytest.mark.parametrize("balls", nightly([still, moving, appears, vanishes, divides, grows], appears, grows))
def test_every_surface_is_covered_and_nothing_comes_back(balls: Balls) -> None:
    """Each stroke has one span of steps; what was covered by the painting's measure is so in all steps."""
    strokes, lives, stage = story(balls)
    assert (lives.own[:, 0] <= PAINTED).all() and (lives.own[:, 1] >= PAINTED).all()
    if lives.when is not None:
        assert (lives.when[:, 1] <= lives.when[:, 0]).all() and (lives.when[:, 0] <= lives.when[:, 2]).all()
        assert (lives.when[:, 0] != PAINTED).all()
    for step in range(STEPS):
        there = at_step(strokes, lives, stage, step)
        check_covered(there, balls(step / (STEPS - 1)))


def test_what_appears_gets_strokes_and_what_vanishes_loses_them() -> None:
    strokes, lives, stage = story(appears)
    assert lives.born is not None and lives.when is not None and (lives.own == (0, STEPS - 1)).all()
    assert np.linalg.norm(lives.born.where - (0.75, 0.5, 0.5), axis=1).max() < 0.25, "none where there was paint"
    assert lives.when[:, 0].min() == 6 and len(at_step(strokes, lives, stage, 5)) == len(strokes)
    strokes, lives, stage = story(vanishes)
    lost = lives.own[:, 1] < STEPS - 1
    away = np.linalg.norm(strokes.where[strokes.start[:-1]] - (0.83, 0.5, 0.5), axis=1)
    assert np.array_equal(lost, away < 0.14) and lives.born is None


def test_strokes_grow_and_shrink_over_some_steps() -> None:
    strokes, lives, stage = story(appears)
    assert lives.when is not None
    born = int(lives.when[0, 0])
    sizes = []
    for step in range(born, STEPS):
        there = at_step(strokes, lives, stage, step)
        sizes.append(float(there.radius[strokes.start[-1] :].max()))
    assert sizes[0] == pytest.approx(WIDTH / 2 / GROWN, rel=1e-3)
    assert sizes == sorted(sizes)


def test_one_step_without_anything_removes_nothing() -> None:
    """Hysteresis: strokes are gone only if they are so twice in a row."""
    gap = 6 / (STEPS - 1)
    strokes, lives, stage = story(lambda time: [] if time == gap else still(time))
    assert (lives.own == (0, STEPS - 1)).all() and lives.born is None
    assert np.abs(at_step(strokes, lives, stage, STEPS - 1).where - strokes.where).max() < 0.1 * WIDTH
    nothing = story(lambda time: still(time) if time <= 0.5 else [])
    assert (nothing[1].own[:, 1] == PAINTED + 2).all() and len(at_step(nothing[0], nothing[1], nothing[2], 8)) == 1


def test_what_returns_after_all_was_gone_is_painted_again() -> None:
    strokes, lives, stage = story(lambda time: [] if 0.5 < time < 0.9 else still(time))
    assert lives.born is not None and (lives.own[:, 1] < STEPS - 1).all()
    there = at_step(strokes, lives, stage, STEPS - 1)
    assert cKDTree(there.where).query(strokes.where)[0].max() < 3 * WIDTH


def test_files_keep_the_lives() -> None:
    strokes, lives, stage = story(appears)
    again = Lives.from_arrays(lives.to_arrays(), len(strokes))
    assert again is not None and np.array_equal(again.own, lives.own)
    mine, its = (at_step(strokes, one, stage, STEPS - 1) for one in (lives, again))
    np.testing.assert_allclose(its.where, mine.where, atol=1e-3)
    assert Lives.from_arrays({}, 3) is None
    damaged = lives.to_arrays()
    damaged["alive"] = damaged["alive"][1:]
    with pytest.raises(ValueError, match="do not fit"):
        Lives.from_arrays(damaged, len(strokes))
    damaged = lives.to_arrays()
    damaged["born.when"] = damaged["born.when"][1:]
    with pytest.raises(ValueError, match="do not fit"):
        Lives.from_arrays(damaged, len(strokes))


def test_lives_are_within_the_steps_that_there_are() -> None:
    _, lives, _ = story(appears)
    assert lives.are_within(STEPS) and not lives.are_within(STEPS - 1) and not lives.are_within(0)
    assert not Lives(np.array([[-1, 2]])).are_within(STEPS)


class Live:
    """A series that is played: strokes as painted on its middle, and those that live at a time."""

    def __init__(self, balls: Balls, times: tuple[float, ...] = ()) -> None:
        strokes = painted(balls(PAINTED / (STEPS - 1)))
        red = np.linspace(0.0, 1.0, len(strokes), dtype=np.float32)
        self.balls, self.strokes = balls, replace(strokes, colour=np.stack([red] * 3, axis=1))
        self.flocks = Flocks(float(PAINTED), times)

    def at(self, step: float) -> Strokes:
        before, now = (field_of(self.balls(one / (STEPS - 1))) for one in (PAINTED, step))
        return self.flocks.at(step)(self.strokes, 0, before, now, lambda place: place)


FORTH, BACK = range(PAINTED + 1, STEPS), range(PAINTED - 1, -1, -1)


@pytest.mark.parametrize("balls", nightly([still, moving, appears, vanishes, divides, grows], moving, divides))
def test_what_is_played_is_covered_and_looks_the_same_again(balls: Balls) -> None:
    """In whichever order: the ends in turn, and then all steps again."""
    live = Live(balls)
    seen = {step: live.at(step) for step in [*FORTH, *BACK]}
    for step, there in seen.items():
        check_covered(there, balls(step / (STEPS - 1)))
        again = live.at(step)
        assert np.array_equal(again.where, there.where) and np.array_equal(again.radius, there.radius)


def test_played_strokes_change_little_from_step_to_step() -> None:
    """Births, and removals of which nobody knew before, take as many steps as in a file of the series."""
    for balls, way, changes in ((appears, FORTH, True), (vanishes, FORTH, True), (still, BACK, False)):
        live, most = Live(balls), 0.0
        before = _by_name(live.strokes)
        for step in way:
            there = _by_name(live.at(step))
            most = max(most, *(abs(there.get(name, 0.0) - before.get(name, 0.0)) for name in {*there, *before}))
            before = there
        assert most < 1.01 * WIDTH / 2 / GROWN and (most > 0.99 * WIDTH / 2 / GROWN) == changes


def _by_name(strokes: Strokes) -> dict[tuple[float, int], float]:
    """The half widths of strokes, by their colours and irregularities, which they keep."""
    told = zip(strokes.colour[:, 0].tolist(), strokes.seed.tolist(), _widths(strokes).tolist(), strict=True)
    return {(red, seed): width for red, seed, width in told}


def _widths(strokes: Strokes) -> np.ndarray:
    return np.maximum.reduceat(strokes.radius, strokes.start[:-1])


def test_after_a_jump_strokes_are_there_at_once_and_what_has_gone_is_not() -> None:
    """Known times tell that steps are left out; one in which nothing is visible still removes no stroke."""
    times = tuple(map(float, range(STEPS)))
    live = Live(appears, times)
    there = live.at(STEPS - 1)
    check_covered(there, appears(1.0))
    assert _widths(there).min() > 0.99 * WIDTH / 2
    live = Live(vanishes, times)
    there = live.at(STEPS - 1)
    assert np.linalg.norm(there.where - (0.83, 0.5, 0.5), axis=1).min() > 0.14 and len(there) < len(live.strokes)
    between = live.at(5.2)
    assert len(between) == len(live.strokes), "they have not gone at once"
    live = Live(lambda time: [] if time == 1.0 else still(time), times)
    live.at(STEPS - 1)
    assert len(live.at(STEPS - 2)) == len(live.strokes)
