"""Splats in a picture, compiled with numba: forward in tiles, front to back, and the analytic gradients of that.

They match :func:`svv.core.rays.splatting.splatted`. Sums are of one thread each, in one order: results do not depend on
the number of threads. Letters: N splats, K harmonics, T tiles, P pairs of a splat and a tile, (H, W) padded pixels.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from svv.core.compiled import njit
from svv.core.fast_math import FAST_MATH
from svv.core.lanes import (
    LANES,
    as_floats,
    bits_of,
    exp,
    lane_numbers,
    load,
    mask_of,
    minimum,
    select,
    splat,
    store,
    total,
)
from svv.core.rays.splatting import LEAST_ALPHA, LEAST_TRANSMITTANCE, LOW_PASS, MOST_ALPHA, NEAREST

TILE = LANES
"""Side of a tile in pixels: a row of it is a vector."""

DRAWN = 10
"""Numbers of a splat in the picture: column, row, inverse covariance xx, xy, yy, opacity, RGB, reach in rows."""

SUMS = 11
"""Sums of a pair: those of the gradient by the exponent, times 1, dx, dy, dx dx, dx dy, dy dy; gradients by RGB; the
weight in pixels, and the weight times the pixels' errors."""

BLOCK = 256
"""Splats that share memory to work in."""

ZERO, HALF, ONE, TWO = (np.float32(v) for v in (0.0, 0.5, 1.0, 2.0))
LEAST, MOST, ENOUGH = np.float32(LEAST_ALPHA), np.float32(MOST_ALPHA), np.float32(LEAST_TRANSMITTANCE)
WIDENED, NEAR, LEVELS = np.float32(LOW_PASS), np.float32(NEAREST), np.float32(1.0 / LEAST_ALPHA)
ALL = np.int64((1 << LANES) - 1)
B = tuple(
    np.float32(v)
    for v in (
        0.28209479177387814, 0.48860251190291987, 1.0925484305920792, 0.94617469575755997, 0.31539156525251999,
        0.54627421529603959, 0.59004358992664352, 2.8906114426405538, 0.45704579946446572, 0.3731763325901154,
        1.4453057213202769,
    )
)  # fmt: skip
THREE, FIVE, SIX, TEN, FIFTEEN = (np.float32(v) for v in (3.0, 5.0, 6.0, 10.0, 15.0))


@njit(fastmath=FAST_MATH, inline="always")
def basis_of(x, y, z, count, out):  # type: ignore[no-untyped-def]
    """Write the first ``count`` harmonics of a unit direction."""
    out[0] = B[0]
    if count > 1:
        out[1], out[2], out[3] = -B[1] * y, B[1] * z, -B[1] * x
    if count > 4:
        out[4], out[5], out[6] = B[2] * x * y, -B[2] * y * z, B[3] * z * z - B[4]
        out[7], out[8] = -B[2] * x * z, B[5] * (x * x - y * y)
    if count > 9:
        xx, yy, zz = x * x, y * y, z * z
        out[9], out[10], out[11] = B[6] * y * (yy - THREE * xx), B[7] * x * y * z, B[8] * y * (ONE - FIVE * zz)
        out[12], out[13] = B[9] * z * (FIVE * zz - THREE), B[8] * x * (ONE - FIVE * zz)
        out[14], out[15] = B[10] * z * (xx - yy), B[6] * x * (THREE * yy - xx)


@njit(fastmath=FAST_MATH, inline="always")
def _slopes(x, y, z, count, out):  # type: ignore[no-untyped-def]
    """Write the derivatives of the first ``count`` harmonics along x, y, z. (count, 3)"""
    out[:count] = ZERO
    if count > 1:
        out[1, 1], out[2, 2], out[3, 0] = -B[1], B[1], -B[1]
    if count > 4:
        out[4, 0], out[4, 1], out[5, 1], out[5, 2] = B[2] * y, B[2] * x, -B[2] * z, -B[2] * y
        out[6, 2], out[7, 0], out[7, 2] = TWO * B[3] * z, -B[2] * z, -B[2] * x
        out[8, 0], out[8, 1] = TWO * B[5] * x, -TWO * B[5] * y
    if count > 9:
        xx, yy, zz = x * x, y * y, z * z
        out[9, 0], out[9, 1] = -SIX * B[6] * x * y, THREE * B[6] * (yy - xx)
        out[10, 0], out[10, 1], out[10, 2] = B[7] * y * z, B[7] * x * z, B[7] * x * y
        out[11, 1], out[11, 2] = B[8] * (ONE - FIVE * zz), -TEN * B[8] * y * z
        out[12, 2] = B[9] * (FIFTEEN * zz - THREE)
        out[13, 0], out[13, 2] = B[8] * (ONE - FIVE * zz), -TEN * B[8] * x * z
        out[14, 0], out[14, 1], out[14, 2] = TWO * B[10] * x * z, -TWO * B[10] * y * z, B[10] * (xx - yy)
        out[15, 0], out[15, 1] = THREE * B[6] * (yy - xx), SIX * B[6] * x * y


@njit(fastmath=FAST_MATH, inline="always")
def _turn(rotation, out):  # type: ignore[no-untyped-def]
    """Write the matrix (3, 3) of a quaternion, and return its length."""
    w, x, y, z = rotation[0], rotation[1], rotation[2], rotation[3]
    length = np.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / length, x / length, y / length, z / length
    out[0, 0], out[0, 1], out[0, 2] = ONE - TWO * (y * y + z * z), TWO * (x * y - w * z), TWO * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = TWO * (x * y + w * z), ONE - TWO * (x * x + z * z), TWO * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = TWO * (x * z - w * y), TWO * (y * z + w * x), ONE - TWO * (x * x + y * y)
    return length


@njit(fastmath=FAST_MATH, inline="always")
def _across(seen, axes, focal, turn, scales, flat, out):  # type: ignore[no-untyped-def]
    """Write what takes world vectors into the picture, ``flat`` (2, 3), and a splat's unit vectors, ``out`` (2, 3)."""
    x, y, z = seen
    for k in range(3):
        flat[0, k] = focal / z * (axes[0, k] - x / z * axes[2, k])
        flat[1, k] = focal / z * (axes[1, k] - y / z * axes[2, k])
    for i in range(2):
        for k in range(3):
            out[i, k] = (flat[i, 0] * turn[0, k] + flat[i, 1] * turn[1, k] + flat[i, 2] * turn[2, k]) * scales[k]


@njit(fastmath=FAST_MATH, inline="always")
def _seen(centre, eye, axes):  # type: ignore[no-untyped-def]
    dx, dy, dz = centre[0] - eye[0], centre[1] - eye[1], centre[2] - eye[2]
    return (
        axes[0, 0] * dx + axes[0, 1] * dy + axes[0, 2] * dz,
        axes[1, 0] * dx + axes[1, 1] * dy + axes[1, 2] * dz,
        axes[2, 0] * dx + axes[2, 1] * dy + axes[2, 2] * dz,
    )


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def project(  # type: ignore[no-untyped-def]
    centres, scales, rotations, opacities, harmonics, axes, eye, focal, width, height, drawn, tiles, keys
):
    """Write the splats as a camera sees them: ``drawn`` (N, DRAWN), and the tiles that each may touch.

    ``axes`` (3, 3): right, down, forward; ``tiles`` (N, 4): first column and row, and past the last; ``keys`` (N,)
    uint64: bits of the depth, and below them the number, or all ones for a splat that is nowhere in the picture.
    """
    count = harmonics.shape[1]
    for block in prange((len(centres) + BLOCK - 1) // BLOCK):
        turn, flat, out = np.empty((3, 3), np.float32), np.empty((2, 3), np.float32), np.empty((2, 3), np.float32)
        basis, bits = np.empty(16, np.float32), np.empty(1, np.float32)
        for n in range(block * BLOCK, min((block + 1) * BLOCK, len(centres))):
            keys[n] = np.uint64(0xFFFFFFFFFFFFFFFF)
            tiles[n] = 0
            x, y, z = seen = _seen(centres[n], eye, axes)
            if z <= NEAR or opacities[n] < LEAST:
                continue
            _turn(rotations[n], turn)
            _across(seen, axes, focal, turn, scales[n], flat, out)
            xx = out[0, 0] * out[0, 0] + out[0, 1] * out[0, 1] + out[0, 2] * out[0, 2] + WIDENED
            xy = out[0, 0] * out[1, 0] + out[0, 1] * out[1, 1] + out[0, 2] * out[1, 2]
            yy = out[1, 0] * out[1, 0] + out[1, 1] * out[1, 1] + out[1, 2] * out[1, 2] + WIDENED
            scale = ONE / (xx * yy - xy * xy)
            column, row = focal * x / z + HALF * width, focal * y / z + HALF * height
            far = TWO * np.log(LEVELS * opacities[n])
            wide, high = np.sqrt(far * xx), np.sqrt(far * yy)
            left, right = max(ZERO, column - wide), min(np.float32(width), column + wide)
            top, bottom = max(ZERO, row - high), min(np.float32(height), row + high)
            if not (left < right and top < bottom):
                continue
            tiles[n, 0], tiles[n, 2] = np.int32(left) // TILE, (np.int32(right) + TILE) // TILE
            tiles[n, 1], tiles[n, 3] = np.int32(top) // TILE, (np.int32(bottom) + TILE) // TILE
            tiles[n, 2] = min(tiles[n, 2], (width + TILE - 1) // TILE)
            tiles[n, 3] = min(tiles[n, 3], (height + TILE - 1) // TILE)
            d = drawn[n]
            d[0], d[1], d[2], d[3], d[4] = column, row, yy * scale, -xy * scale, xx * scale
            d[5], d[9] = opacities[n], high
            away = ONE / np.sqrt(x * x + y * y + z * z)
            dx, dy, dz = centres[n, 0] - eye[0], centres[n, 1] - eye[1], centres[n, 2] - eye[2]
            basis_of(dx * away, dy * away, dz * away, count, basis)
            for channel in range(3):
                colour = HALF
                for k in range(count):
                    colour += basis[k] * harmonics[n, k, channel]
                d[6 + channel] = max(colour, ZERO)
            bits[0] = z
            keys[n] = (np.uint64(bits.view(np.uint32)[0]) << np.uint64(32)) | np.uint64(n)


@njit(cache=True)
def fill_tiles(order, tiles, across, firsts, starts, splats, pairs):  # type: ignore[no-untyped-def]
    """Write the splats of each tile in ``order``: ``splats`` (P,), of each its row in sums, ``pairs`` (P,).

    ``across``: tiles in a row; ``firsts`` (N,): first row of each splat's sums; ``starts`` (T + 1,): where a tile's
    splats start, which is counted first.
    """
    for n in order:
        for row in range(tiles[n, 1], tiles[n, 3]):
            for column in range(tiles[n, 0], tiles[n, 2]):
                starts[row * across + column + 1] += 1
    for tile in range(len(starts) - 1):
        starts[tile + 1] += starts[tile]
    next_of = starts[:-1].copy()
    for n in order:
        pair = firsts[n]
        for row in range(tiles[n, 1], tiles[n, 3]):
            for column in range(tiles[n, 0], tiles[n, 2]):
                tile = row * across + column
                splats[next_of[tile]], pairs[next_of[tile]] = n, pair
                next_of[tile] += 1
                pair += 1


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def draw_tiles(drawn, across, starts, splats, image):  # type: ignore[no-untyped-def]
    """Draw the tiles' splats, front to back, into ``image`` (4, H, W): RGB times alpha, and alpha."""
    plane, wide = image.shape[1] * image.shape[2], image.shape[2]
    for tile in prange(len(starts) - 1):
        left, top = tile % across * TILE, tile // across * TILE
        lanes = as_floats(lane_numbers()) + (np.float32(left) + HALF)
        going = np.full(TILE, ALL, np.int64)
        through, out = np.ones(TILE * TILE, np.float32), np.zeros(3 * TILE * TILE, np.float32)
        rows_left = TILE
        for at in range(starts[tile], starts[tile + 1]):
            d = drawn[splats[at]]
            first = max(0, np.int64(np.ceil(d[1] - d[9] - HALF)) - top)
            last = min(TILE - 1, np.int64(np.floor(d[1] + d[9] - HALF)) - top)
            dx = lanes - d[0]
            bent = dx * dx * (-HALF * d[2])
            for row in range(first, last + 1):
                if going[row] == 0:
                    continue
                dy = np.float32(top + row) + HALF - d[1]
                alpha = minimum(exp(bent - dx * (d[3] * dy) - HALF * d[4] * dy * dy) * d[5], splat(MOST))
                alpha = select(mask_of(going[row]) & (alpha >= LEAST), alpha, splat(ZERO))
                if bits_of(alpha > ZERO) == 0:
                    continue
                before = load(through, row * TILE)
                after = before - before * alpha
                on = after >= ENOUGH
                going[row] &= bits_of(on)
                if going[row] == 0:
                    rows_left -= 1
                weight = select(on, before - after, splat(ZERO))
                store(through, row * TILE, select(on, after, before))
                for channel in range(3):
                    place = (channel * TILE + row) * TILE
                    store(out, place, load(out, place) + weight * d[6 + channel])
            if rows_left == 0:
                break
        for row in range(TILE):
            place = (top + row) * wide + left
            for channel in range(3):
                store(image, channel * plane + place, load(out, (channel * TILE + row) * TILE))
            store(image, 3 * plane + place, splat(ONE) - load(through, row * TILE))


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def sum_tiles(drawn, across, starts, splats, pairs, image, slope, error, sums):  # type: ignore[no-untyped-def]  # long: one loop, whose state is registers
    """Write the sums of each pair, ``sums`` (P, SUMS), from the ``slope`` of a loss by the ``image``. (4, H, W) both

    ``error`` (H, W): the pixels' errors.
    """
    plane, wide = image.shape[1] * image.shape[2], image.shape[2]
    for tile in prange(len(starts) - 1):
        left, top = tile % across * TILE, tile // across * TILE
        lanes = as_floats(lane_numbers()) + (np.float32(left) + HALF)
        going = np.full(TILE, ALL, np.int64)
        through, rest = np.ones(TILE * TILE, np.float32), np.empty(TILE * TILE, np.float32)
        rows_left = TILE
        for row in range(TILE):  # what lies behind a splat adds to the loss, to first order
            place = (top + row) * wide + left
            behind = (load(image, 3 * plane + place) - ONE) * load(slope, 3 * plane + place)
            for channel in range(3):
                behind = behind + load(image, channel * plane + place) * load(slope, channel * plane + place)
            store(rest, row * TILE, behind)
        for at in range(starts[tile], starts[tile + 1]):
            d, own = drawn[splats[at]], sums[pairs[at]]
            if rows_left == 0:
                own[:] = ZERO
                continue
            first = max(0, np.int64(np.ceil(d[1] - d[9] - HALF)) - top)
            last = min(TILE - 1, np.int64(np.floor(d[1] + d[9] - HALF)) - top)
            dx = lanes - d[0]
            bent = dx * dx * (-HALF * d[2])
            zero = splat(ZERO)
            s, s_x, s_y, s_xx, s_xy, s_yy = zero, zero, zero, zero, zero, zero
            s_red, s_green, s_blue, s_weight, s_error = zero, zero, zero, zero, zero
            for row in range(first, last + 1):
                if going[row] == 0:
                    continue
                dy = np.float32(top + row) + HALF - d[1]
                alpha = exp(bent - dx * (d[3] * dy) - HALF * d[4] * dy * dy) * d[5]
                free = alpha <= MOST
                alpha = minimum(alpha, splat(MOST))
                alpha = select(mask_of(going[row]) & (alpha >= LEAST), alpha, zero)
                if bits_of(alpha > ZERO) == 0:
                    continue
                before = load(through, row * TILE)
                after = before - before * alpha
                on = after >= ENOUGH
                going[row] &= bits_of(on)
                if going[row] == 0:
                    rows_left -= 1
                alpha = select(on, alpha, zero)
                weight = before * alpha
                store(through, row * TILE, before - weight)
                place = (top + row) * wide + left
                red, green, blue = load(slope, place), load(slope, plane + place), load(slope, 2 * plane + place)
                own_slope = red * d[6] + green * d[7] + blue * d[8]
                behind = load(rest, row * TILE) - weight * own_slope
                store(rest, row * TILE, behind)
                by_alpha = before * own_slope - behind / (splat(ONE) - alpha)
                change = select(free, alpha * by_alpha, zero)
                s = s + change
                along, down = change * dx, change * dy
                s_x, s_y = s_x + along, s_y + down
                s_xx, s_xy, s_yy = s_xx + along * dx, s_xy + along * dy, s_yy + down * dy
                s_red, s_green, s_blue = s_red + weight * red, s_green + weight * green, s_blue + weight * blue
                s_weight, s_error = s_weight + weight, s_error + weight * load(error, place)
            own[0], own[1], own[2], own[3], own[4], own[5] = (
                total(s), total(s_x), total(s_y), total(s_xx), total(s_xy), total(s_yy)
            )  # fmt: skip
            own[6], own[7], own[8], own[9], own[10] = (
                total(s_red), total(s_green), total(s_blue), total(s_weight), total(s_error)
            )  # fmt: skip


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def unproject(  # type: ignore[no-untyped-def]
    centres, scales, rotations, harmonics, axes, eye, focal, drawn, firsts, sums, by_centre, by_scale, by_rotation,
    by_opacity, by_harmonic, seen_of,
):  # fmt: skip
    """Write the gradients by splats' centres (N, 3), scales (N, 3), rotations (N, 4), opacities (N,) and harmonics.

    ``seen_of`` (N, 2): its weight in the picture, and the weight times errors. ``firsts`` (N + 1,): where a splat's
    sums start in those of pairs, ``sums`` (P, SUMS).
    """
    for block in prange((len(centres) + BLOCK - 1) // BLOCK):
        turn, flat, out = np.empty((3, 3), np.float32), np.empty((2, 3), np.float32), np.empty((2, 3), np.float32)
        by_turn, by_flat, by_out = np.empty_like(turn), np.empty_like(flat), np.empty_like(out)
        basis, slopes, own = np.empty(16, np.float32), np.empty((16, 3), np.float32), np.empty(SUMS, np.float32)
        for n in range(block * BLOCK, min((block + 1) * BLOCK, len(centres))):
            by_centre[n], by_scale[n], by_rotation[n], seen_of[n] = ZERO, ZERO, ZERO, ZERO
            by_harmonic[n] = ZERO
            by_opacity[n] = ZERO
            if firsts[n] == firsts[n + 1]:
                continue
            own[:] = ZERO
            for pair in range(firsts[n], firsts[n + 1]):
                for k in range(SUMS):
                    own[k] += sums[pair, k]
            d = drawn[n]
            by_opacity[n] = own[0] / d[5]
            by_column, by_row = d[2] * own[1] + d[3] * own[2], d[3] * own[1] + d[4] * own[2]
            seen_of[n, 0], seen_of[n, 1] = own[9], own[10]
            _unproject_shape(
                centres[n], scales[n], rotations[n], axes, eye, focal, d, own, by_column, by_row, by_centre[n],
                by_scale[n], by_rotation[n], turn, flat, out, by_out, by_flat, by_turn,
            )  # fmt: skip
            _uncolour(centres[n], harmonics[n], eye, d, own, by_centre[n], by_harmonic[n], basis, slopes)


@njit(fastmath=FAST_MATH)
def _unproject_shape(  # type: ignore[no-untyped-def]
    centre, scales, rotation, axes, eye, focal, d, own, by_column, by_row, by_centre, by_scale, by_rotation, turn, flat,
    out, by_out, by_flat, by_turn,
):  # fmt: skip
    """Write the gradients by a splat's place and shape, from those by its place and shape in the picture.

    The last six arguments are memory to work in.
    """
    x, y, z = seen = _seen(centre, eye, axes)
    length = _turn(rotation, turn)
    _across(seen, axes, focal, turn, scales, flat, out)
    # By the covariance: the inverse's derivative, between the sums of -dx dx / 2, -dx dy and -dy dy / 2.
    a, b, c, p, q, r = d[2], d[3], d[4], HALF * own[3], HALF * own[4], HALF * own[5]
    h_xx = a * (a * p + b * q) + b * (a * q + b * r)
    h_xy = a * (b * p + c * q) + b * (b * q + c * r)
    h_yy = b * (b * p + c * q) + c * (b * q + c * r)
    by_flat[:] = ZERO
    for k in range(3):
        by_out[0, k] = TWO * (h_xx * out[0, k] + h_xy * out[1, k])
        by_out[1, k] = TWO * (h_xy * out[0, k] + h_yy * out[1, k])
    for i in range(3):
        for k in range(3):
            change = flat[0, i] * by_out[0, k] + flat[1, i] * by_out[1, k]
            by_scale[k] += change * turn[i, k]
            by_turn[i, k] = change * scales[k]
            for row in range(2):
                by_flat[row, i] += by_out[row, k] * turn[i, k] * scales[k]
    _unturn(rotation, length, by_turn, by_rotation)
    # By the place, of which the picture's place and what takes vectors into the picture depend.
    near = focal / z
    across, down, ahead, lower = ZERO, ZERO, ZERO, ZERO  # gradients by the four numbers of the projection's slope
    for k in range(3):
        across += by_flat[0, k] * axes[0, k]
        down += by_flat[0, k] * axes[2, k]
        ahead += by_flat[1, k] * axes[1, k]
        lower += by_flat[1, k] * axes[2, k]
    by_x = near * by_column - near / z * down
    by_y = near * by_row - near / z * lower
    by_z = -near / z * (x * by_column + y * by_row + across + ahead) + TWO * near / (z * z) * (x * down + y * lower)
    for k in range(3):
        by_centre[k] += axes[0, k] * by_x + axes[1, k] * by_y + axes[2, k] * by_z


@njit(fastmath=FAST_MATH)
def _unturn(rotation, length, by_turn, by_rotation):  # type: ignore[no-untyped-def]
    """Write the gradient by a quaternion of a ``length`` from that by its matrix. (3, 3)"""
    w, x, y, z = rotation[0] / length, rotation[1] / length, rotation[2] / length, rotation[3] / length
    g = by_turn
    by_w = TWO * (x * (g[2, 1] - g[1, 2]) + y * (g[0, 2] - g[2, 0]) + z * (g[1, 0] - g[0, 1]))
    by_x = TWO * (
        y * (g[0, 1] + g[1, 0]) + z * (g[0, 2] + g[2, 0]) + w * (g[2, 1] - g[1, 2]) - TWO * x * (g[1, 1] + g[2, 2])
    )
    by_y = TWO * (
        x * (g[0, 1] + g[1, 0]) + z * (g[1, 2] + g[2, 1]) + w * (g[0, 2] - g[2, 0]) - TWO * y * (g[0, 0] + g[2, 2])
    )
    by_z = TWO * (
        x * (g[0, 2] + g[2, 0]) + y * (g[1, 2] + g[2, 1]) + w * (g[1, 0] - g[0, 1]) - TWO * z * (g[0, 0] + g[1, 1])
    )
    along = w * by_w + x * by_x + y * by_y + z * by_z
    by_rotation[0], by_rotation[1] = (by_w - w * along) / length, (by_x - x * along) / length
    by_rotation[2], by_rotation[3] = (by_y - y * along) / length, (by_z - z * along) / length


@njit(fastmath=FAST_MATH)
def _uncolour(centre, harmonics, eye, d, own, by_centre, by_harmonic, basis, slopes):  # type: ignore[no-untyped-def]
    """Write the gradients by a splat's harmonics (K, 3), and add those of its colour by its centre.

    ``basis`` (16,) and ``slopes`` (16, 3) are memory to work in.
    """
    count = len(harmonics)
    x, y, z = centre[0] - eye[0], centre[1] - eye[1], centre[2] - eye[2]
    away = ONE / np.sqrt(x * x + y * y + z * z)
    x, y, z = x * away, y * away, z * away
    basis_of(x, y, z, count, basis)
    for channel in range(3):
        if d[6 + channel] > ZERO:
            for k in range(count):
                by_harmonic[k, channel] = basis[k] * own[6 + channel]
    if count == 1:
        return
    _slopes(x, y, z, count, slopes)
    by_x, by_y, by_z = ZERO, ZERO, ZERO
    for channel in range(3):
        if d[6 + channel] > ZERO:
            for k in range(1, count):
                change = harmonics[k, channel] * own[6 + channel]
                by_x += change * slopes[k, 0]
                by_y += change * slopes[k, 1]
                by_z += change * slopes[k, 2]
    along = x * by_x + y * by_y + z * by_z
    by_centre[0] += (by_x - x * along) * away
    by_centre[1] += (by_y - y * along) * away
    by_centre[2] += (by_z - z * along) * away


@njit(parallel=True, fastmath=FAST_MATH, cache=True)
def step(values, slopes, firsts, mean, square, rate, old, older, unbiased, tiny):  # type: ignore[no-untyped-def]
    """Move the ``values`` (N, F) of the splats that are seen by Adam, from ``slopes`` (N, F).

    Kingma and Ba, "Adam", 2015; only splats with a gradient move, as in Mallick et al., "Taming 3DGS", 2024.
    ``unbiased``: 1 - old^t and 1 - older^t; ``mean``, ``square`` (N, F): its moments.
    """
    for n in prange(len(values)):
        if firsts[n] == firsts[n + 1]:
            continue
        for k in range(values.shape[1]):
            slope = slopes[n, k]
            mean[n, k] = old * mean[n, k] + (ONE - old) * slope
            square[n, k] = older * square[n, k] + (ONE - older) * slope * slope
            values[n, k] -= rate[k] * (mean[n, k] / unbiased[0]) / (np.sqrt(square[n, k] / unbiased[1]) + tiny)
