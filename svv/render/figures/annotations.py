"""What is drawn into a panel of a figure: a scale bar, and how the volume's axes lie. Lengths on the page are in mm."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.render.figures.framing import distance_to, round_length
from svv.render.figures.lettering import Lettering

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INSET = 1.2
"""Distance of annotations from the edge of their panel."""

LONGEST_BAR = 0.35
"""Largest length of a scale bar, as a fraction of the panel's width."""

BAR_WIDTH, AXIS_WIDTH = 0.55, 0.22
"""Thickness of the scale bar and of the axes."""

AXIS = 4.5
"""Length of an axis that lies in the plane of the picture."""

RING = 0.75
"""Radius of the sign of an axis along the line of sight."""

LEAST_SEEN_AXIS = 0.12
"""Part of an axis' length below which it points at the viewer, or away, and is drawn as a dot or a cross."""

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def format_length(length: float, unit: str | None) -> str:
    """Return a length for a scale bar.

    >>> [format_length(x, "mm") for x in (50.0, 0.02, 2e-6)]
    ['50 mm', '0.02 mm', '2 × 10⁻⁶ mm']
    """
    if 1e-3 <= length < 1e5:
        text = f"{length:g}"
    else:
        power = int(np.floor(np.log10(length) + 1e-9))
        text = f"{length / 10.0**power:g} × 10" + str(power).translate(SUPERSCRIPTS)
    return f"{text} {unit or ('unit' if length == 1.0 else 'units')}"


def bar_of(camera: Camera, middle: NDArray[np.floating], width: float) -> tuple[float, float]:
    """Return the length of a scale bar in world units, and on a panel of ``width`` mm."""
    per_mm = float(camera.pixel_at(distance_to(camera, middle))) * camera.width / width
    length = round_length(LONGEST_BAR * width * per_mm)
    return length, length / per_mm


def bar_size(lettering: Lettering, text: str, length: float) -> tuple[float, float]:
    """Return the width and height of a scale bar with its text."""
    return max(length, lettering.width(text)) + 2 * INSET, lettering.line + BAR_WIDTH + 2 * INSET


def draw_bar(axes: Axes, place: tuple[float, float], lettering: Lettering, text: str, length: float) -> None:
    """Draw a scale bar with its text above it; its box (:func:`bar_size`) begins at a place in axes of mm."""
    width, _ = bar_size(lettering, text, length)
    x, y = place[0] + 0.5 * (width - length), place[1] + INSET
    _line(axes, (x, x + length), (y + 0.5 * BAR_WIDTH,) * 2, lettering, BAR_WIDTH)
    middle = place[0] + 0.5 * width
    axes.text(middle, y + BAR_WIDTH + 0.35, text, ha="center", va="bottom", **lettering.properties())


def axes_size(lettering: Lettering, camera: Camera) -> tuple[float, float]:
    """Return the width and height of the box of the axes with their names before a camera."""
    low, high = _extent(lettering, *_axes(lettering, camera))
    width, height = high - low + 2.0 * INSET
    return float(width), float(height)


def _axes(lettering: Lettering, camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the tips of the world's axes on the page, and the middles of their names, from their origin. (3, 2)"""
    tips = np.asarray(camera.camera_to_world[:3, :2] * AXIS)
    lengths = np.linalg.norm(tips, axis=1, keepdims=True)
    # The name of an axis along the line of sight stands away from the others.
    along = np.where(lengths < LEAST_SEEN_AXIS * AXIS, -(tips.sum(0) - tips), tips)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return tips, np.where(lengths < LEAST_SEEN_AXIS * AXIS, 0.0, tips) + 0.7 * lettering.line * along


def _extent(
    lettering: Lettering, tips: NDArray[np.float64], names: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners of the box around the axes and their names. (2,) each"""
    half, ring = 0.4 * lettering.line, np.full((1, 2), RING)
    every = np.concatenate([tips, names - half, names + half, ring, -ring])
    return every.min(0), every.max(0)


def draw_axes(
    axes: Axes, place: tuple[float, float], lettering: Lettering, names: tuple[str, str, str], camera: Camera
) -> None:
    """Draw how the world's axes lie before a camera: arrows, or a dot or a cross for one along the line of sight.

    The lower left corner of their box (:func:`axes_size`) is at a place in axes of mm from the panel's lower left
    corner.
    """
    tips, at = _axes(lettering, camera)
    towards = camera.camera_to_world[:3, 2]
    origin = np.array(place) + INSET - _extent(lettering, tips, at)[0]
    for k in np.argsort(towards):  # the one that points away first
        if float(np.hypot(*tips[k])) < LEAST_SEEN_AXIS * AXIS:
            _towards(axes, lettering, origin, bool(towards[k] > 0))
        else:
            arrow = {"arrowstyle": "-|>,head_length=0.28,head_width=0.13", "shrinkA": 0, "shrinkB": 0}
            style = {"lw": AXIS_WIDTH * 72 / 25.4, "color": lettering.ink, "mutation_scale": 10}
            axes.annotate("", tuple(origin + tips[k]), tuple(origin), arrowprops={**arrow, **style})
        x, y = origin + at[k]
        axes.text(x, y, names[k], ha="center", va="center", **lettering.properties())


def _towards(axes: Axes, lettering: Lettering, origin: NDArray[np.floating], facing: bool) -> None:
    """Draw the sign of an axis along the line of sight: a dot in a ring towards the viewer, a cross away."""
    from matplotlib.patches import Circle

    width = AXIS_WIDTH * 72 / 25.4
    axes.add_patch(Circle(tuple(origin), RING, fill=False, lw=width, ec=lettering.ink))
    if facing:
        axes.add_patch(Circle(tuple(origin), 0.25, lw=0, fc=lettering.ink))
    else:
        d = RING / np.sqrt(2.0)
        for sign in (-1.0, 1.0):
            xs, ys = (origin[0] - d, origin[0] + d), (origin[1] - sign * d, origin[1] + sign * d)
            _line(axes, xs, ys, lettering, AXIS_WIDTH)


def _line(axes: Axes, x: tuple[float, float], y: tuple[float, float], lettering: Lettering, width: float) -> None:
    axes.plot(x, y, color=lettering.ink, lw=width * 72 / 25.4, solid_capstyle="butt")
