"""Encodings of positions and directions: the plain references that the compiled kernels must match.

Letters: S samples, L levels, F features per level, V stored vertices (over all levels).
"""

from __future__ import annotations

import itertools

import torch
from torch import Tensor

HASH_PRIMES = (1, 2654435761, 805459861)
"""Factors of the spatial hash (Müller et al. 2022, eq. 4)."""

SH_DEGREES = (1, 2, 3, 4)
"""Supported degrees of spherical harmonics."""

CORNERS = tuple(itertools.product((0, 1), repeat=3))
"""Corners of a cell as steps along x, y and z."""


def spherical_harmonics(directions: Tensor, degree: int = 4) -> Tensor:
    """Return the real spherical harmonics, orthonormal on the sphere, of unit directions (..., 3). (..., degree ** 2)

    Bands 0 to ``degree`` - 1, of 1 to 4; StyleRF-VolVis and Instant-NGP use 4.
    """
    if degree not in SH_DEGREES:
        raise ValueError(f"degree must be one of {SH_DEGREES}, not {degree}")
    x, y, z = directions.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    bands = [torch.full_like(x, 0.28209479177387814)]
    if degree > 1:
        bands += [-0.48860251190291987 * y, 0.48860251190291987 * z, -0.48860251190291987 * x]
    if degree > 2:
        bands += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.94617469575755997 * zz - 0.31539156525251999,
            -1.0925484305920792 * x * z,
            0.54627421529603959 * (xx - yy),
        ]
    if degree > 3:
        bands += [
            0.59004358992664352 * y * (yy - 3.0 * xx),
            2.8906114426405538 * x * y * z,
            0.45704579946446572 * y * (1.0 - 5.0 * zz),
            0.3731763325901154 * z * (5.0 * zz - 3.0),
            0.45704579946446572 * x * (1.0 - 5.0 * zz),
            1.4453057213202769 * z * (xx - yy),
            0.59004358992664352 * x * (3.0 * yy - xx),
        ]
    return torch.stack(bands, dim=-1)


def directions_of_samples(directions: Tensor, ray: Tensor) -> Tensor:
    """Return the spherical harmonics of degree 4 of each sample's ray: unit vectors (R, 3) and rays (S,) -> (S, 16)."""
    if len(ray) < len(directions):
        return spherical_harmonics(directions[ray.long()], 4)
    return spherical_harmonics(directions, 4)[ray.long()]


VERTICES_A_WORD = 32
"""Vertices along z that share a word of a lattice's index."""


def stored_rows(vertices: Tensor, shape: Tensor, base: Tensor | int, index: Tensor) -> Tensor:
    """Return the table rows of a level's vertices (S, 3); those of vertices that are not stored mean nothing. (S,)

    Rows are numbered in raster order. A word of the index tells of :data:`VERTICES_A_WORD` vertices along z which are
    stored, in its lower 32 bits, and the row of the first, in the upper ones; the others' rows follow by counting bits.
    A row per vertex would take 16 times the memory, and every look-up would miss the caches.

    ``shape`` (3,): number of vertices of the level along x, y, z; ``base``: its first word in ``index``, the words of
    all levels in raster order, all int64.
    """
    x, y, z = vertices.unbind(1)
    word = index[
        base + (x * shape[1] + y) * ((shape[2] + VERTICES_A_WORD - 1) // VERTICES_A_WORD) + z // VERTICES_A_WORD
    ]
    before = word & ((1 << z % VERTICES_A_WORD) - 1)
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F)):  # counts bits of pairs, nibbles and bytes
        before = (before & mask) + (before >> shift & mask)
    return (word >> 32) + (before * 0x01010101 >> 24 & 0xFF)


def lattice_corners(x: Tensor, shape: Tensor, scale: Tensor, base: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
    """Return rows and trilinear weights of the eight vertices around positions on a lattice level. (S, 8) each

    ``x`` (S, 3): box coordinates in occupied cells; ``scale``: cells per box unit; the rest as in :func:`stored_rows`.
    """
    f = x * scale
    i = torch.minimum(f.long(), shape - 2)
    w = f - i
    rows, weights = [], []
    for corner in CORNERS:
        bit = torch.tensor(corner, device=x.device)
        rows.append(stored_rows(i + bit, shape, base, index))
        weights.append(torch.where(bit == 1, w, 1.0 - w).prod(dim=1))
    return torch.stack(rows, dim=1), torch.stack(weights, dim=1)


def lattice_features(x: Tensor, shapes: Tensor, scales: Tensor, bases: Tensor, index: Tensor, table: Tensor) -> Tensor:
    """Interpolate trilinearly on L sparse vertex lattices and concatenate the levels' features. (S, L * F)

    ``x`` (S, 3): box coordinates in occupied cells; ``shapes`` (L, 3), ``scales`` (L,) and ``bases``, of which L are
    used: of each level as in :func:`lattice_corners`; ``table``: features (V, F).
    """
    levels = []
    for level in zip(shapes, scales, bases[: len(shapes)], strict=True):
        rows, weights = lattice_corners(x, *level, index)
        levels.append((weights[:, :, None] * table[rows.clamp(max=len(table) - 1)]).sum(dim=1))
    return torch.cat(levels, dim=1)


def hash_rows(vertices: Tensor, resolution: int, entries: int) -> Tensor:
    """Return the rows of vertices (S, 3) int64 in a level's table: direct if all fit, hashed otherwise (S,) int64.

    (Müller et al. 2022, eq. 4.) Coordinates are in [0, ``resolution``]; hashed ``entries`` are a power of two.
    """
    side = resolution + 1
    if side**3 <= entries:
        return (vertices[:, 0] * side + vertices[:, 1]) * side + vertices[:, 2]
    mask = 0xFFFFFFFF
    rows = torch.zeros_like(vertices[:, 0])
    for axis, prime in enumerate(HASH_PRIMES):
        rows = rows ^ ((vertices[:, axis] * prime) & mask)
    return rows % entries


def hash_corners(x: Tensor, resolution: int, first: int, entries: int) -> tuple[Tensor, Tensor]:
    """Return rows and trilinear weights of the eight vertices around positions on a hash grid level. (S, 8) each

    ``x`` (S, 3): box coordinates in [0, 1]; ``resolution``: cells along each axis; ``first`` of its ``entries`` rows.
    """
    f = x * resolution
    i = f.long().clamp(0, resolution - 1)
    w = f - i
    rows, weights = [], []
    for corner in CORNERS:
        bit = torch.tensor(corner, device=x.device)
        rows.append(first + hash_rows(i + bit, resolution, entries))
        weights.append(torch.where(bit == 1, w, 1.0 - w).prod(dim=1))
    return torch.stack(rows, dim=1), torch.stack(weights, dim=1)


def hash_features(x: Tensor, resolutions: Tensor, offsets: Tensor, table: Tensor) -> Tensor:
    """Return the multiresolution hash encoding (Müller et al. 2022, section 3) of box coordinates in [0, 1]. (S, L * F)

    ``resolutions`` (L,) int64: cells along each axis; ``offsets`` (L + 1,) int64: first row of each level in ``table``
    (V, F), and the end of the last.
    """
    levels = []
    ends = offsets.tolist()
    for resolution, first, end in zip(resolutions.tolist(), ends, ends[1:]):
        rows, weights = hash_corners(x, resolution, first, end - first)
        levels.append((weights[:, :, None] * table[rows]).sum(dim=1))
    return torch.cat(levels, dim=1)
