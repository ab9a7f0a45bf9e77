"""A scene's fields on grids, for a viewer that interpolates them instead of running networks.

Values are stored with as few levels as their effect on pictures needs, so that a page can be sent; what that costs in
dB is in docs/measurements/large.md#pages-for-browsers. Letters: V vertices of a grid, C channels, P regions, N levels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from torch import Tensor

from svv.core.colour.light import NORMAL_SCALE
from svv.core.rays.extinction import LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.errors import Progress, part, silent
from svv.fields.radiance.encodings import Encoding, SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.scene.occlusion import is_occluded, occlude
from svv.fields.scene.scene import Scene
from svv.render.web.harmonics import BANDS, fitted_light, geometry_at, principal
from svv.render.web.holding_kernels import held

VERTICES_AT_A_TIME = 1 << 17
"""Vertices whose values are computed together, to bound the memory."""

VISIBLE_LENGTH = 1.0 / 16.0
"""Length in box units over which a vertex's extinction is seen: its opacity over it is how much its values show."""

LEAST_WEIGHT = 0.05
"""Palette weight below which a colour's offset is left out: it cannot be seen."""

EXTINCTION_STEP, MOST_EXTINCTION_STEP, EXTINCTION_LENGTH = 0.2, 0.8, 1.0 / 64.0
"""Distance between levels of the logarithm of the extinction, where it matters most, and elsewhere: it matters most
where the optical depth over EXTINCTION_LENGTH box units is 1, little in haze and little in what is opaque anyway."""

HOLD = 0.75
"""Tolerance of the extinction in levels; 0.5 would round."""

SHARE_STEP = 1.0 / 63.0
"""Distance between levels of the palette weights."""


@dataclass(frozen=True)
class Steps:
    """How exactly the channels of a field are stored."""

    step: float
    """Distance between levels."""
    tolerance: float = 0.0
    """Greatest error where a surface shows the value, if above half a step; it grows as the vertex is seen less."""
    most: float = 0.0
    """Greatest error anywhere, if above half a step."""


MATERIAL = Steps(0.02, 0.02, 0.1)
LIGHT = Steps(0.08, 0.04, 0.3)
NORMALS = Steps(0.03, 0.015, 0.15)
PAINT = Steps(1.0 / 20.0, 0.05, 0.2)
"""Of the intensity and the palette's colours, as fractions; of the amounts of light, in units of harmonics; of vectors
whose direction is a normal; and of paint."""


Channel = tuple[NDArray[np.float32], NDArray[np.uint8]]
"""Values of a channel's levels (N,), ascending, and the number of each vertex's level (V,)."""


class Grid:
    """Vertices of the occupied cells at one resolution, in raster order, as in :class:`SparseLattice`."""

    def __init__(self, occupancy: Occupancy, resolution: int) -> None:
        """Lay out the grid; ``resolution``: cells per box unit."""
        lattice = SparseLattice(occupancy.occupied, occupancy.cells, (resolution,), 1)
        places = torch.from_numpy(lattice.places_of_level(0, occupancy.occupied, occupancy.cells))
        self.resolution = resolution
        self.shape = tuple(lattice.shapes[0].tolist())
        pieces = lattice.pieces_of_level(0, occupancy.occupied, occupancy.cells)
        self.vertices = np.concatenate([np.zeros((0, 3), np.int32), *(own.astype(np.int32) for _, own in pieces)])
        """Integer coordinates. (V, 3)"""
        self.places = torch.minimum(places, places.new_tensor(occupancy.box.extent))
        """Box coordinates, in occupied cells. (V, 3)"""

    def pieces(self) -> Sequence[Tensor]:
        """Return the places in pieces of at most :data:`VERTICES_AT_A_TIME`."""
        return self.places.split(VERTICES_AT_A_TIME)


@dataclass(frozen=True)
class Field:
    """Values on the vertices of a grid. The byte b stands for low + b / 255 (high - low)."""

    name: str
    resolution: int
    """Cells per box unit of its grid."""
    low: list[float]
    """Value of byte 0 of each channel. (C)"""
    high: list[float]
    """Value of byte 255 of each channel. (C)"""
    levels: list[list[int]]
    """Byte of each level of each channel, ascending. (C, N)"""
    codes: NDArray[np.uint8]
    """Numbers of levels. (C, V)"""

    @classmethod
    def of(cls, name: str, resolution: int, channels: Sequence[Channel], unit: bool = False) -> Field:
        """Return a field of channels; bytes of a ``unit`` field stand for values in [0, 1]."""
        ends = [(float(levels[0]), max(float(levels[-1]), float(levels[0]) + 1e-6)) for levels, _ in channels]
        ends = [(0.0, 1.0)] * len(channels) if unit else ends
        parts = [(levels - low) / (high - low) for (levels, _), (low, high) in zip(channels, ends, strict=True)]
        levels = [np.rint(255.0 * part).clip(0, 255).astype(int).tolist() for part in parts]
        codes = np.stack([codes for _, codes in channels])
        return cls(name, resolution, [low for low, _ in ends], [high for _, high in ends], levels, codes)

    def values(self) -> NDArray[np.float32]:
        """Return what a viewer makes of the codes. (V, C)"""
        parts = [np.array(levels)[codes] / 255.0 for levels, codes in zip(self.levels, self.codes, strict=True)]
        low, high = np.array(self.low), np.array(self.high)
        return (low + (high - low) * np.stack(parts, axis=1)).astype(np.float32)


class Baker:
    """Computes the fields of one scene, on the CPU."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.grids: dict[int, Grid] = {}
        self.found: list[Field] = []
        assert scene.palette_network is not None
        self.palette = scene.palette_network
        self._opacity: tuple[int, NDArray[np.uint8]] | None = None
        self._seen: dict[int, NDArray[np.float32]] = {}

    def grid(self, encoding: Encoding | None) -> Grid:
        """Return the grid for an encoding's values: of its finest level, or for a hash grid of the occupied cells."""
        finest = encoding.resolutions[-1] if isinstance(encoding, SparseLattice) else self.scene.occupancy.cells
        resolution = int(finest)
        if resolution not in self.grids:
            self.grids[resolution] = Grid(self.scene.occupancy, resolution)
        return self.grids[resolution]

    def extinction(self) -> None:
        """Add the logarithm of the extinction."""
        grid = self.grid(self.scene.base.density)
        exponent = torch.cat([geometry_at(self.scene, places)[0] for places in grid.pieces()]).numpy()
        exponent = exponent.clip(LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION)
        levels = [float(exponent.min())]
        while levels[-1] < exponent.max():
            depth = np.exp(levels[-1]) * EXTINCTION_LENGTH
            least = EXTINCTION_STEP / max(depth * np.exp(1.0 - depth), 1e-6)
            levels.append(levels[-1] + min(least, MOST_EXTINCTION_STEP))
        number = np.interp(exponent, levels, np.arange(len(levels)))
        codes = held(number, np.full(len(number), HOLD))
        self.found.append(Field.of("extinction", grid.resolution, [(np.array(levels, np.float32), codes)]))
        opacity = np.zeros(grid.shape, np.uint8)
        opacity[tuple(grid.vertices.T)] = np.rint(255.0 * -np.expm1(-VISIBLE_LENGTH * np.exp(exponent)))
        self._opacity = grid.resolution, opacity

    def seen(self, grid: Grid) -> NDArray[np.float32]:
        """Return how much the values at a grid's vertices show, in [0, 1]: the greatest opacity around each. (V,)"""
        assert self._opacity is not None
        resolution, opacity = self._opacity
        if grid.resolution not in self._seen:
            around = maximum_filter(opacity, 2 * max(1, resolution // grid.resolution) + 1)
            at = np.minimum(grid.vertices * resolution // grid.resolution, np.array(opacity.shape) - 1)
            self._seen[grid.resolution] = around[tuple(at.T)].astype(np.float32) / 255.0
        return self._seen[grid.resolution]

    def stored(self, grid: Grid, values: NDArray[np.float32], how: Steps) -> list[Channel]:
        """Return levels and codes of each channel of values (V, C)."""
        seen, channels = self.seen(grid), []
        for channel in values.T:
            low, high = float(channel.min()), float(channel.max())
            step = max(how.step, (high - low) / 255.0)
            tolerance = np.clip(how.tolerance / np.maximum(seen, 1e-3), 0.0, how.most) / step
            codes = held((channel - low) / step, np.maximum(tolerance, 0.5))
            channels.append((low + step * np.arange(int(codes.max()) + 1, dtype=np.float32), codes))
        return channels

    def material(self) -> None:
        """Add intensity, palette weights, and the palette's colours with their offsets."""
        grid, shares, material = self.grid(self.palette.encoding), [], []
        for places in grid.pieces():
            intensity, weights, offsets = self.palette.material(places)
            occlude(self.scene, intensity[:, None], places, self.scene.region_of(places, weights))
            shown = torch.where((weights >= LEAST_WEIGHT)[:, :, None], offsets, 0.0)
            weights, colours = self._of_regions(places, weights, self.palette.colours + shown)
            shares.append(weights)
            material.append(torch.cat([intensity[:, None], colours.flatten(1)], dim=1))
        channels = self.stored(grid, torch.cat(shares).numpy(), Steps(SHARE_STEP))
        self.found.append(Field.of("weights", grid.resolution, channels, unit=True))
        channels = self.stored(grid, torch.cat(material).numpy(), MATERIAL)
        self.found.append(Field.of("material", grid.resolution, channels))

    def _of_regions(self, places: Tensor, weights: Tensor, colours: Tensor) -> tuple[Tensor, Tensor]:
        """Return palette weights (V, P) and colours (V, P, 3) as those of the regions: a part has a colour of its own.

        The viewer thus need not know about parts. Where a region is not, its weight is 0.
        """
        here = self.scene.regions_at(places)
        if here is None:
            return weights, colours
        spread = self.palette.colours[self.scene.roots].expand(len(places), -1, -1)
        own = weights.new_zeros(spread.shape[:2]).scatter(1, here, weights)
        return own, spread.scatter(1, here[:, :, None].expand(-1, -1, 3), colours)

    def paint(self, progress: Progress) -> None:
        """Add the colours of each painting."""
        paintings = self.scene.every_variant
        for number, variant in enumerate(paintings):
            progress(number / len(paintings), f"painting {variant.name}")
            network = self.scene.with_variant(variant.name).paint_shown
            assert network is not None
            grid = self.grid(network.encoding)
            pieces = []
            for places in grid.pieces():
                pieces.append(network(places).clamp(0.0, 1.0))
                if is_occluded(self.scene):
                    occlude(
                        self.scene, pieces[-1], places, self.scene.region_of(places, self.palette.material(places)[1])
                    )
            stored = self.stored(grid, torch.cat(pieces).numpy(), PAINT)
            self.found.append(Field.of(f"paint{number}", grid.resolution, stored, unit=True))

    def light(self, progress: Progress) -> dict[str, object]:
        """Add the light, if the scene has one, and return how a viewer reads that of a network."""
        phong = self.palette.phong
        if phong is not None:
            grid = self.grid(phong.normals)
            vectors = torch.cat([phong.normals(places).unflatten(1, (-1, 3)).sum(dim=1) for places in grid.pieces()])
            channels = self.stored(grid, (NORMAL_SCALE * vectors).numpy(), NORMALS)
            self.found.append(Field.of("light", grid.resolution, channels))
        elif self.palette.lighting_mlp is not None:
            grid = self.grid(self.palette.encoding)
            self.grids.clear()  # finer ones are not needed any more
            fitted = fitted_light(self.scene, grid.places, progress)
            light = fitted.numpy()
            mean, axes, amounts = principal(light, self.seen(grid))
            self.found.append(Field.of("light", grid.resolution, self.stored(grid, amounts, LIGHT)))
            return {"harmonics": BANDS**2, "mean": mean, "axes": axes}
        return {}


@torch.no_grad()
def fields_of(scene: Scene, progress: Progress = silent) -> tuple[list[Field], dict[str, object]]:
    """Return what a viewer needs to draw a scene with a palette network, on the CPU, and how to read a network's light.

    ``extinction`` is its logarithm (1 channel). ``weights`` holds palette weights (P), ``material`` the intensity and
    the palette's colours with their offsets (1 + 3 P). ``light`` holds vectors v of the normals under an explicit light
    (3) and otherwise amounts of light; it is missing where the scene has no light. ``paint0``, ``paint1`` and so on are
    the colours of its paintings (3 each).

    Of a network's light, shade and specular light are dot products of ``harmonics`` harmonics of a ray's direction with
    each half of ``mean`` + amounts @ ``axes``; nothing is told of any other light.
    """
    baker = Baker(scene)
    progress(0.0, "extinction")
    baker.extinction()
    progress(0.1, "material")
    baker.material()
    baker.paint(part(progress, 0.2, 0.4))
    light = baker.light(part(progress, 0.4, 1.0))
    return baker.found, light
