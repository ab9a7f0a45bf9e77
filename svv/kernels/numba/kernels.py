"""The kernels on the CPU: numba, working in the tensors' memory. See :class:`svv.kernels.types.Kernels`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import torch
from numba import get_num_threads
from numpy.typing import NDArray
from torch import Tensor

from svv.kernels.numba import beams as numba_beams
from svv.kernels.numba import bricks as numba_bricks
from svv.kernels.numba import hashing as numba_hashing
from svv.kernels.numba import image as numba_image
from svv.kernels.numba import image_packets, operations, packets
from svv.kernels.numba import lattice as numba_lattice
from svv.kernels.numba import leaping as numba_leaping
from svv.kernels.numba import learning as numba_learning
from svv.kernels.numba import marching as numba_marching
from svv.kernels.numba import rays as numba_rays
from svv.kernels.numba import regions as numba_regions
from svv.kernels.numba import vertices as numba_vertices
from svv.kernels.numba.operations import directions_of_samples as directions_of_samples
from svv.kernels.numba.operations import lattice_backward as lattice_backward
from svv.kernels.numba.operations import lattice_encode as lattice_encode
from svv.kernels.numba.operations import network as network
from svv.kernels.numba.operations import representatives as representatives
from svv.kernels.reference import draw_pixels as draw_pixels
from svv.kernels.types import (
    ImageKernels,
    Lattice,
    Left,
    Limits,
    RegionKernels,
    Samples,
    StrokeKernels,
    TomographyKernels,
    TrainingKernels,
    VertexKernels,
)

NAME = "numba"
RAYS = 1 << 15
"""Rays of an image at a time: so many that what each piece takes before its first sample does not count (1 << 13 took
1.1 to 1.2 times as long), and few enough that features stay in the CPU's caches (1 << 16: 1.0 to 1.1 times)."""
SAMPLES = 1 << 14
"""Samples at a time: few enough that activations stay in the CPU cache."""
IMAGE: ImageKernels | None = numba_image
STROKES: StrokeKernels | None = None
VERTICES: VertexKernels | None = numba_vertices
TOMOGRAPHY: TomographyKernels | None = None
REGIONS: RegionKernels = numba_regions
TRAINING: TrainingKernels | None = numba_learning

NO_PIECES = np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32)
"""Stands for rays that are whole."""


def hash_encode(x: Tensor, resolutions: Tensor, offsets: Tensor, table: Tensor) -> Tensor:
    out = torch.empty(len(x), len(resolutions) * table.shape[1])
    numba_hashing.encode(x.numpy(), resolutions.numpy(), offsets.numpy(), table.detach().numpy(), out.numpy())
    return out


def hash_backward(x: Tensor, g: Tensor, resolutions: Tensor, offsets: Tensor, gradient: Tensor, used: Tensor) -> None:
    numba_hashing.encode_backward(
        x.numpy(), g.numpy(), resolutions.numpy(), offsets.numpy(), gradient.numpy(), used.numpy()
    )


def adam(
    table: Tensor, gradient: Tensor, used: Tensor, moments: Tensor, age: Tensor, rate: float | Tensor,
    constants: tuple[float, float, float], pull: float | Tensor, finer: int,
) -> None:  # fmt: skip
    first, second = moments.numpy()
    numbers = (np.float32(v) for v in (float(rate), *constants, float(pull)))
    numba_lattice.adam(
        table.detach().numpy(), gradient.numpy(), used.numpy(), first, second, age.numpy(), *numbers,
        _bias_corrections(*constants[:2]), finer,
    )  # fmt: skip


def marked_rows(marks: Tensor) -> Tensor:
    rows = torch.empty(int(np.count_nonzero(marks.numpy())), dtype=torch.int64)
    numba_lattice.marked_rows(marks.numpy(), rows.numpy())
    return rows


def pixel_rays(
    pixels: Tensor, cameras: tuple[Tensor, Tensor, Tensor], width: int, height: int
) -> tuple[Tensor, Tensor]:
    origins, directions = torch.empty(len(pixels), 3), torch.empty(len(pixels), 3)
    arrays = (camera.numpy() for camera in cameras)
    numba_rays.pixel_rays(pixels.numpy(), *arrays, width, height, origins.numpy(), directions.numpy())
    return origins, directions


def pixels_in_sight(
    camera: tuple[Tensor, Tensor, Tensor], width: int, height: int, distance: Tensor, cells: int,
    extent: Sequence[float],
) -> Tensor:  # fmt: skip
    """Leave out whole tiles that miss all occupied cells, because marching their rays would take as long as others."""
    rotation, position, lens = (part.numpy().astype(np.float64) for part in camera)
    seen = np.zeros((-(-height // numba_beams.TILE_SIDE), -(-width // numba_beams.TILE_SIDE)), np.uint8)
    numba_beams.tiles_in_sight(
        rotation, position, lens, width, height, numba_beams.nearest_of(distance), float(cells),
        np.asarray(extent, np.float64), seen,
    )  # fmt: skip
    if seen.all():
        return torch.arange(width * height)
    return torch.from_numpy(numba_beams.pixels_of(seen, width, height))


def march(
    origins: Tensor, directions: Tensor, distance: Tensor, cells: int, extent: Sequence[float],
    where: Lattice, table: Tensor, ceiling: float, limits: Limits, seed: int | Tensor, room: int,
    first_ray: int = 0, left: Left | None = None,
) -> tuple[Samples, int]:  # fmt: skip
    """March blocks of rays, each into a separate part of the buffers, and pack the parts afterwards."""
    count = len(origins)
    rays_a_block = min(max(count // (4 * get_num_threads()), packets.LEAST_RAYS), packets.MOST_RAYS)
    blocks = -(-count // rays_a_block)
    start, number = np.empty(count, np.int64), np.empty(count, np.int64)
    tail = np.empty(count, np.float32)
    bricks = numba_bricks.bricks_for(where, table, limits)
    if bricks.slots.size > 0 and left is None and limits.keep == 0.0 and int(seed) == 0:
        rays = origins.numpy(), directions.numpy()
        box = np.asarray(extent, np.float32), np.float32(limits.step)
        return _march_image(rays, (distance, cells), box, where, bricks, ceiling, limits, room, rays_a_block)
    pieces, marked = NO_PIECES, left is not None and left.distance is not None
    if left is not None:  # compiled code takes numbers to be finite
        far = float(packets.FAR)
        pieces = left.begin.clamp(max=far).numpy(), left.end.clamp(max=far).numpy()
        distance = distance if left.distance is None else left.distance
    while True:
        # Room for the longest possible ray would be hundreds of times too much, so the size is found by trial.
        buffers = _sample_buffers(blocks * rays_a_block * room)
        full = np.zeros(blocks, np.uint8)
        packets.march(
            origins.numpy(), directions.numpy(), distance.numpy(), np.float32(cells), np.asarray(extent, np.float32),
            np.float32(limits.step), int(seed), first_ray, *operations.arrays_of(where), table.detach().numpy()[:, 0],
            *bricks, np.float32(ceiling),
            *(np.float32(v) for v in (limits.least_weight, limits.keep, limits.stop, limits.fade)), limits.merge,
            *pieces, marked, *buffers, start, number, tail, full, rays_a_block,
        )  # fmt: skip
        if not full.any():
            break
        room *= 2
    packed = _sample_buffers(int(number.sum()))
    numba_marching.gather(start, number, np.cumsum(number) - number, *buffers, *packed)
    position, skipped, sigma, ray = packed
    found = (torch.from_numpy(a) for a in (position, sigma, skipped, ray, start, number, tail))
    return Samples(*found, limits.step), room  # type: ignore[arg-type, call-arg]


def _march_image(
    rays: tuple[NDArray[np.float32], NDArray[np.float32]], grid: tuple[Tensor, int],
    box: tuple[NDArray[np.float32], np.float32], where: Lattice, bricks: numba_bricks.Bricks, ceiling: float,
    limits: Limits, room: int, rays_a_block: int,
) -> tuple[Samples, int]:  # fmt: skip
    """March whole rays through bricks, each block into a separate part of the buffers, and give every ray its samples.

    ``rays``: their origins and directions; ``grid``: distances, and cells per box unit; ``box``: extent and step.
    """
    count = len(rays[0])
    blocks = -(-count // rays_a_block)
    number, tail = np.empty(count, np.int64), np.empty(count, np.float32)
    while True:
        some = blocks * rays_a_block * room
        found = np.empty(some, np.int32), np.empty(some, np.int32), np.empty(some, np.float32)
        written, full = np.zeros(blocks, np.int64), np.zeros(blocks, np.uint8)
        image_packets.march_image(
            *rays, grid[0].numpy(), np.float32(grid[1]), *box, where.shapes.numpy(), where.scales.numpy(), *bricks,
            *(np.float32(v) for v in (ceiling, limits.least_weight, limits.stop, limits.fade)), *found, number, tail,
            written, full, rays_a_block,
        )  # fmt: skip
        if not full.any():
            break
        room *= 2
    start, total = np.cumsum(number) - number, int(number.sum())
    position, sigma, ray = np.empty((total, 3), np.float32), np.empty(total, np.float32), np.empty(total, np.int32)
    image_packets.sort_samples(*rays, *box, *found, written, start.copy(), position, sigma, ray)
    packed = position, sigma, np.zeros(total, np.float32), ray, start, number, tail
    return Samples(*(torch.from_numpy(a) for a in packed), limits.step), room  # type: ignore[arg-type, call-arg]


def composite(sigma: Tensor, values: Tensor, samples: Samples) -> tuple[Tensor, Tensor, Tensor]:
    rays, channels = len(samples.start), values.shape[1]
    out, transmittance, weights = torch.empty(rays, channels), torch.empty(rays), torch.empty(len(sigma))
    numba_marching.composite(
        sigma.numpy(), samples.skipped.numpy(), values.numpy(), samples.start.numpy(), samples.count.numpy(),
        samples.tail.numpy(), np.float32(samples.step), out.numpy(), transmittance.numpy(), weights.numpy(),
    )  # fmt: skip
    return out, transmittance, weights


def composite_backward(
    sigma: Tensor, values: Tensor, weights: Tensor, samples: Samples, out: Tensor, transmittance: Tensor,
    g_out: Tensor, g_transmittance: Tensor,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    g_sigma, g_values = torch.empty(len(sigma)), torch.empty(*values.shape)
    numba_marching.composite_backward(
        sigma.numpy(), samples.skipped.numpy(), values.numpy(), weights.numpy(), samples.start.numpy(),
        samples.count.numpy(), np.float32(samples.step), out.numpy(), transmittance.numpy(), g_out.numpy(),
        g_transmittance.numpy(), g_sigma.numpy(), g_values.numpy(),
    )  # fmt: skip
    return g_sigma, g_values


def leaps(occupied: Tensor) -> Tensor:
    out = torch.empty(8, *occupied.shape, dtype=torch.uint8)
    numba_leaping.leaps(occupied.numpy(), out.numpy())
    return out


@cache
def _bias_corrections(beta1: float, beta2: float) -> NDArray[np.float32]:
    return numba_lattice.bias_corrections(np.float32(beta1), np.float32(beta2))


def _sample_buffers(capacity: int) -> tuple[NDArray[np.generic], ...]:
    """Return buffers for position, skipped, sigma and ray of samples (only pages that are written take up memory)."""
    return (
        np.empty((capacity, 3), np.float32),
        np.empty(capacity, np.float32),
        np.empty(capacity, np.float32),
        np.empty(capacity, np.int32),
    )
