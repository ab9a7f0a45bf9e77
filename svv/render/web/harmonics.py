"""A light that a network learned, as spherical harmonics at each point: what a viewer evaluates without the network.

At each vertex of a grid, shade m and specular c_s are fitted by least squares in the directions from the cameras of a
sphere of views; those from which the vertex can be seen count most. Letters: V vertices, D directions, K harmonics, S
pairs of a vertex and a direction.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import normalize, pad

from svv.core.geometry.cameras import Camera
from svv.errors import Progress, silent
from svv.fields.radiance.networks import encode_directions
from svv.fields.radiance.rendering import march, not_hidden
from svv.fields.scene.scene import Scene
from svv.render.web.fitting_kernels import fit

BANDS = 3
"""Bands of the harmonics: 9 functions of the direction."""

VIEWS, VIEW_SIZE = 42, 128
"""Number of views in whose directions the light is fitted where they see, and their side in pixels."""

AROUND = 12
"""Number of views in whose directions it is fitted everywhere: corners of an icosahedron, on which the mean of products
of two harmonics is that on the sphere."""

SIGHT_CELLS = 64
"""Cells per box unit in which it is recorded what the views see."""

LEAST_SIGHT, FAINT = 0.2, 0.05
"""Weight of each of the directions in which the light is fitted everywhere: edits may uncover a vertex that cannot be
seen. And the sight, as a fraction of that from where the vertex is seen best, up to which a view does not count."""

RIDGE = 1e-3
"""Weight of the squared coefficients, for vertices that are seen from few directions."""

MOST_AXES, LEFT_OUT = 12, 0.1
"""Most numbers that describe a vertex's light, and the root of the mean square that they may leave out. The harmonics
are orthonormal: in light, that is LEFT_OUT / sqrt(4 pi), or 0.03."""

VERTICES_AT_A_TIME = 1 << 13
"""Vertices that are fitted together, to bound the memory."""


@torch.no_grad()
def fitted_light(scene: Scene, places: Tensor, progress: Progress = silent) -> Tensor:
    """Return K coefficients of the shade and K of the specular light that a scene's network gives places. (V, 2 K)

    Places are box coordinates in occupied cells (V, 3). A dot product with
    :func:`svv.core.rays.encodings.spherical_harmonics` of a ray's direction turns coefficients into light.
    """
    cameras = scene.rig.sphere(VIEWS, VIEW_SIZE)
    sight, every = _sight(scene, cameras), [*cameras, *scene.rig.sphere(AROUND, VIEW_SIZE)]
    found = []
    for number, own in enumerate(pieces := places.split(VERTICES_AT_A_TIME)):
        progress(number / len(pieces), "light")
        cell = (own * SIGHT_CELLS).long()
        seen = sight[:, cell[:, 0], cell[:, 1], cell[:, 2]].T  # (V, VIEWS)
        seen = seen / seen.amax(dim=1, keepdim=True).clamp(min=1e-6)
        weight = pad(torch.where(seen > FAINT, seen, 0.0), (0, AROUND), value=LEAST_SIGHT)
        found.append(_fit(scene, own, every, weight))
    return torch.cat(found)


def principal(
    light: NDArray[np.float32], seen: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Describe coefficients (V, 2 K) by few numbers each: their mean, and amounts of a few common directions (PCA).

    ``seen`` is the weight of each vertex (V,). Returns the mean (2 K,), at most :data:`MOST_AXES` axes (A, 2 K),
    orthonormal, and amounts (V, A).
    """
    weights = seen + np.float32(1e-3)
    mean = np.average(light, axis=0, weights=weights)
    total = np.zeros((len(mean), len(mean)))
    for first in range(0, len(light), VERTICES_AT_A_TIME):
        own = slice(first, first + VERTICES_AT_A_TIME)
        weighted = (light[own] - mean) * np.sqrt(weights[own])[:, None]
        total += weighted.T @ weighted
    power, axes = np.linalg.eigh(total / weights.sum())
    power, axes = power[::-1], axes.T[::-1]
    left = np.sqrt(np.maximum(power.sum() - power.cumsum(), 0.0))  # error with 1, 2 ... axes
    count = min(1 + int((left > LEFT_OUT).sum()), MOST_AXES)
    axes = np.ascontiguousarray(axes[:count], np.float32)
    return mean.astype(np.float32), axes, light @ axes.T - (axes @ mean).astype(np.float32)


def geometry_at(scene: Scene, places: Tensor) -> tuple[Tensor, Tensor]:
    """Return the logarithm of the extinction (V,) and geometry features (V, G) at places in occupied cells (V, 3)."""
    base = scene.base
    features = base.encoding(places)
    if base.density is not None:
        return base.density(places).sum(dim=1), features
    assert base.density_mlp is not None
    both = base.density_mlp(features)
    return both[:, 0], both[:, 1:]


def _directions(scene: Scene, cameras: list[Camera], places: Tensor, camera: Tensor) -> Tensor:
    """Return the directions in which the lights of cameras (S,), by number, shine at places (S, 3). (S, 3)"""
    if cameras[0].is_orthographic or scene.settings.headlight == "axis":
        return places.new_tensor(np.stack([-each.camera_to_world[:3, 2] for each in cameras]))[camera]
    eyes = places.new_tensor(scene.occupancy.box.to_box(np.stack([each.position for each in cameras])))
    return normalize(places - eyes[camera], dim=-1)


def _fit(scene: Scene, places: Tensor, cameras: list[Camera], weight: Tensor) -> Tensor:
    """Fit shade and specular light at places (V, 3) in the directions of cameras, by weights (V, D). (V, 2 K)"""
    palette, (vertex, camera) = scene.palette_network, weight.nonzero(as_tuple=True)
    assert palette is not None
    directions = _directions(scene, cameras, places[vertex], camera)
    harmonics = encode_directions(directions, torch.arange(len(vertex), dtype=torch.int32))
    specular, shade = palette.lighting(geometry_at(scene, places)[1][vertex], harmonics)
    end, out = (weight > 0).sum(dim=1).cumsum(0), torch.empty(len(places), 2 * BANDS**2)
    arrays = (end, weight[vertex, camera], harmonics, shade, specular)
    fit(*(array.numpy() for array in arrays), np.float32(RIDGE), out.numpy())
    return out


def _sight(scene: Scene, cameras: list[Camera]) -> Tensor:
    """Return how much light from each cell of the box reaches each camera, as a fraction. (D, X, Y, Z)"""
    shape = [int(np.ceil(side * SIGHT_CELLS)) + 1 for side in scene.occupancy.box.extent]
    sight = torch.zeros(len(cameras), int(np.prod(shape)))
    for own, camera in zip(sight, cameras, strict=True):
        rays = scene.caster([camera]).view(0)
        samples = march(rays, scene.occupancy, scene.base.density, scene.marching_for_images)
        if scene.base.density is None:
            samples, _ = not_hidden(samples, scene.base.extinction(samples), scene.marching_for_images)
        depth = (samples.skipped + samples.sigma * samples.step).double()
        total = torch.cat([depth.new_zeros(1), depth.cumsum(0)])
        before = total[:-1] - total[samples.start][samples.ray.long()]
        x, y, z = (samples.position * SIGHT_CELLS).long().unbind(1)
        cell = (x * shape[1] + y) * shape[2] + z
        own.index_add_(0, cell, torch.exp(-before).float())
        own /= torch.bincount(cell, minlength=len(own)).clamp(min=1)
    return sight.view(-1, *shape)
