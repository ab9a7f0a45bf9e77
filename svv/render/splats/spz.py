"""Splats as .spz of Niantic, version 3: a gzipped header and bytes, about a tenth of a .ply.

Positions have 24 bits, scales a 16th of a natural logarithm, the three smaller components of a quaternion 10 bits,
opacities 8, coefficients 5 to 8. https://github.com/nianticlabs/spz
"""

from __future__ import annotations

import gzip
import struct
import zlib
from itertools import pairwise
from pathlib import Path

import numpy as np

from svv.errors import BadInput, Progress, silent
from svv.fields.splats.splats import Splats
from svv.io.files.atomic import atomic_path
from svv.io.files.declared_sizes import check_fits

MAGIC, VERSION = 0x5053474E, 3
HEADER = struct.Struct("<IIIBBBB")
"""Magic, version, number of splats, degree, fractional bits, flags, 0."""

EXTENDED = 2
"""The flag of files with extensions, which may change what coefficients mean."""

MOST_POINTS = 10_000_000
"""What the authors' reader accepts."""

SIDES = (1.0, 1000.0)
"""Longest sides in a file's unit: scales from 5e-5 to 380 can be held."""

COLOUR_STEP = 0.15
"""What the coefficient of the constant harmonic is multiplied by."""

STEPS = 16.0
"""Steps of coefficients beyond the constant's from 0 to 1, of 128 that bytes could have: files are a quarter smaller,
and pictures of painted scenes 51 dB from those of the splats (47 with the 8 steps that the authors keep)."""

LARGEST_BITS = 511.0 * np.sqrt(2.0)
"""What a smaller component of a quaternion, at most 1/sqrt(2), is multiplied by."""


def write_spz(path: Path, splats: Splats, progress: Progress = silent) -> list[str]:
    """Write splats whose positions and scales fit, whole or not at all; return sentences on what the format lost.

    Raises BadInput for more splats than readers accept, or as `atomic_path`.
    """
    n, k = splats.harmonics.shape[:2]
    if n > MOST_POINTS:
        raise BadInput(f"A .spz file holds at most {MOST_POINTS} splats, not {n}: write a .ply file.")
    furthest = float(np.abs(splats.centres).max())
    bits = int(np.clip(np.floor(np.log2((2**23 - 1) / max(furthest, 1e-6))), 0, 20))
    logs = (np.log(splats.scales) + 10.0) * 16.0
    fixed = np.rint(splats.centres.astype(float) * 2.0**bits).astype("<i4")
    parts = [
        fixed.view(np.uint8).reshape(n, 3, 4)[:, :, :3],
        _bytes(splats.opacities * 255.0), _bytes(splats.harmonics[:, 0] * (COLOUR_STEP * 255.0) + 127.5),
        _bytes(logs), _packed_turns(splats.rotations),
        _bytes(np.rint(splats.harmonics[:, 1:] * STEPS) * (128.0 / STEPS) + 128.0),
    ]  # fmt: skip
    progress(0.2, "compressing")
    header = HEADER.pack(MAGIC, VERSION, n, int(np.sqrt(k)) - 1, bits, 0, 0)
    with atomic_path(path) as temporary, temporary.open("wb") as raw:
        with gzip.GzipFile(filename="", mode="wb", fileobj=raw, mtime=0) as file:
            file.write(header)
            for number, part in enumerate(parts):
                file.write(part.tobytes())
                progress(0.2 + 0.8 * (number + 1) / len(parts), "compressing")
    steep = int((np.abs(splats.harmonics[:, 1:]) > 1.0 + 0.5 / STEPS).any(axis=(1, 2)).sum())
    colour = np.abs(splats.harmonics[:, 0]) * COLOUR_STEP > 0.5
    lost = steep + int(colour.any(axis=1).sum())
    return [f"{lost} splats have stronger colours than .spz holds, which cuts them; .ply keeps them."] if lost else []


def read_spz(path: Path) -> Splats:
    """Return a file's splats in its own units, all of region 0; raises BadInput for other than versions 2 and 3."""
    content, n, degree, version, bits = _unzipped(path)
    ends = n * np.cumsum([0, *_widths(degree, version)])
    places, alpha, colour, logs, turns, rest = (
        np.frombuffer(content, np.uint8, b - a, a).reshape(n, -1) for a, b in pairwise(ends)
    )
    fixed = np.zeros((n, 3, 4), np.uint8)
    fixed[:, :, 1:] = places.reshape(n, 3, 3)
    harmonics = np.concatenate(
        [((colour / 255.0 - 0.5) / COLOUR_STEP)[:, None], (rest.reshape(n, -1, 3) - 128.0) / 128.0], axis=1
    )
    return Splats(
        centres=((fixed.view("<i4")[..., 0] >> 8) / 2.0**bits).astype(np.float32),
        scales=np.exp(logs / 16.0 - 10.0).astype(np.float32),
        rotations=_unpacked_turns(turns).astype(np.float32),
        opacities=(alpha[:, 0] / 255.0).astype(np.float32), harmonics=harmonics.astype(np.float32),
        regions=np.zeros(n, np.int16), names=("0",), background=(1.0, 1.0, 1.0),
    )  # fmt: skip


def _unzipped(path: Path) -> tuple[bytes, int, int, int, int]:
    """Return a file's bytes after the header, and number of splats, degree, version and fractional bits."""
    remedy = f"{path} is no whole .spz file of version 2 or 3: copy it again, or convert it to .ply."
    unpacker = zlib.decompressobj(31)
    try:
        header = unpacker.decompress(path.read_bytes(), HEADER.size)
        magic, version, n, degree, bits, flags, _ = HEADER.unpack(header)
        if magic != MAGIC or version not in (2, 3) or degree > 3 or flags & EXTENDED or not 0 < n <= MOST_POINTS:
            raise BadInput(remedy)
        size = n * sum(_widths(degree, version))
        check_fits(size, str(path))
        content = unpacker.decompress(unpacker.unconsumed_tail, size + 1)  # no more, whatever the file unpacks to
    except (struct.error, zlib.error) as error:
        raise BadInput(remedy) from error
    if len(content) != size:
        raise BadInput(remedy)
    return content, n, degree, version, bits


def _widths(degree: int, version: int) -> list[int]:
    """Bytes of each splat's position, opacity, colour, scales, quaternion and other coefficients."""
    return [9, 1, 3, 3, 4 if version == 3 else 3, 3 * ((degree + 1) ** 2 - 1)]


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(values), 0.0, 255.0).astype(np.uint8)


def _packed_turns(rotations: np.ndarray) -> np.ndarray:
    """Quaternions w, x, y, z as 32 bits: which of x, y, z, w is largest, and sign and magnitude of the others. (N,)"""
    turns = np.roll(rotations.astype(float), -1, axis=1)  # x, y, z, w
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    largest = np.abs(turns).argmax(axis=1)
    turns *= np.where(np.take_along_axis(turns, largest[:, None], 1) < 0.0, -1.0, 1.0)
    packed = largest.astype(np.uint32)
    for k in range(4):
        magnitude = np.minimum(np.abs(turns[:, k]) * LARGEST_BITS + 0.5, 511.0).astype(np.uint32)
        with_it = packed << 10 | (turns[:, k] < 0.0).astype(np.uint32) << 9 | magnitude
        packed = np.where(largest == k, packed, with_it)
    return packed.astype("<u4")


def _unpacked_turns(turns: np.ndarray) -> np.ndarray:
    """Quaternions w, x, y, z of 4 bytes each, or of version 2's 3 bytes. (N, 4)"""
    if turns.shape[1] == 3:
        xyz = turns / 127.5 - 1.0
        return np.concatenate([np.sqrt(np.maximum(1.0 - (xyz**2).sum(axis=1), 0.0))[:, None], xyz], axis=1)
    packed = np.ascontiguousarray(turns).view("<u4")[:, 0]
    largest, found = packed >> 30, np.zeros((len(packed), 4))
    for k in (3, 2, 1, 0):
        value = (packed & 511) / LARGEST_BITS * np.where(packed & 512, -1.0, 1.0)
        found[:, k] = np.where(largest == k, 0.0, value)
        packed = np.where(largest == k, packed, packed >> 10)
    rest = np.sqrt(np.maximum(1.0 - (found**2).sum(axis=1), 0.0))
    np.put_along_axis(found, largest[:, None].astype(np.int64), rest[:, None], 1)
    return np.roll(found, 1, axis=1)
