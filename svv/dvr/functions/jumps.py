"""Jumps of a transfer function: what a voxel shows whose value is exactly that of a jump.

At two points of one value, the opacity is that of the second one (as in VTK since 9.3), and the colour that of the
first (as in every VTK); in the colour space Step, it is the point's own. Ray casters look values up in tables, whose
entries lie on either side of a jump by chance, so that labels and masks would be shown or not depending on their
number. They are given a function with a narrow plateau at each jump instead, as high as the function is exactly there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from svv.dvr.functions.scales import MOST_POINTS, Points
from svv.dvr.functions.transfer_functions import TransferFunction

Array = NDArray[np.float64]
Point = tuple[float, ...]

SLOPES = 16000
"""Width of the values over that of the slope on each side of a plateau. VTK gives a table as many entries as there are
such widths, which must not be more than the 16384 of usual graphics cards."""

PLATEAU = 3.0
"""Half the width of a plateau with its slope, in widths of the slope: the plateau covers two entries on each side."""

ROOM = 0.2
"""Part of the way to the nearest other point that a plateau with its slope may take."""

PATHS, BETWEEN = "Lab/CIEDE2000", 512
"""Colour space in which VTK searches paths, and number of colours that replace them."""

SAME, ALIKE = 1e-6, 1e-3
"""Distance of two points, relative to their values and to the width, at which they make a jump; and difference of
colours and opacities that is none."""


def settled(tf: TransferFunction, width: float) -> TransferFunction:
    """Return a function, on linear scales, that tables over values of this width show as it is at its jumps.

    Args:
        tf: The function.
        width: Width of the values over which a table is made.

    Returns:
        The function itself if it does not jump; otherwise one without two points of one value, whose colours and
        opacities hold beyond its points.
    """
    if tf.space == PATHS:
        colours = _along_paths(tf.colours, tf.colour_at)
        tf = replace(tf, colours=colours, space="RGB")
    first, last = tf.range
    slope = max((width or last - first or 1.0) / SLOPES, 2.0 * float(np.spacing(max(abs(first), abs(last)))))
    sharp = [a[0] + a[2] * (b[0] - a[0]) for a, b in pairwise(tf.opacities) if a[3] > 0]
    opacities = _parted(tf.opacities, sharp, lambda at: tf.opacity_at(at)[:, None], slope, (0.5, 0.0), ())
    ends = () if tf.below is None else (0,), () if tf.above is None else (-1,)
    every = range(len(tf.colours)) if tf.space == "Step" else (*ends[0], *ends[1])
    colours = _parted(tf.colours, (), tf.colour_at, slope, (), every)
    if (opacities, colours) == (tf.opacities, tf.colours) or max(len(opacities), len(colours)) > MOST_POINTS:
        return tf
    space = "RGB" if tf.space == "Step" else tf.space
    return replace(tf, colours=colours, opacities=opacities, space=space, below=None, above=None)


def _along_paths(points: Points, at: Callable[[Array], Array]) -> Points:
    """Return points for the space RGB instead of those whose colours VTK would search paths between, for each entry."""
    values = np.unique([point[0] for point in points])
    between = np.unique(np.linspace(values[:-1], values[1:], 2 + BETWEEN // len(points))[1:-1])
    inner = [(float(value), *colour) for value, colour in zip(between, at(between))]
    return tuple(sorted([*points, *inner], key=lambda point: float(point[0])))


def _parted(
    points: Points,
    sharp: Sequence[float],
    at: Callable[[Array], Array],
    slope: float,
    straight: tuple[float, ...],
    alone: Sequence[int],
) -> Points:
    """Return points with a plateau at each jump.

    Args:
        points: Points of a function.
        sharp: Values between points at which it may jump.
        at: The function itself. (N,) -> (N, C)
        slope: Width of a plateau's slopes.
        straight: What makes a straight line to the next point.
        alone: Numbers of the points at which it may jump although no other point is near.
    """
    jumping = {points[number][0] for number in alone}
    groups: list[list[Point]] = []
    for point in sorted((*points, *((value,) for value in sharp)), key=lambda one: one[0]):
        last = groups[-1][0][0] if groups else -np.inf
        near = point[0] - last <= SAME * min(max(abs(point[0]), abs(last)), SLOPES * slope)
        groups[-1].append(point) if near else groups.append([point])
    result: list[Point] = []
    for number, group in enumerate(groups):
        own = [point for point in group if len(point) > 1]
        if len(group) == len(own) == 1 and group[0][0] not in jumping:
            result += own
            continue
        gaps = [group[0][0] - groups[number - 1][-1][0]] if number else []
        gaps += [groups[number + 1][0][0] - group[-1][0]] if number + 1 < len(groups) else []
        room, start = min(gaps, default=np.inf), len(result)
        middle = min((point[0] for point in group), key=lambda value: len(repr(value)))  # 3 of 2.9999999999999996 and 3
        off = min(1e-9 * room, 1e-9 * SLOPES * slope)
        first, last = min(group[0][0] - off, np.nextafter(group[0][0], -np.inf)), group[-1][0] + off
        before, here, after = at(np.array([first, middle, max(last, np.nextafter(group[-1][0], np.inf))]))
        curve = own[-1][1 + len(here) :] if own else straight
        step = min(slope, ROOM * room / PLATEAU)
        falls = np.abs(np.stack([here - before, after - here])).max(axis=1) > ALIKE
        if not falls.any() or step < 2.0 * np.spacing(abs(middle)):
            result += own[:1] if len(own) > 1 and own[0][1:] == own[-1][1:] else own
            continue
        if falls[0]:
            result += [
                (middle - PLATEAU * step, *before, *straight),
                (middle - (PLATEAU - 1.0) * step, *here, *straight),
            ]
        if not falls.all():
            result.append((middle, *here, *(straight if falls[1] else curve)))
        if falls[1]:
            result += [(middle + (PLATEAU - 1.0) * step, *here, *straight), (middle + PLATEAU * step, *after, *curve)]
        if not own:  # the point before it led here by a sharp curve
            result[start - 1] = (*result[start - 1][: -len(straight)], *straight)
    return tuple(tuple(float(number) for number in point) for point in result)
