"""The palette of a scene: one colour per visible range of its transfer function, extracted from its views.

Pixels of a direct volume rendering lie in the cone from black that the palette colours and white span (StyleRF-VolVis,
eq. 2). A colour on an edge of it is a separate range; one inside is a mixture, a shade or a highlight. Candidates for
the edges are the corners of the RGB convex hull (Tan et al. 2018); the hue rule of the paper joins colours that are too
similar. Letters: N pixels, B bins of similar pixels, P palette colours, G generators of a cone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import hsb_array, hue_distance
from svv.core.colour.hex_codes import to_hex
from svv.errors import BadInput

Array = NDArray[np.float64]
WHITE = np.ones((1, 3))
"""White, as a generator of the cone."""
CELLS_AN_EDGE = 20
"""Number of cells along an edge of the RGB cube; colours within a cell's width count as the same."""
CLIPPED_CHANNEL = 0.99
"""Channel value from which a highlight may have been clipped."""
LEAST_BRIGHTNESS = 1e-6
"""Brightness below which a colour is black and is not scaled up."""
LEAST_CHROMA = 5.0 / CELLS_AN_EDGE
"""Saturation times brightness above which the colours of a cell have about the same hue."""

HUES = 12
"""Number of equal parts of the circle of hues, even: each has an opposite one."""


@dataclass(frozen=True)
class PaletteSettings:
    """Settings for extracting a palette from pixels."""

    max_colours: int = 8
    """Maximum number of colours; those that represent the most pixels are kept."""
    hue_distance: float = 0.05
    """Colours closer in hue are joined; 1 is the full circle. (T_h of the paper, where it is 0.1, which would join
    orange and amber.)"""
    grey_saturation: float = 0.2
    """Colours of less saturation are grey: light rather than a range (T_b of the paper, there of brightness)."""
    grey_share: float = 0.06
    """Share of the image that grey pixels must cover to count as a range; highlights cover less."""
    min_share: float = 0.004
    """Share of the image that must need a colour for it to be kept."""
    tolerance: float = 0.06
    """RGB distance up to which a pixel counts as reproduced by the other colours."""
    peak_share: float = 0.01
    """Share of the image that must have one hue, within ``peak_width``, for it to be a range even if others could mix
    it."""
    peak_width: float = 0.012
    """Distance of hues that count as equal: the error from eight bits and interpolation."""
    peak_contrast: float = 4.0
    """Ratio by which a hue must exceed the hues on either side in share of the image: shades and highlights of a range
    keep its hue and accumulate there, while mixtures spread over all hues in between."""
    min_alpha: float = 0.1
    """Pixels of less opacity are ignored: 8-bit colour divided by such an alpha is noise."""
    max_pixels: int = 1_000_000
    """Larger inputs are subsampled to this many pixels."""
    refined: bool = True
    """Whether greys, mixtures and similar hues are removed. Otherwise the palette is only the simplified hull (Tan et
    al. 2018), for comparison."""


@dataclass(frozen=True)
class Palette:
    """Colours of a scene's regions, the one that represents the most pixels first."""

    colours: Array
    """Pure and fully lit colours, RGB in [0, 1]. (P, 3)"""
    share: Array
    """Share of the visible image that each colour represents; the shares sum to 1. (P,)"""
    steps: tuple[str, ...]
    """Description of each step for the user."""


def extract_palette(
    pixels: NDArray[np.floating],
    weights: NDArray[np.floating],
    settings: PaletteSettings | None = None,
    seed: int = 0,
) -> Palette:
    """Extract the palette of a scene, 1 to ``settings.max_colours`` colours, from the visible pixels of its views.

    ``pixels``: straight (un-premultiplied) RGB in [0, 1] (N, 3); ``weights``: their alpha in [0, 1] (N,); ``settings``:
    docs/design/archive.csv (palette/thresholds) tells how far each may move; ``seed``: for subsampling large inputs.
    Raises BadInput if no pixel is visible.
    """
    settings = settings or PaletteSettings()
    colours, mass = _bins(pixels, weights, settings, seed)
    steps = [f"{len(colours)} distinct colours in the visible pixels"]
    corners = _hull_corners(colours, mass)
    if not settings.refined:
        return _simplified_hull(colours, mass, corners, settings)
    coloured = corners[hsb_array(colours[corners])[:, 1] >= settings.grey_saturation]
    steps.append(f"{len(corners)} corners of their RGB hull, {len(corners) - len(coloured)} of them grey")
    grey = _grey_range(colours, mass, settings)
    light = WHITE  # (G, 3), may be mixed in besides the palette
    if len(grey):
        light = np.concatenate((WHITE, grey))
        steps.append("there are more grey pixels than highlights explain: grey is a separate range")
    edges = _grow_cone(colours, mass, coloured, light, settings)
    steps.append(f"{len(edges)} of them needed as edges of the cone of mixtures, shades and highlights")
    edges = _drop_mixtures(colours, mass, edges, light, settings)
    steps.append(f"{len(edges)} left after dropping those that the others can mix")
    peaks = _peaks(colours, mass, edges, settings)
    if len(peaks):
        edges = np.concatenate((edges, peaks))
        steps.append(f"{len(peaks)} more that others could mix, but whose hue is frequent in the image")
    edges = _join_hues(colours, mass, edges, settings)
    steps.append(f"{len(edges)} left after joining hues closer than {settings.hue_distance:g}")
    found = np.concatenate((colours[edges], grey))
    if not len(found):
        found = np.average(colours, 0, mass)[None]
        steps.append("no colour found: the scene is one grey range")
    # if grey is a range, white light belongs to it
    palette, share = _measure(colours, mass, found, WHITE[: 1 - len(grey)])
    order = np.argsort(-share, kind="stable")[: settings.max_colours]
    steps.append("palette " + ", ".join(f"{to_hex(palette[i])} ({share[i]:.1%})" for i in order))
    return Palette(palette[order], share[order] / share[order].sum(), tuple(steps))


def _bins(
    pixels: NDArray[np.floating], weights: NDArray[np.floating], settings: PaletteSettings, seed: int
) -> tuple[Array, Array]:
    """Return mean colours (B, 3) and weights (B,), summing to 1, of the well-filled cells of a grid over RGB."""
    visible = np.flatnonzero(weights >= settings.min_alpha)
    if not len(visible):  # a scene of haze alone: take all of it
        visible = np.flatnonzero(weights > 0)
    if not len(visible):
        raise BadInput("No pixel of the views is visible; make the transfer function less transparent.")
    if len(visible) > settings.max_pixels:
        visible = np.random.default_rng(seed).choice(visible, settings.max_pixels, replace=False)
    rgb = np.clip(np.asarray(pixels[visible], dtype=np.float64), 0, 1)
    weight = np.asarray(weights[visible], dtype=np.float64)
    cell = np.minimum((rgb * CELLS_AN_EDGE).astype(np.int64), CELLS_AN_EDGE - 1) @ np.array(
        [CELLS_AN_EDGE**2, CELLS_AN_EDGE, 1]
    )
    mass = np.bincount(cell, weight, CELLS_AN_EDGE**3)
    sums = np.stack([np.bincount(cell, weight * rgb[:, channel], CELLS_AN_EDGE**3) for channel in range(3)], 1)
    # outliers shape a hull, so nearly empty cells are left out unless all cells are nearly empty
    filled = mass > min(2e-5 * mass.sum(), 0.5 * mass.max())
    return sums[filled] / mass[filled, None], mass[filled] / mass[filled].sum()


def _hull_corners(colours: Array, mass: Array) -> NDArray[np.int64]:
    """Return the indices of the bins that are corners of the convex hull of all bins and black."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(np.concatenate((colours, np.zeros((1, 3)))))
    except QhullError:  # all colours in one plane: every bin may be a corner
        return np.argsort(-mass, kind="stable")
    return np.sort(hull.vertices[hull.vertices < len(colours)]).astype(np.int64)


def _simplified_hull(colours: Array, mass: Array, corners: NDArray[np.int64], settings: PaletteSettings) -> Palette:
    """Choose at most ``max_colours`` corners of the hull: the heaviest, then always the one farthest from those."""
    chosen = [int(corners[mass[corners].argmax()])]
    while len(chosen) < settings.max_colours:
        away = np.linalg.norm(colours[corners, None] - colours[chosen], axis=2).min(axis=1)
        if away.max() <= settings.tolerance:
            break
        chosen.append(int(corners[away.argmax()]))
    nearest = np.linalg.norm(colours[:, None] - colours[chosen], axis=2).argmin(axis=1)
    share = np.bincount(nearest, mass, len(chosen)).astype(np.float64)
    order = np.argsort(-share, kind="stable")
    steps = (f"{len(corners)} corners of the RGB hull, {len(chosen)} chosen far from each other, without refinement",)
    return Palette(colours[chosen][order], share[order] / share.sum(), steps)


def _mix(colours: Array, generators: Array) -> tuple[Array, Array]:
    """Find the non-negative mixture of generators closest to each colour: coefficients (B, G) and distance (B,).

    Generators are scaled to a brightness of 1: coefficients are comparable amounts of light. A channel clipped by a
    highlight is only a lower bound, which a mixture may exceed.
    """
    from scipy.optimize import nnls

    matrix = (generators / np.maximum(generators.max(1, keepdims=True), LEAST_BRIGHTNESS)).T
    clipped = colours >= CLIPPED_CHANNEL
    solved = [
        nnls(np.concatenate((matrix, -np.eye(3)[:, over]), 1) if over.any() else matrix, colour)
        for colour, over in zip(colours, clipped)
    ]
    coefficients = np.array([x[: len(generators)] for x, _ in solved]).reshape(-1, len(generators))
    return coefficients, np.array([distance for _, distance in solved])


def _grow_cone(
    colours: Array, mass: Array, corners: NDArray[np.int64], light: Array, settings: PaletteSettings
) -> NDArray[np.int64]:
    """Choose corners one after another, each the farthest outside the cone of light and the previous ones."""
    edges: list[int] = []
    open_corners = set(corners.tolist())
    _, distance = _mix(colours, light)
    while open_corners and len(edges) < 2 * settings.max_colours:
        corner = max(open_corners, key=lambda index: (distance[index], -index))
        if distance[corner] <= settings.tolerance:
            break
        open_corners.remove(corner)
        outside = np.flatnonzero(distance > settings.tolerance)
        coefficients, closer = _mix(colours[outside], np.concatenate((light, colours[[*edges, corner]])))
        gained = coefficients[:, -1] > coefficients[:, :-1].max(1)
        if mass[outside[gained]].sum() >= settings.min_share:  # otherwise an outlier
            edges.append(corner)
            distance[outside] = closer
    return np.array(edges, dtype=np.int64)


def _drop_mixtures(
    colours: Array, mass: Array, edges: NDArray[np.int64], light: Array, settings: PaletteSettings
) -> NDArray[np.int64]:
    """Drop edges that the others, light and black reproduce, the least needed first."""
    while len(edges) > 1:
        coefficients, distance = _mix(colours, np.concatenate((light, colours[edges])))
        needed = np.empty(len(edges))
        for i in range(len(edges)):
            users = np.flatnonzero((coefficients[:, len(light) + i] > 0) & (distance <= settings.tolerance))
            _, without = _mix(colours[users], np.concatenate((light, colours[np.delete(edges, i)])))
            needed[i] = mass[users[without > settings.tolerance]].sum()
        least = int(needed.argmin())
        if needed[least] >= settings.min_share:
            break
        edges = np.delete(edges, least)
    return edges


def _peaks(colours: Array, mass: Array, edges: NDArray[np.int64], settings: PaletteSettings) -> NDArray[np.int64]:
    """Find bins of hues that are ranges but not edges of the cone, such as yellow between a red and a green range.

    A mixture of two ranges has every hue between theirs, so a hue that covers more of the image than those on either
    side is a range.
    """
    hue, saturation, brightness = hsb_array(colours).T
    # a cell of dark or pale pixels contains many hues; their mean would be a false peak
    weight = mass * ((saturation >= settings.grey_saturation) & (saturation * brightness >= LEAST_CHROMA))
    width = settings.peak_width

    def held(middle: float, reach: float) -> float:
        """Return the share of the image within ``reach`` of a hue."""
        return float(weight[hue_distance(hue, middle) <= reach].sum())

    found: list[int] = []
    taken = list(hue[edges])
    for index in np.argsort(-weight * saturation * brightness, kind="stable"):
        middle = float(hue[index])
        if weight[index] <= 0 or any(hue_distance(middle, other) < settings.hue_distance for other in taken):
            continue
        own = held(middle, width)
        beside = max(held((middle + side * 2.0 * width) % 1.0, width) for side in (-1.0, 1.0))
        if own >= settings.peak_share and own >= settings.peak_contrast * beside:
            found.append(int(index))
            taken.append(middle)
    return np.array(found, dtype=np.int64)


def _join_hues(colours: Array, mass: Array, edges: NDArray[np.int64], settings: PaletteSettings) -> NDArray[np.int64]:
    """Keep, of edges of nearly the same hue, the one that represents more pixels (paper: appendix, refinement).

    An edge represents the coloured pixels that are closer to it in hue than to any other edge.
    """
    if not len(edges):
        return edges
    hue, saturation, _ = hsb_array(colours).T
    nearest = hue_distance(hue[:, None], hue[edges]).argmin(1)
    behind = np.bincount(nearest, mass * (saturation >= settings.grey_saturation), len(edges))
    kept: list[int] = []
    for edge in edges[np.argsort(-behind, kind="stable")]:
        if all(hue_distance(float(hue[edge]), float(hue[other])) >= settings.hue_distance for other in kept):
            kept.append(int(edge))
    return np.array(kept, dtype=np.int64)


def _grey_range(colours: Array, mass: Array, settings: PaletteSettings) -> Array:
    """Return the mean colour of grey pixels (1, 3), or (0, 3) if highlights and opposite hues explain them.

    Mixtures of opposite hues spread evenly along the line between them, so as many are grey as have up to twice the
    saturation of a grey, half of them with either hue.
    """
    hue, saturation, _ = hsb_array(colours).T
    grey, limit = saturation < settings.grey_saturation, settings.grey_saturation
    dull = (saturation >= limit) & (saturation < 2.0 * limit)
    near = np.bincount((hue[dull] * HUES).astype(np.int64) % HUES, mass[dull], HUES)
    mixed = np.minimum(near, np.roll(near, HUES // 2)).sum()
    if mass[grey].sum() - mixed < settings.grey_share:
        return np.empty((0, 3))
    return np.average(colours[grey], 0, mass[grey])[None]


def _measure(colours: Array, mass: Array, palette: Array, highlights: Array) -> tuple[Array, Array]:
    """Measure colour (P, 3) and share (P,) of each region: hue and saturation of its purest pixels, fully lit.

    The corner of a hull is its most extreme pixel, so the colour of a range is the mean of its purest fifth. These
    pixels are often dark (no highlight dilutes them), so the brightness is that of the best-lit fiftieth without
    highlights.
    """
    mixed, distance = _mix(colours, np.concatenate((palette, highlights)))
    behind = _mix(colours, palette)[0].argmax(1)
    purity = mixed[:, : len(palette)].max(1) / np.maximum(mixed.sum(1) + distance, LEAST_BRIGHTNESS)
    measured = palette.copy()
    for i in range(len(palette)):
        mine = np.flatnonzero(behind == i)
        if len(mine):
            pure = _heaviest(mine, purity, mass, 0.2)
            tint = mass[pure] @ colours[pure]
            light = mixed[_heaviest(mine, mixed[:, i], mass, 0.02)[-1], i]
            measured[i] = tint / max(tint.max(), LEAST_BRIGHTNESS) * np.clip(light, 0, 1)
    return measured, np.asarray(np.bincount(behind, mass, len(palette)), dtype=np.float64)


def _heaviest(members: NDArray[np.int64], key: Array, mass: Array, part: float) -> NDArray[np.int64]:
    """Return the members with the largest keys that hold the given part of the members' mass (at least one)."""
    ordered = members[np.argsort(-key[members], kind="stable")]
    return ordered[: 1 + np.searchsorted(np.cumsum(mass[ordered]), part * mass[members].sum())]
