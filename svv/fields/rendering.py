"""Rays, their samples, and compositing: what training and rendering share.

Letters: R rays, S samples (of all rays, one after another), C channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.box import Box
from svv.core.cameras import Camera
from svv.fields.encodings import SparseLattice
from svv.fields.occupancy import Occupancy
from svv.kernels import marching
from svv.kernels.rays import pixel_rays

Floats = NDArray[np.float32]

CEILING = np.float32(9.0)
"""Largest exponent of the extinction (a clipped exponential): e^9 in 1 / box unit is opaque within any step."""


@dataclass(frozen=True)
class Rays:
    """Origins in box coordinates and unit directions, float32. (R, 3) each"""

    origins: Floats
    directions: Floats

    def __len__(self) -> int:
        return len(self.origins)


class RayCaster:
    """Makes the rays of a list of cameras that share one image size."""

    def __init__(self, cameras: Sequence[Camera], box: Box) -> None:
        self.width, self.height = cameras[0].width, cameras[0].height
        matrices = np.stack([c.camera_to_world for c in cameras])
        self._rotations = np.ascontiguousarray(matrices[:, :3, :3], np.float32)
        self._positions = box.to_box(matrices[:, :3, 3]).astype(np.float32)
        self._focal = np.array([c.focal for c in cameras], np.float32)

    def rays(self, pixels: NDArray[np.int64]) -> Rays:
        """Rays through flat pixel indices ``(view * height + row) * width + column``."""
        origins, directions = np.empty((len(pixels), 3), np.float32), np.empty((len(pixels), 3), np.float32)
        size = self.width, self.height
        pixel_rays(pixels, self._rotations, self._positions, self._focal, *size, origins, directions)
        return Rays(origins, directions)

    def view(self, view: int) -> Rays:
        """All rays of one view, row by row from the top."""
        n = self.width * self.height
        return self.rays(np.arange(view * n, (view + 1) * n))


@dataclass(frozen=True)
class Samples:
    """Samples of rays that matter, in the order of their rays, front to back.

    ``position`` (S, 3) box coordinates; ``sigma`` (S,) extinction in 1 / box unit; ``skipped`` (S,) optical depth
    that was left out before each; ``ray`` (S,) int32; ``start`` and ``count`` (R,) where each ray's samples lie;
    ``tail`` (R,) optical depth left out behind the last; ``step`` the sample distance in box units.
    """

    position: Tensor
    sigma: Tensor
    skipped: Floats
    ray: Tensor
    start: NDArray[np.int64]
    count: NDArray[np.int64]
    tail: Floats
    step: float

    def __len__(self) -> int:
        return len(self.sigma)


@dataclass(frozen=True)
class Marching:
    """How rays are sampled."""

    step: float
    """Sample distance in box units."""
    least_weight: float = 1e-3
    """Samples that would weigh less in the pixel are left out of colour evaluation."""
    keep: float = 0.0
    """Share of the samples below ``least_weight`` that is kept all the same (so that they can learn)."""
    stop: float = 7.0
    """Optical depth at which a ray ends: exp(-7) is below what 8 bits can show."""
    merge: bool = False
    """Whether samples that weigh less are joined to the next (for images) instead of being left out (for training)."""


def march(
    rays: Rays, occupancy: Occupancy, density: SparseLattice | None, how: Marching, seed: int = 0
) -> Samples:
    """Sample rays in occupied cells, leaving out what cannot be seen.

    Args:
        rays: R rays.
        occupancy: Where to sample.
        density: Lattice of one feature a level whose sum's exponential is the extinction; without it every sample
            is kept and ``sigma`` is 1.
        how: Sample distance and thresholds.
        seed: > 0 shifts each ray's samples at random; 0 puts them in the middle of their steps.
    """
    count, blocks = len(rays), -(-len(rays) // marching.BLOCK)
    start, number = np.empty(count, np.int64), np.empty(count, np.int64)
    tail = np.empty(count, np.float32)
    lattice = density if density is not None else _constant(occupancy)
    limits = (how.least_weight, how.keep, how.stop) if density is not None else (-1.0, 0.0, marching.NO_STOP)
    while True:
        # Room for the longest possible ray would be hundreds of times what is needed, so it is found by trying.
        buffers = _sample_buffers(blocks * marching.BLOCK * occupancy.samples_a_ray)
        full = np.zeros(blocks, np.uint8)
        marching.march(
            rays.origins, rays.directions, occupancy.distance, np.float32(occupancy.cells), occupancy.extent,
            np.float32(how.step), seed, *lattice.layout, lattice.table.detach().numpy()[:, 0], CEILING,
            *(np.float32(v) for v in limits), how.merge, *buffers, start, number, tail, full,
        )  # fmt: skip
        if not full.any():
            break
        occupancy.samples_a_ray *= 2
    packed = _sample_buffers(int(number.sum()))
    marching.gather(start, number, np.cumsum(number) - number, *buffers, *packed)
    position, skipped, sigma, ray = packed
    return Samples(
        torch.from_numpy(position), torch.from_numpy(sigma), skipped, torch.from_numpy(ray), start, number, tail,
        how.step,
    )  # fmt: skip


def composite(samples: Samples, sigma: Tensor, values: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Composite values along rays, differentiable in ``sigma`` (S,) and ``values`` (S, C).

    Returns:
        Sum of weight times value (R, C), transmittance behind the ray (R,), and the weights (S,), which carry no
        gradient.
    """
    return _Composite.apply(sigma, values, samples)  # type: ignore[no-any-return]


class _Composite(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, sigma: Tensor, values: Tensor, samples: Samples) -> tuple[Tensor, Tensor, Tensor]:
        rays, channels = len(samples.start), values.shape[1]
        s, v = sigma.detach().numpy(), values.detach().contiguous().numpy()
        out, transmittance = np.empty((rays, channels), np.float32), np.empty(rays, np.float32)
        weights = np.empty(len(s), np.float32)
        step = np.float32(samples.step)
        marching.composite(s, samples.skipped, v, samples.start, samples.count, samples.tail, step, out, transmittance,
                           weights)  # fmt: skip
        ctx.saved = (s, v, weights, out, transmittance, samples)
        result = torch.from_numpy(out), torch.from_numpy(transmittance), torch.from_numpy(weights)
        ctx.mark_non_differentiable(result[2])
        return result

    @staticmethod
    def backward(ctx: Any, g_out: Tensor, g_transmittance: Tensor, _: Tensor) -> tuple[Any, Any, None]:  # type: ignore[override]
        s, v, weights, out, transmittance, samples = ctx.saved
        g_sigma, g_values = np.empty_like(s), np.empty_like(v)
        marching.composite_backward(
            s, samples.skipped, v, weights, samples.start, samples.count, np.float32(samples.step), out,
            transmittance, g_out.contiguous().numpy(), g_transmittance.contiguous().numpy(), g_sigma, g_values,
        )  # fmt: skip
        return torch.from_numpy(g_sigma), torch.from_numpy(g_values), None


class Extinction(torch.autograd.Function):
    """The extinction of samples as a function of the density lattice; the marcher computed its value already."""

    @staticmethod
    def forward(ctx: Any, samples: Samples, table: Tensor, density: SparseLattice) -> Tensor:
        ctx.samples, ctx.density = samples, density
        return samples.sigma.clone()

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[None, None, None]:  # type: ignore[override]
        samples, density = ctx.samples, ctx.density
        raw = (gradient * samples.sigma)[:, None].expand(-1, density.levels)
        density.add_gradient(samples.position, raw)
        return None, None, None


def _sample_buffers(capacity: int) -> tuple[Floats, Floats, Floats, NDArray[np.int32]]:
    """Position, skipped, sigma and ray of ``capacity`` samples (the system hands out only what is written)."""
    return (
        np.empty((capacity, 3), np.float32),
        np.empty(capacity, np.float32),
        np.empty(capacity, np.float32),
        np.empty(capacity, np.int32),
    )


def _constant(occupancy: Occupancy) -> SparseLattice:
    """A lattice that is zero everywhere: extinction 1."""
    return SparseLattice(np.ones_like(occupancy.occupied[:1, :1, :1]), 1, (1,), 1)
