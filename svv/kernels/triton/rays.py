"""Rays, marching and compositing in Triton: one thread per ray.

Letters: R rays, S samples, C channels, L levels of the density lattice. ``WIDE`` is C rounded up to a power of two, and
``BLOCK`` is the number of rays of one program. :mod:`svv.kernels.numba.rays` and :mod:`svv.kernels.numba.marching`
describe what each function computes. Arguments that are not specialized: see :mod:`svv.kernels.triton.tables`.
"""

from __future__ import annotations

import triton
import triton.language as tl

from svv.kernels.triton.tables import row_of


@triton.jit(do_not_specialize=["pixels", "width", "height", "origins", "directions", "rays"])
def pixel_rays(  # type: ignore[no-untyped-def]
    pixels, rotations, positions, lenses, width, height, origins, directions, rays, BLOCK: tl.constexpr
):
    """Compute origins and unit directions (R, 3) of rays through pixel centres."""
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = r < rays
    pixel = tl.load(pixels + r, mask=there, other=0)
    view, rest = pixel // (width * height), (pixel % (width * height)).to(tl.int32)
    f = tl.load(lenses + view * 4, mask=there, other=1.0)
    u = ((rest % width).to(tl.float32) + tl.load(lenses + view * 4 + 1, mask=there, other=0.0)) / f
    v = -((rest // width).to(tl.float32) + tl.load(lenses + view * 4 + 2, mask=there, other=0.0)) / f
    parallel = tl.load(lenses + view * 4 + 3, mask=there, other=0.0) > 0.0
    norm = 1.0 / tl.sqrt(u * u + v * v + 1.0)
    for k in tl.static_range(3):
        m = rotations + view * 9 + 3 * k
        x = tl.load(m, mask=there, other=0.0)
        y = tl.load(m + 1, mask=there, other=0.0)
        z = tl.load(m + 2, mask=there, other=0.0)
        tl.store(directions + 3 * r + k, tl.where(parallel, -z, (x * u + y * v - z) * norm), mask=there)
        shift = tl.where(parallel, x * u + y * v, 0.0)
        tl.store(origins + 3 * r + k, tl.load(positions + view * 3 + k, mask=there, other=0.0) + shift, mask=there)


@triton.jit
def store_harmonics(to, along, there, BLOCK: tl.constexpr):  # type: ignore[no-untyped-def]
    """Evaluate degree 4 harmonics, as :func:`svv.core.rays.encodings.spherical_harmonics`, of the vectors ``along``."""
    x = tl.load(along, mask=there, other=0.0)
    y = tl.load(along + 1, mask=there, other=0.0)
    z = tl.load(along + 2, mask=there, other=0.0)
    xx, yy, zz = x * x, y * y, z * z
    tl.store(to, tl.full((BLOCK,), 0.28209479177387814, tl.float32), mask=there)
    tl.store(to + 1, -0.48860251190291987 * y, mask=there)
    tl.store(to + 2, 0.48860251190291987 * z, mask=there)
    tl.store(to + 3, -0.48860251190291987 * x, mask=there)
    tl.store(to + 4, 1.0925484305920792 * x * y, mask=there)
    tl.store(to + 5, -1.0925484305920792 * y * z, mask=there)
    tl.store(to + 6, 0.94617469575755997 * zz - 0.31539156525251999, mask=there)
    tl.store(to + 7, -1.0925484305920792 * x * z, mask=there)
    tl.store(to + 8, 0.54627421529603959 * (xx - yy), mask=there)
    tl.store(to + 9, 0.59004358992664352 * y * (yy - 3.0 * xx), mask=there)
    tl.store(to + 10, 2.8906114426405538 * x * y * z, mask=there)
    tl.store(to + 11, 0.45704579946446572 * y * (1.0 - 5.0 * zz), mask=there)
    tl.store(to + 12, 0.3731763325901154 * z * (5.0 * zz - 3.0), mask=there)
    tl.store(to + 13, 0.45704579946446572 * x * (1.0 - 5.0 * zz), mask=there)
    tl.store(to + 14, 1.4453057213202769 * z * (xx - yy), mask=there)
    tl.store(to + 15, 0.59004358992664352 * x * (3.0 * yy - xx), mask=there)


@triton.jit(do_not_specialize=["ray", "samples"])
def harmonics(directions, ray, out, samples, BLOCK: tl.constexpr):  # type: ignore[no-untyped-def]
    """Evaluate the harmonics of each sample's ray."""
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = i < samples
    store_harmonics(out + 16 * i, directions + 3 * tl.load(ray + i, mask=there, other=0).to(tl.int64), there, BLOCK)


@triton.jit
def uniform(seed, a, b):  # type: ignore[no-untyped-def]
    """Return a random number in [0, 1) from three integers, as :func:`svv.core.rays.marching.uniform`."""
    h = seed.to(tl.uint64) * 0x9E3779B97F4A7C15 ^ a.to(tl.uint64) * 0xBF58476D1CE4E5B9
    h ^= b.to(tl.uint64) * 0x94D049BB133111EB
    h ^= h >> 31
    h *= 0x9E3779B97F4A7C15
    h ^= h >> 29
    h *= 0xBF58476D1CE4E5B9
    h ^= h >> 32
    return (h >> 40).to(tl.float32) * (1.0 / 16777216.0)


@triton.jit
def slab(o, d, extent, near, far):  # type: ignore[no-untyped-def]
    """Clip a ray to the slab between the two planes of one axis; return near, far and the inverse direction."""
    along = tl.abs(d) < 1e-9
    inverse = 1.0 / tl.where(along, 1.0, d)
    a, b = -o * inverse, (extent - o) * inverse
    misses = along & ((o < 0.0) | (o > extent))
    near = tl.where(along, near, tl.maximum(near, tl.minimum(a, b)))
    far = tl.where(along, far, tl.minimum(far, tl.maximum(a, b)))
    return near, tl.where(misses, -1.0, far), tl.where(along, 0.0, inverse)


@triton.jit
def leap(cell, empty, d, o, inverse, side):  # type: ignore[no-untyped-def]
    """Return where a ray leaves the slab of ``empty`` cells that begins with a cell, along one axis."""
    plane = tl.where(d > 0, cell + empty, cell + 1 - empty).to(tl.float32) * side
    return tl.where(inverse == 0.0, 1e30, (plane - o) * inverse)


@triton.jit
def exponent_at(x, y, z, inside, shapes, scales, bases, index, table, LEVELS: tl.constexpr):  # type: ignore[no-untyped-def]
    """Return the sum over levels of the trilinear interpolation of a one-channel table."""
    total = tl.zeros_like(x)
    for level in tl.static_range(LEVELS):
        scale = tl.load(scales + level)
        nx = tl.load(shapes + 3 * level).to(tl.int32)
        ny = tl.load(shapes + 3 * level + 1).to(tl.int32)
        nz = tl.load(shapes + 3 * level + 2).to(tl.int32)
        fx, fy, fz = x * scale, y * scale, z * scale
        ix = tl.minimum(fx.to(tl.int32), nx - 2)
        iy = tl.minimum(fy.to(tl.int32), ny - 2)
        iz = tl.minimum(fz.to(tl.int32), nz - 2)
        wx, wy, wz = fx - ix.to(tl.float32), fy - iy.to(tl.float32), fz - iz.to(tl.float32)
        words = (nz + 31) // 32
        at = index + (tl.load(bases + level) + (ix.to(tl.int64) * ny + iy) * words + iz // 32)
        for corner in tl.static_range(4):
            # Vertices are numbered in raster order, so the neighbour in z always has the next number.
            word = tl.load(at + (corner >> 1) * ny * words + (corner & 1) * words, mask=inside, other=0)
            row = row_of(word, iz, tl.load(bases + LEVELS))
            low = tl.load(table + row, mask=inside, other=0.0)
            high = tl.load(table + row + 1, mask=inside, other=0.0)
            w = (wx if corner & 2 else 1.0 - wx) * (wy if corner & 1 else 1.0 - wy)
            total += w * ((1.0 - wz) * low + wz * high)
    return total


@triton.jit(
    do_not_specialize=["origins", "directions", "nx", "ny", "nz", "seed", "first_ray", "rays", "ends", "most", "start",
                       "count", "tail", "total", "dropped", "position", "skipped", "sigma", "ray", "merge", "begins",
                       "finishes", "pieces"]
)  # fmt: skip
def march(  # type: ignore[no-untyped-def]  # long: one loop, whose state is registers
    origins, directions, distance, nx, ny, nz, cells, extent_x, extent_y, extent_z, step, seed, first_ray,
    shapes, scales, bases, index, table, ceiling, least_weight, keep, stop, fade, rays,
    ends, most, start, count, tail, total, dropped, position, skipped, sigma, ray, merge, begins, finishes, pieces,
    LEVELS: tl.constexpr, WRITES: tl.constexpr, MARKED: tl.constexpr, DIVIDED: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """March a block of rays, either to count their samples or, with ``WRITES``, to write them and their ``start``.

    ``seed`` (1,) int32 is that of their random numbers, or 0. With ``DIVIDED``, only ``pieces`` of each ray are
    marched, from ``begins`` to ``finishes`` (R, pieces); with ``MARKED``, cells of distance 255 are occupied, but
    neither dim nor end a ray: as in :func:`svv.kernels.numba.packets.march`.
    ``ends`` (R,) are the sums of ``count`` up to each ray. There is room for ``most`` samples: rays whose samples end
    beyond it have none, a ``count`` of -1, and are added to ``dropped``. ``total`` is the number of samples written.

    Both passes are compiled apart, and a compiler may round one of them differently. The second one therefore writes
    exactly ``count`` samples of each ray: those it has too many of are left out, missing ones have no extinction.
    """
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = r < rays
    ox = tl.load(origins + 3 * r, mask=there, other=0.0)
    oy = tl.load(origins + 3 * r + 1, mask=there, other=0.0)
    oz = tl.load(origins + 3 * r + 2, mask=there, other=0.0)
    dx = tl.load(directions + 3 * r, mask=there, other=1.0)
    dy = tl.load(directions + 3 * r + 1, mask=there, other=1.0)
    dz = tl.load(directions + 3 * r + 2, mask=there, other=1.0)
    near, far = tl.zeros((BLOCK,), tl.float32), tl.full((BLOCK,), 1e30, tl.float32)
    near, far, inverse_x = slab(ox, dx, extent_x, near, far)
    near, far, inverse_y = slab(oy, dy, extent_y, near, far)
    near, far, inverse_z = slab(oz, dz, extent_z, near, far)
    hit = there & (near < far)
    shift = tl.full((BLOCK,), 0.5, tl.float32)
    number = tl.load(seed)
    if number > 0:
        shift = uniform(number, first_ray + r, tl.zeros_like(r))
    i = tl.ceil(tl.where(hit, near, 0.0) / step - shift).to(tl.int32)
    last = tl.floor(tl.where(hit, far, 0.0) / step - shift).to(tl.int32)
    stops, piece = tl.full((BLOCK,), 1e9, tl.float32), tl.zeros((BLOCK,), tl.int64)
    going = hit & (i <= last)
    if DIVIDED:
        going = hit
        last = tl.full((BLOCK,), -1, tl.int32)
        i = tl.zeros((BLOCK,), tl.int32)
    octant = 4 * (dx < 0).to(tl.int64) + 2 * (dy < 0).to(tl.int64) + (dz < 0).to(tl.int64)
    side = 1.0 / cells
    rate = 1.0 / step
    # Optical depth left out since the last kept sample, and total since the start of the ray.
    left_out, tau = tl.zeros((BLOCK,), tl.float32), tl.zeros((BLOCK,), tl.float32)
    # Largest optical depth of a step, and where that is.
    most_of, most_x, most_y, most_z = left_out, left_out, left_out, left_out
    n = tl.zeros((BLOCK,), tl.int64)
    none = n
    end = n
    if WRITES:
        end = tl.load(ends + r, mask=there, other=0)
        n = end - tl.load(count + r, mask=there, other=0)
        none = n
        too_many = there & (end > most)
        tl.store(start + r, n, mask=there)
        tl.store(count + r, tl.full((BLOCK,), -1, tl.int64), mask=too_many)
        lost = tl.sum(too_many.to(tl.int64), axis=0)
        tl.atomic_add(dropped, lost, mask=lost > 0, sem="relaxed")
        # Sums never fall, so the rays for which there is room are the first ones, and one of them is the last.
        following = tl.load(ends + r + 1, mask=r + 1 < rays, other=1 << 62)
        tl.store(total + tl.zeros_like(r), end, mask=there & (end <= most) & (following > most))
        going = going & (end <= most)
        end = tl.where(too_many, n, end)
    while tl.max(going.to(tl.int32), axis=0) > 0:
        if DIVIDED:
            waits = going & (i > last)
            while tl.max(waits.to(tl.int32), axis=0) > 0:
                found = waits & (piece < pieces)
                low = tl.load(begins + r * pieces + piece, mask=found, other=0.0)
                high = tl.load(finishes + r * pieces + piece, mask=found, other=0.0)
                found = found & (high > low) & (low < far) & (high > near)
                low = tl.where(found, low, 0.0)
                high = tl.where(found, tl.minimum(high, 1e9), 0.0)
                whole = tl.floor(low / step)
                moved = low / step - whole + 0.5
                first = tl.maximum(whole, tl.ceil(tl.where(found, near, 0.0) / step - moved))
                final = tl.floor(tl.where(found, far, 0.0) / step - moved)
                final = tl.where(high < far, tl.minimum(final, tl.ceil(high / step - moved + 0.5) - 1.0), final)
                going = going & (found | (piece < pieces) | (waits == 0))
                piece = tl.where(waits, piece + 1, piece)
                shift = tl.where(found, moved, shift)
                stops = tl.where(found, high, stops)
                i = tl.where(found, first.to(tl.int32), i)
                last = tl.where(found, final.to(tl.int32), last)
                waits = going & (i > last)
        t = (i.to(tl.float32) + shift) * step
        covers = tl.minimum((stops - t) * rate + 0.5, 1.0)
        if DIVIDED:
            t = tl.minimum(t, 0.5 * (t - 0.5 * step + stops))
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        cx = tl.minimum(tl.maximum((x * cells).to(tl.int32), 0), nx - 1)
        cy = tl.minimum(tl.maximum((y * cells).to(tl.int32), 0), ny - 1)
        cz = tl.minimum(tl.maximum((z * cells).to(tl.int32), 0), nz - 1)
        at = ((octant * nx + cx) * ny + cy) * nz + cz
        empty = tl.load(distance + at, mask=going, other=0).to(tl.int32)
        sure = empty == 0
        inside = going & sure
        if MARKED:
            inside = going & (sure | (empty == 255))
        # Go to the first sample behind the cube of empty cells around this one.
        tx = leap(cx, empty, dx, ox, inverse_x, side)
        ty = leap(cy, empty, dy, oy, inverse_y, side)
        tz = leap(cz, empty, dz, oz, inverse_z, side)
        behind = tl.ceil(tl.where(inside | (there == 0), 0.0, tl.minimum(tx, tl.minimum(ty, tz))) * rate - shift)
        x = tl.minimum(tl.maximum(x, 0.0), extent_x)
        y = tl.minimum(tl.maximum(y, 0.0), extent_y)
        z = tl.minimum(tl.maximum(z, 0.0), extent_z)
        raw = exponent_at(x, y, z, inside, shapes, scales, bases, index, table, LEVELS)
        s = tl.exp(tl.minimum(raw, ceiling))
        if DIVIDED:
            s = s * covers
        thickness = tl.where(inside, s * step, 0.0)
        heavier = thickness > most_of
        most_of = tl.where(heavier, thickness, most_of)
        most_x, most_y = tl.where(heavier, x, most_x), tl.where(heavier, y, most_y)
        most_z = tl.where(heavier, z, most_z)
        before = left_out * merge
        weight = 1.0 - tl.exp(-thickness - before)
        dims = before - tau
        if MARKED:
            dims = tl.minimum(dims, 0.0)
        weight = tl.where(weight >= least_weight, weight * tl.exp(fade * dims), weight)
        kept = weight >= least_weight
        if keep > 0.0:
            kept = kept | (uniform(number, first_ray + r, i + 1) < keep)
        kept = kept & inside
        if WRITES:
            kept = kept & (n < end)
            tl.store(position + 3 * n, x, mask=kept)
            tl.store(position + 3 * n + 1, y, mask=kept)
            tl.store(position + 3 * n + 2, z, mask=kept)
            tl.store(skipped + n, left_out - before, mask=kept)
            tl.store(sigma + n, s + before * rate, mask=kept)
            tl.store(ray + n, r, mask=kept)
        n += kept.to(tl.int64)
        left_out = tl.where(kept, 0.0, left_out + thickness)
        if MARKED:
            thickness = tl.where(sure, thickness, 0.0)
        tau += thickness
        i = tl.where(inside, i + 1, tl.maximum(i + 1, behind.to(tl.int32)))
        going = going & (fade * tau <= stop)
        if DIVIDED:
            going = going & ((i <= last) | (piece < pieces))
        else:
            going = going & (i <= last)
    alone = there & (n == none) & (left_out * merge > 1.0 / 4096.0)  # svv.core.rays.marching.LEAST_DEPTH
    if WRITES:
        alone = alone & (n < end)
        tl.store(position + 3 * n, most_x, mask=alone)
        tl.store(position + 3 * n + 1, most_y, mask=alone)
        tl.store(position + 3 * n + 2, most_z, mask=alone)
        tl.store(skipped + n, 0.0, mask=alone)
        tl.store(sigma + n, left_out * rate, mask=alone)
        tl.store(ray + n, r, mask=alone)
    n += alone.to(tl.int64)
    left_out = tl.where(alone, 0.0, left_out)
    if WRITES:
        while tl.max((n < end).to(tl.int32), axis=0) > 0:
            for k in tl.static_range(3):
                tl.store(position + 3 * n + k, 0.0, mask=n < end)
            tl.store(skipped + n, 0.0, mask=n < end)
            tl.store(sigma + n, 0.0, mask=n < end)
            tl.store(ray + n, r, mask=n < end)
            n += 1
    else:
        tl.store(count + r, n, mask=there)
        tl.store(tail + r, left_out, mask=there)
        tl.store(total, 0, mask=tl.program_id(0) == 0)  # of the second pass, unless there is room for no ray


@triton.jit(do_not_specialize=["sigma", "skipped", "start", "count", "cuts", "shift", "begin", "end", "taken", "rays"])
def cuts_of_rays(  # type: ignore[no-untyped-def]
    sigma, skipped, start, count, step, cuts, shift, begin, end, taken, rays, BLOCK: tl.constexpr
):
    """Write where samples ``begin`` and ``end`` (S,) among their ray's cuts, and how many are ``taken`` (R,)."""
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    first = tl.load(start + r, mask=r < rays, other=0)
    length = tl.load(count + r, mask=r < rays, other=0)
    moved = tl.load(shift + r, mask=r < rays, other=0.0)
    tau = tl.zeros((BLOCK,), tl.float32)
    number = tl.zeros((BLOCK,), tl.int64)
    for k in range(tl.max(length, axis=0)):
        inside = k < length
        tau += tl.load(skipped + first + k, mask=inside, other=0.0)
        low = (1.0 - tl.exp(-tau)) * cuts + moved
        tau += tl.load(sigma + first + k, mask=inside, other=0.0) * step
        high = (1.0 - tl.exp(-tau)) * cuts + moved
        tl.store(begin + first + k, low, mask=inside)
        tl.store(end + first + k, high, mask=inside)
        number += (inside & (tl.floor(high) > tl.floor(low))).to(tl.int64)
    # The last sample of a ray without any cut represents all.
    tl.store(taken + r, tl.where(length > 0, tl.maximum(number, 1), 0), mask=r < rays)


@triton.jit(do_not_specialize=["begin", "end", "start", "count", "taken", "ends", "chosen", "place", "passed", "rays"])
def representatives(  # type: ignore[no-untyped-def]
    begin, end, start, count, taken, ends, chosen, place, passed, rays, BLOCK: tl.constexpr
):
    """Write the samples into which a cut falls, ``chosen`` (K,), and each sample's ``place`` in them (S,).

    ``ends`` (R,) are the sums of ``taken`` up to each ray. ``passed`` (S,) is a buffer for each sample's distance
    from the last cut.
    """
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    first = tl.load(start + r, mask=r < rays, other=0)
    length = tl.load(count + r, mask=r < rays, other=0)
    number = tl.load(ends + r, mask=r < rays, other=0) - tl.load(taken + r, mask=r < rays, other=0)
    longest = tl.max(length, axis=0)
    last = tl.full((BLOCK,), -1e30, tl.float32)
    lone = length < 0
    for k in range(longest):
        inside = k < length
        low = tl.load(begin + first + k, mask=inside, other=0.0)
        high = tl.load(end + first + k, mask=inside, other=0.0)
        lone = lone | ((k == length - 1) & (last < -1e29) & (tl.floor(high) == tl.floor(low)))
        cut = inside & ((tl.floor(high) > tl.floor(low)) | lone)
        tl.store(chosen + number, first + k, mask=cut)
        number += cut.to(tl.int64)
        last = tl.where(cut, tl.floor(high), last)
        tl.store(place + first + k, number - 1, mask=inside)
        tl.store(passed + first + k, 0.5 * (low + high) - last, mask=inside)
    tl.debug_barrier()
    following = tl.full((BLOCK,), 1e30, tl.float32)
    for back in range(longest):
        k = longest - 1 - back
        inside = k < length
        low = tl.load(begin + first + k, mask=inside, other=0.0)
        high = tl.load(end + first + k, mask=inside, other=0.0)
        cut = inside & ((tl.floor(high) > tl.floor(low)) | (lone & (k == length - 1)))
        nearer = tl.load(passed + first + k, mask=inside, other=0.0) >= following - 0.5 * (low + high)
        tl.store(place + first + k, number, mask=inside & nearer & (cut == 0))
        number -= cut.to(tl.int64)
        following = tl.where(cut, tl.floor(low) + 1.0, following)


@triton.jit(
    do_not_specialize=["sigma", "skipped", "start", "count", "tail", "transmittance", "weights", "rays", "channels"]
)
def composite(  # type: ignore[no-untyped-def]
    sigma, skipped, values, start, count, tail, step, out, transmittance, weights, rays, channels,
    WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Composite ``values`` (S, C) of a block of rays front to back."""
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    c = tl.arange(0, WIDE)
    there = r < rays
    first = tl.load(start + r, mask=there, other=0)
    number = tl.load(count + r, mask=there, other=0)
    t = tl.full((BLOCK,), 1.0, tl.float32)
    total = tl.zeros((BLOCK, WIDE), tl.float32)
    longest = tl.max(number, axis=0)
    k = tl.zeros_like(longest)
    while k < longest:
        at, going = first + k, k < number
        t *= tl.exp(-tl.load(skipped + at, mask=going, other=0.0))
        e = tl.exp(-tl.load(sigma + at, mask=going, other=0.0) * step)
        w = t * (1.0 - e)
        tl.store(weights + at, w, mask=going)
        both = going[:, None] & (c < channels)[None, :]
        total += w[:, None] * tl.load(values + at[:, None] * channels + c[None, :], mask=both, other=0.0)
        t *= e
        k += 1
    ends = there[:, None] & (c < channels)[None, :]
    tl.store(out + r.to(tl.int64)[:, None] * channels + c[None, :], total, mask=ends)
    tl.store(transmittance + r, t * tl.exp(-tl.load(tail + r, mask=there, other=0.0)), mask=there)


@triton.jit(
    do_not_specialize=[
        "sigma",
        "skipped",
        "start",
        "count",
        "transmittance",
        "g_transmittance",
        "g_sigma",
        "rays",
        "channels",
    ]
)
def composite_backward(  # type: ignore[no-untyped-def]
    sigma, skipped, values, weights, start, count, step, out, transmittance, g_out, g_transmittance,
    g_sigma, g_values, rays, channels,
    WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Compute gradients of :func:`composite` for extinction (S,) and values (S, C) of a block of rays."""
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    c = tl.arange(0, WIDE)
    there = r < rays
    ends = there[:, None] & (c < channels)[None, :]
    row = r.to(tl.int64)[:, None] * channels + c[None, :]
    first = tl.load(start + r, mask=there, other=0)
    number = tl.load(count + r, mask=there, other=0)
    g = tl.load(g_out + row, mask=ends, other=0.0)
    left = tl.load(transmittance + r, mask=there, other=0.0) * tl.load(g_transmittance + r, mask=there, other=0.0)
    behind = left + tl.sum(g * tl.load(out + row, mask=ends, other=0.0), axis=1)
    t = tl.full((BLOCK,), 1.0, tl.float32)
    longest = tl.max(number, axis=0)
    k = tl.zeros_like(longest)
    while k < longest:
        at, going = first + k, k < number
        both = going[:, None] & (c < channels)[None, :]
        sample = at[:, None] * channels + c[None, :]
        t *= tl.exp(-tl.load(skipped + at, mask=going, other=0.0))
        e = tl.exp(-tl.load(sigma + at, mask=going, other=0.0) * step)
        w = tl.load(weights + at, mask=going, other=0.0)
        dot = tl.sum(g * tl.load(values + sample, mask=both, other=0.0), axis=1)
        tl.store(g_values + sample, w[:, None] * g, mask=both)
        behind -= w * dot
        tl.store(g_sigma + at, step * (t * e * dot - behind), mask=going)
        t *= e
        k += 1
