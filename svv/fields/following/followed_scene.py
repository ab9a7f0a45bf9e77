"""A scene at another time step of its volume, without views and without training.

In a scene of the encoding ``values``, extinction, colour and light are functions of the volume's values
(:mod:`svv.fields.radiance.of_values`): at another time step, only the values are new.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.geometry.box import Box
from svv.core.volumes.classified import ClassifiedVolume, ValueGrid, grid_shape
from svv.errors import BadInput
from svv.fields.following.carried_paint import at_rest, carried
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, PaletteField, UnrestrictedField
from svv.fields.radiance.occupancy import FAINTEST, Occupancy, largest_in, least_extinction
from svv.fields.radiance.of_values import SLOPES, VALUES, exponents_at, fill_features, fill_palette
from svv.fields.radiance.time_steps import TimeSteps
from svv.fields.radiance.value_function import ValueFunction
from svv.fields.scene.edits import without_undone_splits
from svv.fields.scene.joined import members, with_members
from svv.fields.scene.model import Model, S
from svv.fields.strokes.flocks import Alive
from svv.fields.strokes.stored_strokes import NOBODY

CPU = torch.device("cpu")

FOLLOWED = "followed"
"""Key of a scene's record: true if it shows another volume than the one that it was trained on."""

Matter = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Where the matter at positions (S, 3), of a box or the world, was when it was painted. (S, 3)"""


def at_step(scene: S, step: int, anew: bool = False) -> S:
    """Return the scene as one of its time steps makes it, with the same palette, edits and paint.

    Paint moves with the matter. The result has no other time steps. ``anew``: whether the own step is made from its
    values, too. Raises BadInput if the scene has no such step, or cannot follow a volume (:func:`check_follows`).
    """
    steps = scene.steps
    if steps is None or not 0 <= step < len(steps):
        count = 0 if steps is None else len(steps)
        told = f"it has the steps 0 to {count - 1}" if count > 1 else "it has no time steps; svv follow adds them"
        raise BadInput(f"The scene has no time step {step}: {told}.")
    scene = without_undone_splits(scene)
    if scene.layers:
        alone = steps.only(step)
        found = [(member, at_step(member, step, anew)) for member in members(scene)]
        # Arrays and members of an ensemble have values of their own; transfer functions share one volume's.
        return with_members(scene, [replace(s, steps=alone) if m.steps is steps else s for m, s in found])
    if step == steps.own and not anew:
        return replace(scene, steps=steps.only(step))
    function, _ = check_follows(scene)
    try:
        grid = steps.grid(step, function.visible).over(function.interval, function.visible)
    except ValueError as error:
        raise BadInput(f"Time step {step} of the scene cannot be read: {error}.") from error
    return _over(scene, grid, steps.box, steps.only(step), steps.place(step), step)


def at_time(scene: S, time: float) -> S:
    """Return the scene at the last of its time steps that is not after ``time``, or at the first."""
    steps = scene.steps
    if steps is None or len(steps) < 2:
        return scene
    return at_step(scene, step_at(steps, time))


def step_at(steps: TimeSteps, time: float) -> int:
    """Return the number of the last step that is not after a time; 0 before all of them."""
    return max(0, int(np.searchsorted(steps.times, time, side="right")) - 1)


def at_volume(
    scene: S, volume: ClassifiedVolume, time: float = 0.0, matter: Matter = lambda position: position,
    alive: Alive | None = None,
) -> S:  # fmt: skip
    """Return the scene as another volume's values make it, with the same palette, edits and paint.

    Where there was no paint before, it is that of the nearest place, or strokes are born. The scene has the encoding
    ``values``, a palette network and no regions that were split off; the volume, classified by its transfer function,
    has its values and ones between: otherwise, raises BadInput. ``matter``: where the matter at positions in the world
    was when the scene was painted, by default at rest; ``alive``: the strokes that live in this volume
    (:meth:`svv.fields.strokes.flocks.Flocks.at`), by default all.
    """
    scene = without_undone_splits(scene)
    function, _ = check_follows(scene)
    if volume.values is None:
        raise BadInput("The volume comes without its values: classify it again.")
    volume.values.check_between()
    grid = volume.values.over(function.interval, function.visible)
    box = volume.box
    steps = TimeSteps.of(grid, box, time)
    return _over(scene, grid, box, steps, lambda at: box.to_box(matter(box.to_world(at))), alive)


def check_follows(scene: Model) -> tuple[ValueFunction, PaletteField]:
    """Return what a scene needs to follow its volume.

    Raises BadInput if it is no function of its volume's values, or has parts or paint that cannot follow.
    """
    if scene.values is None or scene.palette_network is None:
        raise BadInput(
            "The scene does not know its volume's values, so it cannot follow them: train it with --encoding values."
        )
    check_paint_follows(scene)
    return scene.values, scene.palette_network


def check_paint_follows(scene: Model) -> None:
    """Raise BadInput if a scene has parts or paint that cannot be moved to other cells."""
    if scene.parts is not None and scene.parts.active:
        raise BadInput("Parts that were split off cannot follow a volume: undo the splits first.")
    for network in (scene.styled, *(other.network for other in scene.others)):
        if network is not None and not network.direct:
            raise BadInput("Only paint on a lattice can follow a volume: remove this painting first.")


@torch.no_grad()
def _over(
    scene: S, grid: ValueGrid, box: Box, steps: TimeSteps, matter: Matter, step: int | Alive | None
) -> S:  # fmt: skip
    """Return the scene over a grid of values, one of its own ``step`` or another (:func:`carried`)."""
    function, palette = check_follows(scene)
    device, old = scene.device, scene.base.density
    assert old is not None
    occupancy, density = _occupied(scene, function, grid, box)
    finer = occupancy.cells // scene.occupancy.cells
    settings = replace(scene.settings, resolutions=_times(finer, scene.settings.resolutions))
    base = BaseField(settings, occupancy, _times(finer, old.resolutions))
    base.colour_mlp.load_state_dict(scene.base.colour_mlp.state_dict())
    base.density = density
    fill_features(base, grid, occupancy)
    normals = None if palette.phong is None else _times(finer, palette.phong.normals.resolutions)
    moved = PaletteField(settings, occupancy, base.geometry_width, palette.colours.detach().cpu(), normals)
    fill_palette(moved, base)
    learned = {name: value for name, value in palette.state_dict().items() if not name.endswith("table")}
    moved.load_state_dict(learned, strict=False)

    def painted(network: UnrestrictedField) -> UnrestrictedField:
        return carried(network, scene, (occupancy, grid), step, matter, lambda place: owners(result, place)).to(device)

    result = replace(
        scene, occupancy=occupancy, base=base.requires_grad_(False).to(device), steps=steps, parts=None,
        settings=settings, marching=replace(scene.marching, step=scene.marching.step / finer),
        palette_network=moved.requires_grad_(False).to(device), made={**scene.made, FOLLOWED: True},
        expected=None,  # they are those of the volume that the scene was trained on
    )  # fmt: skip
    return replace(
        result,
        styled=None if scene.styled is None else painted(scene.styled),
        others=tuple(replace(other, network=painted(other.network)) for other in scene.others),
    )


def on_cells_of(scene: Model, network: UnrestrictedField, painted: Model) -> UnrestrictedField:
    """Return paint, laid on the scene ``painted``, on the cells that the same scene has with other opacities.

    ``scene`` is that one, not painted yet. Raises BadInput for paint that cannot follow (:func:`check_paint_follows`).
    """
    if np.array_equal(scene.occupancy.occupied, painted.occupancy.occupied):
        return network
    check_paint_follows(painted)
    steps, regions = scene.steps, {k: r.style for k, r in enumerate(painted.regions)}
    styled = replace(scene, regions=tuple(replace(r, style=regions.get(k)) for k, r in enumerate(scene.regions)))
    if steps is None or painted.values is None:
        return at_rest(network, painted, scene.occupancy, partial(owners, styled)).to(scene.device)
    function = painted.values
    grid = steps.grid(steps.own, function.visible).over(function.interval, function.visible)
    over = scene.occupancy, grid
    found = carried(network, painted, over, steps.own, lambda position: position, partial(owners, styled))
    if found.brushed is not None and network.brushed is not None:
        found.brushed.lives = network.brushed.lives
    return found.to(scene.device)


def owners(scene: Model, place: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the painted region at box coordinates (V, 3), 255 for none. (V,)"""
    region = scene.painted_region(place)
    return np.where(region < 0, NOBODY, region).astype(np.uint8)


def _times(factor: int, numbers: Sequence[int]) -> tuple[int, ...]:
    return tuple(factor * number for number in numbers)


def _occupied(
    scene: Model, function: ValueFunction, grid: ValueGrid, box: Box
) -> tuple[Occupancy, SparseLattice]:  # fmt: skip
    """Return the cells in which a grid of values shows something, and its extinction; one cell if there are none.

    They are as large as the scene's, or nearly so, in a box of any size.
    """
    density, own = scene.base.density, scene.occupancy
    assert density is not None
    finer = 2 ** max(0, round(np.log2(box.size / own.box.size)))
    cells = finer * own.cells
    longer = float(np.log(box.size / function.size))
    rows = function.table.reshape(VALUES, SLOPES)[:, 0].cpu().numpy() + longer
    least = least_extinction(FAINTEST, float(np.exp(rows.max())))
    # A cell with a visible value is occupied: others' extinction is next to nothing, and was not learned.
    low, high = (np.array(function.visible) * (VALUES - 1)).round().astype(np.int64)
    visible = (np.arange(VALUES) >= low - 1) & (np.arange(VALUES) <= high + 1)
    seen = np.concatenate([[0], np.cumsum(visible & (rows > np.log(least)))])
    codes = grid.values()
    row = np.minimum((codes * (VALUES - 1)).astype(np.int32), VALUES - 2)
    low, high = row, row + 1
    for axis in range(3):
        first, second = (np.moveaxis(a, axis, 0) for a in (low, high))
        low, high = (
            np.moveaxis(np.minimum(first[1:], first[:-1]), 0, axis),
            np.moveaxis(np.maximum(second[1:], second[:-1]), 0, axis),
        )
    there = seen[high + 1] > seen[low]
    occupied = np.zeros(tuple(grid_shape(box, cells)), np.uint8)
    marked = _at_cells(there, grid.cells, cells)
    kept = tuple(slice(0, min(a, b)) for a, b in zip(occupied.shape, marked.shape))
    occupied[kept] = marked[kept]
    if not occupied.any():
        occupied[0, 0, 0] = 1
    occupancy = Occupancy(box, cells, occupied)
    lattice = SparseLattice(occupied, cells, _times(finer, density.resolutions), 1).requires_grad_(False)
    lattice.table.copy_(exponents_at(function, grid, lattice, occupancy)[:, None])
    corner = occupancy.occupied_on(CPU).nonzero()
    between = lattice.resolutions[0] <= cells  # no vertex lies within a cell
    largest = largest_in(lambda points: lattice(points)[:, 0], corner, occupancy, corners=between)
    left = occupancy.pruned(largest, least_extinction(FAINTEST, float(largest.max())), grow=False)
    if not left.occupied.any():
        left.occupied[tuple(corner[0].tolist())] = 1
        left = Occupancy(box, cells, left.occupied)
    return left, lattice.restricted(left.occupied, cells).requires_grad_(False)


def _at_cells(marked: NDArray[np.bool_], cells: int, wanted: int) -> NDArray[np.bool_]:
    """Return marks of cells at another number of cells per box unit, both powers of two."""
    if wanted >= cells:
        for axis in range(3):
            marked = marked.repeat(wanted // cells, axis)
        return marked
    k = cells // wanted
    padded = np.pad(marked, [(0, -n % k) for n in marked.shape])
    x, y, z = (n // k for n in padded.shape)
    return np.asarray(padded.reshape(x, k, y, k, z, k).any(axis=(1, 3, 5)))
