"""Checks of the kernels that find regions along rays, as in :mod:`svv.fields.devices.kernel_checks`.

Letters: S samples, R rays, V vertices, P regions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import torch
from torch import Tensor

from svv.core.rounding import KERNELS
from svv.fields.devices.kernel_checks import CPU, Check
from svv.kernels import reference
from svv.kernels.types import Kernels, RaySamples, RegionKernels, VertexSamples

SAME_NORMAL = 1e-3
"""Largest difference of products of two components of a unit vector that counts as rounding."""


class Inputs:
    """Random samples in the order of rays, and others in that of vertices, of as many rays as vertices, on a device."""

    def __init__(self, device: torch.device, seed: int, counts: Sequence[int], regions: int) -> None:
        generator, own, total = torch.Generator().manual_seed(seed), len(counts), sum(counts)

        def numbers(*shape: int) -> Tensor:
            return torch.rand(shape, generator=generator).to(device)

        def places(*shape: int) -> Tensor:
            return torch.randint(own, shape, generator=generator, dtype=torch.int32).to(device)

        first = torch.tensor([0, *counts]).cumsum(0).int().to(device)
        pixel = numbers(own, 3)
        along = torch.nn.functional.normalize(pixel, dim=1)
        self.rays = RaySamples(first, places(total), numbers(total), numbers(total), pixel, along)
        weight, neighbours = numbers(total), places(own, 6)
        lit = weight * numbers(total)
        self.vertices = VertexSamples(first, places(total), weight, lit, neighbours, numbers(own), 0.01)
        self.region = torch.randint(regions, (own,), generator=generator).to(device)
        self.light, self.error = numbers(regions, 6), numbers(own, 3) - 0.5
        columns = regions + regions % 2
        self.ahead, self.member = numbers(own, columns), torch.eye(columns, device=device)[self.region]
        self.step = 0.1 + 0.2 * numbers(own)
        self.grid = numbers(9, 12, 10)
        self.places = torch.cartesian_prod(*(torch.arange(side) for side in self.grid.shape)).to(device)


def _normal_equations(own: RegionKernels, at: Inputs) -> list[Tensor]:
    total = own.normal_equations(at.rays, at.region, len(at.light))
    return [total[:, : -len("RGB")].tril().float(), total[:, -len("RGB") :].float()]


def _descent(own: RegionKernels, at: Inputs) -> list[Tensor]:
    member, following, regions = at.member.clone(), torch.empty_like(at.member), len(at.light)
    own.descend(at.vertices, at.error, at.light, at.step, (0.3, 0.6), at.ahead, member, following)
    return [found[:, :regions] for found in (member, following)]


def _normals(own: RegionKernels, at: Inputs) -> list[Tensor]:
    normal = own.normals(at.grid, at.places, (1.0, 1.0))
    return [normal[:, :, None] * normal[:, None]]  # of either sign


PARTS: dict[str, Callable[[RegionKernels, Inputs], list[Tensor]]] = {
    "light": _normal_equations,
    "errors": lambda own, at: [own.errors(at.rays, kept, at.light, at.ahead) for kept in (1.0, 0.1)],
    "descent": _descent,
    "blurred": lambda own, at: [own.blurred(at.grid, 0.6)],
    "normals": _normals,
}
"""Each kernel."""


def check_regions(
    kernels: Kernels, device: torch.device, seed: int, part: str, counts: Sequence[int], regions: int
) -> None:
    """Compare one kernel; where a field changes alike in two directions, rounding decides between them."""
    expected = PARTS[part](reference.REGIONS, Inputs(CPU, seed, counts, regions))
    got = [found.cpu() for found in PARTS[part](kernels.REGIONS, Inputs(device, seed, counts, regions))]
    for mine, theirs in zip(got, expected, strict=True):
        if part == "normals":
            apart = (mine - theirs).abs().amax(dim=(1, 2)) > SAME_NORMAL
            assert int(apart.sum()) <= max(1, len(mine) // 100), f"{int(apart.sum())} of {len(mine)} normals differ"
        else:
            torch.testing.assert_close(mine, theirs, atol=KERNELS["value"], rtol=1e-5)


def region_checks(samples: int) -> dict[str, Check]:
    """Return these checks by name, with about so many samples each."""
    counts = tuple(np.random.default_rng(2).integers(0, 9, max(30, samples // 4)).tolist())
    return {
        f"regions, {part}": partial(check_regions, part=part, counts=counts, regions=regions)
        for part, regions in zip(PARTS, (3, 5, 3, 1, 1), strict=True)
    }
