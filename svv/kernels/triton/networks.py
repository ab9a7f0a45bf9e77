"""Small networks in Triton on tensor cores: all layers for a block of samples in one kernel, forward and backward.

Products have float16 operands and are accumulated in float32; weights, inputs, outputs and gradients are float32 in
memory. Activations are never stored there: the backward pass recomputes them, which costs less than reading them.

float16 has eleven bits of precision instead of the eight of bfloat16, but its largest number is 65504 and it loses
precision below 6e-5. Activations are therefore clamped to its range instead of becoming infinite. The gradients of a
loss that is a mean over thousands of pixels would all be too small, so those of a block are scaled layer by layer to
make the largest 2^15, and the sums are scaled back. Nothing overflows, and only values 2^39 times smaller than a
neighbour are lost.

Letters: S samples, I inputs, W width of the hidden layers, O outputs. ``WIDE_IN``, ``WIDE`` and ``WIDE_OUT`` are the
last three, rounded up to a power of two of at least 16, the minimum for tensor cores; ``DEEP`` means two hidden layers
instead of one, and ``BLOCK`` is the number of samples that a program processes together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import torch
import triton
import triton.language as tl
from torch import Tensor
from torch.autograd.function import once_differentiable

from svv.core.rays.networks import relu_layers
from svv.kernels.triton.tables import known
from svv.kernels.types import Context

WIDEST_LAYER = 64
"""Widest layer that the kernels support: the backward pass holds the gradients of all weights at once."""

AMPERE = (8, 0)
"""Lowest compute capability with which Triton uses tensor cores and a program has the 64 KiB that it needs."""

DATA_CENTRE_BLACKWELL = (10, 0), (12, 0)
"""Compute capabilities from the first to below the second have tensor cores with a memory of their own, for which
Triton 3.7 does not compile the backward pass. It uses them for programs of 4 or 8 warps alone."""

WARPS, MORE_WARPS = 4, 16
"""Warps of a program; the second number is for the backward pass where the first does not compile."""


@dataclass(frozen=True)
class Launch:
    """Distribution of a kernel over the GPU."""

    block: int
    """Number of samples that a program processes together."""
    programs: int
    """Maximum number of programs; each processes many blocks and reads the weights once."""


FORWARD = Launch(128, 1024)
"""Distribution of the forward pass."""
BACKWARD = Launch(64, 264)
"""Distribution of the backward pass: two programs per multiprocessor of the largest GPUs, each with a partial sum of
the weights' gradients. The parts are added in a fixed order, so that the results are reproducible."""


@triton.jit
def half(x):  # type: ignore[no-untyped-def]
    """Convert to float16, clamped to its largest number; NaN stays NaN."""
    x = tl.where(x > 65504.0, 65504.0, x)
    return tl.where(x < -65504.0, -65504.0, x).to(tl.float16)


@triton.jit
def relu(x):  # type: ignore[no-untyped-def]
    """Return max(x, 0); NaN stays NaN."""
    return tl.where(x < 0.0, 0.0, x)


@triton.jit
def scaled(g):  # type: ignore[no-untyped-def]
    """Return gradients as operands, scaled to a largest of 2^15, and the factor to multiply their products by."""
    largest = tl.max(tl.max(tl.abs(g), axis=1), axis=0)
    unit = tl.where(largest < 1e-30, 1.0, largest * (1.0 / 32768.0))
    return (g / unit).to(tl.float16), unit


@triton.jit
def rows_of(first, end, columns, ROWS: tl.constexpr, COLUMNS: tl.constexpr):  # type: ignore[no-untyped-def]
    """Return the offsets of rows from ``first`` on in a matrix (``end``, ``columns``), and a mask of existing ones."""
    row, column = first + tl.arange(0, ROWS), tl.arange(0, COLUMNS)
    return row.to(tl.int64)[:, None] * columns + column[None, :], (row < end)[:, None] & (column < columns)[None, :]


@triton.jit
def weights_of(weights, outputs, inputs, OUTPUTS: tl.constexpr, INPUTS: tl.constexpr):  # type: ignore[no-untyped-def]
    """Load a layer's weights (to, from) as operands, padded with zeros."""
    at, there = rows_of(0, outputs, inputs, OUTPUTS, INPUTS)
    return half(tl.load(weights + at, mask=there, other=0.0))


@triton.jit(do_not_specialize=["samples"])
def network(  # type: ignore[no-untyped-def]
    x, first, middle, last, out, samples, inputs, width, outputs,
    WIDE_IN: tl.constexpr, WIDE: tl.constexpr, WIDE_OUT: tl.constexpr, DEEP: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Run a network of two or three layers: ``x`` (S, I) -> ``out`` (S, O).

    The weights are ``first`` (W, I), ``middle`` (W, W) and ``last`` (O, W).
    """
    samples = known(samples)
    w_first = weights_of(first, width, inputs, WIDE, WIDE_IN)
    w_middle = w_first
    if DEEP:
        w_middle = weights_of(middle, width, width, WIDE, WIDE)
    w_last = weights_of(last, outputs, width, WIDE_OUT, WIDE)
    for block in range(tl.program_id(0), tl.cdiv(samples, BLOCK), tl.num_programs(0)):
        at, there = rows_of(block * BLOCK, samples, inputs, BLOCK, WIDE_IN)
        h = half(tl.load(x + at, mask=there, other=0.0))
        h = half(relu(tl.dot(h, tl.trans(w_first))))
        if DEEP:
            h = half(relu(tl.dot(h, tl.trans(w_middle))))
        at, there = rows_of(block * BLOCK, samples, outputs, BLOCK, WIDE_OUT)
        tl.store(out + at, tl.dot(h, tl.trans(w_last)), mask=there)


@triton.jit(do_not_specialize=["samples"])
def network_backward(  # type: ignore[no-untyped-def]
    x, g_out, first, middle, last, g_x, parts, samples, inputs, width, outputs,
    WIDE_IN: tl.constexpr, WIDE: tl.constexpr, WIDE_OUT: tl.constexpr, DEEP: tl.constexpr, INWARD: tl.constexpr,
    BLOCK: tl.constexpr,
):  # fmt: skip
    """Compute the gradients of :func:`network`: ``g_x`` (S, I) if ``INWARD``, and partial sums for the weights.

    ``parts`` (programs, W I + W W + O W) holds each program's sums, without W W if there is no middle layer.
    """
    samples = known(samples)
    w_first = weights_of(first, width, inputs, WIDE, WIDE_IN)
    w_last = weights_of(last, outputs, width, WIDE_OUT, WIDE)
    sum_first = tl.zeros((WIDE, WIDE_IN), tl.float32)
    sum_last = tl.zeros((WIDE_OUT, WIDE), tl.float32)
    if DEEP:
        w_middle = weights_of(middle, width, width, WIDE, WIDE)
        sum_middle = tl.zeros((WIDE, WIDE), tl.float32)
    for block in range(tl.program_id(0), tl.cdiv(samples, BLOCK), tl.num_programs(0)):
        at_x, there_x = rows_of(block * BLOCK, samples, inputs, BLOCK, WIDE_IN)
        h_0 = half(tl.load(x + at_x, mask=there_x, other=0.0))
        h_1 = half(relu(tl.dot(h_0, tl.trans(w_first))))
        h = h_1
        if DEEP:
            h = half(relu(tl.dot(h_1, tl.trans(w_middle))))
        at, there = rows_of(block * BLOCK, samples, outputs, BLOCK, WIDE_OUT)
        g = tl.load(g_out + at, mask=there, other=0.0)
        small, unit = scaled(g)
        sum_last += tl.dot(tl.trans(small), h) * unit
        g = tl.where(h > 0.0, tl.dot(small, w_last) * unit, 0.0)
        if DEEP:
            small, unit = scaled(g)
            sum_middle += tl.dot(tl.trans(small), h_1) * unit
            g = tl.where(h_1 > 0.0, tl.dot(small, w_middle) * unit, 0.0)
        small, unit = scaled(g)
        sum_first += tl.dot(tl.trans(small), h_0) * unit
        if INWARD:
            tl.store(g_x + at_x, tl.dot(small, w_first) * unit, mask=there_x)
    parts += tl.program_id(0).to(tl.int64) * (width * (inputs + outputs + (width if DEEP else 0)))
    at, there = rows_of(0, width, inputs, WIDE, WIDE_IN)
    tl.store(parts + at, sum_first, mask=there)
    parts += width * inputs
    if DEEP:
        at, there = rows_of(0, width, width, WIDE, WIDE)
        tl.store(parts + at, sum_middle, mask=there)
        parts += width * width
    at, there = rows_of(0, outputs, width, WIDE_OUT, WIDE)
    tl.store(parts + at, sum_last, mask=there)


def fits(weights: Sequence[Tensor]) -> bool:
    """Return whether the kernels support a network: one or two hidden layers, none wider than :data:`WIDEST_LAYER`."""
    width, inputs = weights[0].shape
    return (
        _can_run(weights[0].device)
        and len(weights) in (2, 3)
        and all(w.shape == (width, width) for w in weights[1:-1])
        and max(inputs, width, weights[-1].shape[0]) <= WIDEST_LAYER
    )


def run(x: Tensor, weights: Sequence[Tensor]) -> Tensor:
    """Run a network as in :meth:`svv.kernels.types.Kernels.network`; unsupported networks run in plain torch."""
    if not fits(weights):
        return relu_layers(x, weights)
    return _Network.apply(x.contiguous(), *weights)


def forward(x: Tensor, weights: Sequence[Tensor], samples: Tensor | int) -> Tensor:
    """Return the outputs of a network that :func:`fits`, without a graph: the first ``samples`` rows of (S, O)."""
    shape = x.shape[1], len(weights[0]), len(weights[-1])
    out = torch.empty(len(x), shape[-1], device=x.device)
    if len(x):
        network[_programs(x, FORWARD),](
            x, weights[0], weights[-2], weights[-1], out, samples, *shape, *_wide(shape), len(weights) == 3,
            FORWARD.block, num_stages=1,
        )  # fmt: skip
    return out


def backward(
    x: Tensor, g_out: Tensor, weights: Sequence[Tensor], samples: Tensor | int, inward: bool
) -> tuple[Tensor | None, list[Tensor]]:
    """Return the gradients of :func:`forward` with respect to ``x`` (S, I), if ``inward``, and to the weights."""
    shape, programs = (x.shape[1], len(weights[0]), len(weights[-1])), _programs(x, BACKWARD)
    g_x = torch.empty_like(x) if inward else None
    # One buffer holds the parts of all layers, so that a single sum adds them up.
    parts = torch.empty(programs, sum(w.numel() for w in weights), device=x.device)
    if len(x):
        network_backward[programs,](
            x, g_out, weights[0], weights[-2], weights[-1], x if g_x is None else g_x, parts, samples, *shape,
            *_wide(shape), len(weights) == 3, inward, BACKWARD.block, num_stages=1, num_warps=_warps(x.device),
        )  # fmt: skip
    gradients = parts.sum(dim=0).split([w.numel() for w in weights])
    return g_x, [g.view_as(w) for g, w in zip(gradients, weights, strict=True)]


class _Network(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Context, x: Tensor, *weights: Tensor) -> Tensor:
        ctx.save_for_backward(x, *weights)
        return forward(x, weights, len(x))

    @staticmethod
    @once_differentiable
    def backward(ctx: Context, g_out: Tensor) -> tuple[Tensor | None, ...]:
        x, *weights = ctx.saved_tensors
        g_x, gradients = backward(x, g_out.contiguous(), weights, len(x), ctx.needs_input_grad[0])
        return g_x, *gradients


@cache
def _can_run(device: torch.device) -> bool:
    """Return whether a device has tensor cores that Triton uses; its interpreter, on the CPU, needs none."""
    return device.type == "cpu" or torch.cuda.get_device_capability(device) >= AMPERE


@cache
def _warps(device: torch.device) -> int:
    """Return how many warps a program of the backward pass has."""
    return WARPS if device.type == "cpu" else warps_for(torch.cuda.get_device_capability(device))


def warps_for(capability: tuple[int, int]) -> int:
    """Return how many warps a program of the backward pass has on GPUs of a compute capability.

    >>> warps_for((9, 0)), warps_for((10, 0)), warps_for((12, 0))
    (4, 16, 4)
    """
    least, end = DATA_CENTRE_BLACKWELL
    return MORE_WARPS if least <= capability < end else WARPS


def _programs(x: Tensor, launch: Launch) -> int:
    return min(launch.programs, triton.cdiv(len(x), launch.block))


def _wide(shape: Sequence[int]) -> list[int]:
    return [max(16, triton.next_power_of_2(size)) for size in shape]
