"""Ink drawings that need no picture: stippling, hatching and cross-hatching laid on the surfaces.

A tone is found for every place: how much the form turns away from a light at the upper left, and how much it is a
hollow (:class:`svv.train.form.Form`), brought to equal shares from light to dark. Dots lie apart as Poisson discs do,
the closer the darker it is (Deussen et al. 2000); lines are evenly spaced streamlines of the direction in which the
surface bends least (Jobard & Lefer 1997), that swell where it is darker and end in the light (Winkenbach & Salesin
1994), with lines between or across them in the dark. All is the same from every side: strokes are on the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput, Progress, part
from svv.fields.paint_light import DRAWN
from svv.kernels import inking
from svv.train.form import Floats, Form
from svv.train.quilt import LIGHT

PAPER = (0.97, 0.955, 0.92)
"""Colour of what is not inked: warm white, RGB."""

DARKNESS, COLOURFUL = 20.0, 32.0
"""Lightness of ink, and its chroma at most, in CIELAB: dark, but regions are told apart by their inks."""

HOLLOW = 0.7
"""What a hollow weighs beside the light, both in units of their deviations."""

SURFACE = 2.0
"""Side of the cubes of which each has one point of the surface at most, in pixels or cells of the paint."""

DEPTH, THIN = 4.0, 1.5
"""How deep strokes go, and within what the two sides of a sheet share them, in pixels or cells of the paint."""

SOFT = 0.9
"""Width of the rims of strokes, in cells of the paint."""

STEP = 0.5
"""Of a line, in units."""

SMALLEST, LARGEST = 0.85, 1.45
"""Radius of dots in the lightest and in the darkest tone, in units."""

BLANK = 0.12
"""Tone from which on there are dots."""

BLACKEST = 0.72
"""Part of the darkest places that is ink."""

PACKED = 0.70
"""Dots laid at random as long as there is room: part of the square of their distance for each."""

TRIES = 10
"""Candidates for dots at each point of the surface."""


@dataclass(frozen=True)
class Layer:
    """Lines of one direction."""

    across: float
    """Angle against the direction in which the surface bends least, radians."""
    apart: float
    """Distance of their middles, in units."""
    tone: float
    """Where they begin: the lighter part of the surface has none of them."""
    thin: float
    """Their width there,"""
    thick: float
    """and in the darkest places, in units."""
    between: bool = False
    """Whether they lie between the lines of the layer before, with which they then share the direction."""


HATCHING = (Layer(0.0, 6.0, 0.16, 1.2, 2.9), Layer(0.0, 3.0, 0.60, 0.9, 1.9, True))
CROSSED = (
    Layer(0.0, 6.0, 0.16, 1.2, 2.2), Layer(1.15, 6.0, 0.48, 1.2, 2.2), Layer(0.0, 3.0, 0.82, 0.9, 1.6, True)
)  # fmt: skip


INKS: dict[str, tuple[tuple[Layer, ...], str]] = {
    "stippling": ((), "dots of a pen, the closer the darker it is"),
    "hatching": (HATCHING, "lines along the form that swell in the dark and end in the light"),
    "cross-hatching": (CROSSED, "lines along the form, and in the dark others across"),
}
"""Name -> layers of lines, none of which are dots, and what it looks like."""


@dataclass(frozen=True)
class Ink:
    """A way to draw, where else a style picture is given."""

    kind: str
    """One of :data:`INKS`."""
    size: float = 1.0
    """Scale of the strokes."""

    @property
    def name(self) -> str:
        """What it is called where styles are named."""
        return DRAWN + self.kind


def ink_named(source: object) -> Ink | None:
    """The ink that ``ink:NAME`` is; None for what names no ink.

    Raises:
        BadInput: there is no such ink.
    """
    text = str(source)
    if not text.startswith(DRAWN):
        return None
    kind = text.removeprefix(DRAWN).strip().lower().replace("_", "-").replace(" ", "-")
    if kind not in INKS:
        raise BadInput(f"There is no '{text}'; choose one of {', '.join(DRAWN + name for name in INKS)}.")
    return Ink(kind)


def ink_colour(colour: Sequence[float]) -> Floats:
    """The ink of a region: a dark one of its hue, RGB. (3,)"""
    from skimage.color import lab2rgb, rgb2lab

    _, a, b = rgb2lab(np.clip(np.asarray(colour, np.float64), 0.0, 1.0))
    scale = min(1.0, COLOURFUL / max(float(np.hypot(a, b)), 1e-9))
    return np.asarray(lab2rgb(np.array([DARKNESS, scale * a, scale * b])), np.float32)


def tones(form: Form, points: Floats, normals: Floats) -> Floats:
    """How dark places (S, 3) with outward normals (S, 3) are, from the light to the dark; in no unit. (S,)"""
    dark = -(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    hollow = form.hollowness(points)
    return np.asarray(dark / max(dark.std(), 1e-3) + HOLLOW * hollow / max(hollow.std(), 1e-3), np.float32)


@dataclass(frozen=True)
class Sheet:
    """The surface of a region that is drawn on: points, one at most in each cube of a side.

    ``points``, ``normals`` and ``tangents`` are (S, 3), ``tones`` (S,) in [0, 1], each as frequent as every other.
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
        """That of points (S, 3) that are seen, which may lie at several depths: they are brought to their middle."""
        points, slot = _in_cubes(surface, side)
        normals, tangents, _ = form.frames(points)
        tone = tones(form, points, normals)
        out = np.empty((len(points), 10))
        inking.settle(side, slot, points, normals, tangents, tone, out)
        _, kept, slot = _numbered(out[:, :3].astype(np.float32), side)
        out = out[kept]
        rank = np.argsort(np.argsort(out[:, 9])) / max(len(out) - 1, 1)
        points, normals, tangents = (np.ascontiguousarray(out[:, k : k + 3], np.float32) for k in (0, 3, 6))
        return cls(side, slot, points, normals, tangents, rank.astype(np.float32))

    def turned(self, angle: float) -> Sheet:
        """With tangents turned by an angle about the normals."""
        other = np.cross(self.normals, self.tangents)
        turned = np.cos(angle) * self.tangents + np.sin(angle) * other
        return replace(self, tangents=np.ascontiguousarray(turned, np.float32))

    @property
    def looked_up(self) -> tuple[float, NDArray[np.int32], Floats, Floats, Floats, Floats]:
        """What the kernels take."""
        return self.side, self.slot, self.points, self.normals, self.tangents, self.tones


def _in_cubes(points: Floats, side: float) -> tuple[Floats, NDArray[np.int32]]:
    points, _, slot = _numbered(np.asarray(points, np.float32), side)
    return points, slot


def _numbered(points: Floats, side: float) -> tuple[Floats, NDArray[np.int64], NDArray[np.int32]]:
    """The first point of each cube, its number among all, and the numbers of those that stay in a grid of cubes."""
    cells = int(np.ceil(1.0 / side)) + 1
    cube = np.clip((points / side).astype(np.int64), 0, cells - 1)
    flat, first = np.unique(np.ravel_multi_index(tuple(cube.T), (cells,) * 3), return_index=True)
    slot = np.full(cells**3, -1, np.int32)
    slot[flat] = np.arange(len(flat))
    return np.ascontiguousarray(points[first]), first, slot.reshape(cells, cells, cells)


@dataclass(frozen=True)
class Strokes:
    """Discs on a surface, of which lines are rows."""

    where: Floats
    """Box coordinates. (K, 3)"""
    normal: Floats
    """Outward. (K, 3)"""
    radius: Floats
    """In box units. (K,)"""
    line: NDArray[np.int64]
    """Number of the line that each is of, its own for a dot. (K,)"""
    layer: NDArray[np.int64]
    """Number of its layer. (K,)"""


def dots(sheet: Sheet, unit: float, cell: float, seed: int) -> Strokes:
    """Stippling.

    Args:
        sheet: What is drawn on.
        unit: What radii and distances count in, in box units.
        cell: Side of a cell of the paint, in box units.
        seed: Another one is another layout.
    """
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
    count = inking.scatter(place, normal, distance, THIN * cell, size, head, following, kept)
    own = kept[:count]
    return Strokes(place[own], normal[own], radius[own].astype(np.float32), np.arange(count), np.zeros(count, np.int64))


def lines(sheet: Sheet, layers: Sequence[Layer], unit: float, cell: float, seed: int, progress: Progress) -> Strokes:
    """Hatching; see :func:`dots`."""
    generator = np.random.default_rng(seed)
    size = 1.5 * max(layer.apart for layer in layers) * unit
    parts: list[Strokes] = []
    families: dict[float, tuple[NDArray[np.generic], ...]] = {}
    counts: dict[float, int] = {}
    for number, layer in enumerate(layers):
        progress(number / len(layers), "drawing lines")
        turned = sheet.turned(layer.across)
        most = int(1.5 * len(sheet.points) * sheet.side**2 / (STEP * 0.5 * min(l.apart for l in layers) * unit**2)) + 4096
        if not layer.between:
            head, following = _bins(size, most)
            where, normal, tangent = (np.empty((most, 3), np.float32) for _ in range(3))
            tone, start = np.empty(most, np.float32), np.zeros(most // 4 + 2, np.int64)
            families[layer.across] = head, following, where, normal, tangent, tone, start
            counts[layer.across] = 0
        there, held = counts[layer.across], families[layer.across]
        least = layer.tone + generator.uniform(-0.05, 0.05, 997)
        longest = generator.uniform(30.0, 90.0, 991) / STEP
        apart = layer.apart * unit * (0.92 if layer.between else 1.0)
        count = inking.draw(
            generator.permutation(len(sheet.points)), least, longest.astype(np.int64), apart, 0.6 * apart, THIN * cell,
            STEP * unit, int(4.0 / STEP), *turned.looked_up, size, *held, there, 0,
        )  # fmt: skip
        where, normal, _, tone, start = held[2:]
        parts.append(_inked(layer, unit, where, normal, tone, start[there : count + 1], number, generator))
        counts[layer.across] = count
    progress(1.0, "drawing lines")
    return Strokes(*(np.concatenate([getattr(p, name) for p in parts]) for name in Strokes.__dataclass_fields__))


def _inked(layer, unit, where, normal, tone, start, number, generator) -> Strokes:  # type: ignore[no-untyped-def]
    """How thick the lines of a layer are at each of their points: in rows start[l] to start[l + 1]."""
    first, last = int(start[0]), int(start[-1])
    line = np.repeat(np.arange(len(start) - 1), np.diff(start))
    index = np.arange(first, last)
    end = np.minimum(index - start[:-1][line], start[1:][line] - 1 - index) * STEP
    dark = np.clip((tone[first:last] - layer.tone) / (1.0 - layer.tone), 0.0, 1.0)
    width = (layer.thin + (layer.thick - layer.thin) * dark) * generator.uniform(0.9, 1.1, len(start))[line]
    width *= np.minimum(1.0, 0.35 + end / 5.0)
    radius = (0.5 * unit * width).astype(np.float32)
    return Strokes(where[first:last], normal[first:last], radius, line, np.full(len(line), number))


def _bins(side: float, count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    cells = int(np.ceil(1.0 / side)) + 1
    return np.full((cells, cells, cells), -1, np.int32), np.full(count, -1, np.int32)


class Drawing:
    """One region in ink."""

    def __init__(
        self, ink: Ink, colour: Sequence[float], form: Form, surface: Floats, pixel: float, cell: float,
        seed: int, progress: Progress,
    ) -> None:  # fmt: skip
        """Draw it.

        Args:
            ink: How.
            colour: The region's, RGB; its ink is a dark one of that hue.
            form: The scene's.
            surface: Box coordinates of points that are seen of the region. (S, 3)
            pixel: Side of a pixel of the stylization views on the surface, in box units, and
            cell: that of a cell of the paint: strokes are as fine as the coarser of both.
            seed: Another one is another layout.
            progress: Called several times a second.
        """
        self.form, self.cell, self.colour = form, cell, ink_colour(colour)
        fine = max(pixel, cell)
        self.depth, self.thin = DEPTH * fine, THIN * fine
        self.sheet = Sheet.of(form, surface, SURFACE * fine)
        layers, unit = INKS[ink.kind][0], ink.size * fine
        progress(0.1, "drawing")
        if layers:
            self.strokes = lines(self.sheet, layers, unit, fine, seed, part(progress, 0.1, 1.0))
        else:
            self.strokes = dots(self.sheet, unit, fine, seed)
        radius = float(self.strokes.radius.max(initial=0.0)) + SOFT * cell
        self._side = float(np.hypot(self.depth, radius))
        self._head, self._following = _bins(self._side, len(self.strokes.where))
        inking.put_all(self.strokes.where, self._side, self._head, self._following)

    def covered(self, position: Floats) -> Floats:
        """How much of box coordinates (V, 3) is ink, in [0, 1]. (V,)"""
        out = np.empty(len(position), np.float32)
        normal = self.form.frames(position)[0]
        inking.cover(
            np.ascontiguousarray(position, np.float32), normal, self.depth, self.thin, SOFT * self.cell, self._side,
            self._head, self._following, self.strokes.where, self.strokes.normal, self.strokes.radius, out,
        )  # fmt: skip
        return np.maximum(out, 0.0)

    def __call__(self, position: Floats) -> Floats:
        """Colours of box coordinates (V, 3) -> (V, 3)."""
        paper = np.array(PAPER, np.float32)
        return np.asarray(paper + self.covered(position)[:, None] * (self.colour - paper), np.float32)
