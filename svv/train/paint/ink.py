"""Ink drawings without a style picture: stippling, hatching and cross-hatching on the surfaces.

Every place has a tone: how far the form turns away from a light at the upper left, and how hollow it is, equalized.
Dots are spaced like Poisson discs, closer where it is darker (Deussen et al. 2000). Lines are evenly spaced streamlines
of the direction in which the surface bends least (Jobard & Lefer 1997); they swell where it is darker and end in the
light (Winkenbach & Salesin 1994), and dark places have further lines between or across them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput, Progress, part, silent
from svv.options.making import DRAWN
from svv.styles.gallery.offered import INKS, Layer

if TYPE_CHECKING:
    from svv.train.paint.surface_form import Floats, Form

PAPER = (0.97, 0.955, 0.92)
"""Colour of paper, which is not inked: warm white, RGB."""

DARKNESS, COLOURFUL = 14.0, 26.0
"""Lightness of ink, and its maximum chroma, in CIELAB: dark, but with enough colour to tell regions apart."""

HOLLOW = 0.7
"""Weight of hollowness relative to the light, both in units of their standard deviations."""

SURFACE = 2.0
"""Side of the cubes that contain at most one surface point each, in pixels or cells of the paint."""

DEPTH, THIN = 4.0, 1.5
"""Depth of strokes, and thickness up to which both sides of a sheet share them, in pixels or cells of the paint."""

SOFT = 0.5
"""Width of the soft edges of strokes, in cells of the paint."""

STEP = 0.5
"""Step along a line, in units."""

NEAREST = 0.6
"""Fraction of their spacing to which two lines may approach each other before one ends."""

SQUEEZED = 0.92
"""Factor on the spacing of lines between other lines, whose gaps are not always as wide as they should be."""

LENGTHS = (60.0, 180.0)
"""Range of the maximum length of lines, in units: a pen is lifted from time to time."""

SHORTEST, TAPER = 4.0, 5.0
"""Minimum length of lines, and length of their tapered ends, in units."""

SMALLEST, LARGEST = 0.8, 1.4
"""Radius of dots in the lightest and in the darkest tone, in units."""

BLANK = 0.12
"""Tone below which there are no dots."""

BLACKEST = 0.72
"""Fraction of the area that is ink in the darkest places."""

PACKED = 0.70
"""Squared distance of dots placed at random until no room is left, as a fraction of the area per dot."""

TOLERANCE = 1e-3
"""How far the values of a picture may lie outside of [0, 1], as those of one that was resampled do."""

TRIES = 10
"""Number of candidate dots at each point of the surface."""


@dataclass(frozen=True)
class Ink:
    """A drawing technique, used in place of a style picture; raises BadInput if there is no such ink.

    >>> painted, report = svv.stylize_scene(scene, [svv.Ink("hatching")], "draft", mapping={0: 0})
    >>> report["manner"], painted.regions[0].style
    ({'0': 'ink'}, 'ink:hatching')
    """

    kind: str
    """One of :data:`INKS`: ``stippling``, ``hatching`` or ``cross-hatching``."""
    size: float = 1.0
    """Scale of the strokes; :func:`svv.train.pipeline.stylize_scene` replaces it by its stroke size."""

    def __post_init__(self) -> None:
        if self.kind not in INKS:
            inks = ", ".join(DRAWN + kind for kind in INKS)
            raise BadInput(f"There is no '{self.name}'; choose one of {inks}.")

    @property
    def name(self) -> str:
        """Name of the ink among styles, such as ``ink:hatching``."""
        return DRAWN + self.kind


Style = NDArray[np.floating] | Ink
"""A style of a region: a picture (H, W, 3), sRGB in [0, 1], or an ink."""


@dataclass(frozen=True, eq=False)
class StyleInput:
    """A style with its name and mask, for :func:`svv.train.pipeline.stylize_scene`.

    Raises:
        BadInput: The style is neither an ink nor an RGB picture in [0, 1] or of bytes, or the picture is too small.

    >>> picture = np.random.default_rng(0).random((64, 64, 3), np.float32)
    >>> svv.StyleInput(picture, "noise").name
    'noise'
    """

    style: Style
    """A picture or an ink."""
    name: str | None = None
    """Name of a picture; an ink has its own."""
    mask: NDArray[np.bool_] | None = None
    """Part of the picture to learn from, (h, w), None for all of it. For several, give the picture several times."""
    measured: NDArray[np.bool_] | None = None
    """Of a divided picture, the part in which its hand is measured, (h, w); None for all of it."""
    divided: bool = False
    """Whether the mask is a part of a divided picture, whose hand is that of the whole."""

    def __post_init__(self) -> None:
        if not isinstance(self.style, Ink):
            object.__setattr__(self, "style", _validate_style(self.style))


def _validate_style(picture: object) -> Floats:
    """Return a picture whose bytes, if it has some, count from 0 to 1; raises BadInput if it is none. (H, W, 3)"""
    if isinstance(picture, str | Path):
        raise BadInput(
            f"A style is a picture or an ink, not a name: read the picture with svv.read_style('{picture}')."
        )
    values = np.asarray(picture)
    if values.ndim != 3 or values.shape[2] != 3 or min(values.shape) < 1 or values.dtype.kind not in "uif":
        raise BadInput(f"A style picture is an array of numbers (height, width, 3), not {values.dtype} {values.shape}.")
    values = values / np.float32(255.0) if values.dtype == np.uint8 else values
    if not (np.isfinite(values).all() and -TOLERANCE <= values.min() and values.max() <= 1.0 + TOLERANCE):
        raise BadInput(
            "A style picture is sRGB in [0, 1] or of bytes: read it with svv.read_style, or scale its values."
        )
    return np.asarray(values, np.float32)


def ink_named(source: object) -> Ink | None:
    """Return the ink that ``ink:NAME`` means, None if the source names none; raises BadInput if it does not exist."""
    text = str(source)
    if not text.startswith(DRAWN):
        return None
    return Ink(text.removeprefix(DRAWN).strip().lower().replace("_", "-").replace(" ", "-"))


def style_named(source: str | Path, progress: Progress = silent) -> tuple[str, Style]:
    """Return the name and picture or ink of ``ink:NAME``, ``gallery:NAME`` or a file; raises BadInput without one."""
    from svv.styles.gallery import open_style

    ink = ink_named(source)
    return open_style(source, progress) if ink is None else (ink.name, ink)


def picture_of(style: Style) -> NDArray[np.floating]:
    """Return the picture of a style, for its mask; raises BadInput for an ink."""
    if isinstance(style, Ink):
        raise BadInput(f"{style.name} is drawn without a picture, so there is nothing to mask: leave out its mask.")
    return style


def ink_colour(colour: Sequence[float]) -> Floats:
    """Return the ink colour of a region: dark, with the region's hue, RGB. (3,)"""
    from svv.core.colour.colour import lab_to_rgb, rgb_to_lab

    _, a, b = rgb_to_lab(np.clip(np.asarray(colour, np.float64), 0.0, 1.0))
    scale = min(1.0, COLOURFUL / max(float(np.hypot(a, b)), 1e-9))
    return lab_to_rgb(np.array([DARKNESS, scale * a, scale * b]))


def tones(form: Form, points: Floats, normals: Floats) -> Floats:
    """Return the darkness of points (S, 3) with outward normals (S, 3), larger where darker, without a unit. (S,)"""
    from svv.train.paint.quilt import LIGHT

    dark = -(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    hollow = form.hollowness(points)
    return np.asarray(dark / max(dark.std(), 1e-3) + HOLLOW * hollow / max(hollow.std(), 1e-3), np.float32)


@dataclass(frozen=True)
class Sheet:
    """The surface of a region on which to draw: points, at most one in each cube of side ``side``.

    ``points``, ``normals`` and ``tangents`` are (S, 3), ``tones`` (S,) in [0, 1] and evenly distributed.
    """

    side: float
    slot: NDArray[np.int32]
    """Number of the point in each cube, -1 for none. (X, Y, Z)"""
    points: Floats
    normals: Floats
    tangents: Floats
    tones: Floats

    @classmethod
    def of(cls, form: Form, surface: Floats, side: float) -> Sheet:
        """Return the surface through visible points (S, 3); points at several depths are moved to their mean depth."""
        from svv.train.paint import ink_kernels as numba_inking
        from svv.train.paint.surface_form import in_cubes, slots_of

        points = np.ascontiguousarray(surface[in_cubes(surface, side)[0]])
        normals, tangents, _ = form.frames(points)
        tone = tones(form, points, normals)
        out = np.empty((len(points), 10))
        numba_inking.settle(side, slots_of(points, side), points, normals, tangents, tone, out)
        out = out[in_cubes(out[:, :3].astype(np.float32), side)[0]]
        rank = np.argsort(np.argsort(out[:, 9])) / max(len(out) - 1, 1)
        points, normals, tangents = (np.ascontiguousarray(out[:, k : k + 3], np.float32) for k in (0, 3, 6))
        return cls(side, slots_of(points, side), points, normals, tangents, rank.astype(np.float32))

    @property
    def looked_up(self) -> tuple[float, NDArray[np.int32], Floats, Floats, Floats, Floats]:
        """Arguments of the kernels."""
        return self.side, self.slot, self.points, self.normals, self.tangents, self.tones


@dataclass(frozen=True)
class Strokes:
    """Discs on a surface; lines are rows of discs."""

    where: Floats
    """Box coordinates of the discs. (K, 3)"""
    normal: Floats
    """Outward unit normals. (K, 3)"""
    radius: Floats
    """Radii in box units. (K,)"""
    line: NDArray[np.int64]
    """Number of the line of each disc; every dot has its own. (K,)"""
    layer: NDArray[np.int64]
    """Number of the layer of each disc. (K,)"""


def dots(sheet: Sheet, unit: float, cell: float, seed: int) -> Strokes:
    """Draw the dots of stippling; ``unit``, of radii and distances, and ``cell``, of the paint, are in box units."""
    from svv.train.paint import ink_kernels as numba_inking

    generator = np.random.default_rng(seed)
    near = generator.permutation(np.repeat(np.arange(len(sheet.points)), TRIES))
    aside = generator.uniform(-0.75, 0.75, (len(near), 2)).astype(np.float32) * sheet.side
    other = np.cross(sheet.normals, sheet.tangents)
    place = sheet.points[near] + aside[:, :1] * sheet.tangents[near] + aside[:, 1:] * other[near]
    tone, normal = sheet.tones[near], sheet.normals[near]
    place, normal, tone = (a[tone > BLANK] for a in (place, normal, tone))
    dark = (tone - BLANK) / (1.0 - BLANK)
    radius = unit * (SMALLEST + (LARGEST - SMALLEST) * dark)
    distance = radius * np.sqrt(PACKED * np.pi / (BLACKEST * np.maximum(dark, 0.04)))
    size = 1.5 * float(distance.max(initial=unit))
    head, following = _bins(size, len(place))
    kept = np.empty(len(place), np.int64)
    count = numba_inking.scatter(place, normal, distance, THIN * cell, size, head, following, kept)
    own = kept[:count]
    return Strokes(place[own], normal[own], radius[own].astype(np.float32), np.arange(count), np.zeros(count, np.int64))


class Family:
    """Lines of one direction, filled in by the kernels; for ``start`` see :func:`svv.train.paint.ink_kernels.draw`."""

    def __init__(self, sheet: Sheet, angle: float, side: float, most: int) -> None:
        """Allocate ``most`` line points in bins of side ``side``, on a sheet with its tangents turned by ``angle``."""
        other = np.cross(sheet.normals, sheet.tangents)
        turned = np.ascontiguousarray(np.cos(angle) * sheet.tangents + np.sin(angle) * other, np.float32)
        self.sheet, self.side, self.count = replace(sheet, tangents=turned), side, 0
        self.head, self.following = _bins(side, most)
        self.where, self.normal, self.tangent = (np.empty((most, 3), np.float32) for _ in range(3))
        self.tone, self.start = np.empty(most, np.float32), np.zeros(most // 4 + 2, np.int64)

    def draw(self, layer: Layer, unit: float, thin: float, generator: np.random.Generator) -> slice:
        """Add the lines of a layer; returns their numbers."""
        from svv.train.paint import ink_kernels as numba_inking

        first, order = self.count, generator.permutation(len(self.sheet.points))
        least = layer.tone + generator.uniform(-0.05, 0.05, 997)
        longest = (generator.uniform(*LENGTHS, 991) / STEP).astype(np.int64)
        apart = layer.apart * unit * (SQUEEZED if layer.between else 1.0)
        self.count = numba_inking.draw(
            order, least, longest, apart, NEAREST * apart, thin, STEP * unit, int(SHORTEST / STEP),
            *self.sheet.looked_up, self.side, self.head, self.following, self.where, self.normal, self.tangent,
            self.tone, self.start, self.count,
        )  # fmt: skip
        return slice(first, self.count)


def lines(sheet: Sheet, layers: Sequence[Layer], unit: float, cell: float, seed: int, progress: Progress) -> Strokes:
    """Draw the lines of hatching, layer by layer; for the arguments see :func:`dots`."""
    generator = np.random.default_rng(seed)
    side = 1.5 * max(layer.apart for layer in layers) * unit
    most = int(len(sheet.points) * sheet.side**2 / (0.25 * STEP * min(x.apart for x in layers) * unit**2)) + 4096
    family, parts = Family(sheet, 0.0, side, most), []
    for number, layer in enumerate(layers):
        progress(number / len(layers), "drawing lines")
        if number and not layer.between:
            family = Family(sheet, layer.across, side, most)
        drawn = family.draw(layer, unit, THIN * cell, generator)
        start = family.start[drawn.start : drawn.stop + 1]
        line = np.repeat(np.arange(len(start) - 1), np.diff(start))
        own = slice(int(start[0]), int(start[-1]))
        index = np.arange(own.start, own.stop)
        end = np.minimum(index - start[:-1][line], start[1:][line] - 1 - index) * STEP
        dark = np.clip((family.tone[own] - layer.tone) / (1.0 - layer.tone), 0.0, 1.0)
        width = (layer.thin + (layer.thick - layer.thin) * dark) * generator.uniform(0.9, 1.1, len(start))[line]
        radius = 0.5 * unit * width * np.minimum(1.0, 0.35 + end / TAPER)
        layer_of = np.full(len(line), number)
        parts.append((family.where[own], family.normal[own], radius.astype(np.float32), line, layer_of))
    progress(1.0, "drawing lines")
    return Strokes(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _bins(side: float, count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    cells = int(np.ceil(1.0 / side)) + 1
    return np.full((cells, cells, cells), -1, np.int32), np.full(count, -1, np.int32)


class Drawing:
    """A region drawn in ink."""

    def __init__(
        self, ink: Ink, colour: Sequence[float], form: Form, surface: Floats, pixel: float, cell: float,
        seed: int, progress: Progress,
    ) -> None:  # fmt: skip
        """Draw a region at visible points (S, 3), in ink of its colour's hue, as fine as pixels or cells allow."""
        from svv.train.paint import ink_kernels as numba_inking

        self.form, self.cell, self.colour = form, cell, ink_colour(colour)
        fine = max(pixel, cell)
        self.depth, self.thin = DEPTH * fine, THIN * fine
        self.sheet = Sheet.of(form, surface, SURFACE * fine)
        layers, unit = INKS[ink.kind], ink.size * fine
        progress(0.1, "drawing")
        if layers:
            self.strokes = lines(self.sheet, layers, unit, fine, seed, part(progress, 0.1, 1.0))
        else:
            self.strokes = dots(self.sheet, unit, fine, seed)
        radius = float(self.strokes.radius.max(initial=0.0)) + SOFT * cell
        self._side = float(np.hypot(self.depth, radius))
        self._head, self._following = _bins(self._side, len(self.strokes.where))
        numba_inking.put_all(self.strokes.where, self._side, self._head, self._following)

    def covered(self, position: Floats) -> Floats:
        """Return how much ink there is at box coordinates (V, 3), in [0, 1]. (V,)"""
        from svv.train.paint import ink_kernels as numba_inking

        out = np.empty(len(position), np.float32)
        normal = self.form.frames(position)[0]
        numba_inking.cover(
            np.ascontiguousarray(position, np.float32), normal, self.depth, self.thin, SOFT * self.cell, self._side,
            self._head, self._following, self.strokes.where, self.strokes.normal, self.strokes.radius, out,
        )  # fmt: skip
        return np.maximum(out, 0.0)

    def __call__(self, position: Floats) -> Floats:
        """Return the colours at box coordinates (V, 3) -> (V, 3)."""
        paper = np.array(PAPER, np.float32)
        return np.asarray(paper + self.covered(position)[:, None] * (self.colour - paper), np.float32)
