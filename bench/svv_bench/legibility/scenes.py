"""Generated scenes of several translucent, nested regions, and questions whose answers are known.

A name is a kind and a seed, such as ``shells-3``; the same name always gives the same volume, camera, marks and
questions. Everything lies in the cube [-1, 1]^3. What is opaque has the largest and the smallest values, so that its
surface, where values pass to those of the surroundings, shows no value but those of faint skins.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import grey_dilation, label
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from svv.core.geometry.cameras import Camera, CameraRig
from svv.errors import BadInput
from svv.io.files.atomic import make_folder, write_json
from svv.job.demo import write_volume
from svv_bench.stability.scenes import KnownScene, Range, solid

Array = NDArray[np.float64]
Point = tuple[float, float, float]

RESOLUTION = 96
"""Voxels along each side of a volume that is written."""

RIG = CameraRig((0.0, 0.0, 0.0), 5.0, float(np.pi / 6))
"""Where the cameras of the questions' pictures stand: the scenes fill four fifths of these."""

CANDIDATES, LOOK, LOOK_RESOLUTION = 96, 96, 64
"""Number of cameras to choose from, and the size of their pictures and of the volume in them."""

AT_ONCE = 8
"""Cameras whose pictures are drawn together."""

APART, AROUND = 0.1, 0.045
"""Smallest distance of two marks in a picture, and of a mark and a tube that passes it, in widths of it."""

CROSSING = 0.01
"""Distance of tubes that cross in a picture, in widths of it."""

OWN = 0.25
"""Distance from a mark up to which a tube is the one that is marked."""

ATTEMPTS = 40
"""Scenes of one name that are tried until a camera shows everything that is asked for."""

STEP = 0.65
"""Difference of the values on both sides of a skin."""

RAMP = 0.14
"""Width of a skin's transition between them; half of it is visible."""

TUBE, BALL = -1.0, 3.2
"""Values of what is opaque."""

BEIGE, BLUE, VIOLET = (0.75, 0.7, 0.55), (0.3, 0.5, 0.85), (0.6, 0.35, 0.75)
RED, GOLD, GREEN, PINK = (0.9, 0.17, 0.15), (1.0, 0.78, 0.1), (0.2, 0.68, 0.4), (0.85, 0.65, 0.6)

TUBES, BALLS = Range(-1.6, -0.5, 0.9, RED), Range(2.6, 3.8, 0.9, GOLD)


@dataclass(frozen=True)
class Question:
    """A question on one picture, with its choices."""

    what: str
    """Its kind: ``parts``, ``count``, ``layers``, ``inside``, ``end``, ``joined``, ``widest`` or ``depth``."""
    text: str
    choices: tuple[str, ...]
    answer: str
    """The right one of the choices."""


@dataclass(frozen=True)
class Mark:
    """A mark in the picture."""

    at: Point
    part: int
    """Number of the range that is visible there."""
    beside: tuple[Point, float] | None = None
    """A place, and how far from the line of sight through it the mark lies at least, in one of the views."""


@dataclass(frozen=True)
class TaskScene:
    """A scene, its questions and what its picture has to show so that they can be answered."""

    known: KnownScene
    questions: tuple[Question, ...]
    marks: Mapping[str, Mark] = field(default_factory=dict)
    """Their letters or numbers."""
    curves: Sequence[Array] = ()
    """Middles of its tubes: none but its own passes near a mark in the picture. (n, 3) each"""
    forks: Sequence[tuple[Array, Array]] = ()
    """Forks of a tree, and the middles of another, which does not pass near them in the picture. (n, 3), (m, 3)"""
    bodies: tuple[int, int] | None = None
    """Number of a range and of its bodies, which lie side by side in the first view."""
    turn: float | None = None
    """Degrees by which the scene is turned in a second view, about the vertical of the first; None is one view."""
    apart: float = APART
    """Smallest distance of two marks in the first view in widths of it; in the second, half of that."""
    crossing: int = 0
    """Pairs of its tubes that cross in the first view, at least."""

    def views(self, camera: Camera) -> list[Camera]:
        """Return the cameras of a picture, the first of which is given."""
        if self.turn is None:
            return [camera]
        turned = np.eye(4)
        turned[:3, :3] = Rotation.from_rotvec(-np.radians(self.turn) * camera.camera_to_world[:3, 1]).as_matrix()
        return [camera, replace(camera, camera_to_world=turned @ camera.camera_to_world)]


def _skin(depth: Array) -> Array:
    """Return 0 outside and STEP inside a surface, with a ramp between; ``depth`` is positive inside."""
    return STEP * np.clip(depth / RAMP + 0.5, 0.0, 1.0)


def _skin_range(number: int, opacity: float, colour: Point) -> Range:
    """Return the visible middle of the ramp of the skin ``number``, counted from the outside."""
    low = STEP * number
    return Range(low + 0.15, low + 0.5, opacity, colour)


def _put(values: Array, value: float, distance: Array) -> Array:
    """Return values with an opaque body (distance < 0) of one value; its edge is half as wide as other scenes'."""
    return np.asarray(values + (value - values) * solid(2.0 * distance))


def _length(point: Array) -> Array:
    return np.asarray(np.sqrt((point**2).sum(axis=0)))


def _to_balls(point: Array, centres: Sequence[Point], radius: float) -> Array:
    ways = [_length(point - np.reshape(centre, (3,) + (1,) * (point.ndim - 1))) for centre in centres]
    return np.asarray(np.min(ways, axis=0) - radius)


def _to_curves(point: Array, curves: Sequence[Array], radius: float) -> Array:
    """Return the distance from tubes around curves, each a dense list of points. (n, 3)"""
    distance, _ = cKDTree(np.concatenate(curves)).query(point.reshape(3, -1).T, distance_upper_bound=0.2)
    return np.asarray(np.minimum(distance, 0.2).reshape(point.shape[1:]) - radius)


def _dented(point: Array, phase: float, strength: float = 0.06) -> Array:
    x, y, z = point
    return 1.0 + strength * np.sin(4.0 * x + phase) * np.sin(4.0 * y) * np.cos(3.0 * z)


def _spread(
    random: np.random.Generator, count: int, radius: float, apart: float, fits: Callable[[Array], bool] | None = None
) -> list[Point]:
    """Return points in a ball that are ``apart`` and fit."""
    found: list[Point] = []
    while len(found) < count:
        place = random.uniform(-radius, radius, 3)
        if (
            np.linalg.norm(place) <= radius
            and all(np.linalg.norm(place - other) >= apart for other in found)
            and (fits is None or fits(place))
        ):
            x, y, z = place.tolist()
            found.append((x, y, z))
        elif random.random() < 0.01:
            found.clear()
    return found


def _point(place: Array) -> Point:
    x, y, z = place.tolist()
    return x, y, z


def _numbers(first: int, last: int) -> tuple[str, ...]:
    return tuple(str(number) for number in range(first, last + 1))


def _parts(answer: int) -> Question:
    text = (
        "How many kinds of parts does the picture show? Skins around others, balls and tubes are parts. Parts of the "
        "same form that have the same colours or pattern are one kind; skins inside one another are different kinds."
    )
    return Question("parts", text, _numbers(1, 6), str(answer))


def _end(
    random: np.random.Generator, start: Array, right: Array, wrong: Sequence[Array], text: str, part: Sequence[int]
) -> tuple[dict[str, Mark], Question]:
    """Return the marks S and A, B, C at ends, and the question which one belongs to S.

    ``part``: the range of the start, of the right end and of each wrong one.
    """
    ends = [right, *wrong]
    order = random.permutation(len(ends))
    letters = tuple("ABCDEFGH"[: len(ends)])
    marks = {letter: Mark(_point(ends[k]), part[k + 1]) for letter, k in zip(letters, order)}
    answer = letters[list(order).index(0)]
    return {"S": Mark(_point(start), part[0]), **marks}, Question("end", text, letters, answer)


TRACE = "A tube starts at the ring S. Follow it: at which of the rings does it end?"


def shells(random: np.random.Generator) -> TaskScene:
    """Return two nested skins, two tubes wound between them, and three balls, one of which is in the inner skin."""
    phase, turns, first = random.uniform(0, 6), random.uniform(0.8, 1.5), random.uniform(0, 2 * np.pi)
    turned, handed = Rotation.random(random_state=random).as_matrix(), random.choice((-1.0, 1.0))
    tubes = []
    for start in (first, first + np.pi):
        along = np.linspace(0.0, 1.0, 400)
        height, angle = np.radians(-62 + 124 * along), start + handed * 2 * np.pi * turns * along
        ring = np.stack([np.cos(height) * np.cos(angle), np.sin(height), np.cos(height) * np.sin(angle)], axis=1)
        tubes.append(0.74 * ring @ turned)
    aside = random.normal(size=3)
    centre = 0.26 * aside / np.linalg.norm(aside)
    winding = cKDTree(np.concatenate(tubes))
    while True:
        around = np.array(_spread(random, 2, 0.64, 0.4))
        if winding.query(around)[0].min() > 0.18 and np.linalg.norm(around - centre, axis=1).min() > 0.58:
            break
    inner = centre + _spread(random, 1, 0.17, 0.0)[0]
    places = [_point(place) for place in (inner, *around)]

    def values(point: Array) -> Array:
        from_centre = point - np.reshape(centre, (3,) + (1,) * (point.ndim - 1))
        skins = _skin(0.9 - _length(point)) + _skin(0.4 - _length(from_centre) * _dented(point, phase))
        return _put(_put(skins, BALL, _to_balls(point, places, 0.1)), TUBE, _to_curves(point, tubes, 0.045))

    ranges = (TUBES, _skin_range(0, 0.05, BEIGE), _skin_range(1, 0.12, BLUE), BALLS)
    marks, trace = _end(
        random, tubes[0][0], tubes[0][-1], [tubes[1][0], tubes[1][-1]], TRACE, (0, 0, 0, 0)
    )  # fmt: skip
    order = random.permutation(3)
    for number, k in enumerate(order):
        marks[str(number + 1)] = Mark(places[k], 3, (_point(centre), 0.54) if k else None)
    inside = str(list(order).index(0) + 1)
    text = "There are two skins, one inside the other. Which ball lies inside the inner skin?"
    return TaskScene(
        KnownScene(values, ranges), (_parts(4), Question("inside", text, _numbers(1, 3), inside), trace), marks, tubes
    )


def _tree(random: np.random.Generator, root: Array, others: Sequence[Array]) -> tuple[list[Array], list[Array]]:
    """Grow a tree that keeps away from others; returns its branches as dense curves, and its tips."""
    branches: list[Array] = []
    tips: list[Array] = []
    far = cKDTree(np.concatenate(others)) if others else None

    def grow(place: Array, way: Array, forks: int) -> None:
        points = [place]
        for _ in range(4):
            way = way + random.normal(0, 0.25, 3)
            way /= np.linalg.norm(way)
            nearer = place + 0.12 * way
            if np.linalg.norm(nearer / (0.74, 0.6, 0.64)) > 1 or (far is not None and far.query(nearer)[0] < 0.15):
                break
            place = nearer
            points.append(place)
        if len(points) < 3:
            tips.append(points[-1])
            if len(points) > 1:
                branches.append(_dense(np.array(points)))
            return
        branches.append(_dense(np.array(points)))
        if not forks:
            tips.append(place)
            return
        aside = np.cross(way, random.normal(size=3))
        aside *= 0.9 / np.linalg.norm(aside)
        grow(place, way + aside, forks - 1)
        grow(place, way - aside, forks - 1)

    grow(root, np.array([-np.sign(root[0]), 1.2, 0.0]), 2)  # the trees pass each other
    return branches, tips


def _dense(points: Array, count: int = 60) -> Array:
    """Return many points on the smooth curve through some. (count, 3)"""
    if len(points) < 3:
        return np.linspace(points[0], points[-1], count)
    return np.asarray(CubicSpline(np.arange(len(points)), points)(np.linspace(0, len(points) - 1, count)))


def tissue(random: np.random.Generator) -> TaskScene:
    """Return lobed tissue with two branching vessels and one to five balls."""
    while True:
        roots = [np.array([side * 0.35, -0.42, side * random.uniform(0.1, 0.25)]) for side in (-1.0, 1.0)]
        one, one_tips = _tree(random, roots[0], [])
        two, two_tips = _tree(random, roots[1], one)
        if len(one_tips) >= 2 and len(two_tips) >= 2:
            break
    count, phase = int(random.integers(1, 6)), random.uniform(0, 6)
    vessels = [*one, *two]
    forks = [
        (np.array([branch[0] for branch in tree]), np.concatenate(other)) for tree, other in ((one, two), (two, one))
    ]
    near = cKDTree(np.concatenate(vessels))
    while True:
        balls = _spread(random, count, 0.55, 0.3)
        if near.query(balls)[0].min() > 0.17:
            break

    def values(point: Array) -> Array:
        x, y, z = point
        reach = np.sqrt((x / 0.95) ** 2 + (y / 0.8) ** 2 + (z / 0.85) ** 2)
        lobes = 1 + 0.05 * np.sin(8 * x + phase) * np.sin(8 * y) * np.sin(7 * z)
        skin = _skin(0.85 * (0.95 - reach * lobes))
        return _put(_put(skin, BALL, _to_balls(point, balls, 0.11)), TUBE, _to_curves(point, vessels, 0.04))

    ranges = (TUBES, _skin_range(0, 0.07, PINK), Range(BALLS.low, BALLS.high, 0.9, GREEN))
    text = "A branching tube starts at the ring S. Which of the other rings can be reached from S along its branches?"
    wrong = [two_tips[k] for k in random.permutation(len(two_tips))[:2]]
    right = one_tips[int(random.integers(len(one_tips)))]
    marks, trace = _end(random, roots[0], right, wrong, text, (0, 0, 0, 0))
    counted = Question("count", "How many balls are there?", _numbers(1, 6), str(count))
    return TaskScene(KnownScene(values, ranges), (_parts(3), counted, trace), marks, vessels, forks, (2, count))


def _meets_itself(curve: Array, clear: float = 0.17) -> bool:
    """Return whether places of a curve (n, 3) that are farther apart along it come near each other."""
    along = np.concatenate([[0.0], np.linalg.norm(np.diff(curve, axis=0), axis=1).cumsum()])[::4]
    near = np.linalg.norm(curve[::4, None] - curve[::4], axis=2) < clear
    return bool(near[np.abs(np.subtract.outer(along, along)) > 2.0 * clear].any())


def tangle(random: np.random.Generator) -> TaskScene:
    """Return two or three tangled tubes of two looks, with or without a faint skin around them."""
    count, skin = int(random.integers(2, 4)), bool(random.integers(2))
    tubes: list[Array] = []
    while len(tubes) < count:
        curve = _dense(np.array(_spread(random, 5, 0.72, 0.5)), 400)
        if np.linalg.norm(curve, axis=1).max() < 0.8 and not _meets_itself(curve):
            if not tubes or cKDTree(np.concatenate(tubes)).query(curve)[0].min() > 0.13:
                tubes.append(curve)
            elif random.random() < 0.03:
                tubes.clear()

    def values(point: Array) -> Array:
        around = _skin(0.93 - _length(point)) if skin else np.full(point.shape[1:], STEP)
        return _put(_put(around, TUBE, _to_curves(point, tubes[::2], 0.05)), BALL, _to_curves(point, tubes[1::2], 0.05))

    ranges = (TUBES, *([_skin_range(0, 0.06, BEIGE)] if skin else []), Range(BALLS.low, BALLS.high, 0.9, BLUE))
    looks = [0 if k % 2 == 0 else len(ranges) - 1 for k in range(count)]
    ends = [(tube[k], looks[number]) for number, tube in enumerate(tubes) for k in (0, -1)]
    (start, own), (right, _), *others = ends
    chosen = [others[k] for k in random.permutation(len(others))[:2]]
    marks, trace = _end(
        random, start, right, [place for place, _ in chosen], TRACE, (own, own, *(look for _, look in chosen))
    )
    text = "How many tubes are there? A tube is one piece from end to end, whatever it passes."
    counted = Question("count", text, _numbers(1, 4), str(count))
    return TaskScene(KnownScene(values, ranges), (_parts(len(ranges)), counted, trace), marks, tubes)


def nuts(random: np.random.Generator) -> TaskScene:
    """Return two or three nested skins and one to five balls in the innermost."""
    layers, count, phase = int(random.integers(2, 4)), int(random.integers(1, 6)), random.uniform(0, 6)
    radii = (0.9, 0.66) if layers == 2 else (0.92, 0.74, 0.56)
    balls = _spread(random, count, radii[-1] - 0.24, 0.3)

    def values(point: Array) -> Array:
        radius = _length(point)
        skins = sum(_skin(r - radius * _dented(point, phase + 2 * k, 0.04)) for k, r in enumerate(radii))
        return _put(np.asarray(skins), BALL, _to_balls(point, balls, 0.11))

    skins = [_skin_range(k, o, c) for k, (o, c) in enumerate(((0.04, BEIGE), (0.07, BLUE), (0.1, VIOLET))[:layers])]
    ranges = (*skins, Range(BALLS.low, BALLS.high, 0.9, RED))
    text = "How many skins lie inside one another around the balls in the middle?"
    questions = (
        _parts(layers + 1), Question("layers", text, _numbers(1, 4), str(layers)),
        Question("count", "How many balls are there?", _numbers(1, 6), str(count)),
    )  # fmt: skip
    return TaskScene(KnownScene(values, ranges), questions, bodies=(layers, count))


def vessels(random: np.random.Generator) -> TaskScene:
    """Return four thin tubes of different widths that cross in projection, and two to eight small balls, in a skin."""
    count, phase, skin = int(random.integers(2, 9)), random.uniform(0, 6), bool(random.integers(2))
    tubes: list[Array] = []
    levels = np.array([-0.6, -0.2, 0.2, 0.6])
    while len(tubes) < len(levels):
        if not tubes:
            heights = np.stack([random.permutation(levels) for _ in range(5)], axis=1)  # at places along each tube
            heights[:, 1:4] *= 0.65
        height = heights[len(tubes)]
        out = np.sqrt(0.8**2 - height[[0, -1]] ** 2)  # ends lie on a circle
        depth = random.uniform(-0.4, 0.4, 5) * (0.1, 1, 1, 1, 0.1)
        points = np.stack([(-out[0], -0.25, 0.0, 0.25, out[1]), height, depth], axis=1)
        curve = _dense(points, 400)
        if np.linalg.norm(curve, axis=1).max() > 0.82 or (
            tubes and cKDTree(np.concatenate(tubes)).query(curve)[0].min() < 0.12
        ):
            if random.random() < 0.2:
                tubes.clear()
            continue
        tubes.append(curve)
    radii = random.permutation((0.03, 0.03, 0.03, 0.042))
    near = cKDTree(np.concatenate(tubes))
    balls = _spread(random, count, 0.72, 0.22, lambda place: bool(near.query(place)[0] > 0.15))

    def values(point: Array) -> Array:
        around = _skin(0.93 - _length(point) * _dented(point, phase, 0.03))
        rest = around if skin else np.full(point.shape[1:], STEP)
        apart = np.min([_to_curves(point, [tube], radius) for tube, radius in zip(tubes, radii)], axis=0)
        return _put(_put(rest, BALL, _to_balls(point, balls, 0.075)), TUBE, apart)

    ranges = (TUBES, *([_skin_range(0, 0.06, BEIGE)] if skin else []), BALLS)
    order = random.permutation(len(tubes))
    marks = {str(n + 1): Mark(_point(tube[10]), 0) for n, tube in enumerate(tubes)}
    marks |= {letter: Mark(_point(tubes[n][-11]), 0) for letter, n in zip("ABCD", order)}
    joined = [
        Question("joined", f"Follow the tube that ends at the ring {letter}: at which number does it start?",
                 _numbers(1, 4), str(n + 1))
        for letter, n in zip("ABC", order)
    ]  # fmt: skip
    widest = Question("widest", "Which of the tubes 1 to 4 is the thickest?", _numbers(1, 4), str(radii.argmax() + 1))
    counted = Question("count", "How many balls are there?", _numbers(2, 8), str(count))
    return TaskScene(
        KnownScene(values, ranges), (*joined, widest, counted, _parts(len(ranges))), marks, tubes,
        bodies=(len(ranges) - 1, count), turn=30.0, crossing=5, apart=0.08,
    )  # fmt: skip


def wrapped(random: np.random.Generator) -> TaskScene:
    """Return two or three skins inside one another, off centre, and three to eight small balls between and in them."""
    layers, count, phase = int(random.integers(2, 4)), int(random.integers(3, 9)), random.uniform(0, 6)
    radii = (0.92, 0.55) if layers == 2 else (0.92, 0.66, 0.38)
    centres = [np.zeros(3)]
    for _ in radii[1:]:
        aside = random.normal(size=3)
        centres.append(centres[-1] + 0.07 * aside / np.linalg.norm(aside))

    def depths(point: Array) -> list[Array]:
        """Return how deep points (3, ...) lie in each skin; (...) each."""
        at = [point - np.reshape(centre, (3,) + (1,) * (point.ndim - 1)) for centre in centres]
        return [r - _length(p) * _dented(p, phase + 2 * k, 0.04) for k, (r, p) in enumerate(zip(radii, at))]

    while True:
        balls = np.array(_spread(random, count, 0.8, 0.2, lambda place: bool(np.abs(depths(place)).min() > 0.115)))
        within = (np.array(depths(balls.T)) > 0).sum(axis=0)
        if len(set(within.tolist())) == layers:
            break

    def values(point: Array) -> Array:
        skins = np.asarray(sum(_skin(depth) for depth in depths(point)))
        return _put(skins, BALL, _to_balls(point, [_point(ball) for ball in balls], 0.07))

    looks = ((0.04, BEIGE), (0.07, BLUE), (0.1, VIOLET))[:layers]
    ranges = (*(_skin_range(k, o, c) for k, (o, c) in enumerate(looks)), BALLS)
    marks, asked = {}, []
    for number, k in enumerate(random.permutation(count)[:3]):
        name, lies = str(number + 1), int(within[k])
        next_skin = (_point(centres[lies]), 1.12 * radii[lies]) if lies < layers else None
        marks[name] = Mark(_point(balls[k]), layers, next_skin)
        text = f"Inside how many skins does the ball at the ring {name} lie?"
        asked.append(Question("depth", text, _numbers(1, 4), str(lies)))
    layered = Question("layers", "How many skins lie inside one another?", _numbers(1, 4), str(layers))
    counted = Question("count", "How many balls are there?", _numbers(2, 8), str(count))
    return TaskScene(
        KnownScene(values, ranges), (*asked, layered, counted, _parts(layers + 1)), marks, bodies=(layers, count),
        turn=75.0,
    )  # fmt: skip


KINDS: dict[str, Callable[[np.random.Generator], TaskScene]] = {
    "shells": shells, "tissue": tissue, "tangle": tangle, "nuts": nuts, "vessels": vessels, "wrapped": wrapped,
}  # fmt: skip
"""Kinds of scenes: four that most people answer from any fair picture, and two harder ones, seen in two views.

Seeds depend on the order of the names, so that a new kind comes last in the alphabet.
"""


@lru_cache(maxsize=64)
def task_scene(name: str) -> tuple[TaskScene, Camera]:
    """Return a scene by its name, such as ``shells-3``, and the camera of its picture.

    The camera is the one of :data:`CANDIDATES` from which everything that is asked for is visible, and the marks are
    farthest apart.

    Raises:
        BadInput: There is no such kind, or the seed is no whole number from 0.
    """
    kind, _, seed = name.rpartition("-")
    if kind not in KINDS or not (seed.isascii() and seed.isdigit() and len(seed) < 10):
        raise BadInput(
            f"'{name}' is no generated scene: give a kind ({', '.join(KINDS)}) and a seed, such as shells-0."
        )
    for attempt in range(ATTEMPTS):
        scene = KINDS[kind](np.random.default_rng([sorted(KINDS).index(kind), int(seed), attempt]))
        camera = best_camera(scene)
        if camera is not None:
            return scene, camera
    raise BadInput(f"No camera shows all of {name}: give another seed.")


def best_camera(scene: TaskScene) -> Camera | None:
    """Return the camera that shows all marks farthest apart, and every body by itself; None if none does."""
    cameras = RIG.sphere(CANDIDATES, LOOK)
    spreads = {number: _spread_of(scene, camera) for number, camera in enumerate(cameras)}
    fitting = sorted((n for n, spread in spreads.items() if spread >= scene.apart), key=lambda n: -spreads[n])
    if not fitting:
        return None
    volume = scene.known.volume(LOOK_RESOLUTION)
    for first in range(0, len(fitting), AT_ONCE):
        some = [scene.views(cameras[number]) for number in fitting[first : first + AT_ONCE]]
        maps = iter(scene.known.class_maps(volume, [view for views in some for view in views]))
        for views in some:
            seen = [next(maps) for _ in views]
            if all(_marks_are_seen(scene, *pair) for pair in zip(views, seen)) and _bodies_are_apart(scene, seen[0]):
                return views[0]
    return None


def _spread_of(scene: TaskScene, camera: Camera) -> float:
    """Return the smallest distance of two marks in widths of the picture, 0 if something is not where it must be."""
    views = scene.views(camera)
    lines = np.array([-view.camera_to_world[:3, 2] for view in views])
    for mark in scene.marks.values():
        if mark.beside is not None:
            aside = np.linalg.norm(np.cross(lines, np.subtract(mark.at, mark.beside[0])), axis=1)
            if aside.max() < mark.beside[1]:
                return 0.0
    shown = [_in_widths(camera, curve) for curve in scene.curves] if scene.crossing else []
    if sum(bool(cdist(one, other).min() < CROSSING) for one, other in combinations(shown, 2)) < scene.crossing:
        return 0.0
    places = np.array([mark.at for mark in scene.marks.values()]).reshape(-1, 3)
    spreads = []
    for view in views:
        apart = cdist(*2 * (_in_widths(view, places),))
        spreads.append(float(apart[np.triu_indices(len(places), 1)].min(initial=1.0)))
    return 0.0 if _is_passed(scene, camera, places) else min(spreads[0], *(2 * spread for spread in spreads[1:]), 1.0)


def _is_passed(scene: TaskScene, camera: Camera, places: Array) -> bool:
    """Return whether a tube passes a mark (n, 3) in the picture, or a tree a fork of the other."""
    shown = _in_widths(camera, places)
    for curve in scene.curves if len(places) else ():
        passing = np.linalg.norm(places[:, None] - curve, axis=2) > OWN
        if (cdist(shown, _in_widths(camera, curve))[passing] < AROUND).any():
            return True
    return any(
        bool((cdist(_in_widths(camera, forks), _in_widths(camera, other)) < AROUND).any())
        for forks, other in scene.forks
    )


def _in_widths(camera: Camera, places: Array) -> Array:
    """Return column and row of places (n, 3) in widths of the picture. (n, 2)"""
    return np.stack(camera.project(places)[:2], axis=1) / camera.width


def _marks_are_seen(scene: TaskScene, camera: Camera, seen: NDArray[np.int16]) -> bool:
    """Return whether a map of classes (h, w) has each mark on its part."""
    for mark in scene.marks.values():
        column, row, _ = (int(value) for value in camera.project(mark.at))
        if seen[row, column] != mark.part:
            return False
    return True


def _bodies_are_apart(scene: TaskScene, seen: NDArray[np.int16]) -> bool:
    """Return whether a map of classes (h, w) has each body by itself."""
    if scene.bodies is None:
        return True
    part, count = scene.bodies
    bodies, found = label(seen == part)
    touching = label(grey_dilation(seen == part, (3, 3)))[1]
    return found == touching == count and bool((np.bincount(bodies.ravel())[1:] >= 9).all())


def write_scene(name: str, folder: Path, resolution: int = RESOLUTION) -> tuple[Path, Path]:
    """Write the volume of a scene (``NAME.vti``) and its transfer function (``NAME.tf.json``); returns both paths.

    Raises:
        BadInput: See :func:`task_scene`; or a file cannot be written.
    """
    scene, _ = task_scene(name)
    make_folder(folder)
    volume, function = folder / f"{name}.vti", folder / f"{name}.tf.json"
    write_volume(volume, scene.known.volume(resolution))
    write_json(function, [scene.known.transfer_function().to_dict()])
    return volume, function
