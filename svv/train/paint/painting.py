"""Stage 3: paint that is laid on a scene's regions, as strokes, pieces of pictures or ink.

It is laid once, the same from every side, on a lattice that stores the colours themselves.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.colour import palette_shading
from svv.core.strokes.strokes import Brush, Strokes
from svv.errors import BadInput, Progress, part
from svv.fields.radiance.encodings import SparseLattice, places_of, vertices_of
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.scene.model import for_colours, of_colour
from svv.fields.scene.scene import Scene
from svv.fields.strokes.stored_strokes import NOBODY, Brushed
from svv.styles.hand import Hand
from svv.train.paint.ink import SURFACE, Drawing, Ink
from svv.train.paint.pieces import PieceStyle, resized
from svv.train.paint.plan import Order
from svv.train.paint.quilt import RADIUS, Manner, Quilt
from svv.train.paint.stroke_painting import Brushing, PaintedRegion, stroke_width
from svv.train.paint.styled_views import UNSEEN, StyledView, visible_from
from svv.train.paint.surface_form import Form, form_of
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.config import StylizeSettings
from svv.train.run.previews import Previews, Show

MOST_VERTICES = 3_000_000
"""Approximate maximum number of vertices of a painting: each takes three bytes in the scene file."""

MOST_CELLS = 256
"""Maximum number of cells of a painting along the longest side: the lattice has a number for every cell of the box."""

UP = np.array([0.0, 1.0, 0.0])
"""The world's up direction, as in the cameras."""

VIEWS, VIEW_SIZE = 20, 256
"""Number of views of the scene that determine where paint is visible, and their side in pixels."""

LEAST_SEEN = 0.02
"""Weight in a pixel above which a point can be painted."""

CELLS_A_STROKE = 6.0
"""Number of cells of the paint across a stroke, if the limits allow."""

POINTS_A_VIEW = 20_000
"""Maximum number of points used of each view."""

AT_A_TIME = 1 << 17
"""Places whose paint is computed together."""

POINTS_A_RADIUS = 8.0
"""Number of surface points along a piece's radius; pieces are chosen by these points."""


def paint_cells(occupancy: Occupancy, pixel: float) -> int:
    """Return the resolution of a painting's lattice: as fine as a pixel (its side in box units), within the limits."""
    cells, count = occupancy.cells, int((occupancy.occupied > 0).sum())
    while 1.0 / cells > pixel and 2 * cells <= MOST_CELLS and 9 * count <= MOST_VERTICES:
        cells, count = 2 * cells, 8 * count
    return cells


def painted_field(scene: Scene, pixel: float) -> UnrestrictedField:
    """Return a black direct colour field for a painting of the scene; ``pixel`` as in :func:`paint_cells`."""
    cells = paint_cells(scene.occupancy, pixel)
    return UnrestrictedField(scene.settings, scene.occupancy, (cells,), direct=True).to(scene.device)


@dataclass(frozen=True)
class Start:
    """Styles, inks and colours from which the paint is made."""

    transferred: Tensor
    """The regions' colours after colour transfer, RGB. (regions, 3)"""
    targets: Mapping[int, PieceStyle]
    """Picture of each region that is painted by pieces; it is painted anew even if it already is."""
    inks: Mapping[int, Ink] = field(default_factory=dict)
    """Ink of each region that is drawn instead; it is drawn again even if the region is already painted."""
    hands: Mapping[int, Hand] = field(default_factory=dict)
    """Hand of the picture of each region that is painted by strokes; it is painted anew even if it already is."""
    size: float = 1.0
    """Scale of the strokes."""
    views: int = VIEWS
    """Number of views that determine where paint is visible."""
    before: UnrestrictedField | None = None
    """Earlier paint, which regions that the scene marks as painted keep unless they are painted anew."""


@dataclass
class Remarks:
    """What there is to say about how regions were painted."""

    notes: list[str] = field(default_factory=list)
    doubtful: bool = False
    """Whether regions may look alike."""

    def add(self, brushing: Brushing) -> None:
        """Add what there is to say about regions painted by strokes."""
        self.notes += brushing.notes
        self.doubtful |= brushing.doubtful


class Painting:
    """One painting of a scene; ``seconds`` holds the duration of each of its parts."""

    def __init__(
        self, scene: Scene, order: Order, settings: StylizeSettings, seed: int, saved: Checkpoint | None,
        preview: Show | None,
    ) -> None:  # fmt: skip
        """Prepare to resume from and save to a checkpoint, and to show the painting from time to time."""
        self.scene, self.order, self.settings, self.seed, self.saved = scene, order, settings, seed, saved
        self.previews = None if preview is None else Previews(preview, partial(order.painted, scene))
        self.seconds: dict[str, float] = {}
        self.remarks = Remarks()
        """What there is to say about how it went."""
        self.refined: list[int] = []
        """Regions that start from their present paint."""


@torch.no_grad()
def painted_start(
    scene: Scene, start: Start, pixel: float, seed: int, progress: Progress, show: Callable[[UnrestrictedField], None],
    remarks: Remarks,
) -> UnrestrictedField:  # fmt: skip
    """Paint the regions; returns a direct colour field, or raises BadInput if none of them is visible.

    ``pixel`` is a style's on the surface, in box units; ``show`` is called with flat colours, and after each region.
    """
    assert scene.palette_network is not None
    occupancy, targets, inks, before = scene.occupancy, start.targets, start.inks, start.before
    narrow = stroke_width(scene, start.size) / CELLS_A_STROKE if start.hands else pixel
    paint = painted_field(scene, min(pixel, narrow))
    lattice = paint.encoding
    assert isinstance(lattice, SparseLattice)
    styled = [k for k, r in enumerate(scene.regions) if before is not None and r.style is not None]
    painted = sorted([*inks, *start.hands, *targets])
    kept = [k for k in styled if k not in painted]
    if painted and not kept and set(painted) == set(start.hands):
        _paint_by_strokes(scene, start, paint, seed, progress, show, remarks)
        return paint
    place, cell = lattice.places_of_level(0, occupancy.occupied, occupancy.cells), 1.0 / lattice.resolutions[0]
    region, colours = _flat(scene, start.transferred, place, painted, kept, before)
    lattice.table.copy_(torch.from_numpy(colours))
    show(paint)
    views = _views_of(scene, start.views, painted, part(progress, 0.0, 0.1))
    progress = part(progress, 0.15, 1.0)
    strokes = {} if before is None or before.brushed is None else before.brushed.regions
    left = {k: own for k, own in strokes.items() if k in kept}
    if start.hands:
        brushing = Brushing(scene, views, start.size, cell, seed)
        paint.brushed = _brush(brushing, start, region, place, colours, left, part(progress, 0.0, 0.9))
        lattice.table.copy_(torch.from_numpy(colours))
        show(paint)
        progress = part(progress, 0.9, 1.0)
        remarks.add(brushing)
        form = brushing.form
    elif painted:
        form = form_of(scene.base, occupancy, UP)
    if not start.hands and kept:
        paint.brushed = Brushed(left)
    for number, k in enumerate(painted):
        if k in start.hands:
            continue
        told = part(progress, number / len(painted), (number + 1) / len(painted))
        larger = 1.0 if k in inks else targets[k].larger
        spacing = SURFACE * max(pixel, cell) if k in inks else larger * RADIUS * pixel / POINTS_A_RADIUS
        points = _surface(views, k, spacing, np.random.default_rng(seed + k))
        if not len(points):
            continue
        laid: Drawing | Quilt
        if k in inks:
            shown = scene.regions[k].edited_colour or scene.regions[k].colour
            laid = Drawing(inks[k], shown, form, points, pixel, cell, seed + k, part(told, 0.0, 0.6))
        else:
            laid = _quilt(targets[k], form, points, pixel, seed + k, part(told, 0.0, 0.6))
        own = np.flatnonzero(region == k)
        own = own[_near_what_is_seen(views, k, occupancy, place[own])]
        _fill(colours, own, place, laid, part(told, 0.6, 1.0))
        lattice.table.copy_(torch.from_numpy(colours))
        show(paint)
    progress(1.0, "painting")
    return paint


def _fill(
    colours: NDArray[np.float32], own: NDArray[np.int64], place: NDArray[np.float32],
    paint: Callable[[NDArray[np.float32]], NDArray[np.float32]], progress: Progress,
) -> None:  # fmt: skip
    """Write paint at the places ``own`` into the colours of all places (V, 3)."""
    for first in range(0, len(own), AT_A_TIME):
        progress(first / len(own), "painting")
        piece = own[first : first + AT_A_TIME]
        colours[piece] = paint(place[piece]).clip(0.0, 1.0)


def _paint_by_strokes(
    scene: Scene, start: Start, paint: UnrestrictedField, seed: int, progress: Progress,
    show: Callable[[UnrestrictedField], None], remarks: Remarks,
) -> None:  # fmt: skip
    """Paint a scene of which all paint is strokes: its lattice follows from them, and waits until it is needed."""
    cells = paint.resolutions[0]
    owner = cache(partial(owners_of, scene, cells, sorted(start.hands)))
    flats = start.transferred.cpu().numpy().astype(np.float32)
    ground = Brushed({}, owner, flats)
    paint.bake_later(ground, ground.baked)
    show(paint)
    views = _views_of(scene, start.views, sorted(start.hands), part(progress, 0.05, 0.25))
    brushing = Brushing(scene, views, start.size, 1.0 / cells, seed)
    works, flats, glazes = _worked(brushing.painted(start.hands, part(progress, 0.3, 1.0)), flats)
    remarks.add(brushing)
    brushed = Brushed(works, owner, flats, glazes)
    paint.bake_later(brushed, brushed.baked)
    show(paint)
    progress(1.0, "painting")


def _worked(
    found: Mapping[int, PaintedRegion], flats: NDArray[np.float32]
) -> tuple[dict[int, tuple[Strokes, Brush]], NDArray[np.float32], dict[int, float]]:
    """Return the strokes of regions, colours of all where no stroke reaches (R, 3), and how opacity follows strokes."""
    flats = flats.copy()
    for k, one in found.items():
        ground = None if one.work is None else one.work.brush.ground
        flats[k] = ground or (flats[k] if one.flat is None else one.flat)
    # As a file keeps them, so that a scene shows the same before it is saved and afterwards.
    works = {
        k: (Strokes.unpacked(one.work.strokes.packed()), one.work.brush)
        for k, one in found.items()
        if one.work is not None
    }
    return works, flats, {k: one.glaze for k, one in found.items() if one.glaze > 0.0}


@torch.no_grad()
def owners_of(scene: Scene, cells: int, painted: Sequence[int]) -> NDArray[np.uint8]:
    """Return the painted region with the largest weight at each vertex of a lattice with ``cells`` cells. (V,)

    A vertex whose cell of the scene has one owner at all corners has it, too, because features are trilinear there.
    """
    occupied, coarse = scene.occupancy.occupied, scene.occupancy.cells
    vertices = vertices_of(occupied, coarse, cells)
    if len(painted) == 1:  # all of the lattice is its
        return np.full(len(vertices), painted[0], np.uint8)
    finer = cells // coarse
    if finer == 1 or (scene.parts is not None and scene.parts.active):
        return owners_at(scene, places_of(occupied, coarse, cells, vertices), painted)
    corners = np.full([n + 1 for n in occupied.shape], NOBODY, np.uint8)
    own = vertices_of(occupied, coarse, coarse)
    corners[tuple(own.T)] = owners_at(scene, places_of(occupied, coarse, coarse, own), painted)
    _, height, depth = corners.shape
    ends = [((v // finer).astype(np.int32), (-(-v // finer)).astype(np.int32)) for v in vertices.T]
    found = corners.ravel()
    owner, alike = np.empty(0, np.uint8), np.ones(len(vertices), bool)
    for x, y, z in itertools.product(*ends):
        there = found[(x * height + y) * depth + z]
        owner = owner if len(owner) else there
        alike &= owner == there
    mixed = np.flatnonzero(~alike)
    owner[mixed] = owners_at(scene, places_of(occupied, coarse, cells, vertices[mixed]), painted)
    return owner


def owners_at(scene: Scene, place: NDArray[np.float32], painted: Sequence[int]) -> NDArray[np.uint8]:
    """Return the painted region with the largest weight at box coordinates (V, 3), NOBODY for none. (V,)"""
    assert scene.palette_network is not None
    own = torch.tensor([k in painted for k in range(len(scene.regions))], device=scene.device)
    found = np.empty(len(place), np.uint8)
    for first in range(0, len(place), AT_A_TIME):
        piece = slice(first, first + AT_A_TIME)
        position = torch.from_numpy(place[piece]).to(scene.device)
        weights, here = scene.palette_network.material(position)[1], scene.regions_at(position)
        best = _best(weights, own, here).cpu().numpy()
        found[piece] = np.where(best < 0, NOBODY, best)
    return found


def _best(weights: Tensor, own: Tensor, here: Tensor | None) -> Tensor:
    """Return the region with the largest of the palette weights (S, P) among those marked in ``own``, -1: none. (S,)"""
    best, which = weights.masked_fill(~for_colours(own, here), -1.0).max(dim=1)
    return torch.where(best > 0.0, of_colour(here, which), -1)


def _views_of(scene: Scene, count: int, painted: Sequence[int], progress: Progress) -> list[StyledView]:
    """Return views that show what is visible of regions to be painted; raises BadInput if that is nothing."""
    if not painted:
        return []
    views = visible_from(scene, scene.rig.sphere(count, VIEW_SIZE), progress)
    if not any(bool((view.region == k).any()) for view in views for k in painted):
        raise BadInput(UNSEEN)
    return views


def _brush(
    brushing: Brushing, start: Start, region: NDArray[np.int64], place: NDArray[np.float32],
    colours: NDArray[np.float32], left: Mapping[int, tuple[Strokes, Brush]], progress: Progress,
) -> Brushed:  # fmt: skip
    """Paint regions by strokes into the colours of all places (V, 3); others keep the strokes that are ``left``."""
    found = brushing.painted(start.hands, part(progress, 0.0, 0.65))
    works, flats, glazes = _worked(found, start.transferred.cpu().numpy().astype(np.float32))
    owner = np.where(region < 0, NOBODY, region).astype(np.uint8)
    brushed = Brushed(works, owner, flats)
    theirs = np.isin(region, list(start.hands))
    colours[theirs] = brushed.baked(place, brushing.cell, part(progress, 0.65, 1.0))[theirs]
    return Brushed({**works, **left}, None, flats, glazes)


def _quilt(
    target: PieceStyle, form: Form, points: NDArray[np.float32], pixel: float, seed: int, progress: Progress
) -> Quilt:
    """Lay a style's picture on visible points of a region; in deep regions, pieces and strokes are larger."""
    larger, inside = target.larger, target.inside
    picture = target.picture
    if larger > 1.0:  # the target's picture is already enlarged: here the pixels are enlarged instead
        picture = resized(picture, round(max(picture.shape[1:]) / larger))
        if inside is not None:
            share = resized(torch.from_numpy(inside[None].astype(np.float32)), max(picture.shape[1:]))[0].numpy()
            inside = share >= min(0.5, share.max())
    manner = Manner(picture.permute(1, 2, 0).cpu().numpy(), inside)
    return Quilt(manner, form, points, larger * pixel, seed, progress, target.guides, through=larger > 1.0)


def _flat(
    scene: Scene, transferred: Tensor, place: NDArray[np.float32], painted: list[int], kept: list[int],
    before: UnrestrictedField | None,
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:  # fmt: skip
    """Return the painted region of each vertex, -1 for none (V,), and flat colours (V, 3), also across the border."""
    assert scene.palette_network is not None
    region = np.empty(len(place), np.int64)
    colours = np.empty((len(place), 3), np.float32)
    own = torch.tensor([k in painted for k in range(len(transferred))], device=transferred.device)
    for first in range(0, len(place), AT_A_TIME):
        piece = slice(first, first + AT_A_TIME)
        position = torch.from_numpy(place[piece]).to(transferred.device)
        intensity, weights, offsets = scene.palette_network.material(position)
        here = scene.regions_at(position)
        found = palette_shading.diffuse(intensity, weights, for_colours(transferred, here) + offsets)
        largest = of_colour(here, weights.argmax(dim=1))
        if before is not None:
            there = torch.isin(largest, torch.tensor(kept, device=largest.device))
            found[there] = before(position[there])
            weights = weights.masked_fill(there[:, None], -1.0)
        colours[piece] = found.clamp(0.0, 1.0).cpu().numpy()
        region[piece] = _best(weights, own, here).cpu().numpy()
    return region, colours


def _near_what_is_seen(
    views: Sequence[StyledView], region: int, occupancy: Occupancy, place: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Return whether each vertex lies in, or next to, an occupancy cell in which a view shows the region. (V,)"""
    seen = np.zeros(occupancy.occupied.shape, bool)
    top: NDArray[np.int64] = np.array(seen.shape) - 1
    for view in views:
        own = view.region == region
        seen[tuple(np.minimum((view.position[own].cpu().numpy() * occupancy.cells).astype(np.int64), top).T)] = True
    for axis in range(3):
        before = np.moveaxis(seen.copy(), axis, 0)
        after = np.moveaxis(seen, axis, 0)
        after[1:] |= before[:-1]
        after[:-1] |= before[1:]
    return seen[tuple(np.minimum((place * occupancy.cells).astype(np.int64), top).T)]


def _surface(
    views: Sequence[StyledView], region: int, spacing: float, generator: np.random.Generator
) -> NDArray[np.float32]:
    """Return visible points of a region, about one per cube of side ``spacing``. (S, 3)"""
    parts = []
    for view in views:
        own = torch.nonzero((view.region == region) & (view.weight > LEAST_SEEN))[:, 0].cpu().numpy()
        if len(own) > POINTS_A_VIEW:
            own = own[generator.integers(0, len(own), POINTS_A_VIEW)]
        parts.append(view.position[torch.from_numpy(own).to(view.position.device)].cpu().numpy())
    points = np.concatenate(parts) if parts else np.zeros((0, 3), np.float32)
    cube = (points / spacing).astype(np.int64)
    _, first = np.unique((cube[:, 0] << 40) + (cube[:, 1] << 20) + cube[:, 2], return_index=True)
    return np.ascontiguousarray(points[first], np.float32)
