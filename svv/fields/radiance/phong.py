"""An explicit light in place of the lighting network: with normals and a dozen numbers, the light can be moved.

Letters: S samples, R rays, P palette colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import softplus

from svv.core.colour.light import COEFFICIENTS, NORMAL_SCALE, Lamp, blinn_phong, normals_of
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.core.rays.extinction import LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Rays
from svv.kernels.constants import numbers_on

LONGEST_VECTOR = 2.0
"""Length beyond which a vector v carries no more information; shorter vectors fit into bytes more exactly."""

SHININESS_UNIT = 10.0
"""Unit of the highlight's exponent during training."""

START_COEFFICIENTS = {"ambient": 0.08, "diffuse": 0.9, "specular": 0.05, "shininess": 13.0}
"""Initial coefficients if the views do not record how they were shaded."""

LEAST_COEFFICIENTS = {"ambient": 0.02, "diffuse": 0.05, "specular": 0.01, "shininess": 1.0}
"""Smallest initial coefficients, because a softplus hardly learns from 0."""

EXTINCTION_POWER = 0.25
"""Power of the extinction whose gradient initialises the normals: with 1, faint surfaces would have almost none."""

GRADIENT_DEVIATION = 1.0
"""Standard deviation of the Gaussian whose derivatives give that gradient, in cells."""


@dataclass(frozen=True)
class Beams:
    """Light along R rays: unit vectors towards the viewer and towards the light, (R, 3) each, and its brightness."""

    facing: Tensor
    toward: Tensor
    intensity: float = 1.0
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """The camera's axis up in the world."""
    shadows_from: tuple[float, float, float] | None = None
    """World direction, of length 1, from which shadows come; None where none are cast, or no camera is known."""

    @classmethod
    def headlight(cls, facing: Tensor) -> Beams:
        """Return beams of a light at the viewer."""
        return cls(facing, facing)

    @classmethod
    def of(cls, lamp: Lamp, camera: Camera, rays: Rays) -> Beams:
        """Return beams of a lamp for a camera's rays."""
        rotation = camera.camera_to_world[:3, :3]
        facing = -rays.lit_along
        up = float(rotation[0, 1]), float(rotation[1, 1]), float(rotation[2, 1])
        shadows = None
        if lamp.shadow > 0.0:
            x, y, z = lamp.casting.towards(rotation).tolist()
            shadows = x, y, z
        toward = facing
        if lamp.direction is not None:
            toward = numbers_on(lamp.towards(rotation), facing.device).expand_as(facing)
        elif lamp.moved:
            toward = facing @ numbers_on(lamp.turn(rotation).T, facing.device)
        return cls(facing, toward, lamp.intensity, up, shadows)

    def at(self, ray: Tensor) -> Beams:
        """Return the beams of each sample's ray. (S,) -> S beams"""
        ray = ray.long()
        facing = self.facing[ray]
        toward = facing if self.toward is self.facing else self.toward[ray]
        return replace(self, facing=facing, toward=toward)


class PhongLight(nn.Module):
    """Normals of the scene and reflection coefficients of each region (:func:`svv.core.colour.light.blinn_phong`)."""

    def __init__(self, occupancy: Occupancy, resolutions: Sequence[int], regions: int) -> None:
        """Lay out zero normals on the vertices of occupied cells; ``resolutions``: cells per box unit of each level."""
        super().__init__()
        self.normals = SparseLattice(occupancy.occupied, occupancy.cells, resolutions, 3)
        self.raw = nn.Parameter(torch.zeros(regions, len(COEFFICIENTS)))

    def coefficients(self) -> Tensor:
        """Return ambient, diffuse, specular (>= 0) and shininess (> 0) of each region. (P, 4)"""
        return softplus(self.raw) * numbers_on([1.0, 1.0, 1.0, SHININESS_UNIT], self.raw.device)

    def start(self, density: SparseLattice | None, occupancy: Occupancy, shading: Shading | None, seed: int) -> None:
        """Initialise from the gradient of the extinction, unless that is None, and the views' recorded shading."""
        said = START_COEFFICIENTS
        if shading is not None:
            told = shading.ambient, shading.diffuse, shading.specular, shading.specular_power
            said = dict(zip(COEFFICIENTS, told, strict=True))
        values = [max(float(said[name]), LEAST_COEFFICIENTS[name]) for name in COEFFICIENTS]
        values[3] = min(values[3], 60.0) / SHININESS_UNIT  # a sharper highlight falls between pixels and is not learned
        with torch.no_grad():
            self.raw.copy_(self.raw.new_tensor(values).expm1().log())
            if density is None:
                return
            self.normals.randomize(0.001, torch.Generator().manual_seed(seed))
            level = self.normals.levels - 1
            gradient = gradient_of(density, occupancy, self.normals.resolutions[level])
            self.normals.table[self.normals.rows_of_level(level)] = gradient.to(self.raw.device) / NORMAL_SCALE

    @torch.no_grad()
    def settle(self, occupancy: Occupancy) -> None:
        """Sum the levels of the learned normals into one: the same normals, looked up in less time."""
        device = self.raw.device
        self.normals = self.normals.summed(occupancy.occupied, occupancy.cells).to(device)
        length = NORMAL_SCALE * self.normals.table.norm(dim=1, keepdim=True)
        self.normals.table.mul_(LONGEST_VECTOR / length.clamp(min=LONGEST_VECTOR))

    def normal(self, position: Tensor) -> Tensor:
        """Return normals of either orientation, shorter than 1 away from surfaces. (S, 3) -> (S, 3)"""
        return normals_of(self.normals(position).unflatten(1, (-1, 3)).sum(dim=1))

    def forward(
        self, position: Tensor, weights: Tensor, beams: Beams, coefficients: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Return specular grey c_s >= 0 (S,) and shade m >= 0 (S,), from weights (S, P) and coefficients.

        Coefficients are those of palette colours, (P, 4), or of the palette colours of each sample, (S, P, 4).
        """
        coefficients = self.coefficients() if coefficients is None else coefficients
        each = coefficients.dim() == 3
        mixed = (weights[:, None] @ coefficients)[:, 0] if each else weights @ coefficients
        return blinn_phong(self.normal(position), beams.facing, beams.toward, beams.intensity, mixed)


@torch.no_grad()
def gradient_of(
    density: SparseLattice, occupancy: Occupancy, resolution: int, deviation: float = GRADIENT_DEVIATION
) -> Tensor:
    """Return unit vectors against the gradient of the extinction at a lattice's vertices, in storage order. (V, 3)

    They are shorter where the gradient nearly vanishes. The levels of ``density`` sum to the extinction's logarithm;
    ``deviation``: that of the Gaussian whose derivatives give the gradient, in cells.
    """
    from scipy.ndimage import gaussian_filter

    _, vertices, field = softened_extinction(density, occupancy, resolution)
    x, y, z = vertices.T
    found = np.empty((len(vertices), 3), np.float32)
    for axis in range(3):
        order = [int(k == axis) for k in range(3)]
        found[:, axis] = -gaussian_filter(field, deviation, order=order, mode="nearest")[x, y, z]
    length = np.linalg.norm(found, axis=1, keepdims=True)
    return torch.from_numpy(found / (length + 1e-3))


@torch.no_grad()
def softened_extinction(
    density: SparseLattice, occupancy: Occupancy, resolution: int
) -> tuple[SparseLattice, NDArray[np.int64], NDArray[np.float32]]:
    """Return a lattice of zeros of one level, its vertices (V, 3), and the softened extinction on its whole grid.

    That is the extinction to the power :data:`EXTINCTION_POWER`; the levels of ``density`` sum to its logarithm.
    ``resolution``: cells per box unit of the new lattice. Vertices are in storage order.
    """
    lattice = SparseLattice(occupancy.occupied, occupancy.cells, (resolution,), 1).requires_grad_(False)
    vertices = lattice.vertices_of_level(0, occupancy.occupied, occupancy.cells)
    end = torch.tensor(occupancy.box.extent, dtype=torch.float32)
    places = lattice.places_of_level(0, occupancy.occupied, occupancy.cells)
    points = torch.minimum(torch.from_numpy(places), end)
    exponent = density(points.to(density.table.device)).sum(dim=1)
    exponent = exponent.clamp(LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION).cpu().numpy()
    field = np.full(tuple(lattice.shapes[0].tolist()), np.exp(LEAST_LOG_EXTINCTION * EXTINCTION_POWER), np.float32)
    field[tuple(vertices.T)] = np.exp(EXTINCTION_POWER * exponent)
    return lattice, vertices, field
