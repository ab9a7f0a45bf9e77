"""Small networks in Triton, on tensor cores: all layers of a block of samples in one kernel, forward and backward.

Products take float16 operands and add up in float32; weights, inputs, outputs and gradients are float32 in memory.
Activations never reach it: the backward pass computes them again, which costs less than to read them.

float16 has eleven bits where bfloat16 has eight, but it ends at 65504 and fades below 6e-5. So activations stop there
instead of becoming infinite. The gradients of a loss that is a mean over thousands of pixels would all be too small:
those of a block are scaled, layer by layer, to make the largest 2^15, and the sums scaled back. Then nothing overflows,
and only what is 2^39 times smaller than a neighbour is lost.

Letters: S samples, I inputs, W width of the hidden layers, O outputs. ``WIDE_IN``, ``WIDE`` and ``WIDE_OUT`` are these
three, rounded up to a power of two of at least 16, the least that a tensor core takes; ``DEEP`` says that there are two
hidden layers and not one, and ``BLOCK`` is the samples that a program looks at together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import torch
import triton
import triton.language as tl
from torch import Tensor
from torch.autograd.function import once_differentiable

from svv.core.networks import relu_layers

WIDEST_LAYER = 64
"""Widest layer that a program takes: backward it holds the gradients of all weights at once."""

AMPERE = (8, 0)
"""Compute capability from which on Triton uses the tensor cores, and a program has the 64 KiB that it needs."""


@dataclass(frozen=True)
class Launch:
    """How a kernel is spread over the GPU."""

    block: int
    """Samples that a program looks at together."""
    programs: int
    """Programs at most; each goes over many blocks, with the weights read once."""


FORWARD = Launch(128, 1024)
BACKWARD = Launch(64, 264)
"""Two programs for each multiprocessor of the largest GPUs, each with its part of the weights' gradients. The parts are
added up in one order, so that they come out the same each time."""


@triton.jit
def half(x):  # type: ignore[no-untyped-def]
    """float16, with its largest number for what lies beyond; what is no number stays so."""
    x = tl.where(x > 65504.0, 65504.0, x)
    return tl.where(x < -65504.0, -65504.0, x).to(tl.float16)


@triton.jit
def relu(x):  # type: ignore[no-untyped-def]
    """max(x, 0); what is no number stays so."""
    return tl.where(x < 0.0, 0.0, x)


@triton.jit
def scaled(g):  # type: ignore[no-untyped-def]
    """Gradients as operands, the largest 2^15, and what to multiply their products with."""
    largest = tl.max(tl.max(tl.abs(g), axis=1), axis=0)
    unit = tl.where(largest < 1e-30, 1.0, largest * (1.0 / 32768.0))
    return (g / unit).to(tl.float16), unit


@triton.jit
def rows_of(first, end, columns, ROWS: tl.constexpr, COLUMNS: tl.constexpr):  # type: ignore[no-untyped-def]
    """Places of rows from ``first`` on in a matrix (``end``, ``columns``), and which of them there are."""
    row, column = first + tl.arange(0, ROWS), tl.arange(0, COLUMNS)
    return row.to(tl.int64)[:, None] * columns + column[None, :], (row < end)[:, None] & (column < columns)[None, :]


@triton.jit
def weights_of(weights, outputs, inputs, OUTPUTS: tl.constexpr, INPUTS: tl.constexpr):  # type: ignore[no-untyped-def]
    """A layer's weights (to, from) as operands, with zeros around them."""
    at, there = rows_of(0, outputs, inputs, OUTPUTS, INPUTS)
    return half(tl.load(weights + at, mask=there, other=0.0))


@triton.jit(do_not_specialize=["samples"])
def network(  # type: ignore[no-untyped-def]
    x, first, middle, last, out, samples, inputs, width, outputs,
    WIDE_IN: tl.constexpr, WIDE: tl.constexpr, WIDE_OUT: tl.constexpr, DEEP: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """A network of two or three layers: ``x`` (S, I) -> ``out`` (S, O).

    Weights are ``first`` (W, I), ``middle`` (W, W) and ``last`` (O, W).
    """
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
    """Gradients of :func:`network`: ``g_x`` (S, I) if ``INWARD``, and each program's part of those of the weights.

    ``parts`` (programs, W I + W W + O W), those of the middle layer only if it is there.
    """
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


def fits(x: Tensor, weights: Sequence[Tensor]) -> bool:
    """Whether the kernels take a network: one or two hidden layers of one width, at most :data:`WIDEST_LAYER`."""
    width = weights[0].shape[0]
    return (
        _has_tensor_cores(x.device)
        and len(weights) in (2, 3)
        and all(w.shape == (width, width) for w in weights[1:-1])
        and max(x.shape[1], width, weights[-1].shape[0]) <= WIDEST_LAYER
    )


def run(x: Tensor, weights: Sequence[Tensor]) -> Tensor:
    """See :meth:`svv.kernels.types.Kernels.network`; networks that do not fit run in plain torch."""
    if not fits(x, weights):
        return relu_layers(x, weights)
    return _Network.apply(x.contiguous(), *weights)


class _Network(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, *weights: Tensor) -> Tensor:
        ctx.save_for_backward(x, *weights)
        shape = len(x), x.shape[1], len(weights[0]), len(weights[-1])
        out = torch.empty(len(x), len(weights[-1]), device=x.device)
        if len(x):
            network[_programs(x, FORWARD),](
                x, weights[0], weights[-2], weights[-1], out, *shape, *_wide(shape), len(weights) == 3, FORWARD.block,
                num_stages=1,
            )  # fmt: skip
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, g_out: Tensor) -> tuple[Tensor | None, ...]:
        x, *weights = ctx.saved_tensors
        shape = len(x), x.shape[1], len(weights[0]), len(weights[-1])
        inward, programs = ctx.needs_input_grad[0], _programs(x, BACKWARD)
        g_x = torch.empty_like(x) if inward else None
        # The parts of all layers in one buffer are added up by one sum.
        parts = torch.empty(programs, sum(w.numel() for w in weights), device=x.device)
        if len(x):
            network_backward[programs,](
                x, g_out.contiguous(), weights[0], weights[-2], weights[-1], x if g_x is None else g_x, parts, *shape,
                *_wide(shape), len(weights) == 3, inward, BACKWARD.block, num_stages=1,
            )  # fmt: skip
        gradients = parts.sum(dim=0).split([w.numel() for w in weights])
        return g_x, *(g.view_as(w) for g, w in zip(gradients, weights))


@cache
def _has_tensor_cores(device: torch.device) -> bool:
    return device.type == "cpu" or torch.cuda.get_device_capability(device) >= AMPERE  # cpu: the interpreter


def _programs(x: Tensor, launch: Launch) -> int:
    return min(launch.programs, triton.cdiv(len(x), launch.block))


def _wide(shape: Sequence[int]) -> list[int]:
    return [max(16, triton.next_power_of_2(size)) for size in shape[1:]]
