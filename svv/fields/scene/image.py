"""Pixels of a palette scene from rays, without gradients, by the image kernels of its device.

They draw what :meth:`svv.fields.scene.scene.Scene.shade` computes. On devices without such kernels
(:attr:`svv.kernels.types.Kernels.IMAGE`), and for scenes with a hash grid, that method draws the image itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from svv.core.colour.colour import hsb_change
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import Rays
from svv.fields.scene.matcaps import dress
from svv.fields.scene.model import Model, for_colours, of_colour
from svv.fields.scene.occlusion import occlude
from svv.fields.scene.paint_light import lights_of
from svv.fields.scene.sections import face_shares, faces, show_sections
from svv.fields.scene.shadows import cast_shadows
from svv.fields.scene.stroke_opacity import strokes_of
from svv.fields.scene.view_cache import Look, key_of_paint
from svv.kernels.constants import numbers_on
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


def look_at(kernels: ImageKernels, scene: Model, samples: Samples, rays: Rays) -> Look | None:
    """Return what the networks say of samples of rays, whatever the scene's edits; None without samples."""
    palette, geometry = scene.palette_network, scene.base.encoding
    assert palette is not None and isinstance(palette.encoding, SparseLattice) and isinstance(geometry, SparseLattice)
    if not len(samples):
        return None
    if palette.lighting_mlp is None:
        return Look(samples, palette.palette_mlp(palette.encoding.look_up(samples.position)), None)
    tables, along = both_tables(geometry.table, palette.encoding), rays.lit_along.contiguous()
    networks = palette.lighting_mlp.weights, palette.palette_mlp.weights
    light, raw = kernels.looks(samples, along, geometry.layout, tables, *networks)
    return Look(samples, raw, light)


def draw(
    kernels: ImageKernels, scene: Model, look: Look, rays: Rays, network: str, beams: Callable[[], Beams],
    images: tuple[Tensor, Tensor, Tensor], share: Tensor | None,
) -> None:  # fmt: skip
    """Render rays into RGBA (R, 4), depth (R,) and region (R,), with the network ``pcn`` or ``styled``.

    ``share`` (R,) is filled with the light from faces of cuts, if it is there.
    """
    samples = look.samples
    surface, sigma = shade(kernels, scene, look, network, beams)
    region = surface.region
    face = None if share is None else faces(scene, samples, region)
    show_sections(scene, surface.colour, samples, region, network, face)
    opacity = numbers_on([r.seen_opacity for r in scene.regions], sigma.device)
    kernels.composite(samples, sigma, surface, opacity, rays.origins, scene.occupancy.box.size, images)
    if share is not None:
        share.copy_(face_shares(scene, samples, sigma * opacity[region], region, face))


def shade(
    kernels: ImageKernels, scene: Model, look: Look, network: str, beams: Callable[[], Beams]
) -> tuple[Surface, Tensor]:
    """Return what samples look like, lit, and their extinction (S,), without that of regions that are cut off."""
    palette, samples = scene.palette_network, look.samples
    assert palette is not None
    here = scene.regions_at(samples.position)
    surface = kernels.material(_recoloured(kernels, scene, look.raw, here), palette.colours)
    if here is not None:
        surface = replace(surface, region=of_colour(here, surface.region))
    region = surface.region.long()
    paint = look.painted(key_of_paint(scene, network), lambda: scene.paint(samples, network, region))
    sigma = samples.sigma
    if paint is not None:
        strokes = strokes_of(scene)
        strokes = numbers_on([(0.0,) * 4] * len(scene.regions), paint.device) if strokes is None else strokes
        sigma = kernels.overpaint(surface, paint, scene.paint_shares, strokes, sigma)
    sigma = scene.cut_open(sigma, samples, region)
    occlude(scene, surface.colour, samples.position, surface.region)
    _add_light(kernels, scene, samples, surface, look.light, beams, lights_of(scene, network), here)
    if any(r.matcap is not None for r in scene.regions):
        dress(scene, surface.colour, samples.position, surface.region, samples.ray, beams())
    if scene.lamp.shadow > 0.0:
        cast_shadows(scene, surface.colour, samples.position, network, beams().shadows_from)
    return surface, sigma


def _recoloured(kernels: ImageKernels, scene: Model, raw: Tensor, here: Tensor | None) -> Tensor:
    """Return the output of the palette MLP (S, 1 + 4 P) with offsets that lead to the edited colours."""
    if all(r.edited_colour is None for r in scene.regions):
        return raw
    assert scene.palette_network is not None
    colours = scene.palette_network.colours.detach()
    if any(r.edited_colour is not None and r.recolour_in != "hsb" for r in scene.regions):
        weights, offsets = raw.split([1 + len(colours), 3 * len(colours)], dim=1)
        edited = scene.edited_colours(offsets.unflatten(1, (-1, 3)), here) - colours
        return torch.cat([weights, edited.flatten(1)], dim=1)
    raw = raw.clone()
    for number, root, shown, target in scene.colour_edits():
        among = None if here is None else here[:, root] == number
        kernels.shift(raw, 1 + len(colours) + 3 * root, colours[root], hsb_change(shown, target), among)
    return raw


def _add_light(
    kernels: ImageKernels, scene: Model, samples: Samples, surface: Surface, light: Tensor | None,
    beams: Callable[[], Beams], lights: Tensor, here: Tensor | None,
) -> None:  # fmt: skip
    """Light the surface's colour in place, by the lighting MLP or by an explicit light."""
    assert scene.palette_network is not None
    if scene.palette_network.phong is not None:
        normals, coefficients = scene.palette_network.phong.normals, scene.coefficients()
        assert coefficients is not None
        shining = beams()
        directions = shining.facing, shining.toward, shining.intensity
        each = for_colours(coefficients, here)
        kernels.phong(surface, samples, directions, normals.layout, normals.table, each, lights)
    elif light is not None:
        kernels.light(surface, light, lights)


_BOTH: WeakKeyDictionary[SparseLattice, tuple[Tensor, tuple[int, int], Tensor]] = WeakKeyDictionary()


def both_tables(geometry: Tensor, material: SparseLattice) -> Tensor:
    """Return features of geometry and material side by side (V, 2 F), cached until one of them changes."""
    if geometry.requires_grad or material.table.requires_grad:  # learning
        return torch.cat([geometry.detach(), material.table.detach()], dim=1)
    versions = geometry._version, material.table._version
    known = _BOTH.get(material)
    if known is None or known[0] is not geometry or known[1] != versions:
        known = _BOTH[material] = geometry, versions, torch.cat([geometry.detach(), material.table.detach()], dim=1)
    return known[2]
