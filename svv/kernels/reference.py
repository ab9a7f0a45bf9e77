"""The reference: the kernels in plain torch, on any device. See :class:`svv.kernels.types.Kernels`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from svv.core.rays import cells, marching
from svv.core.rays.compositing import composite_samples
from svv.core.rays.encodings import directions_of_samples as directions_of_samples
from svv.core.rays.encodings import hash_corners, hash_features, lattice_corners, lattice_features
from svv.core.rays.networks import relu_layers
from svv.core.rays.representatives import representatives as chosen
from svv.kernels import reference_regions
from svv.kernels.types import (
    UNSURE,
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

NAME = "reference"
RAYS = 1 << 16
SAMPLES = 1 << 16
IMAGE: ImageKernels | None = None
STROKES: StrokeKernels | None = None
VERTICES: VertexKernels | None = None
TOMOGRAPHY: TomographyKernels | None = None
REGIONS: RegionKernels = reference_regions
TRAINING: TrainingKernels | None = None

STEPS_AT_A_TIME = 1 << 22
"""Number of ray steps evaluated together."""


def lattice_encode(x: Tensor, where: Lattice, table: Tensor) -> Tensor:
    return lattice_features(x, where.shapes, where.scales, where.bases, where.index, table.detach())


def lattice_backward(x: Tensor, g: Tensor, where: Lattice, gradient: Tensor, used: Tensor) -> None:
    parts = g.split(gradient.shape[1], dim=1)
    for shape, scale, base, part in zip(where.shapes, where.scales, where.bases[:-1], parts, strict=True):
        rows, weights = lattice_corners(x, shape, scale, base, where.index)
        _scatter(rows.clamp(max=len(gradient) - 1), weights, part, gradient, used)


def hash_encode(x: Tensor, resolutions: Tensor, offsets: Tensor, table: Tensor) -> Tensor:
    return hash_features(x, resolutions, offsets, table.detach())


def hash_backward(x: Tensor, g: Tensor, resolutions: Tensor, offsets: Tensor, gradient: Tensor, used: Tensor) -> None:
    parts, ends = g.split(gradient.shape[1], dim=1), offsets.tolist()
    for resolution, first, end, part in zip(resolutions.tolist(), ends, ends[1:], parts):
        _scatter(*hash_corners(x, resolution, first, end - first), part, gradient, used)


def _scatter(rows: Tensor, weights: Tensor, g: Tensor, gradient: Tensor, used: Tensor) -> None:
    """Add weighted gradients (S, F) to the rows (S, 8) that they come from."""
    gradient.index_add_(0, rows.flatten(), (weights[:, :, None] * g[:, None, :]).flatten(0, 1))
    used[rows.flatten()] = 1


def adam(
    table: Tensor, gradient: Tensor, used: Tensor, moments: Tensor, age: Tensor, rate: float | Tensor,
    constants: tuple[float, float, float], pull: float | Tensor, finer: int,
) -> None:  # fmt: skip
    beta1, beta2, epsilon = constants
    rows = used.nonzero()[:, 0]
    age[rows] += 1
    n = age[rows].clamp(max=10000).float()[:, None]
    g = gradient[rows] + pull * (rows >= finer)[:, None] * table[rows]
    first, second = moments[0, rows].lerp(g, 1.0 - beta1), moments[1, rows].lerp(g * g, 1.0 - beta2)
    moments[0, rows], moments[1, rows] = first, second
    right = second / (1.0 - torch.exp(n * math.log(beta2)))
    table[rows] -= rate / (1.0 - torch.exp(n * math.log(beta1))) * first / (right.sqrt() + epsilon)
    gradient[rows] = 0.0
    used[rows] = 0


def marked_rows(marks: Tensor) -> Tensor:
    return marks.nonzero()[:, 0]


def draw_pixels(
    source: PixelSource, seed: int | Tensor, first_ray: int, rays: int, total: int
) -> tuple[Tensor, Tensor, Tensor]:
    number = torch.arange(first_ray, first_ray + rays, device=source.index.device)
    fine, coarse = (marching.uniform(int(seed), number, torch.full_like(number, k)).double() for k in (-2, -1))
    where = (coarse + fine / (1 << 24)) * source.ends[-1]
    step = torch.searchsorted(source.ends[1:-1], where, right=True)
    begin, last, share = source.first[step], source.first[step + 1] - 1, source.shares[step]
    place = begin + ((where - source.ends[step]) / share).long()
    pixels = source.index[torch.minimum(place, last)].long()
    shown = source.levels[pixels].float() / 255.0
    shown[:, :3] *= shown[:, 3:]
    return pixels, (1.0 / (share * total)).float(), shown


def pixel_rays(
    pixels: Tensor, cameras: tuple[Tensor, Tensor, Tensor], width: int, height: int
) -> tuple[Tensor, Tensor]:
    rotations, positions, lenses = cameras
    view, rest = pixels // (width * height), pixels % (width * height)
    focal, across, down, parallel = lenses[view].unbind(1)
    u = ((rest % width).float() + across) / focal
    v = -((rest // width).float() + down) / focal
    shift = torch.stack([u, v, torch.zeros_like(u)], dim=1)
    local = torch.stack([u, v, -torch.ones_like(u)], dim=1)
    local = local / (u * u + v * v + 1.0).sqrt()[:, None]
    local = torch.where(parallel[:, None] > 0, local.new_tensor([0.0, 0.0, -1.0]), local)
    origins = positions[view] + (rotations[view] * (shift * parallel[:, None])[:, None]).sum(dim=2)
    return origins, (rotations[view] * local[:, None]).sum(dim=2)


def pixels_in_sight(
    camera: tuple[Tensor, Tensor, Tensor], width: int, height: int, distance: Tensor, cells: int,
    extent: Sequence[float],
) -> Tensor:  # fmt: skip
    return torch.arange(width * height, device=distance.device)


def march(
    origins: Tensor, directions: Tensor, distance: Tensor, cells: int, extent: Sequence[float],
    where: Lattice, table: Tensor, ceiling: float, limits: Limits, seed: int | Tensor, room: int,
    first_ray: int = 0, left: Left | None = None,
) -> tuple[Samples, int]:  # fmt: skip
    """March without leaps: every step of every ray is evaluated."""
    occupied, shown = distance[0] == 0, None
    if left is not None and left.distance is not None:
        shown = left.distance[0] == 0
        occupied = shown | (left.distance[0] == UNSURE)

    def extinction(x: Tensor) -> Tensor:
        return torch.exp(lattice_encode(x, where, table).sum(dim=1).clamp(max=ceiling))

    steps = math.ceil(math.sqrt(sum(e * e for e in extent)) / limits.step) + 1
    chunk = max(1, STEPS_AT_A_TIME // (steps * (1 if left is None else max(1, left.begin.shape[1]))))
    pieces = [None if left is None else (left.begin[k : k + chunk], left.end[k : k + chunk])
              for k in range(0, len(origins), chunk)]  # fmt: skip
    parts = [
        marching.march(
            origins[k : k + chunk], directions[k : k + chunk], occupied, cells, extent, limits.step, extinction,
            limits.least_weight, limits.keep, limits.stop, limits.fade, limits.merge, int(seed), k, first_ray,
            piece, shown,
        )
        for k, piece in zip(range(0, len(origins), chunk), pieces, strict=True)
    ]  # fmt: skip
    position, sigma, skipped, ray, count, tail = (torch.cat(part) for part in zip(*parts, strict=True))
    return Samples(position, sigma, skipped, ray, count.cumsum(0) - count, count, tail, limits.step), room


def representatives(samples: Samples, every: float, shift: Tensor) -> tuple[Tensor, Tensor]:
    own = samples.sigma * samples.step
    return chosen(own, samples.skipped, samples.ray, samples.start, samples.count, every, shift)


def composite(sigma: Tensor, values: Tensor, samples: Samples) -> tuple[Tensor, Tensor, Tensor]:
    return composite_samples(sigma, values, samples.skipped, samples.start, samples.count, samples.tail, samples.step)


def composite_backward(
    sigma: Tensor, values: Tensor, weights: Tensor, samples: Samples, out: Tensor, transmittance: Tensor,
    g_out: Tensor, g_transmittance: Tensor,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    with torch.enable_grad():
        twins = sigma.detach().requires_grad_(), values.detach().requires_grad_()
        again = composite(*twins, samples)[:2]
        g_sigma, g_values = torch.autograd.grad(again, twins, (g_out, g_transmittance))
    return g_sigma, g_values


def leaps(occupied: Tensor) -> Tensor:
    return cells.leaps(occupied.cpu()).to(occupied.device)


def network(x: Tensor, weights: Sequence[Tensor], rough: bool) -> Tensor:
    return relu_layers(x, weights)


def loss(
    out: Tensor, transmittance: Tensor, shown: Tensor, weight: Tensor, each: Tensor, alpha: bool
) -> tuple[Tensor, Tensor]:
    """Return a loss and the mean squared error of colour; see :class:`svv.kernels.types.TrainingKernels`."""
    last = (1.0 - transmittance - shown[:, 3]).square()[:, None] if alpha else out[:, 3:]
    missing = torch.cat([(out[:, :3] - shown[:, :3]).square(), last], dim=1)
    errors = (weight[:, None] * missing).sum(dim=0)
    return (errors * each).sum(), errors[:3].detach().mean()
