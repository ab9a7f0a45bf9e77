"""Generated scenes with known volume and transfer function, and therefore a known class of every value.

They represent cases in which radiance fields are said to fail, as small and simple as possible: a few shapes in the
cube [-1, 1]^3 and visible ranges of values with one colour each; nothing is read from files.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.colour.colour import rgb_array
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.views import render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array

Array = NDArray[np.float64]
RGB = tuple[float, float, float]

SOFT = 0.05
"""Width in values of the ramps of opacity at both ends of a range."""

EDGE = 0.05
"""Width of the transition from a shape's value to that of its surroundings; 1 is half a side of the volume."""

LEAST_ALPHA = 0.1
"""Alpha from which a pixel belongs to a class; fainter pixels belong to none and are left out of the scores."""

BLUE, GOLD, RED, GREEN = (0.1, 0.35, 0.95), (1.0, 0.7, 0.1), (0.9, 0.12, 0.15), (0.2, 0.8, 0.3)
ORANGE, AMBER = (0.95, 0.45, 0.1), (0.95, 0.72, 0.1)
WHITE, GREY = (0.95, 0.95, 0.95), (0.4, 0.4, 0.4)


@dataclass(frozen=True)
class Range:
    """A visible range of values: the class of all values between ``low`` and ``high``."""

    low: float
    high: float
    opacity: float
    """Opacity of a slab of one opacity unit distance (a voxel's diagonal)."""
    colour: RGB


@dataclass(frozen=True)
class KnownScene:
    """A volume and its transfer function.

    Args:
        field: Values at points (3: x, y, z; ...) of the cube [-1, 1]^3.
        ranges: The visible ranges in ascending order; values between them are invisible.
        noise: Standard deviation of normal noise that is added to every voxel.
        spacing: Size of a voxel in world units; None makes the volume 2 units wide.
        stretch: Factor on the length of voxels along z, and divisor of their number.
        shift: Position of the volume's middle, in sides of the volume.
    """

    field: Callable[[Array], Array]
    ranges: tuple[Range, ...]
    noise: float = 0.0
    spacing: float | None = None
    stretch: int = 1
    shift: RGB = (0.0, 0.0, 0.0)

    def volume(self, resolution: int) -> vtkImageData:
        """Return the volume with ``resolution`` voxels along x and y, float32."""
        counts = np.array([resolution, resolution, (resolution - 1) // self.stretch + 1])
        axes = [np.linspace(-1.0, 1.0, n) for n in counts]
        z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
        values = self.field(np.stack([x, y, z]))
        values = values + self.noise * np.random.default_rng(0).standard_normal(values.shape)
        side = 2.0 if self.spacing is None else self.spacing * (resolution - 1)
        origin = side * (np.array(self.shift) - 0.5)
        return from_array(values.astype(np.float32), list(side / (counts - 1)), list(origin), "value")

    def transfer_function(self, colours: Sequence[RGB] | None = None) -> TransferFunction:
        """Return trapezoids of opacity, each in one colour: by default that of its range."""
        points: list[tuple[float, ...]] = []
        paints: list[tuple[float, ...]] = []
        for number, r in enumerate(self.ranges):
            for value, opacity in ((r.low, 0.0), (r.low + SOFT, r.opacity), (r.high - SOFT, r.opacity), (r.high, 0.0)):
                points.append((value, opacity, 0.5, 0.0))
            colour = r.colour if colours is None else colours[number]
            paints += [(r.low, *colour), (r.high, *colour)]
        return TransferFunction(tuple(paints), tuple(points), name="known")

    def classes(self, values: NDArray[np.floating]) -> NDArray[np.int16]:
        """Return the class of each value: the number of its range, or -1 if it is invisible. Same shape as values."""
        found = np.full(np.shape(values), -1, np.int16)
        for number, r in enumerate(self.ranges):
            found[(values > r.low) & (values < r.high)] = number
        return found

    def class_maps(self, volume: vtkImageData, cameras: Sequence[Camera]) -> NDArray[np.int16]:
        """Return the class of each pixel: the range that contributes most to it.

        The volume is drawn without light and with up to three ranges in pure red, green and blue, the others black:
        the colour of a pixel then gives the contribution of each.

        Args:
            volume: The volume from :meth:`volume`.
            cameras: Cameras of one image size.

        Returns:
            The range, -1 where nothing is visible, -2 where alpha is below ``LEAST_ALPHA``. (n, height, width)
        """
        shares = []
        for first in range(0, len(self.ranges), 3):
            pure = [(0.0, 0.0, 0.0)] * len(self.ranges)
            for channel, number in enumerate(range(first, min(first + 3, len(self.ranges)))):
                pure[number] = tuple(np.eye(3)[channel])
            drawn = render_views(volume, self.transfer_function(pure), cameras, "cpu", Shading(on=False))
            shares.append(drawn[..., :3])
        alpha = drawn[..., 3]
        largest = np.concatenate(shares, axis=-1).argmax(axis=-1).astype(np.int16)
        return np.where(alpha == 0, -1, np.where(alpha < 255 * LEAST_ALPHA, -2, largest)).astype(np.int16)


def solid(distance: Array) -> Array:
    """Return 1 inside a shape, 0 outside, and 0.5 on its surface (distance 0, negative inside)."""
    return 0.5 - 0.5 * np.tanh(2.0 * distance / EDGE)


def _ball(point: Array, centre: RGB, radius: float) -> Array:
    return np.asarray(np.sqrt(sum((p - c) ** 2 for p, c in zip(point, centre)))) - radius


def _ring(point: Array) -> Array:
    x, y, z = point
    return np.hypot(np.hypot(x, y) - 0.6, z) - 0.2


def ring_and_balls(point: Array) -> Array:
    """Return a ring (values near 1) and three balls (near 0) in 0.5, so neither has a skin of the other's values."""
    balls = np.min([_ball(point, (0.0, 0.0, h), 0.22) for h in (-0.65, 0.0, 0.65)], axis=0)
    return np.asarray(0.5 + 0.5 * solid(_ring(point)) - 0.5 * solid(balls))


def ring(point: Array) -> Array:
    """Return the ring without the balls."""
    return 0.5 + 0.5 * solid(_ring(point))


def shells(point: Array) -> Array:
    """Return a field that falls from 1 in the middle to 0 at the sides, in dented shells."""
    x, y, z = point
    radius = np.sqrt(x * x + y * y + z * z)
    dents = 1.0 + 0.1 * np.sin(4.0 * x + 1.0) * np.sin(4.0 * y) * np.cos(3.0 * z)
    return np.asarray(1.0 - radius * dents / 0.95)


def wires(point: Array) -> Array:
    """Return a stent: twelve wires, six in each direction, wound around a tube; a wire is 0.06 thick."""
    x, y, z = point
    across, angle = np.hypot(x, y), np.arctan2(y, x)
    distance = np.full(across.shape, np.inf)
    for way in (-1.0, 1.0):
        turn = np.mod((angle - way * 1.6 * z) * 6.0 / (2.0 * np.pi), 1.0) - 0.5
        along = turn * 2.0 * np.pi / 6.0 * across * np.cos(np.arctan(1.6 * 0.55))
        distance = np.minimum(distance, np.hypot(across - 0.55, along))
    return 0.5 + 0.5 * solid(np.maximum(distance - 0.03, np.abs(z) - 0.9))


def layers(count: int) -> Callable[[Array], Array]:
    """Return the field of ``count`` wavy layers that fill the cube from the bottom up.

    Layer k has values of about k + 0.5. Each layer is visible by itself on four sides, so pixels do not mix colours.
    """

    def field(point: Array) -> Array:
        x, y, z = point
        waves = 0.2 * np.sin(3.0 * x + 1.0) * np.cos(2.0 * y)
        return np.asarray(count * (0.5 + 0.5 * z) + waves)

    return field


GOLDEN = 0.5 * (5.0**0.5 - 1.0)
"""The golden section: of its first eight multiples as hues, no two are closer than 32 degrees, no neighbours alike."""


def distinct(count: int) -> KnownScene:
    """Return ``count`` opaque layers of distinct hues."""
    hues = np.arange(count) * GOLDEN % 1.0
    colours = rgb_array(np.stack([hues, np.full(count, 0.85), np.full(count, 0.95)], axis=1))
    ranges = (Range(k + 0.15, k + 0.85, 0.9, (r, g, b)) for k, (r, g, b) in enumerate(colours.tolist()))
    return KnownScene(layers(count), tuple(ranges))


def similar(apart: float = 0.03) -> KnownScene:
    """Return three opaque layers, two of them with hues ``apart``, too close for a palette; 1 is the full circle."""
    known = distinct(3)
    middle, top = known.ranges[1:]
    (colour,) = rgb_array(np.array([[GOLDEN + apart, 0.85, 0.95]])).tolist()
    red, green, blue = colour
    return replace(known, ranges=(known.ranges[0], middle, replace(top, colour=(red, green, blue))))


def _pair(below: RGB, above: RGB) -> tuple[Range, ...]:
    return Range(-0.5, 0.3, 0.9, below), Range(0.7, 1.5, 0.9, above)


EASY = KnownScene(ring_and_balls, _pair(BLUE, GOLD))
NESTED = KnownScene(shells, (Range(0.1, 0.24, 0.12, BLUE), Range(0.38, 0.52, 0.25, GREEN), Range(0.66, 1.5, 0.9, RED)))
SCENES: dict[str, KnownScene] = {
    "easy": EASY,
    "nested": NESTED,
    "similar-hues": KnownScene(ring_and_balls, _pair(ORANGE, AMBER)),
    "white": KnownScene(ring_and_balls, _pair(WHITE, RED)),
    "greys": KnownScene(ring_and_balls, _pair(GREY, WHITE)),
    "one-region": KnownScene(ring, (Range(0.7, 1.5, 0.9, GOLD),)),
    "wires": KnownScene(wires, (Range(0.7, 1.5, 0.9, GOLD),)),
    "noise": replace(EASY, noise=0.08),
    "anisotropic": replace(EASY, stretch=3),
    "off-centre": replace(EASY, shift=(1000.0, -500.0, 200.0)),
    "tiny-spacing": replace(EASY, spacing=1e-9),
    "huge-spacing": replace(EASY, spacing=1e6),
    **{f"regions-{count}": distinct(count) for count in range(1, 9)},
    "regions-similar": similar(),
}
"""Name -> scene."""

TRANSPARENT = replace(EASY, ranges=tuple(replace(r, opacity=0.0) for r in EASY.ranges))
"""A scene whose transfer function shows nothing, which must be refused."""
