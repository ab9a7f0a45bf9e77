"""Light on paint: shading that keeps a style's brightness.

A style picture has its own light and shade. The scene's shade m, whose mean is arbitrary, would darken the paint, and
its specular c_s would brighten it: only their deviations from the mean are shown, and by default only a fraction of
those. Letters: S samples, P regions.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from svv.core.colour.light import Lamp
from svv.fields.radiance.networks import PaletteField, encode_directions
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.model import Model
from svv.kernels.constants import numbers_on

LIGHT_VIEWS, LIGHT_VIEW_SIZE = 12, 64
"""Number of views all around over which a region's light is averaged, and their side in pixels: the mean over 42 views
of twice the size is the same within 1 %."""

LEAST_MEAN_SHADE = 0.05
"""Least mean that a shade is divided by: shading cannot show the shape of a region that light hardly reaches."""

_known: WeakKeyDictionary[PaletteField, tuple[tuple[float, float], ...]] = WeakKeyDictionary()


def lights_of(scene: Model, network: str) -> Tensor:
    """Return how each region responds to light: a factor f, a scale a of the shade, and b. (regions, 3)

    The lit colour is (1 + f (a m - 1)) c_d + f (c_s - b) for a diffuse colour c_d, shade m and specular c_s. Without
    paint, f is the region's lighting, a is 1 and b is 0. On paint, which ``styled`` of the networks ``pcn`` and
    ``styled`` shows, f is the lighting times the region's light on paint, a is 1 / mean(m) and b is mean(c_s). Where a
    style is shown with a strength s below 1, the light is the mean of both, weighted by s.
    """
    assert scene.palette_network is not None
    lights = [(r.lighting, 1.0, 0.0) for r in scene.regions]
    for k, r in enumerate(scene.regions):
        if network != "styled" or r.style is None:
            continue
        plain, paint = 1.0 - r.strength, r.strength * r.paint_light
        if plain + paint == 0.0:
            lights[k] = 0.0, 1.0, 0.0
        else:
            shade, specular = r.mean_light or mean_lights(scene)[scene.roots[k]]
            part = paint / (plain + paint)
            lights[k] = r.lighting * (plain + paint), 1.0 - part + part / shade, part * specular
    return numbers_on(lights, scene.palette_network.colours.device)


@torch.no_grad()
def mean_lights(scene: Model) -> tuple[tuple[float, float], ...]:
    """Return mean shade m and specular c_s of each region of the palette where it is visible, under the views' light.

    Edits do not change them, and parts that were split off have those of the whole. A region that is not visible gets
    the means over all. Computed once per palette network.
    """
    palette = scene.palette_network
    assert palette is not None
    if palette not in _known:
        sums = torch.zeros(3, len(palette.colours), dtype=torch.float64, device=scene.device)
        rig = scene.camera_rig
        for camera in () if rig is None else rig.sphere(LIGHT_VIEWS, LIGHT_VIEW_SIZE):
            rays = scene.caster([camera]).view(0)
            samples = march(rays, scene.occupancy, scene.base.density, scene.marching_for_images)
            if not len(samples):
                continue
            sigma, geometry = scene.base.geometry(samples)
            _, _, weight = composite(samples, sigma, sigma[:, None])
            at = None
            if palette.phong is not None:
                at = Beams.of(Lamp(), camera, rays).at(samples.ray)
            parts = palette(samples.position, geometry, encode_directions(rays.lit_along, samples.ray), at)
            sums[0].index_add_(0, parts.region, weight.double())
            sums[1].index_add_(0, parts.region, (weight * parts.shade).double())
            sums[2].index_add_(0, parts.region, (weight * parts.specular).double())
        whole = sums.sum(dim=1) if bool(sums.any()) else sums.new_tensor([1.0, 1.0, 0.0])
        weight, shade, specular = torch.where(sums[0] > 0.0, sums, whole[:, None])
        means = (shade / weight).clamp(min=LEAST_MEAN_SHADE), specular / weight
        _known[palette] = tuple(zip(*(mean.tolist() for mean in means), strict=True))
    return _known[palette]
