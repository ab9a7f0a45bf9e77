"""What a training step computes between the networks, compositing and the optimiser, in Triton: one operation each.

Letters: S samples, R rays, P palette colours, C channels. ``BLOCK`` is the number of samples or rays of one program.
"""

from __future__ import annotations

import torch
import triton
import triton.language as tl
from torch import Tensor
from torch.autograd.function import once_differentiable

from svv.kernels.triton.image import softplus
from svv.kernels.triton.tables import known
from svv.kernels.types import Context

BLOCK = 128


@triton.jit
def rising(x):  # type: ignore[no-untyped-def]
    """Return the derivative of softplus."""
    return 1.0 / (1.0 + tl.exp(-tl.maximum(x, -80.0)))


@triton.jit(do_not_specialize=["raw", "light", "colours", "samples", "count", "values"])
def mix(  # type: ignore[no-untyped-def]
    raw, light, colours, bright, gleam, floor, values, samples, count, OUTPUTS: tl.constexpr,
    BLOCK: tl.constexpr,
):  # fmt: skip
    """Write colours and penalties (S, 6) of samples (equation 4).

    The penalties: squared offsets, squared deviation of the shade from 1, and 1 minus the sum of squared weights.
    """
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = i < known(samples)
    at = raw + i * (1 + 4 * count)
    zero = tl.zeros((BLOCK,), tl.float32)
    red, green, blue, total, squares, offsets = zero, zero, zero, zero, zero, zero
    for p in range(count):
        w = softplus(tl.load(at + 1 + p, mask=there, other=0.0)) + floor
        moved = at + 1 + count + 3 * p
        r, g = tl.load(moved, mask=there, other=0.0), tl.load(moved + 1, mask=there, other=0.0)
        b = tl.load(moved + 2, mask=there, other=0.0)
        red += w * (tl.load(colours + 3 * p) + r)
        green += w * (tl.load(colours + 3 * p + 1) + g)
        blue += w * (tl.load(colours + 3 * p + 2) + b)
        total += w
        squares += w * w
        offsets += r * r + g * g + b * b
    scale = softplus(tl.load(at, mask=there, other=0.0) + bright) / total
    specular = softplus(tl.load(light + OUTPUTS * i, mask=there, other=0.0) + gleam)
    shade = zero + 1.0
    if OUTPUTS > 1:
        shade = 2.0 / (1.0 + tl.exp(-tl.load(light + OUTPUTS * i + 1, mask=there, other=0.0)))
    to = values + 6 * i
    tl.store(to, shade * scale * red + specular, mask=there)
    tl.store(to + 1, shade * scale * green + specular, mask=there)
    tl.store(to + 2, shade * scale * blue + specular, mask=there)
    tl.store(to + 3, offsets, mask=there)
    tl.store(to + 4, (shade - 1.0) * (shade - 1.0), mask=there)
    tl.store(to + 5, 1.0 - squares / (total * total), mask=there)


@triton.jit(
    do_not_specialize=["raw", "light", "colours", "g_values", "owner", "number", "g_raw", "g_light", "parts", "samples",
                       "count"]
)  # fmt: skip
def mix_backward(  # type: ignore[no-untyped-def]
    raw, light, colours, bright, gleam, floor, g_values, owner, number, foreign, g_raw, g_light, parts, samples,
    count, OUTPUTS: tl.constexpr, OWNED: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Write the gradients of :func:`mix`; ``parts`` (programs, P, 3): those of the colours from each program.

    If samples are ``OWNED`` by a region, ``owner`` (S,), the logarithm of their weight of it counts ``-foreign``,
    averaged over the ``number`` (P,) of samples of each region.
    """
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = i < known(samples)
    at, back = raw + i * (1 + 4 * count), g_raw + i * (1 + 4 * count)
    zero = tl.zeros((BLOCK,), tl.float32)
    red, green, blue, total = zero, zero, zero, zero
    for p in range(count):
        w = softplus(tl.load(at + 1 + p, mask=there, other=0.0)) + floor
        moved = at + 1 + count + 3 * p
        red += w * (tl.load(colours + 3 * p) + tl.load(moved, mask=there, other=0.0))
        green += w * (tl.load(colours + 3 * p + 1) + tl.load(moved + 1, mask=there, other=0.0))
        blue += w * (tl.load(colours + 3 * p + 2) + tl.load(moved + 2, mask=there, other=0.0))
        total += w
    red, green, blue = red / total, green / total, blue / total
    first = tl.load(at, mask=there, other=0.0) + bright
    intensity = softplus(first)
    to = g_values + 6 * i
    g0, g1 = tl.load(to, mask=there, other=0.0), tl.load(to + 1, mask=there, other=0.0)
    g2, g_offsets = tl.load(to + 2, mask=there, other=0.0), tl.load(to + 3, mask=there, other=0.0)
    g_shade, g_mixed = tl.load(to + 4, mask=there, other=0.0), tl.load(to + 5, mask=there, other=0.0)
    glossy = tl.load(light + OUTPUTS * i, mask=there, other=0.0) + gleam
    tl.store(g_light + OUTPUTS * i, (g0 + g1 + g2) * rising(glossy), mask=there)
    along = g0 * red + g1 * green + g2 * blue
    shade = zero + 1.0
    if OUTPUTS > 1:
        shade = 2.0 / (1.0 + tl.exp(-tl.load(light + OUTPUTS * i + 1, mask=there, other=0.0)))
        g_shade = intensity * along + 2.0 * (shade - 1.0) * g_shade
        tl.store(g_light + OUTPUTS * i + 1, g_shade * shade * (1.0 - 0.5 * shade), mask=there)
    tl.store(back, shade * along * rising(first), mask=there)
    bright_shade = intensity * shade
    g0, g1, g2 = g0 * bright_shade, g1 * bright_shade, g2 * bright_shade
    mean = zero
    if OWNED:
        own_region = tl.load(owner + i, mask=there, other=-1)
    for p in range(count):
        w = (softplus(tl.load(at + 1 + p, mask=there, other=0.0)) + floor) / total
        moved = at + 1 + count + 3 * p
        r, g = tl.load(moved, mask=there, other=0.0), tl.load(moved + 1, mask=there, other=0.0)
        b = tl.load(moved + 2, mask=there, other=0.0)
        tl.store(back + 1 + count + 3 * p, w * g0 + 2.0 * g_offsets * r, mask=there)
        tl.store(back + 2 + count + 3 * p, w * g1 + 2.0 * g_offsets * g, mask=there)
        tl.store(back + 3 + count + 3 * p, w * g2 + 2.0 * g_offsets * b, mask=there)
        own = parts + (tl.program_id(0) * count + p) * 3
        tl.store(own, tl.sum(w * g0, axis=0))
        tl.store(own + 1, tl.sum(w * g1, axis=0))
        tl.store(own + 2, tl.sum(w * g2, axis=0))
        slope = g0 * (tl.load(colours + 3 * p) + r) + g1 * (tl.load(colours + 3 * p + 1) + g)
        slope += g2 * (tl.load(colours + 3 * p + 2) + b) - 2.0 * g_mixed * w
        if OWNED:
            slope -= tl.where(own_region == p, foreign / (tl.maximum(tl.load(number + p), 1).to(tl.float32) * w), 0.0)
        mean += slope * w
        tl.store(back + 1 + p, slope, mask=there)
    for p in range(count):
        x = tl.load(at + 1 + p, mask=there, other=0.0)
        slope = tl.load(back + 1 + p, mask=there, other=0.0)
        tl.store(back + 1 + p, (slope - mean) / total * rising(x), mask=there)


@triton.jit(do_not_specialize=["owner", "number", "samples", "count"])
def count_owned(owner, number, samples, count, BLOCK: tl.constexpr):  # type: ignore[no-untyped-def]
    """Add how many samples each region owns to ``number`` (P,), whose regions are ``owner`` (S,)."""
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    own_region = tl.load(owner + i, mask=i < known(samples), other=-1)
    for p in range(count):
        tl.atomic_add(number + p, tl.sum((own_region == p).to(tl.int64), axis=0), sem="relaxed")


@triton.jit(do_not_specialize=["out", "transmittance", "shown", "weight", "each", "g_out", "g_transmittance", "parts",
                               "rays", "channels"])  # fmt: skip
def error(  # type: ignore[no-untyped-def]
    out, transmittance, shown, weight, each, g_out, g_transmittance, parts, rays, channels,
    ALPHA: tl.constexpr, WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Write each program's part of the loss and of the mean squared error, ``parts`` (programs, 2), and the gradients.

    The first three channels of ``out`` (R, C) are colours, whose squared difference from ``shown`` (R, 4) counts; the
    others count themselves; with ``ALPHA`` so does the squared difference of 1 - ``transmittance`` from alpha. ``each``
    (C + 1,): what each channel and alpha weigh.
    """
    r = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    c = tl.arange(0, WIDE)
    there = r < rays
    both = there[:, None] & (c < channels)[None, :]
    seen = there[:, None] & (c < 3)[None, :]
    w = tl.load(weight + r, mask=there, other=0.0)
    factor = tl.load(each + c, mask=c < channels, other=0.0)
    value = tl.load(out + r[:, None] * channels + c[None, :], mask=both, other=0.0)
    value -= tl.load(shown + 4 * r[:, None] + c[None, :], mask=seen, other=0.0)
    is_colour = (c < 3)[None, :]
    missing = tl.where(is_colour, value * value, value) * w[:, None]
    slope = tl.where(is_colour, 2.0 * value, 1.0) * w[:, None] * factor[None, :]
    tl.store(g_out + r[:, None] * channels + c[None, :], slope, mask=both)
    loss = tl.sum(tl.sum(missing * factor[None, :], axis=1), axis=0)
    squared = tl.sum(tl.sum(tl.where(is_colour, missing, 0.0), axis=1), axis=0)
    if ALPHA:
        apart = 1.0 - tl.load(transmittance + r, mask=there, other=0.0)
        apart -= tl.load(shown + 4 * r + 3, mask=there, other=0.0)
        counts = tl.load(each + channels) * w
        loss += tl.sum(counts * apart * apart, axis=0)
        tl.store(g_transmittance + r, -2.0 * counts * apart, mask=there)
    else:
        tl.store(g_transmittance + r, tl.zeros((BLOCK,), tl.float32), mask=there)
    tl.store(parts + 2 * tl.program_id(0), loss)
    tl.store(parts + 2 * tl.program_id(0) + 1, squared / 3.0)


def loss(
    out: Tensor, transmittance: Tensor, shown: Tensor, weight: Tensor, each: Tensor, alpha: bool
) -> tuple[Tensor, Tensor]:
    """Return the loss and the mean squared error of colour; see :class:`svv.kernels.types.TrainingKernels`."""
    return _Loss.apply(out.contiguous(), transmittance, shown, weight, each, alpha)


class _Losing(Context):
    alpha: bool


class _Loss(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: _Losing, out: Tensor, transmittance: Tensor, shown: Tensor, weight: Tensor, each: Tensor, alpha: bool
    ) -> tuple[Tensor, Tensor]:
        rays, channels = out.shape
        programs = triton.cdiv(rays, BLOCK)
        g_out, g_transmittance = torch.empty_like(out), torch.empty_like(transmittance)
        parts = torch.empty(programs, 2, device=out.device)
        if rays:
            error[(programs,)](
                out, transmittance, shown, weight, each, g_out, g_transmittance, parts, rays, channels, alpha,
                triton.next_power_of_2(max(channels, 4)), BLOCK,
            )  # fmt: skip
        ctx.save_for_backward(g_out, g_transmittance)
        ctx.alpha = alpha
        found, squared = parts.sum(dim=0).unbind()
        ctx.mark_non_differentiable(squared)
        ctx.set_materialize_grads(False)
        return found, squared

    @staticmethod
    @once_differentiable
    def backward(ctx: _Losing, g: Tensor | None, _: None) -> tuple[Tensor | None, ...]:
        if g is None:
            return None, None, None, None, None, None
        g_out, g_transmittance = ctx.saved_tensors
        behind = g_transmittance * g if ctx.alpha else None  # without alpha, nothing depends on it
        return g_out * g, behind, None, None, None, None
