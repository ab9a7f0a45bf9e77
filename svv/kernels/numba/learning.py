"""Whole training steps on the CPU, but for march and optimisers. See :class:`svv.kernels.types.TrainingKernels`.

Between the networks, one compiled function follows a block of rays forward and back. torch would pass over all samples
dozens of times, each time to memory that it has not written before.

Letters: S samples, R rays, K colours, P palette colours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numba import prange
from torch import Tensor

from svv.core.colour.palette_shading import INTENSITY_SHIFT, SPECULAR_SHIFT, WEIGHT_FLOOR
from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.core.lanes import LANES, exp, gather, lane_numbers, minimum, softplus, splat, store
from svv.kernels.numba.operations import (
    encode_into,
    harmonics_into,
    lattice_backward,
    lattice_encode,
    network_and_back,
    representatives,
)
from svv.kernels.reference import loss as loss
from svv.kernels.types import HARMONICS, Lattice, Owned, Samples, Table, Target

SPARE = False
"""Samples have no rows to spare."""

PARTS = 64
"""Parts of the rays, each with a sum of its own, so that sums do not depend on the threads."""

# The functions below have NumPy's error model: Python's may raise an error in a training that diverges, whose weights
# are no longer finite. The loop notices that by itself.
ZERO, HALF, ONE, TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
THIRD, LEAST = np.float32(1.0 / 3.0), np.float32(-80.0)
BRIGHT, GLEAM, FLOOR = (np.float32(v) for v in (INTENSITY_SHIFT, SPECULAR_SHIFT, WEIGHT_FLOOR))


@njit(fastmath=FAST_MATH, error_model="numpy")
def rising(x):  # type: ignore[no-untyped-def]
    """Return 1 / (1 + e^-x), without infinities on the way."""
    return ONE / (ONE + np.exp(-max(x, LEAST)))


@njit(parallel=True, fastmath=FAST_MATH, error_model="numpy", cache=True)
def learn_base(  # type: ignore[no-untyped-def]
    sigma, skipped, raw, place, start, count, tail, step, shown, weight, alpha, w, g_raw, g_density, squared
):
    """Composite rays, compare them with ``shown`` (R, 4), and write the gradients of stage 1's loss.

    Sample k has the colour sigmoid(``raw[place[k]]``), (K, 3), of which ``g_raw`` receives the gradient, and
    ``g_density`` (S,) that of log extinction; ``squared`` (R,): squared errors of colour; ``w`` (S,) is scratch.
    """
    for r in prange(start.shape[0]):
        first, behind = start[r], start[r] + count[r]
        low, high = (place[first], place[behind - 1] + 1) if first < behind else (0, 0)
        for k in range(low, high):
            for c in range(3):
                raw[k, c], g_raw[k, c] = rising(raw[k, c]), ZERO
        t, red, green, blue = ONE, ZERO, ZERO, ZERO
        for j in range(first, behind):
            k = place[j]
            t *= np.exp(-skipped[j])
            left = t * np.exp(-sigma[j] * step)
            w[j], g_density[j], t = t - left, left, left
            red, green, blue = red + w[j] * raw[k, 0], green + w[j] * raw[k, 1], blue + w[j] * raw[k, 2]
        t *= np.exp(-tail[r])
        apart_0, apart_1, apart_2 = red - shown[r, 0], green - shown[r, 1], blue - shown[r, 2]
        squared[r] = weight[r] * (apart_0 * apart_0 + apart_1 * apart_1 + apart_2 * apart_2)
        factor = TWO * THIRD * weight[r]
        g_0, g_1, g_2 = factor * apart_0, factor * apart_1, factor * apart_2
        # The gradient of everything behind a sample with respect to the optical depth before it.
        rest = g_0 * red + g_1 * green + g_2 * blue - TWO * alpha * weight[r] * (ONE - t - shown[r, 3]) * t
        for j in range(first, behind):
            k = place[j]
            dot = g_0 * raw[k, 0] + g_1 * raw[k, 1] + g_2 * raw[k, 2]
            rest -= w[j] * dot
            g_density[j] = sigma[j] * step * (g_density[j] * dot - rest)
            g_raw[k, 0], g_raw[k, 1], g_raw[k, 2] = (
                g_raw[k, 0] + w[j] * g_0, g_raw[k, 1] + w[j] * g_1, g_raw[k, 2] + w[j] * g_2,
            )  # fmt: skip
        for k in range(low, high):
            for c in range(3):
                g_raw[k, c] *= raw[k, c] * (ONE - raw[k, c])


@njit(fastmath=FAST_MATH, error_model="numpy")
def _bend(values, first, column, shift, soft, slope):  # type: ignore[no-untyped-def]
    """Write the softplus of a column of ``values`` (S, C) plus a ``shift``, and its derivative, from a row on."""
    width, last = np.int32(values.shape[1]), splat(np.int32(values.shape[0] - 1))
    for k in range(0, len(soft), LANES):
        row = minimum(lane_numbers() + np.int32(first + k), last)
        x = gather(values, row * width + np.int32(column)) + shift
        store(soft, k, softplus(x))
        store(slope, k, ONE / (ONE + exp(ZERO - x)))


@njit(fastmath=FAST_MATH, error_model="numpy")
def _mix(raw, colours, soft, j, mixed, weights):  # type: ignore[no-untyped-def]
    """Write a sample's ``mixed`` colour, without light, and penalties (6,), and palette ``weights`` (P,).

    ``raw`` (1 + 4 P,): output of the network; ``soft`` (., S): what :func:`_bend` makes of it. Returns what the weights
    were divided by.
    """
    regions = len(colours)
    total, squares, offsets, red, green, blue = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
    for p in range(regions):
        own, at = soft[1 + p, j] + FLOOR, 1 + regions + 3 * p
        r, g, b = raw[at], raw[at + 1], raw[at + 2]
        weights[p], total, squares = own, total + own, squares + own * own
        red, green = red + own * (colours[p, 0] + r), green + own * (colours[p, 1] + g)
        blue += own * (colours[p, 2] + b)
        offsets += r * r + g * g + b * b
    scale = ONE / total
    mixed[0], mixed[1], mixed[2], mixed[3] = scale * red, scale * green, scale * blue, offsets
    mixed[5] = ONE - squares * scale * scale
    for p in range(regions):
        weights[p] *= scale
    return total


@njit(fastmath=FAST_MATH, error_model="numpy")
def _mix_back(  # type: ignore[no-untyped-def]
    raw, colours, soft, slopes, shade, j, mixed, weights, g, owned, foreign, g_raw, g_light, g_colours
):
    """Write the gradients of a sample's outputs of both networks for those of its lit colour and penalties, ``g`` (6,).

    Those of the ``colours`` are added to ``g_colours``. ``owned`` is the region that owns the sample, or negative;
    ``foreign``: the weight of its penalty.
    """
    regions = len(colours)
    along = g[0] * mixed[0] + g[1] * mixed[1] + g[2] * mixed[2]
    g_light[0] = (g[0] + g[1] + g[2]) * slopes[1 + regions, j]
    if len(g_light) > 1:
        g_light[1] = (soft[0, j] * along + TWO * (shade - ONE) * g[4]) * shade * (ONE - HALF * shade)
    g_raw[0] = shade * along * slopes[0, j]
    lit = soft[0, j] * shade
    g_0, g_1, g_2 = g[0] * lit, g[1] * lit, g[2] * lit
    mean = ZERO
    for p in range(regions):
        own, at = weights[p], 1 + regions + 3 * p
        r, green, b = raw[at], raw[at + 1], raw[at + 2]
        slope = g_0 * (colours[p, 0] + r) + g_1 * (colours[p, 1] + green) + g_2 * (colours[p, 2] + b) - TWO * g[5] * own
        if p == owned:
            slope -= foreign / own
        g_raw[at], g_raw[at + 1] = own * g_0 + TWO * g[3] * r, own * g_1 + TWO * g[3] * green
        g_raw[at + 2] = own * g_2 + TWO * g[3] * b
        g_colours[p, 0] += own * g_0
        g_colours[p, 1] += own * g_1
        g_colours[p, 2] += own * g_2
        g_raw[1 + p], mean = slope, mean + slope * own
    for p in range(regions):
        g_raw[1 + p] = (g_raw[1 + p] - mean) / mixed[6] * slopes[1 + p, j]


@njit(parallel=True, fastmath=FAST_MATH, error_model="numpy", cache=True)
def learn_palette(  # type: ignore[no-untyped-def]
    sigma, skipped, raw, light, colours, start, count, step, shown, weight, penalties, owner, foreign, g_raw, g_light,
    g_colours, squared,
):  # fmt: skip
    """Composite rays, compare them with ``shown`` (R, 4), and write the gradients of stage 2's loss.

    ``raw`` (S, 1 + 4 P) and ``light`` (S, 1 or 2): outputs of the networks, of which ``g_raw`` and ``g_light`` receive
    the gradients, and each part's ``g_colours`` (PARTS, P, 3) those of the ``colours``. ``owner`` (S,): region that
    owns each sample, or no numbers; ``foreign`` (P,): weight of the penalty of its samples; ``squared`` (R,): squared
    errors of colour.
    """
    rays, regions, shaded = start.shape[0], len(colours), light.shape[1] > 1
    for part in prange(PARTS):
        begin, end = part * rays // PARTS, (part + 1) * rays // PARTS
        if begin == end:
            continue
        zero = start[begin]
        samples = start[end - 1] + count[end - 1] - zero
        room = (samples + LANES - 1) // LANES * LANES
        soft, slopes = np.empty((3 + regions, room), np.float32), np.empty((3 + regions, room), np.float32)
        for p in range(1 + regions):
            _bend(raw, zero, p, ZERO if p else BRIGHT, soft[p], slopes[p])
        for p in range(light.shape[1]):
            _bend(light, zero, p, ZERO if p else GLEAM, soft[1 + regions + p], slopes[1 + regions + p])
        mixed, weights = np.empty((samples, 8), np.float32), np.empty((samples, regions), np.float32)
        g, out = np.empty(6, np.float32), np.empty(6, np.float32)
        for r in range(begin, end):
            first, behind = start[r], start[r] + count[r]
            t = ONE
            out[:] = ZERO
            for j in range(first, behind):
                k = j - zero
                mixed[k, 6] = _mix(raw[j], colours, soft, k, mixed[k], weights[k])
                shade = TWO * slopes[2 + regions, k] if shaded else ONE
                mixed[k, 4] = (shade - ONE) * (shade - ONE)
                t *= np.exp(-skipped[j])
                left = t * np.exp(-sigma[j] * step)
                own, t = t - left, left
                mixed[k, 7] = own
                for c in range(3):
                    out[c] += own * (soft[0, k] * shade * mixed[k, c] + soft[1 + regions, k])
                    out[3 + c] += own * mixed[k, 3 + c]
            squared[r] = ZERO
            for c in range(3):
                apart = out[c] - shown[r, c]
                squared[r] += weight[r] * apart * apart
                out[c], out[3 + c] = TWO * THIRD * weight[r] * apart, penalties[c] * weight[r]
            for j in range(first, behind):
                k = j - zero
                for c in range(6):
                    g[c] = mixed[k, 7] * out[c]
                shade = TWO * slopes[2 + regions, k] if shaded else ONE
                owned = owner[j] if len(owner) else -1
                most = foreign[owned] if len(owner) else ZERO
                _mix_back(
                    raw[j], colours, soft, slopes, shade, k, mixed[k], weights[k], g, owned, most, g_raw[j], g_light[j],
                    g_colours[part],
                )  # fmt: skip


def fits(weights: Sequence[Tensor]) -> bool:
    """Every network can be part of a step."""
    return True


def base(
    samples: Samples, target: Target, tables: tuple[Table, Table], weights: Sequence[Tensor], every: float,
    shift: Tensor, alpha: float, counted: bool,
) -> tuple[Tensor, list[Tensor], int]:  # fmt: skip
    """Take stage 1's step up to the optimisers."""
    density, table = tables
    rows, place = representatives(samples, every, shift)
    position = samples.position.index_select(0, rows)
    inputs = _with_harmonics(position, samples.ray.index_select(0, rows), target, table.lattice, table.features)
    raw, back = network_and_back(inputs, weights, of_inputs=True)
    w, g_density, g_raw = (torch.empty_like(v) for v in (samples.sigma, samples.sigma, raw))
    squared = torch.empty(len(samples.count))
    learn_base(
        *_arrays(samples.sigma, samples.skipped, raw, place, samples.start, samples.count, samples.tail),
        np.float32(samples.step), *_arrays(target.shown, target.weight), np.float32(alpha),
        *_arrays(w, g_raw, g_density, squared),
    )  # fmt: skip
    of_inputs, *gradients = back(g_raw)
    features = table.features.shape[1] * len(table.lattice.scales)
    lattice_backward(position, of_inputs[:, :features], table.lattice, table.gradient, table.used)
    alike = g_density[:, None].expand(-1, len(density.lattice.scales))
    lattice_backward(samples.position, alike, density.lattice, density.gradient, density.used)
    return squared.sum() / 3.0, gradients, len(rows)


def palette(
    samples: Samples, target: Target, geometry: tuple[Lattice, Tensor], material: Table,
    networks: tuple[Sequence[Tensor], Sequence[Tensor]], colours: Tensor, penalties: Sequence[float] | Tensor,
    owned: Owned | None,
) -> tuple[Tensor, list[Tensor]]:  # fmt: skip
    """Take stage 2's step up to the optimisers."""
    lit = _with_harmonics(samples.position, samples.ray, target, *geometry)
    plain = lattice_encode(samples.position, material.lattice, material.features)
    light, of_light = network_and_back(lit, networks[0], of_inputs=False)
    raw, of_raw = network_and_back(plain, networks[1], of_inputs=True)
    regions, owner, foreign = len(colours), torch.empty(0, dtype=torch.int64), torch.zeros(len(colours))
    if owned is not None:
        owner, foreign = owned.owner, owned.weight / owned.number.clamp(min=1)
    g_raw, g_light, g_colours = torch.empty_like(raw), torch.empty_like(light), torch.zeros(PARTS, regions, 3)
    squared, each = torch.empty(len(samples.count)), np.array([float(p) for p in penalties], np.float32)
    learn_palette(
        *_arrays(samples.sigma, samples.skipped, raw, light, colours, samples.start, samples.count),
        np.float32(samples.step), *_arrays(target.shown, target.weight), each,
        *_arrays(owner, foreign, g_raw, g_light, g_colours, squared),
    )  # fmt: skip
    of_lighting, (of_plain, *of_mixing) = of_light(g_light), of_raw(g_raw)
    lattice_backward(samples.position, of_plain, material.lattice, material.gradient, material.used)
    return squared.sum() / 3.0, [*of_lighting, *of_mixing, g_colours.sum(dim=0)]


def owned_by(samples: Samples, owner: Tensor, regions: int) -> Tensor:
    """Count them."""
    return torch.bincount(owner, minlength=regions)


def _with_harmonics(x: Tensor, ray: Tensor, target: Target, where: Lattice, table: Tensor) -> Tensor:
    """Return features at positions beside the harmonics of their rays. (S, L F + 16)"""
    features = len(where.scales) * table.shape[1]
    out = torch.empty(len(x), features + HARMONICS)
    encode_into(out[:, :features], x, where, table)
    harmonics_into(out[:, features:], target.along, ray)
    return out


def _arrays(*tensors: Tensor) -> list[np.ndarray]:
    """Return tensors as the compiled functions take them."""
    return [tensor.detach().contiguous().numpy() for tensor in tensors]
