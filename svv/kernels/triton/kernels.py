"""The kernels on the GPU: Triton. See :class:`svv.kernels.types.Kernels`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import torch
import triton
from torch import Tensor

from svv.core.rays.cells import FARTHEST_LEAP
from svv.core.rays.networks import relu_layers
from svv.kernels.constants import number_on
from svv.kernels.reference import marked_rows as marked_rows
from svv.kernels.triton import cells as triton_cells
from svv.kernels.triton import drawn as triton_drawn
from svv.kernels.triton import learning as triton_learning
from svv.kernels.triton import networks as triton_networks
from svv.kernels.triton import painted as triton_painted
from svv.kernels.triton import pixels as triton_pixels
from svv.kernels.triton import rays as triton_rays
from svv.kernels.triton import regions as triton_regions
from svv.kernels.triton import tables as triton_tables
from svv.kernels.triton import tomography as triton_tomography
from svv.kernels.types import (
    ImageKernels,
    Lattice,
    Left,
    Limits,
    PixelSource,
    RegionKernels,
    Samples,
    StrokeKernels,
    TomographyKernels,
    TrainingKernels,
    VertexKernels,
)

NAME = "triton"


def rays_at_a_time() -> int:
    """Return the number of rays of an image that are rendered together: a whole view of 1,000 x 1,000 pixels.

    Launching kernels takes longer than running them, but the features of the samples take a kilobyte a ray, so a GPU of
    little memory gets a quarter.
    """
    roomy = torch.cuda.is_available() and torch.cuda.get_device_properties(0).total_memory >= ROOMY
    return 1 << 20 if roomy else 1 << 18


ROOMY = 6 << 30
"""Bytes of GPU memory from which images are rendered in large parts."""
RAYS = rays_at_a_time()
SAMPLES = 1 << 18
"""Samples at a time: enough to fill the GPU."""
IMAGE: ImageKernels | None = triton_drawn
STROKES: StrokeKernels | None = triton_painted
VERTICES: VertexKernels | None = None
TOMOGRAPHY: TomographyKernels | None = triton_tomography
REGIONS: RegionKernels = triton_regions
TRAINING: TrainingKernels | None = triton_learning

TABLE_BLOCK = 128
"""Samples per program that reads or writes tables."""
RAY_BLOCK = 32
"""Rays per program: one warp, which finishes with its longest ray."""


def try_to_compile() -> None:
    """Compile and run the smallest kernel.

    Triton needs a C compiler, Python's headers and a folder that it may write to, and says so only at the first launch,
    in an exception of any kind.
    """
    if torch.cuda.is_available():  # otherwise Triton's interpreter runs the kernels, which compiles nothing
        directions = torch.ones(1, 3, device="cuda")
        directions_of_samples(directions, torch.zeros(1, dtype=torch.int32, device="cuda"))


def lattice_encode(x: Tensor, where: Lattice, table: Tensor) -> Tensor:
    levels, features = len(where.scales), table.shape[1]
    out = torch.empty(len(x), levels * features, device=x.device)
    if len(x):
        triton_tables.lattice_encode[triton.cdiv(len(x), TABLE_BLOCK), levels](
            x.contiguous(), where.shapes, where.scales, where.bases, where.index, table.detach(), out, len(x),
            levels, features, triton.next_power_of_2(features), TABLE_BLOCK,
        )  # fmt: skip
    return out


def lattice_backward(x: Tensor, g: Tensor, where: Lattice, gradient: Tensor, used: Tensor) -> None:
    levels, features = len(where.scales), gradient.shape[1]
    if len(x):
        triton_tables.lattice_backward[triton.cdiv(len(x), TABLE_BLOCK), levels](
            x.contiguous(), x, g, where.shapes, where.scales, where.bases, where.index, gradient, used, len(x), levels,
            levels * features, features, triton.next_power_of_2(features), False, False, TABLE_BLOCK,
        )  # fmt: skip


def hash_encode(x: Tensor, resolutions: Tensor, offsets: Tensor, table: Tensor) -> Tensor:
    levels, features = len(resolutions), table.shape[1]
    out = torch.empty(len(x), levels * features, device=x.device)
    if len(x):
        triton_tables.hash_encode[triton.cdiv(len(x), TABLE_BLOCK), levels](
            x.contiguous(), resolutions, offsets, table.detach(), out, len(x),
            levels, features, triton.next_power_of_2(features), TABLE_BLOCK,
        )  # fmt: skip
    return out


def hash_backward(x: Tensor, g: Tensor, resolutions: Tensor, offsets: Tensor, gradient: Tensor, used: Tensor) -> None:
    levels, features = len(resolutions), gradient.shape[1]
    if len(x):
        triton_tables.hash_backward[triton.cdiv(len(x), TABLE_BLOCK), levels](
            x.contiguous(), g, resolutions, offsets, gradient, used, len(x),
            levels, features, triton.next_power_of_2(features), TABLE_BLOCK,
        )  # fmt: skip


def adam(
    table: Tensor, gradient: Tensor, used: Tensor, moments: Tensor, age: Tensor, rate: float | Tensor,
    constants: tuple[float, float, float], pull: float | Tensor, finer: int,
) -> None:  # fmt: skip
    (rows, features), device = table.shape, table.device
    triton_tables.adam[(triton.cdiv(rows, TABLE_BLOCK),)](
        table.detach(), gradient, used, moments[0], moments[1], age, number_on(rate, device), *constants,
        number_on(pull, device), finer, rows, features, triton.next_power_of_2(features), TABLE_BLOCK,
    )  # fmt: skip


def draw_pixels(
    source: PixelSource, seed: int | Tensor, first_ray: int, rays: int, total: int
) -> tuple[Tensor, Tensor, Tensor]:
    device = source.index.device
    pixels, weight = torch.empty(rays, dtype=torch.int64, device=device), torch.empty(rays, device=device)
    shown = torch.empty(rays, 4, device=device)
    if rays:
        triton_pixels.draw[(triton.cdiv(rays, TABLE_BLOCK),)](
            source.index, source.levels, source.first, source.ends, source.shares, number_on(seed, device), first_ray,
            total, pixels, weight, shown, rays, len(source.shares), TABLE_BLOCK,
        )  # fmt: skip
    return pixels, weight, shown


def pixel_rays(
    pixels: Tensor, cameras: tuple[Tensor, Tensor, Tensor], width: int, height: int
) -> tuple[Tensor, Tensor]:
    origins, directions = (torch.empty(len(pixels), 3, device=pixels.device) for _ in range(2))
    if len(pixels):
        triton_rays.pixel_rays[(triton.cdiv(len(pixels), TABLE_BLOCK),)](
            pixels, *cameras, width, height, origins, directions, len(pixels), TABLE_BLOCK
        )
    return origins, directions


def pixels_in_sight(
    camera: tuple[Tensor, Tensor, Tensor], width: int, height: int, distance: Tensor, cells: int,
    extent: Sequence[float],
) -> Tensor:  # fmt: skip
    """Return all pixels, because a GPU marches them at once."""
    return _all_of(width * height, distance.device)


@lru_cache(1)
def _all_of(pixels: int, device: torch.device) -> Tensor:
    return torch.arange(pixels, device=device)


def march(
    origins: Tensor, directions: Tensor, distance: Tensor, cells: int, extent: Sequence[float],
    where: Lattice, table: Tensor, ceiling: float, limits: Limits, seed: int | Tensor, room: int,
    first_ray: int = 0, left: Left | None = None,
) -> tuple[Samples, int]:  # fmt: skip
    """March twice: count the samples, find the start of each ray from their sums, and write them."""
    device, rays, given = origins.device, len(origins), limits.room
    own_seed = number_on(seed, device)
    make = torch.empty if rays else torch.zeros
    count, start, total = (make(n, dtype=torch.int64, device=device) for n in (rays, rays, 1))
    tail = torch.empty(rays, device=device)
    pieces = 0 if left is None else left.begin.shape[1]
    begin, finish = (tail, tail) if left is None or not pieces else (left.begin.contiguous(), left.end.contiguous())
    marked = left is not None and left.distance is not None
    if left is not None and left.distance is not None:
        distance = left.distance

    def pass_over(behind: Tensor, number: int, written: Sequence[Tensor], writes: bool) -> None:
        triton_rays.march[(triton.cdiv(rays, RAY_BLOCK),)](
            origins, directions, distance, *distance.shape[1:], float(cells), *extent, limits.step, own_seed, first_ray,
            where.shapes, where.scales, where.bases, where.index, table.detach(), ceiling,
            limits.least_weight, limits.keep, limits.stop, limits.fade, rays,
            behind, number, start, count, tail, total, total if given is None else given.dropped, *written,
            float(limits.merge), begin, finish, pieces, len(where.scales), writes, marked, pieces > 0, RAY_BLOCK,
            num_warps=1,
        )  # fmt: skip

    def samples_for(number: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        position, skipped, sigma = (torch.empty(shape, device=device) for shape in ((number, 3), number, number))
        return position, skipped, sigma, torch.empty(number, dtype=torch.int32, device=device)

    written = samples_for(0)
    if rays:
        pass_over(count, 0, written, writes=False)
        behind = count.cumsum(0)
        number = int(behind[-1]) if given is None else given.samples
        written = samples_for(number)
        if number:
            pass_over(behind, number, written, writes=True)
        else:
            start.zero_()
    position, skipped, sigma, ray = written
    return Samples(position, sigma, skipped, ray, start, count, tail, limits.step, total), room


def representatives(samples: Samples, every: float, shift: Tensor) -> tuple[Tensor, Tensor]:
    return triton_learning.representatives(samples, every, shift, counted=True)[:2]


def composite(sigma: Tensor, values: Tensor, samples: Samples) -> tuple[Tensor, Tensor, Tensor]:
    rays, channels, device = len(samples.start), values.shape[1], sigma.device
    out, transmittance = torch.empty(rays, channels, device=device), torch.empty(rays, device=device)
    weights = torch.empty(len(sigma), device=device)
    if rays:
        triton_rays.composite[(triton.cdiv(rays, RAY_BLOCK),)](
            sigma, samples.skipped, values, samples.start, samples.count, samples.tail, samples.step, out,
            transmittance, weights, rays, channels, triton.next_power_of_2(channels), RAY_BLOCK, num_warps=1,
        )  # fmt: skip
    return out, transmittance, weights


def composite_backward(
    sigma: Tensor, values: Tensor, weights: Tensor, samples: Samples, out: Tensor, transmittance: Tensor,
    g_out: Tensor, g_transmittance: Tensor,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    rays, channels = len(samples.start), values.shape[1]
    g_sigma, g_values = torch.empty_like(sigma), torch.empty_like(values)
    if rays:
        triton_rays.composite_backward[(triton.cdiv(rays, RAY_BLOCK),)](
            sigma, samples.skipped, values, weights, samples.start, samples.count, samples.step, out, transmittance,
            g_out, g_transmittance, g_sigma, g_values, rays, channels, triton.next_power_of_2(channels), RAY_BLOCK,
            num_warps=1,
        )  # fmt: skip
    return g_sigma, g_values


def leaps(occupied: Tensor) -> Tensor:
    """Combine distances axis by axis."""
    known = torch.where(occupied > 0, 0, FARTHEST_LEAP).to(torch.uint8)[None]
    for axis, length in enumerate(occupied.shape):
        nearest = torch.empty(len(known), 2, *occupied.shape, dtype=torch.uint8, device=occupied.device)
        for one, both in zip(known, nearest, strict=True):
            for side, found in zip((1, -1), both, strict=True):
                triton_cells.nearest_along[(triton.cdiv(one.numel(), TABLE_BLOCK),)](
                    one, found, one.numel(), one.stride(axis), length, side, TABLE_BLOCK
                )
        known = nearest.flatten(0, 1)
    return known


def directions_of_samples(directions: Tensor, ray: Tensor) -> Tensor:
    out = torch.empty(len(ray), 16, device=ray.device)
    if len(ray):
        triton_rays.harmonics[(triton.cdiv(len(ray), TABLE_BLOCK),)](directions, ray, out, len(ray), TABLE_BLOCK)
    return out


def network(x: Tensor, weights: Sequence[Tensor], rough: bool) -> Tensor:
    return triton_networks.run(x, weights) if rough else relu_layers(x, weights)
