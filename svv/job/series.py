"""A scene with the other time steps of its volume."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, zoom

from svv.core.geometry.box import Box
from svv.core.geometry.displacement import came_from, small
from svv.core.interval_text import interval_text
from svv.core.volumes.classified import COARSE, ValueGrid
from svv.dvr.draw.time_series import beyond, values_over, visible_bounds
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput, Progress, part, silent
from svv.fields.following.carried_paint import with_lives
from svv.fields.following.followed_scene import at_step, check_follows
from svv.fields.radiance.time_steps import TimeSteps, move_shape, packed_codes, packed_moves
from svv.fields.scene.joined import members
from svv.fields.scene.scene import Scene
from svv.fields.strokes.advected import Field

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkImageData

SAME = 0.995
"""Fraction of a grid's values that agree if a scene was trained on a volume."""

SAMPLES, DIFFERENT = 4096, 0.05
"""Places at which two scenes are compared, and the mean difference of their values, relative to those that both have,
from which they are of different volumes."""

BEYOND = 0.01
"""Fraction of a step's visible voxels beyond the known values from which the user is told."""


@dataclass(frozen=True)
class Step:
    """A time step of a volume."""

    name: str
    """Its name in messages."""
    time: float
    read: Callable[[], vtkImageData]
    """Returns the volume, as from :func:`svv.dvr.read.grids.as_volume`."""


def with_time_steps(
    scene: Scene, steps: Sequence[Step], function: TransferFunction | None = None, progress: Progress = silent
) -> tuple[Scene, list[str]]:
    """Return a scene with the time steps of its volume, and what the user should know about them.

    The scene, of the encoding ``values``, was trained on one of the steps, each of whose volumes is read twice. The
    transfer function is by default the one that the scene records. Raises BadInput if the scene is not one of these, or
    was trained on none of the steps; a volume cannot be read; or times are equal.
    """
    if function is not None and not function.placed:
        raise BadInput(
            f"'{function.name}' has no opacity points, so it has no values of its own: leave it out, as the scene "
            "knows its transfer function, or export it from ParaView with its opacities."
        )
    every = members(scene)
    if any(not _same_values(every[0], member) for member in every[1:]):
        raise BadInput(
            "The scene shows several arrays or volumes, whose values differ: follow the scene of each with its own "
            "volumes, and join the results with svv join."
        )
    functions = []
    for member in every:
        check_follows(member)
        functions.append(function or _read_transfer_function(member))
    intervals = [member.values.interval for member in every if member.values is not None]
    interval = min(low for low, _ in intervals), max(high for _, high in intervals)
    steps = sorted(steps, key=lambda step: step.time)
    for before, after in pairwise(steps):
        if before.time == after.time:
            raise BadInput(f"{before.name} and {after.name} have the same time, {before.time:g}.")
    own, bounds, notes = _survey(scene, steps, functions, part(progress, 0.0, 0.3))
    box, cells = _box_over(scene, bounds)
    found = _grids(steps, own, (box, cells, interval), part(progress, 0.3, 0.9))
    layers = tuple(replace(layer, steps=None) for layer in scene.layers)
    result = at_step(replace(scene, steps=found, layers=layers), own, anew=True)
    for member in members(result):
        for network in (member.styled, *(other.network for other in member.others)):
            if network is not None:
                with_lives(network, found, part(progress, 0.9, 1.0))
    progress(1.0, "time steps")
    return replace(result, steps=found), notes


def _same_values(first: Scene, other: Scene) -> bool:
    """Return whether two scenes are of the same volume: their values agree wherever both have some."""
    mine, its = first.steps, other.steps
    if mine is None or its is None or mine is its:
        return True  # without values, it is said that they cannot follow
    (low, high), (start, stop) = (np.asarray(box.bounds) for box in (mine.box, its.box))
    low, high = np.maximum(low, start), np.minimum(high, stop)
    place = low + (high - low) * np.random.default_rng(0).random((SAMPLES, 3))
    found = [Field.of(s.grid(s.own, (0.0, 1.0)), s.box, s.box).at(s.box.to_box(place)) for s in (mine, its)]
    world = [v * (s.interval[1] - s.interval[0]) + s.interval[0] for v, s in zip(found, (mine, its), strict=True)]
    # Beyond an interval, values count as its nearest one.
    bottom, top = (pick(pair) for pick, pair in zip((max, min), zip(mine.interval, its.interval, strict=True)))
    if bottom >= top:
        return True
    return bool(np.abs(np.diff(np.clip(world, bottom, top), axis=0)).mean() <= DIFFERENT * (top - bottom))


def _read_transfer_function(scene: Scene) -> TransferFunction:
    recorded = scene.made.get("source", {}).get("tf")
    if recorded is None:
        raise BadInput("The scene does not record its transfer function: give it with --tf.")
    return TransferFunction.from_dict(recorded)


def _own(scene: Scene) -> TimeSteps:
    if scene.steps is None:
        raise BadInput("The scene was made before scenes kept their values: train it again.")
    return scene.steps


def _survey(
    scene: Scene, steps: Sequence[Step], functions: Sequence[TransferFunction], progress: Progress
) -> tuple[int, NDArray[np.float64], list[str]]:
    """Return which step the scene was trained on, the bounds of all that is visible (2, 3), and notes."""
    known = _own(scene)
    codes, own, notes = known.grid(known.own, (0.0, 1.0)).codes.astype(np.int32), None, []
    every = members(scene)
    bounds = _around([member.occupancy.box.bounds for member in every])
    for number, step in enumerate(steps):
        progress(number / len(steps), f"looking at {step.name}")
        image = step.read()
        if own is None:
            there = values_over(image, known.box, known.cells, known.interval).codes.astype(np.int32)
            own = number if (abs(there - codes) <= COARSE).mean() >= SAME else None
        seen = [b for function in functions if (b := visible_bounds(image, function)) is not None]
        if not seen:
            notes.append(f"{step.name} shows nothing.")
            continue
        bounds = _around([bounds, *seen])
        for function, member in zip(functions, every, strict=True):
            assert member.values is not None
            low, high = member.values.interval
            share = beyond(image, function, (low, high))
            if share > BEYOND:
                notes.append(
                    f"{step.name}: {share:.0%} of what is visible has values beyond {interval_text(low, high)}, those "
                    "of the step that the scene was trained on, and is shown like the nearest of them."
                )
    if own is None:
        raise BadInput("The scene was trained on none of these volumes: name the one that it was trained on, too.")
    return own, bounds, notes


def _around(bounds: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the smallest bounds that contain all of these. (2, 3)"""
    return np.stack([np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)])


def _box_over(scene: Scene, bounds: NDArray[np.float64]) -> tuple[Box, int]:
    """Return a box around the bounds whose grid continues that of the scene, and its cells per box unit."""
    own, known = scene.occupancy.box, _own(scene)
    coarse = own.size / min(scene.occupancy.cells, known.cells)
    low = np.asarray(own.low) + coarse * np.floor((bounds[0] - own.low) / coarse + 1e-6)
    sides = coarse * np.ceil((bounds[1] - low) / coarse - 1e-6)
    scale = 1
    while scale * own.size < sides.max() * (1 - 1e-9):
        scale *= 2
    x, y, z = (float(v) for v in low)
    a, b, c = (float(v) for v in sides / (scale * own.size))
    return Box((x, y, z), scale * own.size, (a, b, c)), scale * known.cells


def _grids(
    steps: Sequence[Step], own: int, over: tuple[Box, int, tuple[float, float]], progress: Progress
) -> TimeSteps:
    """Return the values of all steps over a box, and where their matter was in the own step."""
    (box, cells, interval), count = over, len(steps)
    codes: dict[int, NDArray[np.uint8]] = {}
    moves: dict[int, NDArray[np.uint8] | None] = {own: None}

    def grid(number: int) -> ValueGrid:
        progress(len(codes) / count, steps[number].name)
        return values_over(steps[number].read(), box, cells, interval)

    first = grid(own)
    codes[own], start = packed_codes(first.codes), small(first.values())
    for way in (range(own + 1, count), range(own - 1, -1, -1)):
        before, moved = start, None
        for number in way:
            there = grid(number)
            codes[number], after = packed_codes(there.codes), small(there.values())
            moved = came_from(before, after, moved)
            moves[number], before = _packed_moves(moved, box, there.codes.shape), after
    times = tuple(step.time for step in steps)
    return TimeSteps(
        box, cells, interval, times, tuple(codes[k] for k in range(count)), tuple(moves[k] for k in range(count)), own,
        first.edges,
    )  # fmt: skip


def _packed_moves(moved: NDArray[np.float32], box: Box, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return displacements in cells of their grid (3, X, Y, Z) as the scene's file keeps them."""
    wanted = move_shape((shape[0], shape[1], shape[2]))
    factors = [a / b for a, b in zip(wanted, moved.shape[1:])]
    unit = [side / (n - 1) for side, n in zip(box.extent, moved.shape[1:])]
    smooth = [u * gaussian_filter(axis, 0.4 / factors[0], mode="nearest") for u, axis in zip(unit, moved)]
    return packed_moves(np.stack([zoom(axis, factors, order=1, mode="nearest") for axis in smooth]))
