"""Edits of strokes after they were laid: relief and its light, width, and the colours of another picture.

An edit belongs to a region and is applied to a copy of its strokes when their paint is evaluated. A part that was split
off has the strokes of its whole and edits of its own.

Letters: N strokes, C colours of a palette, V vertices of the paint's lattice, R regions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.srgb import linear
from svv.core.strokes.strokes import Brush, Floats, Strokes
from svv.errors import BadInput
from svv.fields.scene.region import MOST_RELIEF, STROKE_WIDTHS, Region

if TYPE_CHECKING:
    from svv.fields.radiance.networks import UnrestrictedField
    from svv.fields.strokes.stored_strokes import Brushed

STROKE_EDITS = ("stroke_relief", "stroke_width", "stroke_light", "stroke_palette")
"""Fields of a region that are edits of its strokes."""

PALETTE_SIZE = 64
"""Maximum number of colours of a palette, which is stored with every step of the history."""

BROKEN = 0.04
"""Largest difference in tone, in ranks, between a stroke and the palette's colour that it gets."""

KEPT = 2
"""Number of edited paintings that are remembered for each painting: the present one and the one before."""

Owners = Callable[[Floats], NDArray[np.int64]]
"""Region of vertices at box coordinates (V, 3), -1 for none. (V,)"""


def validate_stroke_edits(
    relief: float | None, width: float | None, light: Sequence[float] | None, palette: Sequence[Sequence[float]] | None
) -> dict[str, Any]:
    """Return edits of strokes by field, for ``with_strokes``; None changes nothing. Raises BadInput if out of range."""
    edits: dict[str, Any] = {}
    if relief is not None:
        if not 0.0 <= relief <= MOST_RELIEF:
            raise BadInput(f"The relief of strokes must lie between 0 and {MOST_RELIEF:g}, not {relief}.")
        edits["stroke_relief"] = float(relief)
    if width is not None:
        if not STROKE_WIDTHS[0] <= width <= STROKE_WIDTHS[1]:
            raise BadInput(
                f"Strokes can become {STROKE_WIDTHS[0]:g} to {STROKE_WIDTHS[1]:g} times as wide, not {width}: for "
                "other widths lay them again with svv stylize --stroke-size."
            )
        edits["stroke_width"] = float(width)
    if light is not None:
        edits["stroke_light"] = _direction(light) if len(light) else None
    if palette is not None:
        edits["stroke_palette"] = _palette(palette)
    return edits


def describe_stroke_edits(edits: Mapping[str, Any]) -> str:
    """Return a few words about edits of strokes, for the history."""
    words = [f"stroke {name} {edits[f'stroke_{name}']:g}" for name in ("relief", "width") if f"stroke_{name}" in edits]
    if "stroke_light" in edits:
        light = edits["stroke_light"]
        words.append("stroke light " + ("as painted" if light is None else ",".join(f"{v:.3g}" for v in light)))
    if "stroke_palette" in edits:
        count = len(edits["stroke_palette"])
        words.append(f"stroke palette of {count} colours" if count else "stroke palette as painted")
    return ", ".join(words)


def _direction(light: Sequence[float]) -> tuple[float, float, float]:
    """Return a direction as a unit vector."""
    given = np.asarray(light, np.float64)
    if given.shape != (3,) or not np.isfinite(given).all() or not given.any():
        raise BadInput(f"Light on strokes cannot come from {tuple(light)}: give a direction x, y and z, not all 0.")
    given = given / np.abs(given).max()  # its square would be infinite, or 0
    x, y, z = (float(v) for v in given / np.linalg.norm(given))
    return x, y, z


def _palette(colours: Sequence[Sequence[float]]) -> tuple[tuple[float, float, float], ...]:
    """Return at most :data:`PALETTE_SIZE` of the colours, evenly chosen, from dark to light."""
    if not len(colours):
        return ()
    given = np.asarray(colours, np.float64)
    if given.ndim != 2 or given.shape[1] != 3 or not ((given >= 0.0) & (given <= 1.0)).all():
        raise BadInput("A palette is a list of colours: give red, green and blue between 0 and 1 for each.")
    given = given[np.argsort(luminance(given), kind="stable")]
    if len(given) > PALETTE_SIZE:
        given = given[((np.arange(PALETTE_SIZE) + 0.5) * len(given) / PALETTE_SIZE).astype(np.int64)]
    return tuple((r, g, b) for r, g, b in given.round(3).tolist())


def luminance(colours: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return relative luminance of sRGB colours in [0, 1] (IEC 61966-2-1). (..., 3) -> (...)

    >>> luminance(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])).round(3).tolist()
    [0.0, 1.0]
    """
    from svv.core.colour.colour import LUMA

    return np.asarray(linear(np.asarray(colours, np.float64)) @ np.array(LUMA))


def edits_of_strokes(region: Region) -> tuple[object, ...]:
    """Return the edits of a region's strokes."""
    return tuple(getattr(region, name) for name in STROKE_EDITS)


UNEDITED: tuple[object, ...] = tuple(Region.__dataclass_fields__[name].default for name in STROKE_EDITS)
"""The edits of strokes as they were laid."""


def as_laid(region: Region) -> Region:
    """Return a region without edits of its strokes."""
    plain: dict[str, Any] = dict(zip(STROKE_EDITS, UNEDITED, strict=True))
    return replace(region, **plain)


def edited_strokes(strokes: Strokes, brush: Brush, region: Region) -> tuple[Strokes, Brush]:
    """Return strokes and their brush as a region's edits show them."""
    if region.stroke_palette:
        strokes = recoloured(strokes, region.stroke_palette)
    if region.stroke_width != 1.0:
        strokes = replace(strokes, radius=strokes.radius * np.float32(region.stroke_width))
    light = region.stroke_light or brush.light
    return strokes, replace(brush, relief=region.stroke_relief * brush.relief, light=light)


def recoloured(strokes: Strokes, palette: Sequence[Sequence[float]], seed: int = 0) -> Strokes:
    """Return strokes with colours of a palette, RGB in [0, 1] from dark to light, whose tones follow as theirs do.

    A stroke that is lighter than a fraction of them gets a colour that is lighter than about that fraction of the
    palette (C, 3). ``seed``: of the choice among colours of about the same tone.

    >>> from svv.core.strokes.strokes import straight_stroke
    >>> stroke = straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.05)
    >>> recoloured(stroke, [(0.0, 0.0, 0.5)]).colour.tolist()
    [[0.0, 0.0, 0.5]]
    """
    colours = np.asarray(palette, np.float32)
    # Files keep colours as bytes: the choice must be the same before and after.
    first, second = (luminance(np.rint(255.0 * c) / 255.0) for c in (strokes.colour, strokes.second))
    order = np.argsort(first, kind="stable")
    tone = np.empty(len(order))
    tone[order] = (np.arange(len(order)) + 0.5) / len(order)
    other = (np.searchsorted(first[order], second) + 0.5) / (len(order) + 1)
    broken = np.random.default_rng(seed).uniform(-BROKEN, BROKEN, (2, len(order)))
    index = ((np.stack([tone, other]) + broken) * len(colours)).astype(np.int64).clip(0, len(colours) - 1)
    return replace(strokes, colour=colours[index[0]], second=colours[index[1]])


def entries_of(regions: Sequence[Region], roots: Mapping[int, int]) -> dict[int, int]:
    """Return the regions whose edited strokes differ from those of their whole, each with the region that has them.

    ``roots``: region with strokes -> region of the painting whose strokes it has (:attr:`.model.Model.stroked`).
    """
    from svv.fields.strokes.stored_strokes import NOBODY

    found: dict[int, int] = {}
    for number, root in roots.items():
        own, whole = edits_of_strokes(regions[number]), regions[number].part_of
        if number == root or whole is None:
            found[number] = root
        elif own != edits_of_strokes(regions[whole]) and number < NOBODY:
            found[number] = root
    return found


def edited_field(
    network: UnrestrictedField, regions: Sequence[Region], entries: Mapping[int, int], key: object, owners: Owners
) -> UnrestrictedField:
    """Return the paint of a network with the edits of its strokes; the last results are remembered.

    ``entries``: from :func:`entries_of`; ``owners``: painted region of vertices near strokes; it depends on ``key``.
    """
    every = (key, tuple((number, root, edits_of_strokes(regions[number])) for number, root in entries.items()))
    known = network.edited.get(every)
    if known is None:
        known = _edited(network, regions, entries, owners)
        while len(network.edited) >= KEPT:
            del network.edited[next(iter(network.edited))]
        network.edited[every] = known
    return known


def _edited(
    network: UnrestrictedField, regions: Sequence[Region], entries: Mapping[int, int], owners: Owners
) -> UnrestrictedField:
    """Return paint whose lattice is baked when it is first read."""
    from svv.fields.strokes.stored_strokes import Brushed

    laid = network.brushed
    assert laid is not None
    works = {
        number: edited_strokes(*laid.regions[root], regions[number])
        if edits_of_strokes(regions[number]) != UNEDITED
        else laid.regions[root]
        for number, root in entries.items()
    }
    flats = np.full((max([len(laid.flats), *(number + 1 for number in works)]), 3), 0.5, np.float32)
    flats[: len(laid.flats)] = laid.flats
    for number, root in entries.items():
        palette = regions[number].stroke_palette
        flats[number] = np.mean(palette, axis=0) if palette else laid.flats[root]
    shown = Brushed(works, laid.owners, flats)
    split = any(number != root for number, root in entries.items())

    def shown_at(place: Floats) -> NDArray[np.int64]:
        return _entries(works, regions)[owners(place)]

    def baked(place: Floats, cell: float) -> Floats:
        owner = laid.owner
        if owner is None:
            changed = [k for k in works if works[k] is not laid.regions.get(k)]
            return _over(network, shown, changed, place, cell, shown_at)
        if split:
            own = np.flatnonzero(np.isin(owner, list(entries.values())))
            at = shown_at(place[own])
            shown.owners = whose = owner.copy()
            whose[own] = np.where(at < 0, owner[own], at)
        known = None if network.unbaked else (laid, network.encoding.table.detach().cpu().numpy())
        return shown.baked(place, cell, known=known)

    return network.with_strokes(shown, baked)


def _entries(works: Mapping[int, object], regions: Sequence[Region]) -> NDArray[np.int64]:
    """Return the region whose strokes each region shows, -1 for none; the last is for places of no region. (R + 1,)"""
    found = np.full(len(regions) + 1, -1)
    for number, region in enumerate(regions):
        if number in works:
            found[number] = number
        elif region.part_of is not None:
            found[number] = found[region.part_of]
    return found


def _over(
    network: UnrestrictedField, shown: Brushed, changed: Sequence[int], place: Floats, cell: float, owners: Owners
) -> Floats:
    """Return the lattice of a painting that is only partly of strokes, with the changed strokes in it. (V, 3)"""
    colours = network.encoding.table.detach().cpu().numpy().copy()
    for region in changed:
        paint = shown.paint(region, cell)
        near = np.flatnonzero(paint.is_near(place))
        own = near[owners(place[near]) == region]
        colours[own] = paint(place[own]).clip(0.0, 1.0)
    return np.asarray(colours, np.float32)
