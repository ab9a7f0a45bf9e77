"""Colours before the first step: features of normals and colours, and a network that already shades by them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from svv.core.colour.shading import Shading
from svv.core.volumes.classified import ClassifiedVolume
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, encode_directions
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.of_values import features_of
from svv.fields.radiance.phong import gradient_of
from svv.train.run.loop import falling, groups_of, network_adam

SCALE = 2.0
"""Length of a normal, and half the range of a colour, among the features."""

POINTS, STEPS = 1024, 400
"""Points of a step in which the network learns to shade, and the number of these steps: less than a second."""

RATE, HOLD = 0.03, 0.5
"""Learning rate of these steps, and the fraction of them after which it falls."""

LEAST_LENGTH = 0.3
"""Length from which an interpolated normal tells a direction."""


def start_colours(
    field: BaseField,
    occupancy: Occupancy,
    volume: ClassifiedVolume,
    shading: Shading | None,
    seed: int = 0,
    most: int = STEPS,
) -> bool:
    """Start the features of a field on the CPU from its volume, and let its network learn how views are shaded.

    Without that, a short schedule goes mostly into the few thousand weights of the network. Nothing is done for fields
    whose density is a network, whose lattice has one level or fewer than three features, or whose views are not shaded.
    Returns whether that was done.

    Args:
        field: Field whose density has its initial values.
        occupancy: Cells that may hold something visible.
        volume: The volume, which tells normals and colours. Without its values, normals are those of the extinction.
        shading: How the views are shaded; None if that is not recorded.
        seed: Seed of the points and directions.
        most: Maximum number of steps, less than :data:`STEPS` before a schedule that is as short.
    """
    encoding, density = field.encoding, field.density
    if shading is None or not shading.seen:  # nothing to learn about light; normals would only be noise
        return False
    if not isinstance(encoding, SparseLattice) or density is None or encoding.levels < 2 or encoding.features < 3:
        return False
    normals, colours = (encoding.rows_of_level(encoding.levels - k) for k in (1, 2))
    with torch.no_grad():
        encoding.table[normals, :3] = SCALE * _normals(encoding, density, occupancy, volume)
        encoding.table[colours, :3] = SCALE * (2.0 * _colours(encoding, occupancy, volume) - 1.0)
    _learn_to_shade(field, occupancy, shading, seed, min(STEPS, most))
    return True


def _normals(encoding: SparseLattice, density: SparseLattice, occupancy: Occupancy, volume: ClassifiedVolume) -> Tensor:
    """Return normals of either orientation at the vertices of the finest level, up to 1 long. (V, 3)"""
    if volume.values is None:
        return gradient_of(density, occupancy, encoding.resolutions[-1])
    vertices = encoding.vertices_of_level(encoding.levels - 1, occupancy.occupied, occupancy.cells)
    return torch.from_numpy(features_of(volume.values, vertices, encoding.resolutions[-1])[1])


def _colours(encoding: SparseLattice, occupancy: Occupancy, volume: ClassifiedVolume) -> Tensor:
    """Return the colours that the transfer function gives the vertices of the level before the finest. (V, 3)"""
    level = encoding.levels - 2
    vertices, grid = encoding.vertices_of_level(level, occupancy.occupied, occupancy.cells), volume.values
    if grid is not None and grid.colours is not None:
        low, high = grid.visible
        value = features_of(replace(grid, visible=(0.0, 1.0)), vertices, encoding.resolutions[level])[0].clip(low, high)
        known = np.linspace(0.0, 1.0, len(grid.colours))
        found = np.stack([np.interp(value, known, one) for one in grid.colours.T], axis=1)
    else:
        at = (vertices * (volume.cells / encoding.resolutions[level])).astype(np.int64)
        owner = volume.owner[tuple(np.minimum(at, np.array(volume.owner.shape) - 1).T)]
        found = np.array([one.colour for one in volume.ranges])[owner]
    return torch.from_numpy(found.astype(np.float32))


def _learn_to_shade(field: BaseField, occupancy: Occupancy, shading: Shading, seed: int, steps: int) -> None:
    """Train the colour network to give random points the colours of their features, shaded by their normals."""
    encoding, generator = field.encoding, np.random.default_rng(seed)
    assert isinstance(encoding, SparseLattice)
    cells, end = np.argwhere(occupancy.occupied), np.asarray(occupancy.box.extent, np.float32)
    networks = network_adam(groups_of([field.colour_mlp], RATE, muon=True))
    rays = torch.arange(POINTS, dtype=torch.int32)
    last, before = (slice(first, first + 3) for first in encoding.width - encoding.features * np.array([1, 2]))
    for step in range(steps):
        cell = cells[generator.integers(0, len(cells), POINTS)]
        place = np.minimum((cell + generator.random(cell.shape)) / occupancy.cells, end).astype(np.float32)
        features = encoding.look_up(torch.from_numpy(place))
        direction = normalize(torch.from_numpy(generator.normal(size=cell.shape).astype(np.float32)))
        shown = _shaded(features[:, last] / SCALE, 0.5 * features[:, before] / SCALE + 0.5, direction, shading)
        networks.zero_grad()
        (field(features, encode_directions(direction, rays)) - shown).square().mean().backward()
        for group in networks.param_groups:
            group["lr"] = RATE * falling(step / steps, 0.0, HOLD)
        networks.step()
    networks.zero_grad()


def _shaded(normal: Tensor, colour: Tensor, direction: Tensor, shading: Shading) -> Tensor:
    """Return colours (S, 3) with a headlight that shines along directions (S, 3) on normals of either orientation."""
    length = normal.norm(dim=1, keepdim=True).clamp(min=LEAST_LENGTH)
    cosine = ((normal * direction).sum(dim=1, keepdim=True) / length).abs()
    highlight = shading.specular * cosine**shading.specular_power
    return (colour * (shading.ambient + shading.diffuse * cosine) + highlight).clamp(0.0, 1.0)
