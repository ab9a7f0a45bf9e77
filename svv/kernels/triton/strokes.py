"""Paint of brush strokes in images, in Triton: strokes at places, and the ground among them.

:mod:`svv.kernels.numba.strokes` describes what each function computes. Letters: P places, K points of strokes, N
strokes. ``BLOCK`` is the number of places of one program. The number of places stays on the GPU, in ``ends``
(:mod:`svv.kernels.triton.sheets`): programs beyond it have nothing to do.
"""

from __future__ import annotations

import triton
import triton.language as tl

from svv.core.strokes import strokes as marks

LAST = tl.constexpr(len(marks.NOISE) - 1)
SPREAD0, SPREAD1, SPREAD2 = (tl.constexpr(factor) for factor in marks.SPREAD)
SIDES, END, PHASE, COARSE, FINE, MIXED, PAPER = (
    tl.constexpr(marks.USES[name]) for name in ("sides", "end", "phase", "coarse", "fine", "mixed", "paper")
)
FADES, FINER, LEAST_PIGMENT, OPAQUE, SHRUNK = (
    tl.constexpr(value) for value in (marks.FADES, marks.FINER, marks.LEAST_PIGMENT, marks.OPAQUE, marks.SHRUNK)
)
STEEP, WAVE, WAVY, WET = (tl.constexpr(value) for value in (marks.STEEP, marks.WAVE, marks.WAVY, marks.WET))

FAR = tl.constexpr(1e30)


@triton.jit
def unit(x):  # type: ignore[no-untyped-def]
    """Return x, at least 0 and at most 1."""
    return tl.minimum(tl.maximum(x, 0.0), 1.0)


@triton.jit
def noise_at(noise, x, first):  # type: ignore[no-untyped-def]
    """Return smooth noise in [-1, 1] at x, for a sequence."""
    low = tl.floor(x)
    part = x - low
    part = part * part * (3.0 - 2.0 * part)
    index = low.to(tl.int32) + first
    left, right = tl.load(noise + (index & LAST)), tl.load(noise + ((index + 1) & LAST))
    return left + (right - left) * part


@triton.jit
def rough(noise, x, y, z, first):  # type: ignore[no-untyped-def]
    """Return smooth noise in [-1, 1] at places, with one value for each unit cube, for a sequence."""
    a, b, c = tl.floor(x), tl.floor(y), tl.floor(z)
    x, y, z = x - a, y - b, z - c
    x, y, z = x * x * (3.0 - 2.0 * x), y * y * (3.0 - 2.0 * y), z * z * (3.0 - 2.0 * z)
    i, j, k = a.to(tl.int64), b.to(tl.int64), c.to(tl.int64)
    total = tl.zeros_like(x)
    for corner in tl.static_range(4):
        hashed = ((i + (corner >> 1)) * SPREAD0) ^ ((j + (corner & 1)) * SPREAD1)
        low = tl.load(noise + (((hashed ^ (k * SPREAD2)) + first) & LAST))
        high = tl.load(noise + (((hashed ^ ((k + 1) * SPREAD2)) + first) & LAST))
        share = (x if corner & 2 else 1.0 - x) * (y if corner & 1 else 1.0 - y)
        total += share * (low + (high - low) * z)
    return total


@triton.jit
def twice(noise, x, y, z, size, soft, first):  # type: ignore[no-untyped-def]
    """Return noise of two octaves, of ``size`` and half of it, which fade if finer than ``soft``."""
    half = 0.5 * size
    found = unit(size / soft - 0.5) * rough(noise, x / size, y / size, z / size, first)
    again = rough(noise, x / half + 0.37, y / half + 0.37, z / half + 0.37, first + 77)
    return found + 0.5 * unit(half / soft - 0.5) * again


@triton.jit
def over(colour, alpha, gain, density, body, left, total):  # type: ignore[no-untyped-def]
    """Lay one channel of a colour under what is above: returns what that lets through, and the sum of paint."""
    kept = 1.0 - alpha
    if body < 1.0:
        kept += alpha * (1.0 - body) * tl.exp(density * tl.log(tl.maximum(colour, 1e-30)))
    lighter = colour + gain * (0.6 * (1.0 - colour) + 0.3 * colour)
    shown = unit(tl.where(gain < 0.0, colour * (1.0 + gain), lighter))
    return left * kept, total + left * shown * alpha * body


@triton.jit(do_not_specialize=["place", "before", "until", "size"])
def paint(  # type: ignore[no-untyped-def]  # long: one loop, whose state is registers
    place, ends, before, until, size, start, entries, of, around, points, strokes, seeds, noise, look, out,
    WASHES: tl.constexpr, TOOTH: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Compute the paint at places (P, 3); ``out`` (P, 4) receives colour times coverage, and coverage.

    The places are those from number ends[before] (0 if that is negative) to ends[until]. The other arguments are those
    of :class:`svv.kernels.types.StrokeTables`. ``WASHES``: whether any brush is wet; ``TOOTH``: whether paper shows.
    """
    begin = tl.load(ends + before, mask=before >= 0, other=0)
    p = begin + tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    there = p < tl.load(ends + until)
    relief, dry, mixed, rim = tl.load(look), tl.load(look + 1), tl.load(look + 2), tl.load(look + 3)
    body, grain, tooth, flow = tl.load(look + 4), tl.load(look + 5), tl.load(look + 6), tl.load(look + 7)
    feather, blunt, lift, ragged = tl.load(look + 8), tl.load(look + 9), tl.load(look + 10), tl.load(look + 11)
    run_size, sharp, soft, side = tl.load(look + 12), tl.load(look + 13), tl.load(look + 14), tl.load(look + 15)
    light0, light1, light2 = tl.load(look + 16), tl.load(look + 17), tl.load(look + 18)
    px = tl.load(place + 3 * p, mask=there, other=0.0)
    py = tl.load(place + 3 * p + 1, mask=there, other=0.0)
    pz = tl.load(place + 3 * p + 2, mask=there, other=0.0)
    a = tl.minimum(tl.maximum((px / side).to(tl.int32), 0), size - 1)
    b = tl.minimum(tl.maximum((py / side).to(tl.int32), 0), size - 1)
    c = tl.minimum(tl.maximum((pz / side).to(tl.int32), 0), size - 1)
    cell = (a * size + b) * size + c
    i = tl.load(start + cell, mask=there, other=0)
    last = tl.load(start + cell + 1, mask=there, other=0)
    zero = tl.zeros((BLOCK,), tl.float32)
    one = zero + 1.0
    bare, left0, left1, left2 = one, one, one, one
    red, green, blue, nearer, paper = zero, zero, zero, zero, zero
    wash, weights, deepest, covers, runs, c0, c1, c2 = zero, zero, zero, zero, zero, zero, zero, zero
    if TOOTH:
        paper = twice(noise, px, py, pz, tooth, soft, PAPER)
    going = there & (i < last)
    while tl.max(going.to(tl.int32), axis=0) > 0:
        # The nearest point of the next stroke: of equally near ones the first, which is the last one visited.
        q = tl.load(of + tl.load(entries + i, mask=going, other=0), mask=going, other=0)
        best = zero + FAR
        nearest = tl.zeros((BLOCK,), tl.int32) - 1
        along_it, across_it, above = zero, zero, zero
        searching = going
        while tl.max(searching.to(tl.int32), axis=0) > 0:
            k = tl.load(entries + i, mask=searching, other=0)
            searching = searching & (tl.load(of + k, mask=searching, other=-1) == q)
            i += searching.to(tl.int64)
            at = around + 16 * k
            x = px - tl.load(at, mask=searching, other=0.0)
            y = py - tl.load(at + 1, mask=searching, other=0.0)
            z = pz - tl.load(at + 2, mask=searching, other=0.0)
            height = x * tl.load(at + 3, mask=searching, other=0.0) + y * tl.load(at + 4, mask=searching, other=0.0)
            height += z * tl.load(at + 5, mask=searching, other=0.0)
            near = searching & (height <= tl.load(at + 6, mask=searching, other=0.0))
            near = near & (height >= tl.load(at + 7, mask=searching, other=0.0))
            along = x * tl.load(at + 8, mask=near, other=0.0) + y * tl.load(at + 9, mask=near, other=0.0)
            along += z * tl.load(at + 10, mask=near, other=0.0)
            reach = tl.load(at + 11, mask=near, other=0.0)
            near = near & (tl.abs(along) < reach)
            across = x * tl.load(at + 12, mask=near, other=0.0) + y * tl.load(at + 13, mask=near, other=0.0)
            across += z * tl.load(at + 14, mask=near, other=0.0)
            across -= tl.load(at + 15, mask=near, other=0.0) * along * along
            away = along * along + across * across
            near = near & (tl.abs(across) < 0.5 * reach) & (away <= best)
            best = tl.where(near, away, best)
            nearest = tl.where(near, k, nearest)
            along_it, across_it = tl.where(near, along, along_it), tl.where(near, across, across_it)
            above = tl.where(near, height, above)
            searching = searching & (i < last)
        hit = nearest >= 0
        going = going & (i < last)
        if tl.max(hit.to(tl.int32), axis=0) > 0:
            at = points + 3 * nearest
            r = tl.load(at + 2, mask=hit, other=1.0) + tl.load(at + 1, mask=hit, other=0.0) * along_it
            r = tl.maximum(r, 1e-6)
            u, v = along_it + tl.load(at, mask=hit, other=0.0), across_it
            row = strokes + 8 * q
            bristles = tl.load(row + 6, mask=hit, other=1.0)
            length = tl.load(row + 7, mask=hit, other=1.0)
            first = tl.load(seeds + q, mask=hit, other=0)
            wet = bristles < WET
            run, shrunk = zero, zero
            if WASHES:
                if flow > 0.0:
                    run = tl.where(wet, twice(noise, px, py, pz, run_size, soft, first), 0.0)
                    shrunk = tl.where(wet, flow * SHRUNK * unit(0.5 + 1.2 * run), 0.0)
            wide = r * (1.0 + noise_at(noise, u * WAVE / r, first + SIDES) * WAVY) * (1.0 - shrunk)
            set_down = tl.minimum(u / r + 1.0 - shrunk, 1.0)
            lifted = (length - u) / r + 1.0 - shrunk + ragged * noise_at(noise, 2.5 * v / r + 7.3, first + END)
            lifted = tl.minimum(lifted / lift, 1.0)
            begins, ends_so = set_down * (2.0 - set_down), lifted * (1.0 + blunt * (1.0 - lifted))
            taper = tl.maximum(tl.minimum(begins, ends_so), 0.0)
            edge = wide * tl.sqrt(taper) - tl.abs(v)
            alpha = unit(0.5 + (edge - 0.5 * feather * r) / (soft + feather * r))
            limit = tl.where(above > 0.0, 6, 7)
            deep = above / tl.load(around + 16 * nearest + limit, mask=hit, other=1.0)
            fade = tl.minimum((1.0 - deep) / FADES, 1.0)
            hit = hit & (set_down > 0.0) & (lifted > 0.0) & (alpha > 0.0) & (fade > 0.0)
            part = unit(u / tl.maximum(length, 1e-6))
            # The marks of bristles.
            n = tl.maximum(bristles, WET)
            x = v / wide + 0.2 * noise_at(noise, 0.3 * u / r, first + PHASE)
            coarse, fine = unit(r / (n * soft) - 0.5), unit(r / (n * FINER * soft) - 0.5)
            lines = coarse * noise_at(noise, n * x, first + COARSE)
            lines += 0.5 * fine * noise_at(noise, n * FINER * x, first + FINE)
            slope = noise_at(noise, n * x + 0.3, first + COARSE) - noise_at(noise, n * x - 0.3, first + COARSE)
            gaps = unit(dry * (0.25 + part) * (0.5 - lines - grain * paper * STEEP))
            streak = unit(0.5 + 0.8 * noise_at(noise, 0.6 * n * x + 17.0, first + MIXED))
            if WASHES:
                gaps = tl.where(wet, 0.0, gaps)
                streak = tl.where(wet, unit(0.5 + 1.2 * run), streak)
            alpha *= 1.0 - gaps
            if TOOTH:
                alpha = tl.maximum(alpha - grain * body * unit(0.5 + paper * STEEP), 0.0)
            hit = hit & (alpha > 0.0)
            nearer = tl.where(hit, tl.maximum(nearer, fade), nearer)
            alpha = tl.where(hit, alpha * fade, 0.0)
            if WASHES:
                ended = hit & (weights > 0.0) & (bristles != wash)  # what is above has been another wash
                dark = rim * tl.exp(-deepest / sharp)
                # Without a wash, its sums are those of the last one: divided by nothing, they would be infinite.
                whole = tl.where(weights > 0.0, weights, 1.0)
                density = tl.maximum(1.0 + dark + flow * runs / whole + grain * paper, LEAST_PIGMENT)
                share = tl.where(ended, covers, 0.0)
                left0, red = over(c0 / whole, share, -dark, density, body, left0, red)
                left1, green = over(c1 / whole, share, -dark, density, body, left1, green)
                left2, blue = over(c2 / whole, share, -dark, density, body, left2, blue)
                bare *= 1.0 - share
                weights = tl.where(ended, 0.0, weights)
            streak *= mixed
            value0, value1 = tl.load(row, mask=hit, other=0.0), tl.load(row + 1, mask=hit, other=0.0)
            value2 = tl.load(row + 2, mask=hit, other=0.0)
            value0 += streak * (tl.load(row + 3, mask=hit, other=0.0) - value0)
            value1 += streak * (tl.load(row + 4, mask=hit, other=0.0) - value1)
            value2 += streak * (tl.load(row + 5, mask=hit, other=0.0) - value2)
            if WASHES:
                rate = tl.where(begins < ends_so, 2.0 - 2.0 * set_down, (1.0 + blunt * (1.0 - 2.0 * lifted)) / lift)
                rate = tl.where(taper < 1.0, rate / r, 0.0)
                steep = tl.sqrt(rate * rate + (2.0 * v / (wide * wide)) * (2.0 * v / (wide * wide)))
                inside = tl.maximum(taper - (v / wide) * (v / wide), 0.0) / tl.maximum(steep, 1.0 / wide)
                near_rim = tl.minimum(inside / r, 1.0)
                flows = hit & wet
                weight = tl.where(flows, alpha * (near_rim * near_rim + 0.01), 0.0)
                begun = flows & (weights <= 0.0)
                wash = tl.where(begun, bristles, wash)
                deepest, covers = tl.where(begun, 0.0, deepest), tl.where(begun, 0.0, covers)
                runs, c0 = tl.where(begun, 0.0, runs), tl.where(begun, 0.0, c0)
                c1, c2 = tl.where(begun, 0.0, c1), tl.where(begun, 0.0, c2)
                weights += weight
                runs += weight * run
                c0, c1, c2 = c0 + weight * value0, c1 + weight * value1, c2 + weight * value2
                deepest = tl.where(flows, tl.maximum(deepest, inside), deepest)
                covers = tl.where(flows, tl.maximum(covers, alpha), covers)
                alpha = tl.where(wet, 0.0, alpha)
            turned = unit((tl.abs(v) / wide - 0.45) / 0.55)
            turned = tl.where(v > 0.0, turned, -turned)
            at = around + 16 * nearest
            toward = light0 * tl.load(at + 12, mask=hit, other=0.0) + light1 * tl.load(at + 13, mask=hit, other=0.0)
            toward += light2 * tl.load(at + 14, mask=hit, other=0.0)
            gain = relief * (toward * (0.7 * turned - 0.6 * coarse * slope) + 0.35 * lines)
            density = tl.maximum(1.0 + grain * paper, LEAST_PIGMENT)
            left0, red = over(value0, alpha, gain, density, body, left0, red)
            left1, green = over(value1, alpha, gain, density, body, left1, green)
            left2, blue = over(value2, alpha, gain, density, body, left2, blue)
            bare *= 1.0 - alpha
            going = going & (tl.maximum(left0, tl.maximum(left1, left2)) > 1.0 - OPAQUE)
    if WASHES:
        dark = rim * tl.exp(-deepest / sharp)
        whole = tl.where(weights > 0.0, weights, 1.0)
        density = tl.maximum(1.0 + dark + flow * runs / whole + grain * paper, LEAST_PIGMENT)
        share = tl.where(weights > 0.0, covers, 0.0)
        left0, red = over(c0 / whole, share, -dark, density, body, left0, red)
        left1, green = over(c1 / whole, share, -dark, density, body, left1, green)
        left2, blue = over(c2 / whole, share, -dark, density, body, left2, blue)
        bare *= 1.0 - share
    cover = 1.0 - bare
    whole = tl.minimum(cover / tl.maximum(nearer, 1e-6), 1.0)
    scale = whole / tl.maximum(cover, 1e-6)
    tl.store(out + 4 * p, scale * (red + (left0 - bare) * tl.load(look + 19)), mask=there)
    tl.store(out + 4 * p + 1, scale * (green + (left1 - bare) * tl.load(look + 20)), mask=there)
    tl.store(out + 4 * p + 2, scale * (blue + (left2 - bare) * tl.load(look + 21)), mask=there)
    tl.store(out + 4 * p + 3, whole, mask=there)


@triton.jit(do_not_specialize=["place", "before", "until", "cells"])
def ground(  # type: ignore[no-untyped-def]
    place, ends, before, until, cells, near, start, entries, offsets, of, around, strokes, brightness, bare, tint, out,
    TINTED: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Lay the ground below the paint ``out`` (P, 4) of places (P, 3) that it covers less than ``bare``, near strokes.

    The ground has the colour ``tint`` (3,), or without ``TINTED`` that of the stroke with the nearest point times
    ``brightness``. ``cells``, ``near``, ``start`` and ``entries``: see :class:`svv.kernels.types.StrokeTables`.
    ``offsets`` (729, 4) int32: steps to the cells around one, and the square of the least distance from it, ascending.
    """
    begin = tl.load(ends + before, mask=before >= 0, other=0)
    p = begin + tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    there = p < tl.load(ends + until)
    cover = tl.load(out + 4 * p + 3, mask=there, other=1.0)
    there = there & (cover < bare)
    x = tl.load(place + 3 * p, mask=there, other=0.0)
    y = tl.load(place + 3 * p + 1, mask=there, other=0.0)
    z = tl.load(place + 3 * p + 2, mask=there, other=0.0)
    a = tl.minimum(tl.maximum((x * cells).to(tl.int32), 0), cells)
    b = tl.minimum(tl.maximum((y * cells).to(tl.int32), 0), cells)
    c = tl.minimum(tl.maximum((z * cells).to(tl.int32), 0), cells)
    wide = cells + 2
    there = there & (tl.load(near + (a * wide + b) * wide + c, mask=there, other=0) > 0)
    if TINTED:
        red, green, blue = tl.load(tint), tl.load(tint + 1), tl.load(tint + 2)
    else:
        side = 1.0 / cells
        best = tl.full((BLOCK,), FAR, tl.float32)
        nearest = tl.zeros((BLOCK,), tl.int32)
        number = tl.zeros((), tl.int32)
        searching = there
        while tl.max(searching.to(tl.int32), axis=0) > 0:
            i, j, k = (
                tl.load(offsets + 4 * number),
                tl.load(offsets + 4 * number + 1),
                tl.load(offsets + 4 * number + 2),
            )
            i, j, k = a + i, b + j, c + k
            inside = searching & (i >= 0) & (i < wide) & (j >= 0) & (j < wide) & (k >= 0) & (k < wide)
            cell = (i * wide + j) * wide + k
            at = tl.load(start + cell, mask=inside, other=0)
            last = tl.load(start + cell + 1, mask=inside, other=0)
            while tl.max((at < last).to(tl.int32), axis=0) > 0:
                point = tl.load(entries + at, mask=at < last, other=0)
                dx = x - tl.load(around + 16 * point, mask=at < last, other=0.0)
                dy = y - tl.load(around + 16 * point + 1, mask=at < last, other=0.0)
                dz = z - tl.load(around + 16 * point + 2, mask=at < last, other=0.0)
                away = dx * dx + dy * dy + dz * dz
                nearer = (at < last) & (away < best)
                best, nearest = tl.where(nearer, away, best), tl.where(nearer, point, nearest)
                at += 1
            number += 1
            least = tl.load(offsets + 4 * number + 3, mask=number < 729, other=0).to(tl.float32) * side * side
            searching = searching & (number < 729) & (least < best)
        row = strokes + 8 * tl.load(of + nearest, mask=there, other=0)
        red = brightness * tl.load(row, mask=there, other=0.0)
        green = brightness * tl.load(row + 1, mask=there, other=0.0)
        blue = brightness * tl.load(row + 2, mask=there, other=0.0)
    left = 1.0 - cover
    tl.store(out + 4 * p, tl.load(out + 4 * p, mask=there, other=0.0) + left * red, mask=there)
    tl.store(out + 4 * p + 1, tl.load(out + 4 * p + 1, mask=there, other=0.0) + left * green, mask=there)
    tl.store(out + 4 * p + 2, tl.load(out + 4 * p + 2, mask=there, other=0.0) + left * blue, mask=there)
    tl.store(out + 4 * p + 3, 1.0, mask=there)
