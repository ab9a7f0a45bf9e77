"""Smooth curves through values at given times: of numbers, of directions, and of rotations.

A curve has a continuous velocity, passes every key value, does not swing beyond one at which it turns back, and rests
between equal ones. Letters: K keys, C channels, T times that are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.errors import BadInput

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

HALF_TURN = np.radians(179.5)
"""Angle between two neighbours from which on it is not known which way round a turn goes."""


def along(values: ArrayLike, times: ArrayLike, at: ArrayLike) -> Array:
    """Return key values (K, C) at ascending times (K,), interpolated by cubic Hermite curves. (T, C)

    Before the first time and after the last one, the value is that of the nearest key.

    >>> along([[0.0], [1.0], [1.0]], [0.0, 1.0, 3.0], [0.0, 1.0, 2.0, 9.0]).ravel().tolist()
    [0.0, 1.0, 1.0, 1.0]
    """
    keys, when = np.asarray(values, np.float64), np.asarray(times, np.float64)
    if len(keys) == 1:
        return np.repeat(keys, len(np.atleast_1d(at)), axis=0)
    spans = np.diff(when)[:, None]
    velocity = tangents(np.diff(keys, axis=0) / spans, spans)
    k, t = segments(when, at)
    t, span = t[:, None], spans[k]
    start, end = keys[k], keys[k + 1]
    blend = t * t * (3.0 - 2.0 * t)
    bend = span * t * (1.0 - t) * ((1.0 - t) * velocity[k] - t * velocity[k + 1])
    return np.asarray(start + blend * (end - start) + bend)


def turned(keys: Rotation, times: ArrayLike, at: ArrayLike, names: Sequence[str]) -> Array:
    """Return key rotations interpolated at times, by Bezier curves on the sphere of rotations. (T, 3, 3)

    ``names`` call the cameras of the keys in the BadInput that is raised if two neighbours are half a turn apart.
    Source: K. Shoemake, Animating Rotation with Quaternion Curves, SIGGRAPH 1985.
    """
    from scipy.spatial.transform import Rotation

    when = np.asarray(times, np.float64)
    if len(when) == 1:
        return np.asarray(np.repeat(keys.as_matrix(), len(np.atleast_1d(at)), axis=0))
    steps = (keys[:-1].inv() * keys[1:]).as_rotvec()
    for number, angle in enumerate(np.linalg.norm(steps, axis=1)):
        if angle > HALF_TURN:
            raise BadInput(
                f"The cameras {names[number]} and {names[number + 1]} of the path are half a turn apart, and it is not "
                "known which way round it goes; put a camera between them."
            )
    spans = np.diff(when)[:, None]
    velocity = tangents(steps / spans, spans)
    which, part = segments(when, at)
    out = np.empty((len(which), 3, 3))
    for index, (k, t) in enumerate(zip(which, part, strict=True)):
        points = [
            keys[k], keys[k] * Rotation.from_rotvec(spans[k] * velocity[k] / 3.0),
            keys[k + 1] * Rotation.from_rotvec(-spans[k] * velocity[k + 1] / 3.0), keys[k + 1],
        ]  # fmt: skip
        while len(points) > 1:
            points = [a * Rotation.from_rotvec(t * (a.inv() * b).as_rotvec()) for a, b in pairwise(points)]
        out[index] = points[0].as_matrix()
    return out


def directed(keys: ArrayLike, times: ArrayLike, at: float, what: str) -> Array:
    """Return unit vectors (K, 3) at a time, by turning each evenly into the next one, the shorter way. (3,)

    ``what`` they are begins the sentence of the BadInput that is raised if two neighbours are opposite.

    >>> directed([(1, 0, 0), (0, 1, 0)], [0.0, 2.0], 1.0, "The light").round(4).tolist()
    [0.7071, 0.7071, 0.0]
    """
    vectors, when = np.asarray(keys, np.float64), np.asarray(times, np.float64)
    for number, (one, other) in enumerate(pairwise(vectors)):
        if np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other) > HALF_TURN:
            raise BadInput(
                f"{what} at {when[number]:g} s and {when[number + 1]:g} s points in opposite directions, and it is not "
                "known which way round it turns: put a key frame between them."
            )
    if len(vectors) == 1:
        return vectors[0]
    (k,), (t,) = segments(when, [at])
    one, other = vectors[k], vectors[k + 1]
    angle = np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)
    if angle < 1e-9 or t in (0.0, 1.0):
        return np.asarray(other if t == 1.0 else one)
    return np.asarray((np.sin((1.0 - t) * angle) * one + np.sin(t * angle) * other) / np.sin(angle))


def tangents(rates: Array, spans: Array) -> Array:
    """Return the velocity at each of K keys from the K - 1 velocities (K - 1, C) between them. (K, C)

    Its length is half the sum of two unit vectors times a harmonic mean of the velocities' lengths: none where the
    curve turns back or rests, and the velocity itself where both are equal. ``spans``: times between keys, (K - 1, 1).
    Source of the mean's weights: F. N. Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5, 1984.
    """
    length = np.linalg.norm(rates, axis=1, keepdims=True)
    unit = np.divide(rates, length, out=np.zeros_like(rates), where=length > 0.0)
    first, second = 2.0 * spans[1:] + spans[:-1], spans[1:] + 2.0 * spans[:-1]
    both = first * length[1:] + second * length[:-1]
    mean = np.divide((first + second) * length[:-1] * length[1:], both, out=np.zeros_like(both), where=both > 0.0)
    return np.concatenate([rates[:1], 0.5 * mean * (unit[:-1] + unit[1:]), rates[-1:]])


def segments(times: Array, at: ArrayLike) -> tuple[NDArray[np.intp], Array]:
    """Return the number of each time's segment between ascending ``times`` (K,), and how far it is in it. (T,) each"""
    wanted = np.clip(np.atleast_1d(np.asarray(at, np.float64)), times[0], times[-1])
    segment = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, len(times) - 2)
    return segment, (wanted - times[segment]) / (times[segment + 1] - times[segment])
