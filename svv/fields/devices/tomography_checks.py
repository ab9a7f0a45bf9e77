"""Checks of the kernels of the visual hull and the first extinction, as in :mod:`svv.fields.devices.kernel_checks`.

Letters: N views, R rays, V vertices.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
from torch import Tensor

from svv.core.rounding import KERNELS
from svv.fields.devices.kernel_checks import EXTENT, Check, random_lattice, rays_through
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.hull_kernels import visual_hull
from svv.kernels import reference
from svv.kernels.types import Kernels

STEP, SHIFT, STOP = 1 / 16, 0.3, 3.0
"""Sides of a step along rays in box units, place of its sample, and the optical depth at which rays end."""

Views = tuple[Tensor, Tensor, Tensor]
"""Rotations, positions and lenses."""


def views_around(seed: int, views: int, height: int, width: int) -> Views:
    """Return random cameras that look at the box from all around, in double precision: (N, 3, 3), (N, 3), (N, 4).

    One of them is within, and every third is without perspective.
    """
    rng = np.random.default_rng(seed)
    rotations = np.linalg.qr(rng.normal(size=(views, 3, 3)))[0]
    away = rng.uniform(1.5, 3.0, (views, 1)) * (np.arange(views) != 1)[:, None]
    positions = np.array(EXTENT) * rng.uniform(0.3, 0.7, (views, 3)) + away * rotations[:, 2]
    parallel = np.arange(views) % 3 == 2
    focal = np.where(parallel, 0.6, 1.0) * rng.uniform(0.7, 1.5, views) * width
    lenses = np.stack([focal, np.full(views, 0.5 * width), np.full(views, 0.4 * height), parallel], axis=1)
    return torch.from_numpy(rotations), torch.from_numpy(positions), torch.from_numpy(lenses)


def check_hull(kernels: Kernels, device: torch.device, seed: int, cells: int) -> None:
    """Compare the hull of random discs with that of the CPU: a cell within rounding of a pixel may differ."""
    assert kernels.TOMOGRAPHY is not None
    rng, (views, height, width) = np.random.default_rng(seed), (7, 40, 50)
    y, x = np.mgrid[:height, :width]
    middle = rng.uniform(0.3, 0.7, (views, 2, 1, 1)) * np.array([[[height]], [[width]]])
    masks = np.hypot(y - middle[:, 0], x - middle[:, 1]) < 0.45 * width
    masks[3] = rng.random((height, width)) < 0.2
    tables = np.pad(masks.cumsum(1).cumsum(2), [(0, 0), (1, 0), (1, 0)]).astype(np.int32)
    cameras, shape = views_around(seed, views, height, width), (cells, 3 * cells // 4, cells)
    reach, expected = float(np.sqrt(0.75) / cells), np.zeros(shape, np.uint8)
    visual_hull(tables, *(t.numpy() for t in cameras), float(cells), reach, expected)
    assert 0.0 < (expected > 0).mean() < 1.0 and expected.max() > 2
    rotations, positions, lenses = (t.to(device) for t in cameras)
    there = torch.from_numpy(tables).to(device)
    found = kernels.TOMOGRAPHY.visual_hull(there, (rotations, positions, lenses), float(cells), reach, shape).cpu()
    different = int((found != torch.from_numpy(expected)).sum())
    assert different <= expected.size // 10_000, f"{different} of {expected.size} cells of the hull differ"


def check_depths(kernels: Kernels, device: torch.device, seed: int, rays: int, cells: int = 8) -> None:
    """Compare optical depths of rays with sums over all their samples."""
    assert kernels.TOMOGRAPHY is not None
    lattice, occupied = random_lattice(seed, 1, (cells,), cells)
    origins, directions = rays_through(rays, seed)
    distance = reference.leaps(torch.from_numpy(occupied))
    expected, ends = _summed(lattice, torch.from_numpy(occupied), origins, directions)
    there, own = lattice.to(device), (origins.to(device), directions.to(device))
    found = kernels.TOMOGRAPHY.optical_depths(
        own, distance.to(device), cells, EXTENT, STEP, SHIFT, there.layout, there.table.detach(), STOP
    ).cpu()
    # A sample within rounding of a cell's side may be on the other one, as may be the sum at which a ray ends.
    apart = (found - expected).abs() > KERNELS["value"] * (1.0 + expected)
    assert int((apart & ~ends).sum()) <= max(1, rays // 50), "optical depths differ"
    assert bool((expected > 0.0).any()) and bool((found[ends] >= 0.5 * STOP).all()), "rays end too early"


def _summed(lattice: SparseLattice, occupied: Tensor, origins: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
    """Return the optical depth of each ray, to the sample at which it is above STOP, and whether it gets there. (R,)"""
    number = torch.arange(int(4.0 / STEP))
    points = origins[:, None] + ((number + SHIFT) * STEP)[:, None] * directions[:, None]
    end = torch.tensor(EXTENT)
    inside = ((points >= 0.0) & (points <= end)).all(dim=2)
    points = torch.minimum(points.clamp(min=0.0), end)
    cell = torch.minimum((points * len(occupied)).long(), torch.tensor(occupied.shape) - 1)
    inside &= occupied[tuple(cell.unbind(2))] > 0
    each = torch.zeros(inside.shape)
    exponent = reference.lattice_encode(points[inside], lattice.layout, lattice.table.detach())[:, 0]
    each[inside] = exponent.exp() * STEP
    before = each.cumsum(dim=1) - each
    return torch.where(before <= STOP, each, 0.0).sum(dim=1), each.sum(dim=1) > STOP


def check_back_projection(kernels: Kernels, device: torch.device, seed: int, vertices: int) -> None:
    """Compare sums over views at random vertices with bilinear interpolation."""
    assert kernels.TOMOGRAPHY is not None
    generator, (views, height, width), scale = torch.Generator().manual_seed(seed), (5, 24, 31), 64.0
    at = torch.randint(0, 65, (vertices, 3), generator=generator, dtype=torch.int32)
    images = torch.rand(views, height, width, 2, generator=generator)
    cameras = views_around(seed, views, height, width)
    to_world, lens_of_rays = cameras[0].mT.contiguous(), cameras[2] * torch.tensor([1.0, -1.0, -1.0, 1.0])
    rotations, positions, lenses = (t.float().to(device) for t in (to_world, cameras[1], lens_of_rays))
    there = (rotations, positions, lenses)
    found = kernels.TOMOGRAPHY.back_project(at.to(device), scale, there, images.to(device)).cpu()
    expected = torch.zeros(vertices, 2, dtype=torch.float64)
    for rotation, position, lens, image in zip(*cameras, images, strict=True):
        across, up, toward = ((at.double() / scale - position) @ rotation.T).unbind(1)
        ahead, zoom = -toward > 0.0, lens[0] / (1.0 if lens[3] > 0 else torch.where(toward < 0.0, -toward, 1.0))
        row, column = lens[2] - up * zoom, lens[1] + across * zoom
        place = torch.stack([2.0 * (column + 0.5) / width - 1.0, 2.0 * (row + 0.5) / height - 1.0], dim=1)[None, None]
        seen = torch.nn.functional.grid_sample(image.double().permute(2, 0, 1)[None], place, align_corners=False)
        expected += torch.where(ahead[:, None], seen[0, :, 0].T, 0.0)
    torch.testing.assert_close(found.double(), expected, atol=1e-3, rtol=1e-3)


def tomography_checks(samples: int) -> dict[str, Check]:
    """Return these checks by name, with about so many rays and vertices."""
    return {
        "visual hull": partial(check_hull, cells=32 if samples > 1 << 12 else 8),
        "optical depths": partial(check_depths, rays=min(samples, 1 << 12)),
        "back-projection": partial(check_back_projection, vertices=samples),
    }
