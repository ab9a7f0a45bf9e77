"""Regions along rays, in Triton: one thread per ray or vertex; see :class:`svv.kernels.types.RegionKernels`.

Each adds up its samples in their order, so results are always the same. Normal equations and blurs are products of
matrices, which torch computes. Letters: S samples, R rays, V vertices, P regions, Q columns of memberships. ``BLOCK``
is the number of rays or vertices of one program, ``WIDE`` a power of two of at least P.
"""

from __future__ import annotations

import torch
import triton
import triton.language as tl
from torch import Tensor

from svv.kernels.reference_regions import blurred as blurred
from svv.kernels.reference_regions import normal_equations as normal_equations
from svv.kernels.reference_regions import normals as normals
from svv.kernels.types import RaySamples, VertexSamples

BLOCK = 32


@triton.jit(do_not_specialize=["rays", "count", "stride"])
def errors_of_rays(  # type: ignore[no-untyped-def]
    first, vertex, weight, cosine, pixel, along, kept, light, member, error, rays, count, stride,
    WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Write the errors (R, 3) of pixels, of which the part ``kept`` is left along directions (R, 3)."""
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    p = tl.arange(0, WIDE)
    there, own = r < rays, p < count
    at = tl.load(first + r, mask=there, other=0)
    end = tl.load(first + r + 1, mask=there, other=0)
    plain, lit = tl.zeros((BLOCK, WIDE), tl.float32), tl.zeros((BLOCK, WIDE), tl.float32)
    longest = tl.max(end - at, axis=0)
    k = tl.zeros_like(longest)
    while k < longest:
        going = at < end
        v = tl.load(vertex + at, mask=going, other=0)
        w = tl.load(weight + at, mask=going, other=0.0)
        c = tl.load(cosine + at, mask=going, other=0.0)
        m = tl.load(member + v[:, None] * stride + p[None, :], mask=going[:, None] & own[None, :], other=0.0)
        plain += w[:, None] * m
        lit += (w * c)[:, None] * m
        at += 1
        k += 1
    x, y, z = reflected(plain, lit, light + 6 * p, own)
    x -= tl.load(pixel + 3 * r, mask=there, other=0.0)
    y -= tl.load(pixel + 3 * r + 1, mask=there, other=0.0)
    z -= tl.load(pixel + 3 * r + 2, mask=there, other=0.0)
    ax = tl.load(along + 3 * r, mask=there, other=0.0)
    ay = tl.load(along + 3 * r + 1, mask=there, other=0.0)
    az = tl.load(along + 3 * r + 2, mask=there, other=0.0)
    less = (1.0 - kept) * (x * ax + y * ay + z * az)
    tl.store(error + 3 * r, x - less * ax, mask=there)
    tl.store(error + 3 * r + 1, y - less * ay, mask=there)
    tl.store(error + 3 * r + 2, z - less * az, mask=there)


@triton.jit
def reflected(plain, lit, light, own):  # type: ignore[no-untyped-def]
    """Return the RGB that regions reflect of both kinds of light: (BLOCK, WIDE) each -> (BLOCK,) each."""
    x = tl.sum(plain * tl.load(light, mask=own, other=0.0)[None, :]
               + lit * tl.load(light + 3, mask=own, other=0.0)[None, :], axis=1)  # fmt: skip
    y = tl.sum(plain * tl.load(light + 1, mask=own, other=0.0)[None, :]
               + lit * tl.load(light + 4, mask=own, other=0.0)[None, :], axis=1)  # fmt: skip
    z = tl.sum(plain * tl.load(light + 2, mask=own, other=0.0)[None, :]
               + lit * tl.load(light + 5, mask=own, other=0.0)[None, :], axis=1)  # fmt: skip
    return x, y, z


@triton.jit(do_not_specialize=["vertices", "count", "stride"])
def descend_at_vertices(  # type: ignore[no-untyped-def]
    first, ray, weight, lit, error, neighbours, root, least, light, step, smoothness, momentum, ahead, member,
    following, vertices, count, stride, WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Take a step of each vertex (V,); see :meth:`svv.kernels.types.RegionKernels.descend`."""
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    p = tl.arange(0, WIDE)
    there, own = i < vertices, (p < count)[None, :]
    both = there[:, None] & own
    at = tl.load(first + i, mask=there, other=0)
    end = tl.load(first + i + 1, mask=there, other=0)
    zero = tl.zeros((BLOCK,), tl.float32)
    a, b, c, d, e, f = zero, zero, zero, zero, zero, zero
    longest = tl.max(end - at, axis=0)
    k = tl.zeros_like(longest)
    while k < longest:
        going = at < end
        to = error + 3 * tl.load(ray + at, mask=going, other=0)
        w = tl.load(weight + at, mask=going, other=0.0)
        wc = tl.load(lit + at, mask=going, other=0.0)
        x, y = tl.load(to, mask=going, other=0.0), tl.load(to + 1, mask=going, other=0.0)
        z = tl.load(to + 2, mask=going, other=0.0)
        a, b, c = a + w * x, b + w * y, c + w * z
        d, e, f = d + wc * x, e + wc * y, f + wc * z
        at += 1
        k += 1
    of = light + 6 * p[None, :]
    slope = a[:, None] * tl.load(of, mask=own, other=0.0) + b[:, None] * tl.load(of + 1, mask=own, other=0.0)
    slope += c[:, None] * tl.load(of + 2, mask=own, other=0.0) + d[:, None] * tl.load(of + 3, mask=own, other=0.0)
    slope += e[:, None] * tl.load(of + 4, mask=own, other=0.0) + f[:, None] * tl.load(of + 5, mask=own, other=0.0)
    here = i[:, None] * stride + p[None, :]
    before = tl.load(ahead + here, mask=both, other=0.0)
    light_here = tl.load(root + i, mask=there, other=0.0)
    pull = tl.zeros((BLOCK, WIDE), tl.float32)
    for n in tl.static_range(6):
        m = tl.load(neighbours + 6 * i + n, mask=there, other=0)
        agree = light_here * tl.load(root + m, mask=there, other=0.0) + least
        beside = tl.load(ahead + m[:, None] * stride + p[None, :], mask=both, other=0.0)
        pull += agree[:, None] * (beside - before)
    length = tl.load(step + i, mask=there, other=0.0)[:, None]
    value = before + length * (smoothness * pull - slope)
    # Less by what they have too much each, first the mean of all, then that of those above it (Michelot 1986).
    shift = (tl.sum(tl.where(own, value, 0.0), axis=1) - 1.0) / count
    left = count - 1
    while left > 0:
        above = own & (value > shift[:, None])
        number = tl.sum(above.to(tl.float32), axis=1)
        shift = tl.maximum(shift, (tl.sum(tl.where(above, value, 0.0), axis=1) - 1.0) / tl.maximum(number, 1.0))
        left -= 1
    found = tl.maximum(value - shift[:, None], 0.0)
    last = tl.load(member + here, mask=both, other=0.0)
    tl.store(following + here, found + momentum * (found - last), mask=both)
    tl.store(member + here, found, mask=both)


def errors(seen: RaySamples, kept: float, light: Tensor, member: Tensor) -> Tensor:
    error, rays = torch.empty_like(seen.pixel), len(seen.pixel)
    if rays:
        errors_of_rays[(triton.cdiv(rays, BLOCK),)](
            seen.first, seen.vertex, seen.weight, seen.cosine, seen.pixel, seen.along, kept, light, member, error, rays,
            len(light), member.shape[1], triton.next_power_of_2(len(light)), BLOCK, num_warps=1,
        )  # fmt: skip
    return error


def descend(
    near: VertexSamples, error: Tensor, light: Tensor, step: Tensor, pace: tuple[float, float], ahead: Tensor,
    member: Tensor, following: Tensor,
) -> None:  # fmt: skip
    vertices = len(member)
    descend_at_vertices[(triton.cdiv(vertices, BLOCK),)](
        near.first, near.ray, near.weight, near.lit, error, near.neighbours, near.root, near.least, light, step, *pace,
        ahead, member, following, vertices, len(light), member.shape[1], triton.next_power_of_2(len(light)), BLOCK,
        num_warps=1,
    )  # fmt: skip
