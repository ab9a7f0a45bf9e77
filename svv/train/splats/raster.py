"""Splats drawn on the CPU, with the gradients of what is drawn: buffers around :mod:`svv.train.splats.raster_kernels`.

Letters: N splats, K harmonics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.fields.splats.splats import Floats
from svv.train.splats import raster_kernels as kernels
from svv.train.splats.raster_kernels import DRAWN, SUMS, TILE

NOWHERE = np.uint64(0xFFFFFFFFFFFFFFFF)
"""Key of a splat that a camera does not see."""


@dataclass(frozen=True, eq=False)
class Gaussians:
    """Splats while they are fitted, or gradients by them, all float32.

    Centres (N, 3), standard deviations (N, 3), quaternions of any length (N, 4), opacities (N,), harmonics (N, K, 3).
    """

    centres: Floats
    scales: Floats
    rotations: Floats
    opacities: Floats
    harmonics: Floats

    def __len__(self) -> int:
        return len(self.centres)

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """The five arrays, in their order."""
        return self.centres, self.scales, self.rotations, self.opacities, self.harmonics


@dataclass(frozen=True, eq=False)
class Eye:
    """A pinhole camera whose axis goes through the middle of its picture, in the splats' coordinates."""

    axes: Floats
    """Right, down and forward. (3, 3)"""
    position: Floats
    """(3,)"""
    focal: float
    """Focal length in pixels."""
    width: int
    height: int

    @classmethod
    def of(cls, camera: Camera, origin: NDArray[np.float64], size: float) -> Eye:
        """Return a camera in coordinates that count from a world point ``origin`` (3,) in units of ``size``."""
        axes = (camera.camera_to_world[:3, :3] * (1.0, -1.0, -1.0)).T
        position = (camera.position - origin) / size
        return cls(
            np.ascontiguousarray(axes, np.float32), position.astype(np.float32), camera.focal, camera.width,
            camera.height,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Drawing:
    """A picture of splats, and what its gradients need."""

    splats: Gaussians
    eye: Eye
    padded: Floats
    """RGB times alpha, and alpha, with rows and columns up to whole tiles. (4, H, W)"""
    drawn: Floats
    firsts: NDArray[np.int64]
    """Where the sums of each splat start. (N + 1,)"""
    starts: NDArray[np.int64]
    order: NDArray[np.int32]
    pairs: NDArray[np.int64]

    @property
    def image(self) -> Floats:
        """The picture: RGB times alpha, and alpha. (4, height, width)"""
        return self.padded[:, : self.eye.height, : self.eye.width]

    def gradients(self, slope: Floats, error: Floats) -> tuple[Gaussians, Floats]:
        """Return the gradients of a loss by the splats, from its gradient by the picture (4, height, width).

        Also returns (N, 2): each splat's weight in the picture, and the weight times the ``error`` (height, width) of
        its pixels.
        """
        slopes, errors = np.zeros_like(self.padded), np.zeros(self.padded.shape[1:], np.float32)
        slopes[:, : self.eye.height, : self.eye.width] = slope
        errors[: self.eye.height, : self.eye.width] = error
        sums = np.empty((len(self.pairs), SUMS), np.float32)
        across = self.padded.shape[2] // TILE
        kernels.sum_tiles(
            self.drawn, across, self.starts, self.order, self.pairs, self.padded, slopes, errors, sums
        )  # fmt: skip
        s, eye = self.splats, self.eye
        found = Gaussians(*(np.empty_like(array) for array in s.arrays))
        seen = np.empty((len(s), 2), np.float32)
        kernels.unproject(
            s.centres, s.scales, s.rotations, s.harmonics, eye.axes, eye.position, np.float32(eye.focal), self.drawn,
            self.firsts, sums, *found.arrays, seen,
        )  # fmt: skip
        return found, seen


def draw(splats: Gaussians, eye: Eye) -> Drawing:
    """Draw splats from a camera."""
    count, across, down = len(splats), -(-eye.width // TILE), -(-eye.height // TILE)
    drawn, tiles = np.empty((count, DRAWN), np.float32), np.empty((count, 4), np.int32)
    keys = np.empty(count, np.uint64)
    kernels.project(
        *splats.arrays, eye.axes, eye.position, np.float32(eye.focal), eye.width, eye.height, drawn, tiles, keys
    )
    keys.sort()
    order = (keys[: np.searchsorted(keys, NOWHERE)] & np.uint64(0xFFFFFFFF)).astype(np.int32)
    firsts = np.zeros(count + 1, np.int64)
    np.cumsum((tiles[:, 2] - tiles[:, 0]) * (tiles[:, 3] - tiles[:, 1]), out=firsts[1:])
    starts = np.zeros(across * down + 1, np.int64)
    of_tiles, pairs = np.empty(firsts[-1], np.int32), np.empty(firsts[-1], np.int64)
    kernels.fill_tiles(order, tiles, across, firsts, starts, of_tiles, pairs)
    padded = np.empty((4, down * TILE, across * TILE), np.float32)
    kernels.draw_tiles(drawn, across, starts, of_tiles, padded)
    return Drawing(splats, eye, padded, drawn, firsts, starts, of_tiles, pairs)
