"""Pixels of a palette scene from rays, without gradients, by the image kernels of its device.

They draw what :meth:`svv.fields.scene.scene.Scene.shade` computes. On devices without such kernels
(:attr:`svv.kernels.types.Kernels.IMAGE`), and for scenes with a hash grid, that method draws the image itself.
"""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from svv.core.colour import palette_shading
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.matcaps import dress
from svv.fields.radiance.networks import encode_directions
from svv.fields.radiance.paint_light import lights_of
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import Rays
from svv.fields.scene.model import Model, for_colours, of_colour
from svv.fields.strokes.stroke_opacity import strokes_of
from svv.kernels.dispatch import kernels_for
from svv.kernels.types import ImageKernels, Samples, Surface


def image_kernels_of(scene: Model) -> ImageKernels | None:
    """Return the kernels that draw the scene's palette and paint; None if its device or encoding has none."""
    on_lattices = (
        scene.palette_network is not None
        and isinstance(scene.base.encoding, SparseLattice)
        and isinstance(scene.palette_network.encoding, SparseLattice)
    )
    return kernels_for(scene.base.encoding.table).IMAGE if on_lattices else None


def draw(
    kernels: ImageKernels, scene: Model, samples: Samples, rays: Rays, network: str, beams: Beams,
    images: tuple[Tensor, Tensor, Tensor],
) -> None:  # fmt: skip
    """Render rays into RGBA (R, 4), depth (R,) and region (R,), with the network ``pcn`` or ``styled``."""
    palette, geometry, light = scene.palette_network, scene.base.encoding, None
    assert palette is not None and isinstance(palette.encoding, SparseLattice) and isinstance(geometry, SparseLattice)
    if palette.lighting_mlp is None:
        plain = palette.encoding.look_up(samples.position)
    else:
        tables = _both_tables(geometry.table, palette.encoding)
        along = encode_directions(rays.lit_along, torch.arange(len(rays), dtype=torch.int32))
        lit, plain = kernels.features(samples, along, geometry.layout, tables)
        light = palette.lighting_mlp(lit)
    surface = kernels.material(palette.palette_mlp(plain), palette.colours)
    here = scene.regions_at(samples.position)
    if here is not None:
        surface = replace(surface, region=of_colour(here, surface.region))
    colour = surface.colour
    if any(r.edited_colour is not None for r in scene.regions):
        intensity, weights, offsets = palette_shading.material(surface.raw)
        colour = palette_shading.diffuse(intensity, weights, scene.edited_colours(offsets, here))
    paint = scene.paint(samples, network, surface.region.long())
    surface, sigma = replace(surface, colour=colour.contiguous()), samples.sigma
    if paint is not None:
        strokes = strokes_of(scene)
        strokes = torch.zeros(len(scene.regions), 4) if strokes is None else strokes
        sigma = kernels.overpaint(surface, paint, scene.paint_shares, strokes, sigma)
    _add_light(kernels, scene, samples, surface, light, beams, lights_of(scene, network), here)
    if any(r.matcap is not None for r in scene.regions):
        dress(scene, surface.colour, samples.position, surface.region, samples.ray, beams)
    opacity = torch.tensor([r.seen_opacity for r in scene.regions])
    kernels.composite(samples, sigma, surface, opacity, rays.origins, scene.occupancy.box.size, images)


def _add_light(
    kernels: ImageKernels, scene: Model, samples: Samples, surface: Surface, light: Tensor | None, beams: Beams,
    lights: Tensor, here: Tensor | None,
) -> None:  # fmt: skip
    """Light the surface's colour in place, by the lighting MLP or by an explicit light."""
    assert scene.palette_network is not None
    if scene.palette_network.phong is not None:
        normals, coefficients = scene.palette_network.phong.normals, scene.coefficients()
        assert coefficients is not None
        directions = beams.facing, beams.toward, beams.intensity
        each = for_colours(coefficients, here)
        kernels.phong(surface, samples, directions, normals.layout, normals.table, each, lights)
    elif light is not None:
        kernels.light(surface, light, lights)


_BOTH: WeakKeyDictionary[SparseLattice, tuple[Tensor, Tensor]] = WeakKeyDictionary()


def _both_tables(geometry: Tensor, material: SparseLattice) -> Tensor:
    """Return features of geometry and material side by side (V, 2 F), cached for the next image unless training."""
    known, both = _BOTH.get(material, (None, None))
    learning = geometry.requires_grad or material.table.requires_grad
    if both is None or known is not geometry or learning:
        both = torch.cat([geometry.detach(), material.table.detach()], dim=1)
        if not learning:
            _BOTH[material] = geometry, both
    return both
