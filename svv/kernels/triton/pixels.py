"""Pixels of training rays, drawn in Triton. :class:`svv.train.run.pixels.Pixels` describes what is drawn."""

from __future__ import annotations

import triton
import triton.language as tl

from svv.kernels.triton.rays import uniform


@triton.jit(do_not_specialize=["seed", "first_ray", "total", "pixels", "weight", "shown", "rays"])
def draw(  # type: ignore[no-untyped-def]
    index, levels, first, ends, shares, seed, first_ray, total, pixels, weight, shown, rays,
    STEPS: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Draw the pixels of a batch's rays, of ``total`` in all, from number ``first_ray`` on; ``seed`` (1,) int32.

    ``index`` (N,) int32: pixels by their contrast; ``levels`` (pixels, 4) uint8; ``first`` (STEPS + 1,) int64: where
    each step of contrast begins in ``index``; ``ends`` (STEPS + 1,) float64: the same, weighted by the ``shares``
    (STEPS,) float64 with which its pixels are drawn. Writes ``pixels`` (R,) int64, ``weight`` (R,), ``shown`` (R, 4).
    """
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = i < rays
    ray, none = first_ray + i, tl.zeros_like(i)
    number = tl.load(seed)
    fine = uniform(number, ray, none - 2).to(tl.float64)
    where = (uniform(number, ray, none - 1).to(tl.float64) + fine * (1.0 / 16777216.0)) * tl.load(ends + STEPS)
    step = none
    for k in tl.static_range(1, STEPS):
        step += (where >= tl.load(ends + k)).to(tl.int32)
    share = tl.load(shares + step)
    begin, last = tl.load(first + step), tl.load(first + step + 1) - 1
    place = begin + ((where - tl.load(ends + step)) / share).to(tl.int64)
    pixel = tl.load(index + tl.maximum(tl.minimum(place, last), 0), mask=there, other=0).to(tl.int64)
    alpha = tl.load(levels + 4 * pixel + 3, mask=there, other=0).to(tl.float32) / 255.0
    for k in tl.static_range(3):
        level = tl.load(levels + 4 * pixel + k, mask=there, other=0).to(tl.float32) / 255.0
        tl.store(shown + 4 * i + k, level * alpha, mask=there)
    tl.store(shown + 4 * i + 3, alpha, mask=there)
    tl.store(pixels + i, pixel, mask=there)
    tl.store(weight + i, (1.0 / (share * total)).to(tl.float32), mask=there)
