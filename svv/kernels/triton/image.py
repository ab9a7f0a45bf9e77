"""Everything but the networks in an image, in Triton: features, material, light, compositing.

:mod:`svv.kernels.numba.image` describes what each function computes. Letters: S samples, R rays, P palette colours, L
levels, F features per level, H spherical harmonics. ``BLOCK`` is the number of samples or rays of one program.
Arguments that are not specialized: see :mod:`svv.kernels.triton.tables`.
"""

from __future__ import annotations

import triton
import triton.language as tl

from svv.kernels.triton.rays import store_harmonics
from svv.kernels.triton.tables import corner_weight, known, lattice_cells, row_of


@triton.jit
def softplus(x):  # type: ignore[no-untyped-def]
    """Return log(1 + e^x), as exactly for very negative x as for others."""
    e = tl.exp(tl.minimum(x, 20.0))
    small = e * (1.0 - e * (0.5 - e * (1.0 / 3.0 - 0.25 * e)))
    return tl.where(x > 20.0, x, tl.where(x < -4.0, small, tl.log(1.0 + e)))


@triton.jit(do_not_specialize=["start", "count", "rays"])
def end(sigma, tail, start, count, step, rays, BLOCK: tl.constexpr):  # type: ignore[no-untyped-def]
    """Move the optical depth behind each ray's last sample, ``tail`` (R,), into its extinction (S,), in place."""
    r = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    there = r < rays
    number = tl.load(count + r, mask=there, other=0)
    at = sigma + tl.load(start + r, mask=there, other=0) + number - 1
    behind = tl.load(tail + r, mask=there, other=0.0)
    filled = there & (number > 0)
    tl.store(at, tl.load(at, mask=filled, other=0.0) + behind / step, mask=filled)
    tl.store(tail + r, tl.zeros((BLOCK,), tl.float32), mask=filled)


@triton.jit(do_not_specialize=["x", "ray", "chosen", "directions", "samples", "levels"])
def features(  # type: ignore[no-untyped-def]
    x, ray, chosen, directions, shapes, scales, bases, index, tables, lit, plain, samples, levels,
    FEATURES: tl.constexpr, WIDE: tl.constexpr, BOTH: tl.constexpr, CHOSEN: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Write one level of ``lit`` (S, L F + 16); the first level also the harmonics of the rays' ``directions`` (R, 3).

    With ``BOTH``, ``tables`` (V, 2 F) hold behind these features those of ``plain`` (S, L F), otherwise only these.
    ``FEATURES`` is F, and ``WIDE`` the width of the tables, rounded up to a power of two. Sample k is row k of ``x``
    and ``ray``, or, if only some are ``CHOSEN``, row ``chosen[k]``.
    """
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    level = tl.program_id(1)
    f = tl.arange(0, WIDE)
    there = i < known(samples)
    place = tl.load(chosen + i, mask=there, other=0) if CHOSEN else i
    columns = 2 * FEATURES if BOTH else FEATURES
    both = there[:, None] & (f < columns)[None, :]
    at, along_x, along_y, z, wx, wy, wz = lattice_cells(x, place, there, shapes, scales, bases, level)
    total = tl.zeros((BLOCK, WIDE), tl.float32)
    for corner in tl.static_range(8):
        word = tl.load(index + at + (corner >> 2) * along_x + (corner >> 1 & 1) * along_y, mask=there, other=0)
        row = row_of(word, z, tl.load(bases + levels)) + (corner & 1)
        value = tl.load(tables + row[:, None] * columns + f[None, :], mask=both, other=0.0)
        total += corner_weight(wx, wy, wz, corner)[:, None] * value
    wide = levels * FEATURES + 16
    own = both & (f < FEATURES)[None, :]
    tl.store(lit + (i * wide + level * FEATURES)[:, None] + f[None, :], total, mask=own)
    if BOTH:
        other = both & (f >= FEATURES)[None, :]
        tl.store(plain + ((i * levels + level) * FEATURES)[:, None] + f[None, :] - FEATURES, total, mask=other)
    if level == 0:
        along = directions + 3 * tl.load(ray + place, mask=there, other=0).to(tl.int64)
        store_harmonics(lit + i * wide + levels * FEATURES, along, there, BLOCK)


@triton.jit(do_not_specialize=["raw", "colours", "samples", "count"])
def material(raw, colours, shift, floor, region, diffuse, samples, count, BLOCK: tl.constexpr):  # type: ignore[no-untyped-def]
    """Write diffuse colour I sum_i w_i (P_i + delta_i) (S, 3) and region (S,) from the palette MLP (S, 1 + 4 P)."""
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = i < samples
    at = raw + i * (1 + 4 * count)
    zero = tl.zeros((BLOCK,), tl.float32)
    red, green, blue, total, largest = zero, zero, zero, zero, zero
    best = tl.zeros((BLOCK,), tl.int64)
    for p in range(count):
        w = softplus(tl.load(at + 1 + p, mask=there, other=0.0)) + floor
        offset = at + 1 + count + 3 * p
        red += w * (tl.load(colours + 3 * p) + tl.load(offset, mask=there, other=0.0))
        green += w * (tl.load(colours + 3 * p + 1) + tl.load(offset + 1, mask=there, other=0.0))
        blue += w * (tl.load(colours + 3 * p + 2) + tl.load(offset + 2, mask=there, other=0.0))
        total += w
        best = tl.where(w > largest, p, best)
        largest = tl.maximum(largest, w)
    scale = softplus(tl.load(at, mask=there, other=0.0) + shift) / total
    tl.store(diffuse + 3 * i, scale * red, mask=there)
    tl.store(diffuse + 3 * i + 1, scale * green, mask=there)
    tl.store(diffuse + 3 * i + 2, scale * blue, mask=there)
    tl.store(region + i, best, mask=there)


@triton.jit(do_not_specialize=["paint", "region", "share", "strokes", "sigma", "colour", "followed", "samples"])
def overpaint(paint, region, share, strokes, sigma, colour, followed, samples, BLOCK: tl.constexpr):  # type: ignore[no-untyped-def]
    """Blend ``paint`` into ``colour`` (S, 3) in place, and write the extinction that follows its strokes (S,)."""
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = i < samples
    r = tl.load(region + i, mask=there, other=0)
    part = tl.load(share + r, mask=there, other=0.0)
    low, high = tl.full((BLOCK,), 1.0, tl.float32), tl.zeros((BLOCK,), tl.float32)
    for channel in tl.static_range(3):
        own = tl.load(paint + 3 * i + channel, mask=there, other=0.0)
        before = tl.load(colour + 3 * i + channel, mask=there, other=0.0)
        tl.store(colour + 3 * i + channel, part * own + (1.0 - part) * before, mask=there)
        low, high = tl.minimum(low, own), tl.maximum(high, own)
    slope = tl.load(strokes + 4 * r + 1, mask=there, other=0.0)
    reach = tl.load(strokes + 4 * r + 3, mask=there, other=0.0)
    pale = tl.minimum(tl.maximum(tl.where(slope < 0.0, high, low), 0.0), 1.0)
    change = slope * (tl.load(strokes + 4 * r + 2, mask=there, other=0.0) - pale)
    change = tl.minimum(tl.maximum(change, -reach), reach)
    factor = tl.exp(tl.load(strokes + 4 * r, mask=there, other=0.0) + change)
    value = tl.load(sigma + i, mask=there, other=0.0)
    tl.store(followed + i, tl.where(reach > 0.0, value * factor, value), mask=there)


@triton.jit
def brighten(colour, i, there, factor, shade, specular):  # type: ignore[no-untyped-def]
    """Light samples' diffuse ``colour`` (S, 3) in place, given f, a m and f (c_s - b)."""
    shade = tl.maximum(1.0 + factor * (shade - 1.0), 0.0)
    for channel in tl.static_range(3):
        at = colour + 3 * i + channel
        tl.store(at, tl.load(at, mask=there, other=0.0) * shade + specular, mask=there)


@triton.jit(do_not_specialize=["raw", "lights", "region", "colour", "samples"])
def light(raw, lights, region, shift, colour, samples, OUTPUTS: tl.constexpr, BLOCK: tl.constexpr):  # type: ignore[no-untyped-def]
    """Light diffuse ``colour`` (S, 3) in place with the output of the lighting MLP (S, 1 or 2)."""
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = i < samples
    at = lights + 3 * tl.load(region + i, mask=there, other=0)
    factor, lowest = tl.load(at, mask=there, other=0.0), tl.load(at + 2, mask=there, other=0.0)
    shade = tl.full((BLOCK,), 1.0, tl.float32)
    if OUTPUTS > 1:
        shade = 2.0 / (1.0 + tl.exp(-tl.load(raw + OUTPUTS * i + 1, mask=there, other=0.0)))
    specular = factor * (softplus(tl.load(raw + OUTPUTS * i, mask=there, other=0.0) + shift) - lowest)
    brighten(colour, i, there, factor, tl.load(at + 1, mask=there, other=0.0) * shade, specular)


@triton.jit
def dot(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """Return the products of vectors."""
    return ax * bx + ay * by + az * bz


@triton.jit(
    do_not_specialize=["x", "ray", "facing", "toward", "half", "raw", "coefficients", "each", "lights", "region",
                       "colour", "samples", "levels", "count"]
)  # fmt: skip
def phong(  # type: ignore[no-untyped-def]
    x, ray, facing, toward, half, intensity, shapes, scales, bases, index, normals, scale, soft, rim, grazing, raw,
    coefficients, each, floor, lights, region, colour, samples, levels, count, BLOCK: tl.constexpr,
):  # fmt: skip
    """Light diffuse ``colour`` (S, 3) in place with an explicit light; ``each``: whether samples have coefficients."""
    i = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = i < samples
    zero = tl.zeros((BLOCK,), tl.float32)
    nx, ny, nz = zero, zero, zero
    for level in range(levels):
        at, along_x, along_y, z, wx, wy, wz = lattice_cells(x, i, there, shapes, scales, bases, level)
        for corner in tl.static_range(8):
            word = tl.load(index + at + (corner >> 2) * along_x + (corner >> 1 & 1) * along_y, mask=there, other=0)
            vertex = normals + 3 * (row_of(word, z, tl.load(bases + levels)) + (corner & 1))
            w = corner_weight(wx, wy, wz, corner)
            nx += w * tl.load(vertex, mask=there, other=0.0)
            ny += w * tl.load(vertex + 1, mask=there, other=0.0)
            nz += w * tl.load(vertex + 2, mask=there, other=0.0)
    ambient, diffuse, specular, shininess, total = zero, zero, zero, zero, zero
    for p in range(count):
        share = softplus(tl.load(raw + i * (1 + 4 * count) + 1 + p, mask=there, other=0.0)) + floor
        own = coefficients + 4 * (i * each * count + p)
        ambient += share * tl.load(own, mask=there, other=0.0)
        diffuse += share * tl.load(own + 1, mask=there, other=0.0)
        specular += share * tl.load(own + 2, mask=there, other=0.0)
        shininess += share * tl.load(own + 3, mask=there, other=0.0)
        total += share
    r = 3 * tl.load(ray + i, mask=there, other=0).to(tl.int64)
    fx, fy = tl.load(facing + r, mask=there, other=0.0), tl.load(facing + r + 1, mask=there, other=0.0)
    fz = tl.load(facing + r + 2, mask=there, other=0.0)
    tx, ty = tl.load(toward + r, mask=there, other=0.0), tl.load(toward + r + 1, mask=there, other=0.0)
    tz = tl.load(toward + r + 2, mask=there, other=0.0)
    hx, hy = tl.load(half + r, mask=there, other=0.0), tl.load(half + r + 1, mask=there, other=0.0)
    hz = tl.load(half + r + 2, mask=there, other=0.0)
    long = scale / tl.sqrt(soft * soft + scale * scale * dot(nx, ny, nz, nx, ny, nz))
    aside = tl.minimum(tl.maximum(1.0 - dot(fx, fy, fz, tx, ty, tz), 0.0), 1.0)
    long = tl.where(long * dot(nx, ny, nz, fx, fy, fz) < -rim * aside, -long, long)
    cosine = tl.maximum(long * dot(nx, ny, nz, tx, ty, tz), 0.0)
    across = tl.maximum(long * dot(nx, ny, nz, hx, hy, hz), grazing)
    highlight = intensity * specular / total * tl.exp(shininess / total * tl.log(across))
    highlight = tl.where(cosine > 0.0, highlight, 0.0)
    at = lights + 3 * tl.load(region + i, mask=there, other=0)
    factor = tl.load(at, mask=there, other=0.0)
    shade = tl.load(at + 1, mask=there, other=0.0) * (ambient + intensity * diffuse * cosine) / total
    brighten(colour, i, there, factor, shade, factor * (highlight - tl.load(at + 2, mask=there, other=0.0)))


@triton.jit(
    do_not_specialize=["position", "sigma", "skipped", "colour", "region", "opacity", "origins", "start", "count",
                       "tail", "size", "rgba", "depth", "seen", "rays", "regions"]
)  # fmt: skip
def composite(  # type: ignore[no-untyped-def]
    position, sigma, skipped, colour, region, opacity, origins, start, count, tail, step, size, faint, rgba, depth,
    seen, rays, regions, WIDE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """Write the pixels of rays, ``rgba`` (R, 4), ``depth`` (R,) and ``seen`` (R,) int16.

    A pixel whose alpha does not exceed ``faint`` shows nothing. ``WIDE`` is the number of regions rounded up to a power
    of two.
    """
    r = (tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)).to(tl.int64)
    there = r < rays
    first = tl.load(start + r, mask=there, other=0)
    number = tl.load(count + r, mask=there, other=0)
    ox = tl.load(origins + 3 * r, mask=there, other=0.0)
    oy = tl.load(origins + 3 * r + 1, mask=there, other=0.0)
    oz = tl.load(origins + 3 * r + 2, mask=there, other=0.0)
    zero = tl.zeros((BLOCK,), tl.float32)
    t = zero + 1.0
    red, green, blue, far = zero, zero, zero, zero
    which = tl.arange(0, WIDE)
    shares = tl.zeros((BLOCK, WIDE), tl.float32)
    longest = tl.max(number, axis=0)
    k = tl.zeros_like(longest)
    while k < longest:
        at, going = first + k, k < number
        own = tl.load(region + at, mask=going, other=0)
        t *= tl.exp(-tl.load(skipped + at, mask=going, other=0.0))
        thickness = tl.load(sigma + at, mask=going, other=0.0) * tl.load(opacity + own, mask=going, other=0.0) * step
        e = tl.exp(-thickness)
        w = t * (1.0 - e)
        red += w * tl.load(colour + 3 * at, mask=going, other=0.0)
        green += w * tl.load(colour + 3 * at + 1, mask=going, other=0.0)
        blue += w * tl.load(colour + 3 * at + 2, mask=going, other=0.0)
        x = tl.load(position + 3 * at, mask=going, other=0.0) - ox
        y = tl.load(position + 3 * at + 1, mask=going, other=0.0) - oy
        z = tl.load(position + 3 * at + 2, mask=going, other=0.0) - oz
        far += w * tl.sqrt(x * x + y * y + z * z)
        shares += tl.where(which[None, :] == own[:, None], w[:, None], 0.0)
        t *= e
        k += 1
    alpha = 1.0 - t * tl.exp(-tl.load(tail + r, mask=there, other=0.0))
    shown = alpha > faint
    back = tl.where(shown, 1.0 / tl.maximum(alpha, faint), 0.0)
    tl.store(rgba + 4 * r, tl.minimum(tl.maximum(red * back, 0.0), 1.0), mask=there)
    tl.store(rgba + 4 * r + 1, tl.minimum(tl.maximum(green * back, 0.0), 1.0), mask=there)
    tl.store(rgba + 4 * r + 2, tl.minimum(tl.maximum(blue * back, 0.0), 1.0), mask=there)
    tl.store(rgba + 4 * r + 3, tl.where(shown, alpha, 0.0), mask=there)
    tl.store(depth + r, tl.where(shown, far * back * size, float("nan")), mask=there)
    shares = tl.where(which[None, :] < regions, shares, -1.0)
    tl.store(seen + r, tl.where(shown, tl.argmax(shares, axis=1), -1).to(tl.int16), mask=there)
