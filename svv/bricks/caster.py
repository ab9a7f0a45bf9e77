"""A ray caster for volumes that need not fit into memory.

A ray is marched until it ends or reaches a brick that is not in memory; that is read, and the ray goes on. Bricks that
no ray meets are never read; those that were used least recently make room.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.bricks import filling, marching
from svv.bricks.filling import BLOCKS, BRICK, VOXELS
from svv.bricks.formats.source import Box, Source, check_finite
from svv.bricks.marching import EMPTY, UNKNOWN
from svv.bricks.numbers import Numbers
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera

Array = NDArray[np.float64]

RAYS_AT_A_TIME = 4096
"""Number of rays in a piece of work for a thread."""

MOST_BRICKS = np.iinfo(np.int32).max // VOXELS
"""Bricks in memory, whose voxels must have places that an int32 can hold: 6 to 13 GB."""


@dataclass(frozen=True, eq=False)
class Look:
    """How values are shown: a transfer function in tables, and shading."""

    low: float
    """Value of the first entry of the table; smaller values look the same."""
    high: float
    """Value of its last entry."""
    table: NDArray[np.float32]
    """RGB, and opacity per unit distance, of evenly spaced values. (N, 4)"""
    ranges: Array
    """Intervals of values with an opacity above 0. (R, 2)"""
    unit_distance: float
    """Opacity unit distance, world units."""
    shading: Shading
    """Shading of the volume."""
    nearest: bool = False
    """Whether a sample has the value of the nearest voxel; otherwise values are interpolated trilinearly."""
    blank: NDArray[np.bool_] | None = None
    """Which voxels of the finest level are blanked: what is nearest to them is not shown. (nz, ny, nx)"""
    crop: Array | None = None
    """The part that is shown: lower and upper corner as voxel indices (x, y, z) of the finest level. (2, 3)"""
    stretch: Array | None = None
    """World lengths along the volume's axes per length by which opacities are measured; by default 1. (3,)"""

    def for_step(self, step: float) -> NDArray[np.float32]:
        """Return the table with the opacity of a sample of this length: 1 - (1 - a) ** (step / unit). (N, 4)"""
        table = self.table.astype(np.float64)
        kept = np.log1p(-np.minimum(table[:, 3], 1.0 - 1e-9)) * (step / self.unit_distance)
        table[:, 3] = np.where(table[:, 3] >= 1.0, 1.0, -np.expm1(kept))
        return np.ascontiguousarray(table, np.float32)

    def shades(self, view: Array) -> NDArray[np.float32]:
        """Return the factor of the colour, and the highlight, of each code of a normal. (codes, 2)

        The light comes from the camera, along ``view`` everywhere in the image, and both sides of a surface are lit.
        So is a place without a gradient, but by the ambient light only (as in ``vtkEncodedGradientShader``).
        """
        shading, normals = self.shading, filling.decoded()
        cosine = np.abs(normals @ view)
        if not shading.on:
            shades = np.stack([np.ones_like(cosine), np.zeros_like(cosine)], axis=1)
        else:
            shine = np.where(cosine > 1e-3, shading.specular * cosine**shading.specular_power, 0.0)
            shades = np.stack([shading.ambient + shading.diffuse * cosine, shine], axis=1)
        if self.blank is not None:  # the same again for voxels that are blanked, on which shown samples may border
            shades = np.concatenate([np.pad(shades, [(0, filling.BLANK - len(shades)), (0, 0)]), shades])
        return shades.astype(np.float32)


class BrickCaster:
    """Draws views of one level of a volume, with bricks in ``memory`` bytes; at least 64 bricks are kept."""

    def __init__(self, source: Source, level: int, look: Look, memory: int, threads: int) -> None:
        self.source, self.number, self.look, self.threads = source, level, look, threads
        self.level = source.levels[level]
        self._numbers = Numbers.of(source.dtype, look.low, look.high)
        self._ranges = self._numbers.mapped(look.ranges)
        table = tuple(max(1, -(-(size - 1) // BRICK)) for size in self.level.shape)
        self._slots = np.full(table, UNKNOWN, np.int32)
        self._inverse = np.linalg.inv(self.level.axes)
        bytes_each = VOXELS * (self._numbers.dtype.itemsize + 2)
        count = min(max(64, memory // bytes_each), self._slots.size, MOST_BRICKS)
        # Memory that is never written to takes no room: the pool grows as bricks are read. It holds zeros, because rays
        # that wait for a brick look up the first one's values beside the others, and numbers that are not finite would
        # lead out of the table.
        self._values = np.zeros((count, VOXELS), self._numbers.dtype)
        self._codes = np.zeros((count, VOXELS), np.uint16)
        self._seen = np.zeros((count, BLOCKS, BLOCKS, BLOCKS), np.uint8)
        self._stamps = np.zeros(count, np.int64)
        self._owner = np.full(count, -1, np.int64)
        self._free = list(range(count))[::-1]
        self._now = 0
        self.reads = 0
        """Number of bricks that were read."""

    def render(self, camera: Camera, step: float) -> NDArray[np.float32]:
        """Draw a view with a sample distance in world units: colours times opacity, and opacity. (height, width, 4)

        Raises BadInput if a part of the volume cannot be read, or contains values that are not finite.
        """
        # In a unit of the world, a ray may pass next to nothing of a voxel: a galaxy is 1e23 cm wide.
        unit = float(np.linalg.norm(self.level.axes, axis=0).max())
        frame, corner, pixel = self._frame(camera, unit)
        count = camera.width * camera.height
        state = np.zeros((count, 4), np.float32)
        state[:, 3] = 1.0
        samples = np.zeros(count, np.int32)
        rays = np.arange(count, dtype=np.int32)
        low = self._numbers.mapped(self.look.low)
        span = float(self._numbers.mapped(self.look.high) - low)
        gain = (len(self.look.table) - 1) / span if span > 0.0 else 0.0  # 0: of a volume of one value
        # Beside kept numbers such as 32768, float32 has too few digits for the table's first value, but not for a whole
        # number near it, from which differences are exact.
        near = np.float32(np.rint(low) if self._numbers.dtype.kind == "u" else low)
        first = (float(near) - low) * gain + 0.5
        bounds, lengths = self._bounds(), np.zeros(3)
        if self.look.stretch is not None:
            lengths = self.level.spacing / unit / self.look.stretch
        table, shades = self.look.for_step(step), self.look.shades(-camera.camera_to_world[:3, 2])

        alphas, glossy = np.ascontiguousarray(table[:, 3]), bool((shades[:, 1] != 0.0).any())

        def work(rays: NDArray[np.int32], wanted: NDArray[np.int32]) -> None:
            marching.march(
                rays, camera.width, frame, corner, pixel, lengths, bounds, step / unit, self._slots, self._stamps,
                self._now, self._seen, self._values, self._codes, table, alphas, near, np.float32(gain),
                np.float32(first), shades, glossy, self.look.blank is not None, self.look.nearest, state, samples,
                wanted,
            )  # fmt: skip

        with ThreadPoolExecutor(self.threads) as pool:
            while len(rays):
                self._now += 1
                wanted = np.empty(len(rays), np.int32)
                cuts = range(RAYS_AT_A_TIME, len(rays), RAYS_AT_A_TIME)
                list(pool.map(work, np.split(rays, cuts), np.split(wanted, cuts)))
                waiting = wanted >= 0
                rays = rays[waiting]
                if len(rays):
                    self._fetch(np.unique(wanted[waiting]), pool)
        state[state[:, 3] < marching.SPENT, 3] = 0.0
        state[:, 3] = 1.0 - state[:, 3]
        return state.reshape(camera.height, camera.width, 4)

    def _bounds(self) -> Array:
        """Return the positions between which anything is visible, in voxels. (2, 3)"""
        last = np.array(self.level.shape[::-1]) - 1.0
        if self.look.crop is None:
            return np.array([np.zeros(3), last])
        return np.array([np.maximum(self.look.crop[0], 0.0), np.minimum(self.look.crop[1], last)])

    def _frame(self, camera: Camera, unit: float) -> tuple[Array, Array, float]:
        """Return the camera in voxels, the centre of its first pixel, and the side of a pixel at a distance of 1.

        Lengths are in units of ``unit``, a length in the world.
        """
        turn = unit * self._inverse @ camera.camera_to_world[:3, :3]
        pixel = camera.pixel_at(unit) / unit
        rows = [
            self._inverse @ (camera.position - self.level.origin),
            -turn[:, 2],
            pixel * turn[:, 0],
            -pixel * turn[:, 1],
        ]
        column, row = camera.principal_point
        return np.array(rows), np.array([0.5 - column, 0.5 - row]), 0.0 if camera.is_orthographic else pixel

    def _fetch(self, bricks: NDArray[np.int32], pool: ThreadPoolExecutor) -> None:
        """Read bricks (flat indices), as many as there is room for; the others stay unknown and are asked for again."""
        bricks = bricks[: len(self._owner)]
        lacking = len(bricks) - len(self._free)
        if lacking > 0:
            held = np.flatnonzero(self._owner >= 0)
            oldest = held[np.argpartition(self._stamps[held], lacking - 1)[:lacking]]
            self._slots.ravel()[self._owner[oldest]] = UNKNOWN
            self._owner[oldest] = -1
            self._free += oldest.tolist()
        slots = [self._free.pop() for _ in bricks]
        for brick, slot, shown in zip(bricks.tolist(), slots, list(pool.map(self._read, bricks.tolist(), slots))):
            self._slots.ravel()[brick] = slot if shown else EMPTY
            if shown:
                self._owner[slot], self._stamps[slot] = brick, self._now
            else:
                self._free.append(slot)
        self.reads += len(bricks)

    def _read(self, brick: int, slot: int) -> bool:
        """Read a brick into a slot; returns whether anything in it is visible."""
        index = np.array(np.unravel_index(brick, self._slots.shape)) * BRICK
        start = np.maximum(index - 1, 0)
        stop = np.minimum(index + BRICK + 2, self.level.shape)
        values = self.source.read(self.number, _box(start), _box(stop))
        if values.dtype.kind == "f":  # a file with levels of its own was not read before
            check_finite(values, self.source.name)
        box = self._numbers.converted(values)
        first = index - start
        if not filling.find_visible(box, first, self._ranges, self._seen[slot]):
            return False
        filling.fill(box, first, self._inverse.T.copy(), self._values[slot], self._codes[slot])
        if self.look.blank is not None:
            voxels = [np.minimum(i + np.arange(filling.SIDE), n - 1) for i, n in zip(index, self.level.shape)]
            self._codes[slot][self.look.blank[np.ix_(*voxels)].ravel()] |= np.uint16(filling.BLANK)
        return True


def _box(index: NDArray[np.int64]) -> Box:
    return int(index[0]), int(index[1]), int(index[2])
