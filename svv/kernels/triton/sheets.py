"""Sheets of samples along rays, in Triton; :mod:`svv.kernels.numba.sheets` describes what each function computes.

Letters: R rays, S samples, G painted regions, P sheets. ``BLOCK`` is the number of rays or samples of one program. The
number of sheets stays on the GPU, in ``ends``.
"""

from __future__ import annotations

import triton
import triton.language as tl

from svv.core.rays.sheets import LEAST

LEAST_WEIGHT = tl.constexpr(LEAST)
FAR = tl.constexpr(1e30)


@triton.jit(
    do_not_specialize=[
        "position",
        "sigma",
        "skipped",
        "start",
        "count",
        "region",
        "rays",
        "number",
        "ends",
        "own",
        "where",
    ]
)
def sheets(  # type: ignore[no-untyped-def]
    position, sigma, skipped, step, start, count, region, chosen, apart, rays, number, ends, own, where,
    WRITES: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Count the sheets of one region on each ray, ``number`` (G, R), or write each sample's, ``own`` (S,).

    ``chosen`` (G,): regions that have sheets; ``apart`` (G,) float64: gap that separates them; ``ends`` (G, R):
    number of sheets up to and with those of each ray, region by region; ``where`` (P, 3) receives their mean positions.
    """
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    g = tl.program_id(1)
    there = r < rays
    k, gap = tl.load(chosen + g), tl.load(apart + g)
    gap = gap * gap
    first = tl.load(start + r, mask=there, other=0)
    length = tl.load(count + r, mask=there, other=0)
    row = g.to(tl.int64) * rays + r
    sheet = tl.zeros((BLOCK,), tl.int64) - 1
    if WRITES:
        sheet += tl.load(ends + row, mask=there, other=0) - tl.load(number + row, mask=there, other=0)
    far, none = tl.full((BLOCK,), FAR, tl.float32), tl.zeros((BLOCK,), tl.float64)
    lx, ly, lz = far, far, far
    sx, sy, sz, total = none, none, none, none
    left = tl.full((BLOCK,), 1.0, tl.float32)
    found = tl.zeros((BLOCK,), tl.int32)
    j = tl.zeros((), tl.int64)
    longest = tl.max(length, axis=0)
    while j < longest:
        at, going = first + j, j < length
        mine = going & (tl.load(region + at, mask=going, other=-1) == k)
        x = tl.load(position + 3 * at, mask=mine, other=0.0)
        y = tl.load(position + 3 * at + 1, mask=mine, other=0.0)
        z = tl.load(position + 3 * at + 2, mask=mine, other=0.0)
        dx, dy, dz = x.to(tl.float64) - lx, y.to(tl.float64) - ly, z.to(tl.float64) - lz
        parted = mine & ((found == 0) | (dx * dx + dy * dy + dz * dz > gap))
        if WRITES:
            left *= tl.exp(-tl.load(skipped + at, mask=going, other=0.0))
            through = tl.exp(-tl.load(sigma + at, mask=going, other=0.0) * step)
            weight = (left * (1.0 - through)).to(tl.float64) + LEAST_WEIGHT
            left *= through
            done = parted & (found > 0)
            tl.store(where + 3 * sheet, (sx / tl.maximum(total, LEAST_WEIGHT)).to(tl.float32), mask=done)
            tl.store(where + 3 * sheet + 1, (sy / tl.maximum(total, LEAST_WEIGHT)).to(tl.float32), mask=done)
            tl.store(where + 3 * sheet + 2, (sz / tl.maximum(total, LEAST_WEIGHT)).to(tl.float32), mask=done)
            weight = tl.where(mine, weight, 0.0)
            sx = tl.where(parted, 0.0, sx) + weight * x
            sy = tl.where(parted, 0.0, sy) + weight * y
            sz = tl.where(parted, 0.0, sz) + weight * z
            total = tl.where(parted, 0.0, total) + weight
            sheet += parted.to(tl.int64)
            tl.store(own + at, sheet, mask=mine)
        found += parted.to(tl.int32)
        lx, ly, lz = tl.where(mine, x, lx), tl.where(mine, y, ly), tl.where(mine, z, lz)
        j += 1
    if WRITES:
        done = found > 0
        tl.store(where + 3 * sheet, (sx / tl.maximum(total, LEAST_WEIGHT)).to(tl.float32), mask=done)
        tl.store(where + 3 * sheet + 1, (sy / tl.maximum(total, LEAST_WEIGHT)).to(tl.float32), mask=done)
        tl.store(where + 3 * sheet + 2, (sz / tl.maximum(total, LEAST_WEIGHT)).to(tl.float32), mask=done)
    else:
        tl.store(number + row, found, mask=there)


@triton.jit(do_not_specialize=["own", "region", "covered", "below", "out", "samples"])
def cover(own, region, covered, below, out, samples, FLAT: tl.constexpr, BLOCK: tl.constexpr):  # type: ignore[no-untyped-def]
    """Lay the paint of sheets, ``covered`` (P, 4), over the colours of their samples.

    ``own`` (S,): sheet of each sample, -1 for none. ``below``: colours of the samples (S, 3), or with ``FLAT`` those of
    their regions (G, 3).
    """
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = i < samples
    sheet = tl.load(own + i, mask=there, other=-1)
    painted = there & (sheet >= 0)
    left = 1.0 - tl.load(covered + 4 * sheet + 3, mask=painted, other=0.0)
    row = i
    if FLAT:
        row = tl.load(region + i, mask=there, other=0)
    for channel in tl.static_range(3):
        colour = tl.load(below + 3 * row + channel, mask=there, other=0.0)
        laid = tl.load(covered + 4 * sheet + channel, mask=painted, other=0.0)
        tl.store(out + 3 * i + channel, laid + left * colour, mask=there)
