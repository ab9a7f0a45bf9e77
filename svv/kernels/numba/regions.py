"""Regions along rays on the CPU; see :class:`svv.kernels.types.RegionKernels`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.geometry import surfaces
from svv.kernels.numba import along_rays as loops
from svv.kernels.types import RaySamples, VertexSamples


def normal_equations(seen: RaySamples, region: Tensor, count: int) -> Tensor:
    sums = np.zeros((-(-len(seen.pixel) // loops.BLOCK), 2 * count, 2 * count + 3))
    loops.normal_equations(*_rows(seen), region.numpy(), sums)
    return torch.from_numpy(sums.sum(axis=0))


def errors(seen: RaySamples, kept: float, light: Tensor, member: Tensor) -> Tensor:
    error = torch.empty_like(seen.pixel)
    both = _even(light, member)
    loops.errors(*_rows(seen), seen.along.numpy(), np.float32(kept), both, member.numpy(), error.numpy())
    return error


def descend(
    near: VertexSamples, error: Tensor, light: Tensor, step: Tensor, pace: tuple[float, float], ahead: Tensor,
    member: Tensor, following: Tensor,
) -> None:  # fmt: skip
    smoothness, momentum = pace
    loops.descend(
        _unsigned(near.first), _unsigned(near.ray), near.weight.numpy(), near.lit.numpy(), error.numpy(),
        _unsigned(near.neighbours), near.root.numpy(), np.float32(near.least), _even(light, member), step.numpy(),
        np.float32(smoothness), np.float32(momentum), np.uint32(len(light)), ahead.numpy(), member.numpy(),
        following.numpy(),
    )  # fmt: skip


def blurred(values: Tensor, deviation: float) -> Tensor:
    return torch.from_numpy(surfaces.blurred(values.numpy(), deviation, beyond=False))


def normals(field: Tensor, places: Tensor, deviations: Sequence[float]) -> Tensor:
    return torch.from_numpy(surfaces.surface_normals(field.numpy(), places.numpy(), *deviations))


def _rows(seen: RaySamples) -> tuple[NDArray[np.generic], ...]:
    """Return what a ray sees as the loops take it."""
    first, vertex = _unsigned(seen.first), _unsigned(seen.vertex)
    return first, vertex, seen.weight.numpy(), seen.cosine.numpy(), seen.pixel.numpy()


def _unsigned(index: Tensor) -> NDArray[np.uint32]:
    return index.numpy().view(np.uint32)


def _even(light: Tensor, member: Tensor) -> NDArray[np.float32]:
    """Return the light of as many regions as there are memberships; the last one may be none. (Q, 6)"""
    return np.pad(light.numpy(), ((0, member.shape[1] - len(light)), (0, 0)))
