"""Whole training steps between the march and the optimisers, in Triton. See :class:`svv.kernels.types.TrainingKernels`.

Each operation of a step is one launch, forward and then backward, and none waits: the number of samples may lie on the
GPU, where each kernel reads it; arrays then have rows to spare, which nothing reads.

Letters: S samples, R rays, C channels, K colours, L levels, F features per level, P palette colours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
import triton
import triton.language as tl
from torch import Tensor

from svv.core.colour.palette_shading import INTENSITY_SHIFT, SPECULAR_SHIFT, WEIGHT_FLOOR
from svv.kernels.constants import numbers_on
from svv.kernels.triton import image as triton_image
from svv.kernels.triton import networks
from svv.kernels.triton import rays as triton_rays
from svv.kernels.triton import tables as triton_tables
from svv.kernels.triton import training as triton_training
from svv.kernels.triton.networks import fits as fits
from svv.kernels.triton.training import loss as loss
from svv.kernels.types import HARMONICS, Lattice, Owned, Samples, Table, Target

SPARE = True
"""Samples may have rows to spare."""
BLOCK = 128
"""Samples per program."""
RAY_BLOCK = 32
"""Rays per program: one warp, which finishes with its longest ray."""
PENALTIES = 3
"""Channels behind the colour in stage 2; see :meth:`svv.kernels.types.TrainingKernels.palette`."""


@triton.jit
def sigmoid(x):  # type: ignore[no-untyped-def]
    """Return 1 / (1 + e^-x), without infinities on the way."""
    return 1.0 / (1.0 + tl.exp(-tl.maximum(x, -80.0)))


@triton.jit(
    do_not_specialize=["sigma", "skipped", "values", "place", "start", "count", "tail", "shown", "weight", "penalties",
                       "g_values", "g_density", "parts", "rays"]
)  # fmt: skip
def learn(  # type: ignore[no-untyped-def]  # long: forward and backward of one ray, whose state is registers
    sigma, skipped, values, place, start, count, tail, step, shown, weight, alpha, penalties, g_values, g_density,
    parts, rays, BASE: tl.constexpr, CHANNELS: tl.constexpr, WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Composite a block of rays, compare them with ``shown`` (R, 4), and write the gradients of their loss.

    In stage 1 (``BASE``), sample k has the colour sigmoid(``values[place[k]]``), and the gradient of the values (K, 3)
    is added to ``g_values``; ``g_density`` (S,) receives that of log extinction. In stage 2, sample k has the
    ``values[k]``, colour and penalties, whose weights are ``penalties`` (3,); ``g_values`` (S, 6) receives their
    gradient. ``parts`` (programs,): sums of squared errors of colour. A ray without room, whose ``count`` is negative,
    does not count.
    """
    r = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    c = tl.arange(0, WIDE)
    there = r < rays
    is_colour = (c < 3)[None, :]
    first = tl.load(start + r, mask=there, other=0)
    number = tl.load(count + r, mask=there, other=-1)
    own = tl.where(number < 0, 0.0, tl.load(weight + r, mask=there, other=0.0))
    t = tl.full((BLOCK,), 1.0, tl.float32)
    total = tl.zeros((BLOCK, WIDE), tl.float32)
    longest = tl.max(number, axis=0)
    k = tl.zeros_like(longest)
    while k < longest:
        at, going = first + k, k < number
        both = going[:, None] & (c < CHANNELS)[None, :]
        row = tl.load(place + at, mask=going, other=0) if BASE else at
        value = tl.load(values + row[:, None] * CHANNELS + c[None, :], mask=both, other=0.0)
        if BASE:
            value = sigmoid(value)
        t *= tl.exp(-tl.load(skipped + at, mask=going, other=0.0))
        e = tl.exp(-tl.load(sigma + at, mask=going, other=0.0) * step)
        total += (t * (1.0 - e))[:, None] * value
        t *= e
        k += 1
    t *= tl.exp(-tl.load(tail + r, mask=there, other=0.0))
    seen = there[:, None] & is_colour
    apart = total - tl.load(shown + 4 * r[:, None] + c[None, :], mask=seen, other=0.0)
    squared = tl.sum(tl.where(is_colour, apart * apart, 0.0), axis=1) * own
    tl.store(parts + tl.program_id(0), tl.sum(squared, axis=0) / 3.0)
    each = tl.load(penalties + c - 3, mask=(c >= 3) & (c < CHANNELS), other=0.0)
    g = tl.where(is_colour, (2.0 / 3.0) * apart, each[None, :]) * own[:, None]
    if BASE:
        missing = 1.0 - t - tl.load(shown + 4 * r + 3, mask=there, other=0.0)
        # Gradient of everything behind a sample with respect to the optical depth before it.
        behind = tl.sum(g * total, axis=1) - 2.0 * alpha * own * missing * t
        last = tl.full((BLOCK,), -1, tl.int64)
        colour, gathered = tl.zeros((BLOCK, WIDE), tl.float32), tl.zeros((BLOCK, WIDE), tl.float32)
    t = tl.full((BLOCK,), 1.0, tl.float32)
    k = tl.zeros_like(longest)
    while k < longest:
        at, going = first + k, k < number
        both = going[:, None] & (c < CHANNELS)[None, :]
        t *= tl.exp(-tl.load(skipped + at, mask=going, other=0.0))
        extinction = tl.load(sigma + at, mask=going, other=0.0)
        e = tl.exp(-extinction * step)
        w = t * (1.0 - e)
        if BASE:
            row = tl.load(place + at, mask=going, other=0)
            next_one = going & (row != last)
            done = (next_one & (last >= 0))[:, None] & (c < CHANNELS)[None, :]
            slope = gathered * colour * (1.0 - colour)
            tl.atomic_add(g_values + last[:, None] * CHANNELS + c[None, :], slope, mask=done, sem="relaxed")
            value = sigmoid(tl.load(values + row[:, None] * CHANNELS + c[None, :], mask=both, other=0.0))
            colour = tl.where(next_one[:, None], value, colour)
            gathered = tl.where(next_one[:, None], 0.0, gathered) + tl.where(both, w[:, None] * g, 0.0)
            last = tl.where(next_one, row, last)
            dot = tl.sum(g * tl.where(both, value, 0.0), axis=1)
            behind -= w * dot
            tl.store(g_density + at, extinction * step * (t * e * dot - behind), mask=going)
        else:
            tl.store(g_values + at[:, None] * CHANNELS + c[None, :], w[:, None] * g, mask=both)
        t *= e
        k += 1
    if BASE:
        done = (last >= 0)[:, None] & (c < CHANNELS)[None, :]
        slope = gathered * colour * (1.0 - colour)
        tl.atomic_add(g_values + last[:, None] * CHANNELS + c[None, :], slope, mask=done, sem="relaxed")


def representatives(
    samples: Samples, every: float, shift: Tensor, counted: bool
) -> tuple[Tensor, Tensor, Tensor]:  # fmt: skip
    """Return rows of representatives (K,), each sample's index in them (S,), and how many there are, on the GPU (1,).

    If they are not ``counted``, for which the CPU waits, there are rows for as many as there can be.
    """
    rays, device, grid = len(shift), shift.device, (triton.cdiv(len(shift), RAY_BLOCK),)
    begin, end, passed = torch.empty(3, len(samples), device=device)
    place, taken = (torch.empty(n, dtype=torch.int64, device=device) for n in (len(samples), rays))
    if not len(samples):
        return place, place, torch.zeros(1, dtype=torch.int64, device=device)
    triton_rays.cuts_of_rays[grid](
        samples.sigma, samples.skipped, samples.start, samples.count, samples.step, 1.0 / every, shift,
        begin, end, taken, rays, RAY_BLOCK, num_warps=1,
    )  # fmt: skip
    behind = taken.cumsum(0)
    most = min(len(samples), rays * (math.ceil(1.0 / every) + 1))  # a ray has no more cuts than these
    rows = torch.empty(int(behind[-1]) if counted else most, dtype=torch.int64, device=device)
    triton_rays.representatives[grid](
        begin, end, samples.start, samples.count, taken, behind, rows, place, passed, rays, RAY_BLOCK, num_warps=1
    )
    return rows, place, behind[-1:]


def base(
    samples: Samples, target: Target, tables: tuple[Table, Table], weights: Sequence[Tensor], every: float,
    shift: Tensor, alpha: float, counted: bool,
) -> tuple[Tensor, list[Tensor], int]:  # fmt: skip
    """Take stage 1's step up to the optimisers."""
    density, table = tables
    rows, place, number = representatives(samples, every, shift, counted)
    inputs = _with_harmonics(samples, rows, number, target.along, (table.lattice, table.features))
    raw = networks.forward(inputs, weights, number)
    g_raw, g_density = torch.zeros_like(raw), torch.empty_like(samples.sigma)
    error = _learn(samples, place, raw, target, alpha, (0.0,), (g_raw, g_density))
    g_inputs, gradients = networks.backward(inputs, g_raw, weights, number, inward=True)
    assert g_inputs is not None
    _add_gradient(table, samples.position, rows, number, g_inputs, alike=False)
    _add_gradient(density, samples.position, None, samples.number, g_density[:, None], alike=True)
    return error, gradients, len(rows)


def palette(
    samples: Samples, target: Target, geometry: tuple[Lattice, Tensor], material: Table,
    networks_of: tuple[Sequence[Tensor], Sequence[Tensor]], colours: Tensor, penalties: Sequence[float] | Tensor,
    owned: Owned | None,
) -> tuple[Tensor, list[Tensor]]:  # fmt: skip
    """Take stage 2's step up to the optimisers."""
    lighting, mixing = networks_of
    number, count, grid = samples.number, len(colours), (triton.cdiv(len(samples), BLOCK),)
    lit = _with_harmonics(samples, None, number, target.along, geometry)
    plain = _looked_up(samples.position, number, material)
    light, raw = networks.forward(lit, lighting, number), networks.forward(plain, mixing, number)
    values = raw.new_empty(len(raw), 3 + PENALTIES)
    shifts = INTENSITY_SHIFT, SPECULAR_SHIFT, WEIGHT_FLOOR
    triton_training.mix[grid](raw, light, colours, *shifts, values, number, count, light.shape[1], BLOCK)
    g_values = torch.empty_like(values)
    error = _learn(samples, None, values, target, 0.0, penalties, (g_values, samples.sigma))
    g_raw, g_light = torch.empty_like(raw), torch.empty_like(light)
    parts = raw.new_empty(grid[0], count, 3)
    triton_training.mix_backward[grid](
        raw, light, colours, *shifts, g_values, samples.start if owned is None else owned.owner,
        samples.count if owned is None else owned.number, 0.0 if owned is None else owned.weight, g_raw, g_light, parts,
        number, count, light.shape[1], owned is not None, BLOCK,
    )  # fmt: skip
    g_plain, of_mixing = networks.backward(plain, g_raw, mixing, number, inward=True)
    _, of_lighting = networks.backward(lit, g_light, lighting, number, inward=False)
    assert g_plain is not None
    _add_gradient(material, samples.position, None, number, g_plain, alike=False)
    return error, [*of_lighting, *of_mixing, parts.sum(dim=0)]


def owned_by(samples: Samples, owner: Tensor, regions: int) -> Tensor:
    """Count them block by block."""
    number = torch.zeros(regions, dtype=torch.int64, device=owner.device)
    triton_training.count_owned[(triton.cdiv(len(samples), BLOCK),)](owner, number, samples.number, regions, BLOCK)
    return number


def _with_harmonics(
    samples: Samples, rows: Tensor | None, number: Tensor | int, along: Tensor, of: tuple[Lattice, Tensor]
) -> Tensor:
    """Return features and harmonics of samples, or of some ``rows`` of them. (K, L F + 16)"""
    (lattice, table), count = of, len(samples) if rows is None else len(rows)
    levels, features = len(lattice.scales), table.shape[1]
    out = torch.empty(count, levels * features + HARMONICS, device=table.device)
    triton_image.features[triton.cdiv(count, BLOCK), levels](
        samples.position, samples.ray, samples.ray if rows is None else rows, along.contiguous(), lattice.shapes,
        lattice.scales, lattice.bases, lattice.index, table, out, out, number, levels, features,
        triton.next_power_of_2(features), False, rows is not None, BLOCK,
    )  # fmt: skip
    return out


def _looked_up(x: Tensor, number: Tensor | int, of: Table) -> Tensor:
    """Return features at positions. (S, L F)"""
    where, levels, features = of.lattice, len(of.lattice.scales), of.features.shape[1]
    out = torch.empty(len(x), levels * features, device=x.device)
    triton_tables.lattice_encode[triton.cdiv(len(x), BLOCK), levels](
        x, where.shapes, where.scales, where.bases, where.index, of.features, out, number,
        levels, features, triton.next_power_of_2(features), BLOCK,
    )  # fmt: skip
    return out


def _add_gradient(
    table: Table, x: Tensor, rows: Tensor | None, number: Tensor | int, g_out: Tensor, alike: bool
) -> None:
    """Add the gradients of levels, or of each level if they are alike, at positions or at some rows of them."""
    where, levels, features = table.lattice, len(table.lattice.scales), table.features.shape[1]
    triton_tables.lattice_backward[triton.cdiv(len(g_out), BLOCK), levels](
        x, x if rows is None else rows, g_out, where.shapes, where.scales, where.bases, where.index, table.gradient,
        table.used, number, levels, g_out.shape[1], features, triton.next_power_of_2(features), rows is not None, alike,
        BLOCK,
    )  # fmt: skip


def _learn(
    samples: Samples, place: Tensor | None, values: Tensor, target: Target, alpha: float,
    penalties: Sequence[float] | Tensor, gradients: tuple[Tensor, Tensor],
) -> Tensor:  # fmt: skip
    """Write the gradients of values and of log extinction; return the mean squared error of colour."""
    rays, channels, stage_1 = len(samples.count), values.shape[1], place is not None
    parts = torch.empty(triton.cdiv(rays, RAY_BLOCK), device=values.device)
    learn[(len(parts),)](
        samples.sigma, samples.skipped, values, samples.start if place is None else place, samples.start, samples.count,
        samples.tail, samples.step, target.shown, target.weight, alpha,
        penalties if isinstance(penalties, Tensor) else numbers_on(penalties, values.device), *gradients, parts, rays,
        stage_1, channels, triton.next_power_of_2(channels), RAY_BLOCK, num_warps=1,
    )  # fmt: skip
    return parts.sum()
