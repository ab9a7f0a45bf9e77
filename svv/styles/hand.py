"""The hand of a picture: how its strokes look, measured; nothing is learned.

Strokes run along the structure tensor. The autocorrelation of the lightness across and along them gives their width and
length, and the mean cross-section of light and dark strokes their profile. Units: pixels are those of the picture as
given; lightness and colours are CIELAB. Letters: N samples of strokes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates, zoom
from scipy.spatial import cKDTree

from svv.core.colour.colour import rgb_to_lab
from svv.core.images.structure_tensor import StructureTensor, structure_tensor
from svv.errors import BadInput
from svv.options.making import HandName

Floats = NDArray[np.float32]

SIDE = 900
"""Long side in pixels above which a picture is reduced before it is measured: thinner strokes are not painted."""

SMALLEST = 8
"""Least side in pixels of a picture: smaller ones have no room for a stroke."""

FIRST_WIDTH = 5.0
"""Width in pixels at a long side of :data:`SIDE` from which the measurement starts."""

PASSES = 3
"""Passes of the measurement, each at the scale of the width found before."""

WIDTHS = 2.6
"""Width of a stroke, in lags at which the autocorrelation across strokes has fallen to one half. Disjoint bands of
unrelated tone would have 2; strokes that overlap, whose visible parts are narrower, have more (tests/test_hand.py)."""

SAMPLES = 12_000
"""Number of strokes sampled."""

ELONGATIONS = (1.0, 14.0)
"""Bounds of the ratio of a stroke's length to its width."""

PROFILE = 9
"""Number of places across a stroke at which its profile is kept."""

TONES = 10
"""Number of ranges of tone in which the palette is kept."""

NEIGHBOURS = 24
"""Number of neighbouring strokes between which the scatter of tone is measured."""

SMOOTH, WINDOW = 0.8, 2.0
"""Deviation of lightness below which a neighbourhood is smooth, and the neighbourhood's own, in pixels at a long side
of :data:`SIDE`."""

BIN, COMMONEST = (8.0, 10.0, 10.0), 8
"""Size of the bins of CIELAB in which colours are counted, and number of bins that count as the commonest."""

INKS, LEAST_INK, OTHER_INK = 8, 0.004, 16.0
"""Number of flat colours looked for, the least fraction of the picture that one makes up, and the least distance in
CIELAB between two of them."""

FLAT, EVEN = 0.75, 10.0
"""Fraction of the picture, and deviation of lightness around a pixel, up to which a pixel shows one ink alone."""

NEARLY = 0.03
"""Fraction of strokes that are darker than nearly the darkest, and so on."""

LEAST_CONTRAST = 1.0
"""Contrast in units of lightness below which strokes cannot be seen: such a picture is called plain."""


@dataclass(frozen=True)
class Hand:
    """What is measured in a picture."""

    size: tuple[int, int]
    """Height and width of the picture in pixels."""
    width: float
    """Width of strokes in pixels."""
    elongation: float
    """Length of strokes in widths, from 1 (dots) on."""
    coherence: float
    """Mean consistency of the strokes' directions, in [0, 1]."""
    curvature: float
    """Mean turn of the direction along a stroke, in radians per width."""
    contrast: float
    """Standard deviation of lightness across strokes, without changes wider than them."""
    profile: Floats
    """Mean lightness across a stroke, from edge to edge, relative to its middle's: 1 at the middle, about 0 or less at
    the edges. (PROFILE,)"""
    bristles: float
    """Number of bristle marks across a stroke."""
    relief: float
    """Standard deviation of lightness within strokes: the marks of bristles."""
    scatter: float
    """Broken tone: standard deviation of the tone of neighbouring strokes, in ranks of the whole picture, in [0, 1]."""
    smooth: float
    """Fraction of the picture in which lightness hardly varies: flat ink, sky in a photograph, blank paper."""
    common: float
    """Fraction of the picture that its eight commonest colours make up."""
    inks: Floats
    """Its commonest colours that differ, CIELAB, the commonest first: a print's inks. (at most INKS, 3)"""
    palette: Floats
    """Mean colour of each range of tone, from dark to light, CIELAB. (TONES, 3)"""
    darkest: Floats
    """Mean colour of the darkest strokes, CIELAB: the ground of a dark picture, the accents of a light one. (3,)"""
    colours: Floats
    """Mean colour of each sampled stroke, CIELAB. (N, 3)"""
    places: Floats
    """Where these strokes are: across and up, in units of the picture's long side. (N, 2)"""
    tones: Floats
    """Fraction of the sampled strokes that are darker. (N,)"""
    angles: Floats
    """Anticlockwise angles of these strokes from the horizontal, in radians, in [0, pi). (N,)"""
    coherences: Floats
    """Consistency of the directions around them, in [0, 1]. (N,)"""
    gamut: tuple[float, float, float] = field(default=(0.0, 100.0, 130.0), kw_only=True)
    """Lightness of nearly its darkest and lightest strokes, and chroma of nearly its most vivid ones, CIELAB: in the
    whole picture, if this is the hand of one of its areas."""
    technique: HandName = field(default="oil", kw_only=True)
    """The technique in which it is painted."""
    part: bool = field(default=False, kw_only=True)
    """Whether it is the hand of one area of the picture."""

    @property
    def length(self) -> float:
        """Length of strokes in pixels."""
        return self.elongation * self.width

    @property
    def plain(self) -> bool:
        """Whether no strokes can be seen in the picture: it is flat, or smooth."""
        return self.contrast < LEAST_CONTRAST

    def within(self, area: NDArray[np.bool_]) -> Hand:
        """Return the same hand with the colours and places of the strokes in an area of the picture (H, W) alone."""
        height, width = area.shape
        long = max(height, width)
        column = (self.places[:, 0] * long).astype(np.int64).clip(0, width - 1)
        row = (height - 1 - self.places[:, 1] * long).astype(np.int64).clip(0, height - 1)
        own = area[row, column]
        if not own.any():  # an area smaller than a stroke has the colours of the strokes around it
            own = own.copy()
            y, x = (float(a.mean()) for a in np.nonzero(area))
            own[cKDTree(self.places).query(np.array([x, height - 1 - y]) / long, NEIGHBOURS)[1]] = True
        colours = self.colours[own]
        tones = _ranks(colours).astype(np.float32)
        # An ink is the family's if most strokes around its colour are: there is at least the nearest to what they show.
        among = cKDTree(self.colours).query(self.inks, min(NEIGHBOURS, len(self.colours)))[1]
        mine = own[among.reshape(len(self.inks), -1)].mean(1)
        inks = self.inks[mine >= 0.5] if (mine >= 0.5).any() else self.inks[mine.argmax()][None]
        return replace(
            self, inks=inks, palette=_palette(colours, tones), darkest=colours[tones <= 0.03].mean(0),
            colours=colours, places=self.places[own], tones=tones, angles=self.angles[own],
            coherences=self.coherences[own], part=True,
        )  # fmt: skip


def measure_hand(picture: NDArray[np.floating], mask: NDArray[np.bool_] | None = None, seed: int = 0) -> Hand:
    """Measure the hand of a picture (H, W, 3), sRGB in [0, 1], or of a part of it, a ``mask`` (H, W).

    Raises BadInput if it is smaller than :data:`SMALLEST` pixels, not RGB or not finite, or the mask is empty or does
    not fit.

    >>> measure_hand(np.full((32, 48, 3), 0.5, np.float32)).plain
    True
    """
    lab, inside = _validate_picture(picture, mask)
    height, width = inside.shape
    factor = min(1.0, SIDE / max(height, width))
    if factor < 1.0:
        lab, inside = _reduced(lab, factor), _reduced(inside[..., None].astype(np.float32), factor)[..., 0] > 0.5
    generator = np.random.default_rng(seed)
    stroke = FIRST_WIDTH * max(lab.shape[:2]) / SIDE
    for _ in range(PASSES):
        scale = _Scale(lab, inside, stroke, generator)
        stroke = scale.width
    tensor, profile, bristles, relief = scale.tensor, *scale.cross_section()
    where = _sampled(inside, generator)
    angles, coherences = (_at(field, where, order=0) for field in (tensor.angle, tensor.coherence))
    along = np.stack([-np.sin(angles), np.cos(angles)])
    soft = gaussian_filter(lab, (0.2 * stroke, 0.2 * stroke, 0))
    steps = np.linspace(-0.8, 0.8, 5) * stroke
    stretch = where[:, :, None] + along[:, :, None] * steps
    colours = np.stack([_at(soft[..., c], stretch).mean(1) for c in range(3)], 1)
    tones = _ranks(colours)
    places = np.stack([where[1], lab.shape[0] - 1 - where[0]], 1) / max(lab.shape[:2])
    near = cKDTree(places).query(places, min(NEIGHBOURS, len(places)))[1]
    low, high = np.quantile(colours[:, 0], (NEARLY, 1.0 - NEARLY)).tolist()
    weight = coherences * np.sqrt(_at(tensor.energy, where))
    ahead = _at(tensor.angle, where + along * stroke, order=0)
    turn = np.abs((ahead - angles + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    return Hand(
        (height, width), stroke / factor, scale.elongation, _mean(coherences, weight), _mean(turn, weight),
        scale.contrast, profile, bristles, relief, float(tones[near].std(1).mean()),
        *_uses(lab, inside),
        _palette(colours, tones), colours[tones <= 0.03].mean(0).astype(np.float32),
        *(np.asarray(values, np.float32) for values in (colours, places, tones, angles, coherences)),
        gamut=(low, high, float(np.quantile(np.hypot(colours[:, 1], colours[:, 2]), 1.0 - NEARLY))),
    )  # fmt: skip


def _ranks(colours: Floats) -> Floats:
    """Return the fraction of colours (N, 3) that are darker than each. (N,)"""
    return np.asarray(np.argsort(np.argsort(colours[:, 0], kind="stable")) / max(len(colours) - 1, 1))


def _palette(colours: Floats, tones: Floats) -> Floats:
    """Return the mean of colours (N, 3) in each range of their tones (N,), that of all where there are none."""
    band = np.minimum((tones * TONES).astype(np.int64), TONES - 1)
    means = [colours[band == k].mean(0) if (band == k).any() else colours.mean(0) for k in range(TONES)]
    return np.array(means, np.float32)


class _Scale:
    """Lightness across and along the strokes, for strokes of about a given width."""

    def __init__(self, lab: Floats, inside: NDArray[np.bool_], stroke: float, generator: np.random.Generator) -> None:
        self.tensor: StructureTensor = structure_tensor(lab, max(0.2 * stroke, 0.6), 0.9 * stroke)
        light = lab[..., 0] - gaussian_filter(lab[..., 0], 3.0 * stroke)
        rows, columns = _sampled(inside, generator)
        weight = _at(self.tensor.coherence, (rows, columns)) * np.sqrt(_at(self.tensor.energy, (rows, columns)))
        kept = weight >= np.quantile(weight, 0.6)
        self.where = np.stack([rows[kept], columns[kept]])
        self.angle = _at(self.tensor.angle, self.where, order=0)
        self.light, self.stroke, self.most = light, stroke, 0.5 * min(lab.shape[:2])
        reach = 6.0 * stroke
        self.step = max(0.125 * stroke, 0.25)
        self.lags = np.arange(-reach, reach + 0.5 * self.step, self.step)
        across, along = self._lines(0.5 * np.pi), self._lines(0.0)
        self.contrast = float(across.std())
        half, longer = (_half_lag(lines) * self.step for lines in (across, along))
        # A picture without structure has correlations of rounding errors: its width stays where it began.
        seen = self.contrast >= 0.1
        bounds = 1.5, max(0.25 * min(lab.shape[:2]), 1.6)
        self.width = float(np.clip(WIDTHS * half, *bounds)) if seen else float(np.clip(stroke, *bounds))
        self.elongation = float(np.clip(longer / max(half, 1e-6), *ELONGATIONS)) if seen else 1.0

    def _lines(self, turned: float, shift: NDArray[np.floating] | float = 0.0) -> Floats:
        """Return the lightness along lines through the samples, turned from the strokes' direction. (N, lags)"""
        angle, lags = self.angle[:, None], self.lags[None]
        rows = self.where[0][:, None] - np.sin(angle + turned) * lags - np.sin(angle) * shift
        columns = self.where[1][:, None] + np.cos(angle + turned) * lags + np.cos(angle) * shift
        return _at(self.light, (rows, columns))

    def cross_section(self) -> tuple[Floats, float, float]:
        """Return the profile of strokes (PROFILE,), the number of bristle marks across one, and their contrast."""
        # The mean over a stretch of the stroke leaves what runs along it: the stroke and its bristle marks.
        lines = np.mean([self._lines(0.5 * np.pi, shift * self.width) for shift in (-0.5, 0.0, 0.5)], axis=0)
        smooth = gaussian_filter(lines, (0, 0.25 * self.width / self.step), mode="nearest")
        middle = np.arange(len(self.lags))[np.abs(self.lags) <= self.width]
        offset = middle[np.abs(smooth[:, middle]).argmax(1)]
        height = smooth[np.arange(len(smooth)), offset]
        at = np.linspace(-0.75, 0.75, PROFILE) * self.width / self.step
        each = np.arange(len(lines))[:, None]
        sections = _at(lines.astype(np.float32), (np.broadcast_to(each, (len(each), PROFILE)), offset[:, None] + at))
        seen = np.abs(height) > 1e-3
        profile = np.full(PROFILE, 1.0)
        if seen.any():
            profile = np.average(sections[seen] / height[seen, None], axis=0, weights=np.square(height[seen]))
            profile = profile / max(float(profile[PROFILE // 2]), 0.2)
        fine = lines - smooth
        count = self.width / max(4.0 * _half_lag(fine) * self.step, 1e-6)
        return profile.astype(np.float32), float(np.clip(count, 1.0, 8.0)), float(fine.std())


def _uses(lab: Floats, inside: NDArray[np.bool_]) -> tuple[float, float, Floats]:
    """Return the fraction of a picture that is smooth, that of its commonest colours, and its inks."""
    window = max(WINDOW * max(inside.shape) / SIDE, 1.0)
    mean, square = (gaussian_filter(values, window) for values in (lab[..., 0], np.square(lab[..., 0])))
    spread = np.maximum(square - mean * mean, 0.0)[inside]
    colours = lab[inside]
    _, count = _binned(colours)
    common = float(np.sort(count)[-COMMONEST:].sum() / len(colours))
    # Pixels between two inks are a mixture of both, which is no ink.
    flat = spread <= np.minimum(np.quantile(spread, FLAT), EVEN**2)
    return float((spread < SMOOTH**2).mean()), common, _inks(colours[flat] if flat.any() else colours)


def _inks(colours: Floats) -> Floats:
    """Return the commonest colours of some (N, 3), CIELAB, that differ. (at most INKS, 3)"""
    means, count = _binned(colours)
    inks: list[Floats] = []
    for number in np.argsort(-count, kind="stable"):
        rare = inks and count[number] < LEAST_INK * len(colours)
        if rare or len(inks) == INKS:
            break
        if all(np.linalg.norm(means[number] - ink) >= OTHER_INK for ink in inks):
            inks.append(means[number])
    return np.array(inks, np.float32)


def _binned(colours: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return the mean colour of each bin that has any of some colours (N, 3), (B, 3), and how many it has (B,)."""
    bins = np.ravel_multi_index(tuple((np.floor(colours / np.array(BIN)).astype(np.int64) + 64).T), (128, 128, 128))
    _, of, count = np.unique(bins, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(of.reshape(-1), channel) for channel in colours.T], 1) / count[:, None]
    return means.astype(np.float32), count


def _half_lag(lines: Floats) -> float:
    """Return the lag, in samples of the lines (N, L), at which their autocorrelation falls to one half."""
    most = lines.shape[1] // 2
    covariance = np.array([(lines[:, : lines.shape[1] - lag] * lines[:, lag:]).mean() for lag in range(most)])
    if covariance[0] < 1e-9:
        return 1.0
    below = np.flatnonzero(covariance < 0.5 * covariance[0])
    if not len(below):
        return float(most)
    last = int(below[0]) - 1
    part = (covariance[last] - 0.5 * covariance[0]) / max(covariance[last] - covariance[last + 1], 1e-12)
    return last + float(part)


def _validate_picture(
    picture: NDArray[np.floating], mask: NDArray[np.bool_] | None
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the picture in CIELAB and its mask; raises BadInput as :func:`measure_hand` does."""
    values = np.asarray(picture, np.float32)
    if values.ndim != 3 or values.shape[2] != 3 or min(values.shape[:2]) < SMALLEST:
        raise BadInput(f"A style picture needs three channels and at least {SMALLEST} x {SMALLEST} pixels.")
    if not np.isfinite(values).all():
        raise BadInput("The style picture has values that are not finite: save it again as an 8-bit picture.")
    inside = np.ones(values.shape[:2], bool) if mask is None else np.asarray(mask, bool)
    if inside.shape != values.shape[:2]:
        raise BadInput("The mask and the style picture differ in size: make the mask from that picture.")
    if not inside.any():
        raise BadInput("The mask is empty: select the part of the picture to learn from.")
    return np.asarray(rgb_to_lab(values.clip(0.0, 1.0)), np.float32), inside


def _reduced(values: Floats, factor: float) -> Floats:
    """Reduce (H, W, C) by a factor below 1, without aliasing."""
    blur = 0.4 / factor
    smooth = gaussian_filter(values, (blur, blur, 0))
    return np.asarray(zoom(smooth, (factor, factor, 1), order=1, grid_mode=True, mode="nearest"), np.float32)


def _sampled(inside: NDArray[np.bool_], generator: np.random.Generator) -> Floats:
    """Return rows and columns of random places inside. (2, N)"""
    there = np.flatnonzero(inside)
    chosen = there[generator.integers(0, len(there), SAMPLES)]
    return np.stack(np.unravel_index(chosen, inside.shape)).astype(np.float32)


def _at(field: Floats, where: NDArray[np.floating] | tuple[Floats, Floats], order: int = 1) -> Floats:
    """Interpolate a field (H, W) at rows and columns (2, ...); it is mirrored beyond its border."""
    return np.asarray(map_coordinates(field, np.asarray(where), order=order, mode="mirror"), np.float32)


def _mean(values: Floats, weights: Floats) -> float:
    return float(np.average(values, weights=weights)) if weights.sum() > 0.0 else 0.0
