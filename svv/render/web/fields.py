"""A scene's fields on grids, for a viewer that interpolates them instead of running networks.

Letters: V vertices of a grid, C channels, P regions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.extinction import LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.core.light import NORMAL_SCALE
from svv.errors import Progress, part, silent
from svv.fields.encodings import Encoding, SparseLattice
from svv.fields.occupancy import Occupancy
from svv.fields.scene import Scene
from svv.render.web.harmonics import fitted_light, geometry_at

LEAST_WEIGHT = 0.02
"""Palette weight below which a colour's offset is left out: it cannot be seen, and zeros take no room in the file."""

HASH_CELLS = 128
"""Cells per box unit of the grids of a scene whose encoding is a hash grid, which has no vertices of its own."""

VERTICES_AT_A_TIME = 1 << 17
"""Vertices whose values are computed together, to bound the memory."""


@dataclass(frozen=True)
class Grid:
    """Vertices of the occupied cells at one resolution, in raster order, as in :class:`SparseLattice`."""

    resolution: int
    """Cells per box unit."""
    places: Tensor
    """Box coordinates, in occupied cells. (V, 3)"""

    @classmethod
    def of(cls, occupancy: Occupancy, resolution: int) -> Grid:
        """Return the grid of a scene's occupied cells."""
        lattice = SparseLattice(occupancy.occupied, occupancy.cells, (resolution,), 1)
        places = torch.from_numpy(lattice.places_of_level(0, occupancy.occupied, occupancy.cells))
        return cls(resolution, torch.minimum(places, places.new_tensor(occupancy.box.extent)))

    def pieces(self) -> Iterator[Tensor]:
        """Yield the places in pieces of at most :data:`VERTICES_AT_A_TIME`."""
        yield from self.places.split(VERTICES_AT_A_TIME)


@dataclass(frozen=True)
class Field:
    """Values on the vertices of a grid, as bytes: value = low + code / 255 (high - low)."""

    name: str
    resolution: int
    """Cells per box unit of its grid."""
    low: NDArray[np.float32]
    """Value of code 0 of each channel. (C,)"""
    high: NDArray[np.float32]
    """Value of code 255 of each channel. (C,)"""
    codes: NDArray[np.uint8]
    """(C, V)"""

    @classmethod
    def of(cls, name: str, resolution: int, values: Tensor, ends: tuple[float, float] | None = None) -> Field:
        """Return a field of values (V, C); without ``ends``, each channel's codes span its own range."""
        if ends is None:
            low, high = torch.aminmax(values, dim=0)
        else:
            low, high = (torch.full_like(values[0], end) for end in ends)
        span = (high - low).clamp(min=1e-12)
        codes = ((values.clamp(low, high) - low) * (255.0 / span)).round().byte()
        return cls(name, resolution, low.numpy(), high.numpy(), np.ascontiguousarray(codes.T.numpy()))

    def values(self) -> Tensor:
        """Return the values of the codes. (V, C)"""
        part = torch.from_numpy(self.codes.T.astype(np.float32)) / 255.0
        return torch.from_numpy(self.low) * (1.0 - part) + torch.from_numpy(self.high) * part


@torch.no_grad()
def fields_of(scene: Scene, progress: Progress = silent) -> list[Field]:
    """Return what a viewer needs to draw a scene with its palette: on the CPU, as bytes.

    ``extinction`` is its logarithm (1 channel). ``material`` holds intensity and palette weights (1 + P), ``colours``
    the palette's colours with their offsets (3 P). ``light`` holds vectors v of the normals under an explicit light
    (3), and otherwise coefficients of the shade and the specular light (see :mod:`svv.render.web.harmonics`); it is
    missing where the scene has no light. ``paint0``, ``paint1`` and so on are the colours of its paintings (3 each).

    Args:
        scene: A scene with a palette network, on the CPU.
        progress: Called while the fields are computed.
    """
    grids: dict[int, Grid] = {}

    def grid(encoding: Encoding | None) -> Grid:
        resolution = encoding.resolutions[-1] if isinstance(encoding, SparseLattice) else HASH_CELLS
        if resolution not in grids:
            grids[resolution] = Grid.of(scene.occupancy, resolution)
        return grids[resolution]

    palette = scene.palette_network
    assert palette is not None
    progress(0.0, "extinction")
    own = grid(scene.base.density)
    exponent = torch.cat([geometry_at(scene, places)[0] for places in own.pieces()])
    found = [Field.of("extinction", own.resolution, exponent.clamp(LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION)[:, None])]
    progress(0.1, "material")
    own = grid(palette.encoding)
    found += _material(scene, own)
    paintings = scene.every_variant
    for number, variant in enumerate(paintings):
        progress(0.2 + 0.1 * number / len(paintings), f"painting {variant.name}")
        canvas = grid(variant.network.encoding)
        paint = torch.cat([variant.network(places) for places in canvas.pieces()])
        found.append(Field.of(f"paint{number}", canvas.resolution, paint, (0.0, 1.0)))
    if palette.phong is not None:
        normals = palette.phong.normals
        vectors = [normals(x).view(len(x), -1, 3).sum(dim=1) for x in grid(normals).pieces()]
        found.append(Field.of("light", grid(normals).resolution, NORMAL_SCALE * torch.cat(vectors)))
    elif palette.lighting_mlp is not None:
        light = fitted_light(scene, own.places, part(progress, 0.3, 1.0))
        found.append(Field.of("light", own.resolution, light))
    return found


def _material(scene: Scene, grid: Grid) -> list[Field]:
    palette = scene.palette_network
    assert palette is not None
    shares, colours = [], []
    for places in grid.pieces():
        intensity, weights, offsets = palette.material(places)
        shares.append(torch.cat([intensity[:, None], weights], dim=1))
        seen = torch.where((weights >= LEAST_WEIGHT)[:, :, None], offsets, 0.0)
        colours.append((palette.colours + seen).flatten(1))
    named = {"material": shares, "colours": colours}
    return [Field.of(name, grid.resolution, torch.cat(values)) for name, values in named.items()]
