"""Paint of a scene at another time step of its volume: strokes move with the matter, other paint is looked up.

Letters: V vertices of the paint's lattice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.geometry.box import Box
from svv.core.strokes.strokes import Strokes
from svv.core.volumes.classified import ValueGrid
from svv.errors import Progress, silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.time_steps import TimeSteps
from svv.fields.scene.model import Model
from svv.fields.strokes.advected import Field, Laid, advected
from svv.fields.strokes.flocks import Alive
from svv.fields.strokes.lives import Stage, at_step, lived
from svv.fields.strokes.stored_strokes import Brushed

Matter = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Where the matter at positions (S, 3), of a box or the world, was when it was painted. (S, 3)"""

Owners = Callable[[NDArray[np.float32]], NDArray[np.uint8]]
"""Box coordinates (V, 3) -> the painted region of each, 255 for none. (V,)"""


def carried(
    network: UnrestrictedField, scene: Model, over: tuple[Occupancy, ValueGrid], step: int | Alive | None,
    matter: Matter, owners: Owners,
) -> UnrestrictedField:  # fmt: skip
    """Return paint on the vertices of other cells, where its matter has moved, on the CPU.

    ``over``: the other cells, and the values there; ``step``: number of the scene's step that this is; for another
    volume what gives the strokes that live there, or None: all do; ``matter``: where the matter at box coordinates of
    the other cells was, in the same coordinates; ``owners``: the regions of places in the other cells.
    """
    laid = network.brushed
    brushed = None if laid is None or scene.steps is None else _moved(laid, scene, over, step, matter)
    return _laid(network, scene, over[0], brushed, matter, owners)


def at_rest(network: UnrestrictedField, scene: Model, occupancy: Occupancy, owners: Owners) -> UnrestrictedField:
    """Return paint on the vertices of other cells of the same box, where it is, on the CPU; as :func:`carried`."""
    laid = network.brushed
    brushed = None if laid is None else Brushed(laid.regions, None, laid.flats, laid.glazes)
    return _laid(network, scene, occupancy, brushed, lambda position: position, owners)


def _laid(
    network: UnrestrictedField, scene: Model, occupancy: Occupancy, brushed: Brushed | None, matter: Matter,
    owners: Owners,
) -> UnrestrictedField:  # fmt: skip
    """Return paint on other cells, of strokes that are ``brushed`` there; the rest as :func:`carried`."""
    finer = occupancy.cells // scene.occupancy.cells
    resolutions = tuple(finer * number for number in network.resolutions)
    result = UnrestrictedField(scene.settings, occupancy, resolutions, direct=True)
    painted, laid = replace(scene, styled=network), network.brushed
    result.painted_in = network.painted_in or (lambda: painted)
    if brushed is None or laid is None or not laid.complete:
        _look_up(network, result, scene, occupancy, matter)
        result.brushed = brushed
        return result.requires_grad_(False)

    def owner() -> NDArray[np.uint8]:
        lattice = result._modules["encoding"]
        assert isinstance(lattice, SparseLattice)
        return owners(lattice.places_of_level(0, occupancy.occupied, occupancy.cells))

    brushed.owners = owner
    result.bake_later(brushed, brushed.baked)
    return result.requires_grad_(False)


def stage_of(steps: TimeSteps) -> Stage:
    """Return what strokes need to know about a series."""

    def field(step: int) -> Field:
        return Field.of(steps.grid(step, (0.0, 1.0)), steps.box, steps.box)

    return Stage(len(steps), steps.own, cache(field), cache(steps.place))


def with_lives(network: UnrestrictedField, steps: TimeSteps, progress: Progress = silent) -> None:
    """Follow the strokes of paint through all time steps, so that they are born and removed."""
    if network.brushed is None:
        return
    stage, found = stage_of(steps), {}
    for number, (region, (strokes, _)) in enumerate(network.brushed.regions.items()):
        progress(number / len(network.brushed.regions), "following strokes")
        found[region] = lived(strokes, stage, region)
    network.brushed.lives = found


def _moved(
    laid: Brushed, scene: Model, over: tuple[Occupancy, ValueGrid], step: int | Alive | None, matter: Matter
) -> Brushed:  # fmt: skip
    """Return strokes where their matter is."""
    assert scene.steps is not None
    steps, (occupancy, grid) = scene.steps, over
    old, box = scene.occupancy.box, occupancy.box
    if laid.lives and isinstance(step, int) and old == steps.box == box:
        stage = stage_of(steps)
        there = {k: (at_step(s, laid.lives.get(k), stage, step), b) for k, (s, b) in laid.regions.items()}
        return Brushed(there, None, laid.flats, laid.glazes)
    own = steps.grid(steps.own, (0.0, 1.0)).over(grid.interval, grid.visible)
    # All in coordinates of the box that was painted.
    painted, now = Field.of(own, steps.box, old), Field.of(grid, box, old)

    def backward(place: NDArray[np.float64]) -> NDArray[np.float64]:
        return old.to_box(box.to_world(matter(box.to_box(old.to_world(place)))))

    found = {}
    for region, (strokes, brush) in laid.regions.items():
        if step is None or isinstance(step, int):
            moved = advected(Laid.on(strokes, painted), now, backward)[0]
        else:
            moved = step(strokes, region, painted, now, backward)
        found[region] = _in_box(moved, old, box), brush
    return Brushed(found, None, laid.flats, laid.glazes)


def _in_box(strokes: Strokes, old: Box, box: Box) -> Strokes:
    """Return strokes of one box in the coordinates of another."""
    size = np.float32(old.size / box.size)
    where = box.to_box(old.to_world(strokes.where.astype(np.float64))).astype(np.float32)
    widths = {name: size * getattr(strokes, name) for name in ("radius", "inner", "outer")}
    return replace(strokes, where=where, **widths)


def _look_up(
    network: UnrestrictedField, result: UnrestrictedField, scene: Model, occupancy: Occupancy, matter: Matter
) -> None:
    """Give each vertex the paint of the place that its matter came from.

    It is interpolated where the scene is painted there, otherwise it is that of the nearest vertex.
    """
    from scipy.spatial import cKDTree

    old, box, new = network.encoding, scene.occupancy.box, result.encoding
    assert isinstance(old, SparseLattice) and isinstance(new, SparseLattice)
    vertices = new.vertices_of_level(0, occupancy.occupied, occupancy.cells) / new.resolutions[0]
    place = box.to_box(occupancy.box.to_world(matter(vertices))).astype(np.float32)
    cell = np.floor(place * scene.occupancy.cells).astype(np.int64)
    shape = np.array(scene.occupancy.occupied.shape)
    within = np.asarray(((cell >= 0) & (cell < shape)).all(axis=1))
    painted = within & (scene.occupancy.occupied[tuple(np.where(within[:, None], cell, 0).T)] > 0)
    there, elsewhere = np.flatnonzero(painted), np.flatnonzero(~painted)
    table = old.table.detach()
    new.table[there] = old.look_up(torch.from_numpy(place[there]).to(table.device)).cpu()
    known = old.vertices_of_level(0, scene.occupancy.occupied, scene.occupancy.cells) / old.resolutions[0]
    _, nearest = cKDTree(known).query(place[elsewhere], workers=-1)
    new.table[elsewhere] = table.cpu()[torch.from_numpy(nearest)]
