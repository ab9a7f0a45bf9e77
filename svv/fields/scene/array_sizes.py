"""The sizes of a scene's arrays that follow from its header, known without building its networks."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.light import COEFFICIENTS
from svv.fields.radiance.widths import DIRECTION_WIDTH, FACING_WIDTH

Arrays = Mapping[str, NDArray[np.generic]]


def check_array_sizes(header: Mapping[str, Any], tensors: Arrays, occupied: NDArray[np.uint8]) -> None:
    """Raise ValueError, KeyError or TypeError unless networks and tables have the sizes that loading expects.

    ``header`` and ``tensors`` are those of a file of this version with one transfer function, and ``occupied`` its
    cells (X, Y, Z).
    """
    for name, shape in _weights(header):
        if tensors[name].shape != shape:
            raise ValueError(f"{name} is not {' x '.join(map(str, shape))}")
    counts: dict[int, int] = {}
    for name, resolutions, features in _tables(header):
        if name not in tensors:  # it follows from values or strokes
            continue
        for resolution in resolutions:
            if resolution not in counts:
                counts[resolution] = count_vertices(occupied, header["cells"], resolution)
        rows = sum(counts[resolution] for resolution in resolutions)
        ends = tensors[f"{name}.ends"].shape if tensors[name].dtype == np.uint8 else (len(resolutions), 2, features)
        if tensors[name].shape != (rows, features) or ends != (len(resolutions), 2, features):
            raise ValueError(f"{name} is not {rows} x {features}")


def count_vertices(occupied: NDArray[np.uint8], cells: int, resolution: int) -> int:
    """Return how many vertices cells (X, Y, Z), ``cells`` per box unit, have at a resolution: a divisor, or a multiple.

    Those of finer cells lie on the corners, edges, faces and inside of the given ones, each of which is counted once.

    >>> count_vertices(np.ones((2, 2, 2), np.uint8), 2, 4), count_vertices(np.ones((2, 2, 2), np.uint8), 2, 1)
    (125, 8)
    """
    there, parts = occupied > 0, resolution // cells
    if resolution < cells:
        side, parts = cells // resolution, 1
        there = np.pad(there, [(0, -n % side) for n in there.shape])
        x, y, z = (n // side for n in there.shape)
        there = np.asarray(there.reshape(x, side, y, side, z, side).any(axis=(1, 3, 5)))
    if max(resolution, cells) % min(resolution, cells):
        raise ValueError(f"the resolution {resolution} does not fit {cells} cells")
    total = 0
    for extended in itertools.product((False, True) if parts > 1 else (False,), repeat=3):
        part = there
        for axis in range(3):
            if not extended[axis]:  # between two cells, or at the end of one
                part = np.pad(np.moveaxis(part, axis, 0), [(1, 1), (0, 0), (0, 0)])
                part = np.moveaxis(part[1:] | part[:-1], 0, axis)
        total += int(np.count_nonzero(part)) * (parts - 1) ** sum(extended)
    return total


def _weights(header: Mapping[str, Any]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Yield names and shapes of the networks' weights."""
    s, count = header["settings"], len(header["regions"])
    lattice = s["encoding"] == "lattice"
    features = (len(s["resolutions"]) if lattice else s["levels"]) * s["features"]
    inputs = (features if lattice else 15) + DIRECTION_WIDTH
    yield from _layers("base.colour_mlp", inputs + FACING_WIDTH * s["facing"], s["width"], 2, 3)
    if "pcn" in header["networks"]:
        yield "pcn.colours", (count, 3)
        yield from _layers("pcn.palette_mlp", features, s["width"], 1, 1 + 4 * count)
        if s["lighting"] == "network":
            yield from _layers("pcn.lighting_mlp", inputs, s["width"], 2, 2 if s["shading"] else 1)
        if s["lighting"] == "phong":
            yield "pcn.phong.raw", (count, len(COEFFICIENTS))
    for name, resolutions, direct in _paintings(header):
        if not direct:
            levels = len(resolutions) if lattice else s["levels"]
            yield from _layers(f"{name}.colour_mlp", levels * s["features"], s["width"], 2, 3)


def _layers(name: str, inputs: int, width: int, hidden: int, outputs: int) -> Iterator[tuple[str, tuple[int, int]]]:
    """Yield names and shapes of an MLP's weights; an activation follows each layer but the last."""
    for number in range(hidden):
        yield f"{name}.{2 * number}.weight", (width, inputs)
        inputs = width
    yield f"{name}.{2 * hidden}.weight", (outputs, inputs)


def _tables(header: Mapping[str, Any]) -> Iterator[tuple[str, Sequence[int], int]]:
    """Yield names, resolutions and features of the lattices."""
    s = header["settings"]
    every = [*s["resolutions"], *s["finer"]]
    if s["encoding"] == "lattice":
        yield "base.encoding.table", s["resolutions"], s["features"]
        yield "base.density.table", header["density_resolutions"], 1
        yield "pcn.encoding.table", s["resolutions"], s["features"]
    yield "pcn.phong.normals.table", header["normal_resolutions"] or every, 3
    for name, resolutions, direct in _paintings(header):
        if direct or s["encoding"] == "lattice":
            yield f"{name}.encoding.table", resolutions[-1:] if direct else resolutions, 3 if direct else s["features"]


def _paintings(header: Mapping[str, Any]) -> Iterator[tuple[str, Sequence[int], bool]]:
    """Yield names and resolutions of the paintings, and whether their lattices hold the colours themselves."""
    every = [*header["settings"]["resolutions"], *header["settings"]["finer"]]
    if "styled" in header["networks"]:
        yield "styled", header["paint_resolutions"] or every, header["paint_direct"]
    for number, variant in enumerate(header["variants"]):
        yield f"variant{number}", variant["resolutions"] or every, variant["direct"]
