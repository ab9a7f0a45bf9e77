"""What samples of a scene look like: where there are any along rays, their colours, regions and extinctions.

Letters: S samples.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from svv.core.colour.palette_shading import lit
from svv.fields.radiance.matcaps import dress
from svv.fields.radiance.networks import PaletteColours, encode_directions
from svv.fields.radiance.occlusion import occlude
from svv.fields.radiance.paint_light import lights_of
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import Marching, Rays, ended, march, not_hidden
from svv.fields.scene.model import Model, for_colours, of_colour
from svv.fields.strokes.stroke_opacity import fade_of, followed
from svv.kernels.constants import numbers_on
from svv.kernels.types import Samples

Seen = tuple[Samples, Tensor, Tensor, Tensor]
"""S samples, their colours (S, 3), regions (S,) and a number of each: edited extinctions, or distances (S,)."""


def marching_as_edited(scene: Model, network: str) -> Marching:
    """Return how rays are sampled; they go deeper where edits make regions more transparent."""
    return replace(scene.marching_for_images, fade=fade_of(scene, network))


@torch.no_grad()
def visible_samples(scene: Model, rays: Rays, network: str) -> Samples:
    """Return the samples of rays for an image."""
    how = marching_as_edited(scene, network)
    samples = march(rays, scene.occupancy, scene.base.density, how)
    if scene.base.density is None:
        samples, _ = not_hidden(samples, scene.base.extinction(samples), how)
        return samples
    return ended(samples)


def seen_along(scene: Model, rays: Rays, beams: Beams, network: str) -> Seen | None:
    """Return what an image shows of rays, as samples with their edited extinctions; None if that is nothing."""
    samples = visible_samples(scene, rays, network)
    return (samples, *shade(scene, samples, rays, network, beams)) if len(samples) else None


def shade(
    scene: Model, samples: Samples, rays: Rays, network: str, beams: Beams | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """Return colour (S, 3), region (S,) and edited extinction (S,) of samples; by default lit along the rays."""
    sigma, geometry = scene.base.geometry(samples)
    directions = encode_directions(rays.lit_along, samples.ray)
    if network == "base" or scene.palette_network is None:
        region = torch.zeros_like(samples.ray, dtype=torch.int64)
        return scene.base(geometry, directions), region, sigma
    seen = beams or Beams.headlight(-rays.lit_along)
    at = None if scene.palette_network.phong is None else seen.at(samples.ray)  # a network's light cannot be moved
    here, coefficients = scene.regions_at(samples.position), scene.coefficients()
    coefficients = None if coefficients is None else for_colours(coefficients, here)
    parts = scene.palette_network(samples.position, geometry, directions, at, coefficients)
    region = of_colour(here, parts.region)
    paint = scene.paint(samples, network, region)
    sigma = followed(scene, sigma, region, paint)
    if any(r.seen_opacity != 1.0 for r in scene.regions):
        sigma = sigma * numbers_on([r.seen_opacity for r in scene.regions], sigma.device)[region]
    diffuse = scene.with_style(parts.diffuse(scene.edited_colours(parts.offsets, here)), region, paint)
    occlude(scene, diffuse, samples.position, region)
    colour = light(scene, parts, diffuse, region, network)
    if any(r.matcap is not None for r in scene.regions):
        dress(scene, colour, samples.position, region, samples.ray, seen)
    return colour, region, sigma


def light(scene: Model, parts: PaletteColours, diffuse: Tensor, region: Tensor, network: str) -> Tensor:
    """Light diffuse colours (S, 3) with the brightness that the edits of their regions (S,) set. (S, 3)"""
    if network != "styled":
        factor = numbers_on([r.lighting for r in scene.regions], diffuse.device)[region]
        return lit(diffuse, parts.specular, parts.shade, factor)
    return lit(diffuse, parts.specular, parts.shade, *lights_of(scene, network)[region].unbind(1))
