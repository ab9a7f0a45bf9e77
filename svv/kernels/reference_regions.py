"""Regions along rays in plain torch, on any device; see :class:`svv.kernels.types.RegionKernels`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from svv.core.geometry import surfaces
from svv.kernels.constants import moved
from svv.kernels.types import RaySamples, VertexSamples


def normal_equations(seen: RaySamples, region: Tensor, count: int) -> Tensor:
    """Of a matrix of what each ray sees of each unknown, A, return A^T A beside the product with the pixels."""
    own, ray = region[seen.vertex], _of_each(seen.first, len(seen.vertex))
    lit = seen.weight * seen.cosine
    part = seen.pixel.new_zeros(len(seen.pixel) * 2 * count, dtype=torch.float64)
    for first, weight in ((0, seen.weight), (count, lit)):
        part.index_add_(0, ray * (2 * count) + own + first, weight.double())
    part = part.view(-1, 2 * count)
    return part.T @ torch.cat([part, seen.pixel.double()], dim=1)


def errors(seen: RaySamples, kept: float, light: Tensor, member: Tensor) -> Tensor:
    own, ray = member[seen.vertex, : len(light)], _of_each(seen.first, len(seen.vertex))
    lit = seen.weight * seen.cosine
    shown = seen.weight[:, None] * (own @ light[:, :3]) + lit[:, None] * (own @ light[:, 3:])
    error = (-seen.pixel).index_add(0, ray, shown)
    return error - (1.0 - kept) * (error * seen.along).sum(dim=1, keepdim=True) * seen.along


def descend(
    near: VertexSamples, error: Tensor, light: Tensor, step: Tensor, pace: tuple[float, float], ahead: Tensor,
    member: Tensor, following: Tensor,
) -> None:  # fmt: skip
    (smoothness, momentum), count = pace, len(light)
    vertex, own = _of_each(near.first, len(near.ray)), error[near.ray]
    plain, lit = (
        torch.zeros(len(member), 3, device=error.device).index_add(0, vertex, weight[:, None] * own)
        for weight in (near.weight, near.lit)
    )
    agree = near.root[:, None] * near.root[near.neighbours] + near.least
    pull = (agree[:, :, None] * (ahead[near.neighbours] - ahead[:, None])).sum(dim=1)[:, :count]
    slope = plain @ light[:, :3].T + lit @ light[:, 3:].T - smoothness * pull
    found = to_memberships(ahead[:, :count] - step[:, None] * slope)
    following[:, :count] = found + momentum * (found - member[:, :count])
    member[:, :count] = found


def to_memberships(values: Tensor) -> Tensor:
    """Return the nearest numbers >= 0 with sum 1 (Duchi et al. 2008). (V, P)"""
    over = values.sort(dim=1, descending=True).values.cumsum(dim=1) - 1.0
    among = torch.arange(1, values.shape[1] + 1, device=values.device)
    return (values - (over / among).amax(dim=1, keepdim=True)).clamp(min=0.0)


def blurred(values: Tensor, deviation: float) -> Tensor:
    return _blurred(values, deviation, None, beyond=False)


def normals(field: Tensor, places: Tensor, deviations: Sequence[float]) -> Tensor:
    """Square structure tensors until only the direction of the largest eigenvalue is left."""
    inner, outer = deviations
    at = places.unbind(1)
    gradient = [_blurred(field, inner, axis, beyond=True) for axis in range(3)]
    rows = [[_blurred(a * b, outer, None, beyond=True)[at] for b in gradient[: k + 1]] for k, a in enumerate(gradient)]
    full = [torch.stack([rows[max(j, k)][min(j, k)] for k in range(3)], dim=1) for j in range(3)]
    tensor = torch.stack(full, dim=1).double()
    some = tensor.diagonal(dim1=1, dim2=2).sum(dim=1) > surfaces.LEAST_TRACE
    for _ in range(surfaces.SQUARINGS):
        tensor = tensor / tensor.diagonal(dim1=1, dim2=2).sum(dim=1).clamp(min=surfaces.LEAST_TRACE)[:, None, None]
        tensor = tensor @ tensor
    largest = tensor.diagonal(dim1=1, dim2=2).argmax(dim=1)
    column = tensor.gather(1, largest[:, None, None].expand(-1, 1, 3))[:, 0]
    unit = column / column.square().sum(dim=1, keepdim=True).sqrt()
    return torch.where(some[:, None], unit, 0.0).float()


def _blurred(grid: Tensor, deviation: float, along: int | None, beyond: bool) -> Tensor:
    """Return a grid blurred along each axis, by products with matrices that hold the filters in their rows.

    See :func:`svv.core.geometry.surfaces.blurred`.
    """
    for axis, weights, sign in zip(range(3), *surfaces.filters(deviation, along), strict=True):
        size = grid.shape[axis]
        matrix, row = np.zeros((size, size), np.float32), np.arange(size)
        sides = [(0, weights[0])]
        sides += [(side * k, w if side > 0 else sign * w) for k, w in enumerate(weights) if k for side in (1, -1)]
        for distance, weight in sides:
            near = (row + distance).clip(0, size - 1)
            kept = beyond | (near == row + distance)
            np.add.at(matrix, (row[kept], near[kept]), weight)
        grid = torch.tensordot(moved(matrix, grid.device), grid, ([1], [axis])).movedim(0, axis)
    return grid


def _of_each(first: Tensor, total: int) -> Tensor:
    """Return to which row each of ``total`` samples belongs; ``first`` holds each row's first. (N + 1,) -> (S,)"""
    return torch.repeat_interleave(first.diff(), output_size=total)
