"""Rays to pixels of a palette scene on the CPU: what :meth:`Scene.shade` says, with fused kernels, no gradients.

A sixth of the time of an image went into passes over memory between the networks' products; here each is one pass.
"""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.encodings import spherical_harmonics
from svv.fields.encodings import SparseLattice
from svv.fields.model import Model
from svv.fields.networks import INTENSITY_SHIFT, SPECULAR_SHIFT, WEIGHT_FLOOR
from svv.fields.paint_light import lights_of
from svv.fields.phong import SCALE, SOFT, Beams, PhongLight
from svv.fields.rendering import Rays
from svv.fields.stroke_opacity import followed
from svv.kernels import numba_image as kernels
from svv.kernels.dispatch import kernels_for
from svv.kernels.types import Samples


def can_fuse(scene: Model) -> bool:
    """Whether the kernels know the scene's networks: palette and lattices, on the CPU."""
    return (
        scene.palette is not None
        and isinstance(scene.base.encoding, SparseLattice)
        and isinstance(scene.palette.encoding, SparseLattice)
        and kernels_for(scene.base.encoding.table).NAME == "numba"
    )


def shade(scene: Model, samples: Samples, rays: Rays, network: str, beams: Beams) -> tuple[Tensor, Tensor, Tensor]:
    """Colour (S, 3), region (S,) int64 and extinction (S,) of samples, for the network ``pcn`` or ``styled``.

    The factors on the extinction of whole regions are left to :func:`composite`.
    """
    palette, geometry, light, count = scene.palette, scene.base.encoding, None, len(samples)
    assert palette is not None and isinstance(palette.encoding, SparseLattice) and isinstance(geometry, SparseLattice)
    if palette.lighting_mlp is None:
        plain = palette.encoding.look_up(samples.position)
    else:
        harmonics, layout = spherical_harmonics(rays.directions, 4), geometry.layout
        lit, plain = (torch.empty(count, geometry.width + extra) for extra in (harmonics.shape[1], 0))
        kernels.features(
            *_arrays(samples.position, samples.ray, harmonics),
            *_arrays(layout.shapes, layout.scales, layout.bases, layout.index),
            *_arrays(_both_tables(geometry.table, palette.encoding)), (0.0,) * geometry.features, *_arrays(lit, plain),
        )  # fmt: skip
        light = palette.lighting_mlp(lit)
    material = palette.palette_mlp(plain)
    region = torch.empty(count, dtype=torch.int64)
    diffuse = torch.empty(count, 3)
    kernels.material(
        *_arrays(material, palette.colours), np.float32(INTENSITY_SHIFT), np.float32(WEIGHT_FLOOR),
        *_arrays(region, diffuse),
    )  # fmt: skip
    if any(r.edited_colour is not None for r in scene.regions):
        diffuse = _recoloured(scene, material)
    paint = scene.paint(samples.position, network)
    diffuse = scene.with_style(diffuse, region, paint).contiguous()
    lights = lights_of(scene, network)
    if palette.phong is not None:
        _light_by_phong(scene, palette.phong, samples, beams, material, lights, region, diffuse)
    elif light is not None:
        kernels.light(*_arrays(light, lights, region), np.float32(SPECULAR_SHIFT), *_arrays(diffuse))
    return diffuse, region, followed(scene, samples.sigma, region, paint)


def _light_by_phong(
    scene: Model, phong: PhongLight, samples: Samples, beams: Beams, material: Tensor, lights: Tensor, region: Tensor,
    colour: Tensor,
) -> None:  # fmt: skip
    """Light ``colour`` (S, 3), in place."""
    coefficients, layout = scene.coefficients(), phong.normals.layout
    assert coefficients is not None
    half = torch.nn.functional.normalize(beams.facing + beams.toward, dim=1)
    kernels.phong(
        *_arrays(samples.position, samples.ray, beams.facing.contiguous(), beams.toward.contiguous(), half),
        np.float32(beams.intensity),
        *_arrays(layout.shapes, layout.scales, layout.bases, layout.index, phong.normals.table),
        np.float32(SCALE), np.float32(SOFT), *_arrays(material, coefficients), np.float32(WEIGHT_FLOOR),
        *_arrays(lights, region, colour),
    )  # fmt: skip


_BOTH: WeakKeyDictionary[SparseLattice, tuple[Tensor, Tensor]] = WeakKeyDictionary()


def _both_tables(geometry: Tensor, material: SparseLattice) -> Tensor:
    """Features of geometry and material side by side (V, 2 F), kept for the next image unless they are learning."""
    known, both = _BOTH.get(material, (None, None))
    learning = geometry.requires_grad or material.table.requires_grad
    if both is None or known is not geometry or learning:
        both = torch.cat([geometry.detach(), material.table.detach()], dim=1)
        if not learning:
            _BOTH[material] = geometry, both
    return both


def _recoloured(scene: Model, material: Tensor) -> Tensor:
    assert scene.palette is not None
    intensity, weights, offsets = scene.palette.material_of(material)
    return intensity[:, None] * (weights[:, :, None] * scene.edited_colours(offsets)).sum(dim=1)


def composite(
    scene: Model, samples: Samples, sigma: Tensor, rays: Rays, colour: Tensor, region: Tensor, faint: float,
    *images: Tensor,
) -> None:  # fmt: skip
    """Write what rays see into ``images``: rgba (R, 4), depth (R,), region (R,) int16; other pixels stay."""
    opacity = torch.tensor([r.seen_opacity for r in scene.regions])
    kernels.composite(
        *_arrays(samples.position, sigma, samples.skipped, colour, region, opacity, rays.origins),
        *_arrays(samples.start, samples.count, samples.tail), np.float32(samples.step),
        np.float32(scene.occupancy.box.size), np.float32(faint), *_arrays(*images),
    )  # fmt: skip


def _arrays(*tensors: Tensor) -> tuple[NDArray[Any], ...]:
    """The tensors' own memory."""
    return tuple(t.detach().numpy() for t in tensors)
