"""Regions corrected by pointing: "this is region 1" and "these are one".

A point stands for the connected piece of its region around it. If points in a piece differ, a random walker divides it
(Grady 2006): each cell goes to the point reached first by steps that avoid changes of colour or opacity.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from skimage.segmentation import random_walker
from torch import Tensor

from svv.core.colour.correction import RGB, Point
from svv.core.colour.palette import PaletteSettings
from svv.core.geometry.components import large, least_opacity, nearest_piece, pieces
from svv.errors import BadInput
from svv.fields.radiance.networks import PaletteField
from svv.fields.scene.scene import Scene
from svv.fields.scene.splitting import REACH, format_point, regions_in_cells
from svv.options.editing import SPLIT_LEVEL
from svv.train.palette.ranges import Labelled

MOST_CELLS = 200_000
"""Number of cells in which a piece is divided; larger ones are divided on a coarser grid."""

STIFFNESS = 130.0
"""How much a walker avoids a difference (Grady's beta; scikit-image's default, which it divides by the variance)."""

Grid = NDArray[np.int16]
Cell = tuple[int, ...]
Seeds = list[tuple[Cell, int]]
"""Cells, each with the region that it is said to be."""


class InCells(Labelled):
    """Regions of the cells of a box, which are those of the points in them."""

    def __init__(
        self, region: NDArray[np.integer], cells: int, device: torch.device, moved: NDArray[np.floating] | None = None
    ) -> None:
        """Keep the region of each cell (X, Y, Z), ``cells`` per box unit; cells with -1 have that of the nearest.

        ``moved`` (X, Y, Z): opacity of cells whose region has changed, 0 of others.
        """
        self._moved = np.zeros(region.shape, np.float32) if moved is None else moved
        nearest = distance_transform_edt(region < 0, return_distances=False, return_indices=True)
        self._region = torch.from_numpy(region[tuple(nearest)].astype(np.int64)).to(device)
        self._cells = cells

    def of(self, position: Tensor) -> Tensor:
        """Return the region of each point. (S,)"""
        cell = (position * self._cells).long()
        x, y, z = (v.clamp(0, size - 1) for v, size in zip(cell.unbind(1), self._region.shape, strict=True))
        return self._region[x, y, z]

    @torch.no_grad()
    def followed_by(self, network: PaletteField) -> float:
        """Return the part of what has moved, by opacity, that a network gives to its new region; 1 if nothing moved."""
        there = np.argwhere(self._moved > 0)
        there = there[:: len(there) // MOST_CELLS + 1]
        position = torch.from_numpy(((there + 0.5) / self._cells).astype(np.float32)).to(self._region.device)
        right = network.material(position)[1].argmax(dim=1) == self.of(position)
        opacity = self._moved[tuple(there.T)]
        return float(np.average(right.cpu().numpy(), weights=opacity)) if len(there) else 1.0


@dataclass(frozen=True)
class Pointed:
    """Regions after pointing."""

    region: Grid
    """Region of each cell, -1 where nothing was found; the number after the last one is a new region. (X, Y, Z)"""
    cells: int
    """Cells per box unit."""
    merged: tuple[tuple[int, ...], ...]
    """Groups of regions that are one."""
    moved: NDArray[np.float32]
    """Opacity of the cells whose region changes, 0 of others. (X, Y, Z)"""
    added: RGB | None
    """Colour of the new region; None if there is none."""
    said: tuple[str, ...]
    """What was done."""


def pointed(scene: Scene, points: Sequence[tuple[Point, int]], same: Sequence[tuple[Point, Point]]) -> Pointed:
    """Return the regions, in cells, that places in world units ask for; nothing is trained.

    Each of the ``points`` has the region that is there, or the number after the last one for a new one; each pair of
    ``same`` is one region. Raises BadInput as :func:`check_places`, or if nothing would change or be left of a region.
    """
    count = len(scene.palette_regions)
    (cells, region, opacity), seeds, pairs = _placed(scene, points, same)
    found, said = region.copy(), []
    for own, piece, mine in _by_piece(seeds, region, opacity):
        found[piece] = _divided(scene, piece, mine, cells, opacity)
        whole = max(float(opacity[region == own].sum()), 1e-12)
        for number in sorted({n for _, n in mine if n != own}):
            share = float(opacity[piece & (found == number)].sum()) / whole
            said.append(f"{share:.1%} of region {own} is now region {number}")
    if points and not said and not pairs:
        raise BadInput("These places have these regions already: point at a place that has the wrong one.")
    _check_left(region, found, opacity, count)
    added = _colour_of(scene, found == count, cells, opacity) if (found == count).any() else None
    moved = np.where(found != region, opacity, np.float32(0.0))
    return Pointed(found, cells, tuple(tuple(sorted(pair)) for pair in pairs), moved, added, tuple(said))


def check_places(scene: Scene, points: Sequence[tuple[Point, int]], same: Sequence[tuple[Point, Point]]) -> None:
    """Check what can be told of each place of :func:`pointed` by itself, and of pairs; more places may mend the rest.

    Raises BadInput if nothing is at a place, a region does not exist, places contradict each other, both of a pair have
    the same region already, or the scene has parts.
    """
    _placed(scene, points, same)


def _placed(
    scene: Scene, points: Sequence[tuple[Point, int]], same: Sequence[tuple[Point, Point]]
) -> tuple[tuple[int, Grid, NDArray[np.float32]], Seeds, list[tuple[int, ...]]]:
    """Return the scene's regions in cells, the cells of points, and the regions of pairs; raises as `check_places`."""
    count = len(scene.palette_regions)
    for _, number in points:
        if not 0 <= number <= count:
            raise BadInput(
                f"There is no region {number}: the scene has the regions 0 to {count - 1}, and {count} would be new."
            )
    if scene.parts is not None and scene.parts.active:
        raise BadInput("The scene has parts of regions: undo the splits (svv edit --undo), then point.")
    cells, region, opacity = regions_in_cells(scene.reset())
    seeds = [(_cell_of(scene, place, region, cells), number) for place, number in points]
    ends = [tuple(_cell_of(scene, place, region, cells) for place in pair) for pair in same]
    pairs = [tuple(int(region[cell]) for cell in pair) for pair in ends]
    for (one, other), (place, _) in zip(itertools.combinations(seeds, 2), itertools.combinations(points, 2)):
        if one[1] != other[1] and _beside(one[0], other[0]):
            raise BadInput(
                f"Two points contradict each other: {format_point(place[0])} is said to be region {one[1]} and region "
                f"{other[1]}; leave one out."
            )
    for cells_of, (first, second), (here, there) in zip(ends, pairs, same, strict=True):
        if first == second:
            raise BadInput(f"Both places are region {first} already: point at places of two regions.")
        told = [{number for cell, number in seeds if _beside(cell, end)} for end in cells_of]
        if all(told) and told[0] != told[1]:
            raise BadInput(
                f"Points contradict each other: {format_point(here)} and {format_point(there)} are said to be one "
                f"region, and to be regions {min(told[0])} and {min(told[1])}; leave one out."
            )
    return (cells, region, opacity), seeds, pairs


def _beside(one: Cell, other: Cell) -> bool:
    """Return whether two cells are the same or touch each other."""
    return bool(np.abs(np.subtract(one, other)).max() <= 1)


def _check_left(before: Grid, after: Grid, opacity: NDArray[np.float32], count: int) -> None:
    """Raise BadInput if hardly anything is left of a region."""
    for number in range(count):
        was, left = (float(opacity[grid == number].sum()) for grid in (before, after))
        if left < PaletteSettings().min_share * was:
            raise BadInput(
                f"Nothing would be left of region {number}: also point at a place that is region {number}, or merge it."
            )


def _cell_of(scene: Scene, place: Point, region: Grid, cells: int) -> Cell:
    """Return the occupied cell at a place in world units; raises BadInput if nothing is there."""
    at = scene.occupancy.box.to_box(np.asarray(place, np.float64))
    if np.isfinite(at).all():
        cell = tuple(int(c) for c in np.floor(at * cells))
        if all(0 <= c < n for c, n in zip(cell, region.shape, strict=True)) and region[cell] >= 0:
            return cell
    raise BadInput(f"There is nothing at {format_point(place)}: click on something visible.")


def _by_piece(
    seeds: Seeds, region: Grid, opacity: NDArray[np.float32]
) -> Iterator[tuple[int, NDArray[np.bool_], Seeds]]:
    """Yield the pieces in which points lie, as ``splitting.piece_at`` finds them: region, cells (X, Y, Z), points."""
    for own in sorted({int(region[cell]) for cell, _ in seeds}):
        mine = [seed for seed in seeds if region[seed[0]] == own]
        inside = region == own
        visible = inside & (opacity >= least_opacity(opacity[inside], SPLIT_LEVEL))
        labels, sizes = pieces(visible)
        held = defaultdict(list)
        for cell, number in mine:
            asked, far = nearest_piece(labels, np.asarray(cell) + 0.5)
            if far > REACH:
                raise BadInput(f"Too little is visible of region {own} at a point in it: point at something opaque.")
            held[asked].append((cell, number))
        kept = np.any([large(sizes, asked) for asked in held], axis=0)
        nearest = distance_transform_edt(~kept[labels], return_distances=False, return_indices=True)
        nearer = labels[tuple(nearest)]
        for asked, some in held.items():
            yield own, inside & (nearer == asked), some


@torch.no_grad()
def _divided(
    scene: Scene, piece: NDArray[np.bool_], seeds: Seeds, cells: int, opacity: NDArray[np.float32]
) -> NDArray[np.int16]:
    """Return the region of each cell of a piece (X, Y, Z), in raster order: what the points in it say. (N,)"""
    numbers = sorted({number for _, number in seeds})
    there = np.argwhere(piece)
    if len(numbers) == 1:
        return np.full(len(there), numbers[0], np.int16)
    low = there.min(axis=0)
    size = there.max(axis=0) - low + 1
    coarser = max(1, int(np.ceil((float(np.prod(size)) / MOST_CELLS) ** (1.0 / 3.0))))
    shape = tuple((size - 1) // coarser + 1)
    coarse = np.ravel_multi_index(tuple(((there - low) // coarser).T), shape)
    held, first, back = np.unique(coarse, return_index=True, return_inverse=True)
    colour = _colours_at(scene, there[first], cells)
    look = np.zeros((int(np.prod(shape)), 4))
    look[held, :3] = colour
    look[held, 3] = np.bincount(back, opacity[piece]) / np.bincount(back)
    marks = np.full(len(look), -1, np.int32)
    marks[held] = 0
    for cell, number in seeds:
        at = np.clip((np.asarray(cell) - low) // coarser, 0, np.array(shape) - 1)
        marks[np.ravel_multi_index(tuple(at), shape)] = 1 + numbers.index(number)
    walked = random_walker(look.reshape(*shape, 4), marks.reshape(shape), STIFFNESS, mode="cg_j", channel_axis=-1)
    # Cells that touch the rest by a corner only are reached by no walker.
    nearest = distance_transform_edt(walked <= 0, return_distances=False, return_indices=True)
    reached = walked[tuple(nearest)].ravel()[coarse]
    return np.asarray(numbers, np.int16)[reached - 1]


@torch.no_grad()
def _colours_at(scene: Scene, places: NDArray[np.integer], cells: int) -> NDArray[np.float64]:
    """Return the material's colour at the centres of cells (N, 3), RGB. (N, 3)"""
    assert scene.palette_network is not None
    found = []
    for some in np.array_split(places, max(1, len(places) // MOST_CELLS)):
        position = torch.from_numpy(((some + 0.5) / cells).astype(np.float32)).to(scene.device)
        _, weights, offsets = scene.palette_network.material(position)
        colour = (weights[:, :, None] * (scene.palette_network.colours + offsets)).sum(dim=1)
        found.append(colour.cpu().numpy().astype(np.float64))
    return np.concatenate(found)


def _colour_of(scene: Scene, inside: NDArray[np.bool_], cells: int, opacity: NDArray[np.float32]) -> RGB:
    """Return the mean colour of the material in some cells (X, Y, Z)."""
    colour = _colours_at(scene, np.argwhere(inside), cells)
    red, green, blue = np.average(colour, axis=0, weights=opacity[inside] + 1e-9).clip(0.0, 1.0)
    return float(red), float(green), float(blue)
