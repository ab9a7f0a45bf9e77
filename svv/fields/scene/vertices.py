"""Images from what networks say of vertices of a grid near the samples, interpolated between these.

Colours and light vary more slowly than extinction, so a grid with one or two vertices along each cell of the finest
features shows the same (:mod:`svv.train.base.sampling` tries it), at a fraction of what networks take at all samples.
A plain image interpolates colours, with all edits and lit. Whatever has sharp edges in space - paint, cuts of some
regions, faces of sections, parts of regions, hidden regions, MatCaps, shadows, highlights - has colours of every sample
from the networks' interpolated outputs.

Letters: S samples, V vertices.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from svv.core.geometry.cameras import Camera
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import Rays
from svv.fields.scene.image import both_tables, image_kernels_of, look_at, shade
from svv.fields.scene.known_vertices import MOST, known_vertices
from svv.fields.scene.model import Model
from svv.fields.scene.occlusion import is_occluded
from svv.fields.scene.sections import has_section_lines, is_sectioned
from svv.fields.scene.view_cache import Look
from svv.kernels.constants import numbers_on
from svv.kernels.dispatch import kernels_for
from svv.kernels.types import ImageKernels, Samples, VertexKernels

MOST_PLACES = 1 << 23
"""Most vertices of the whole grid, visible or not, of which the numbers take 4 bytes each."""

PAYS = {True: 1.0, False: 0.35}
"""Vertices per sample up to which they pay in plain images and in others: a look-up of a sample's colour takes a fifth
of its networks' time, one of all that they say two fifths, and views before have seen most vertices."""

PAYS_MOVING = 1.2
"""Vertices per sample up to which they pay in plain images while a camera moves: that is where samples take as long."""

NEAR = 8.0
"""Cells between the box and a light at the camera below which directions of light are those of samples."""

Images = tuple[Tensor, Tensor, Tensor]


@dataclass(frozen=True)
class VertexLook:
    """What the networks say of the vertices around the samples of some rays."""

    pieces: tuple[Samples, ...]
    """Samples of the rays, a chunk of rays each."""
    places: Tensor
    """Place of each vertex in the grid, from :meth:`svv.kernels.types.VertexKernels.touched`. (V,)"""
    look: Look
    """What the networks say of them; its ``samples`` are the vertices, on rays that do not matter."""

    @property
    def bytes(self) -> int:
        """Memory that it takes."""
        numbers = 8 * sum(len(piece) for piece in self.pieces) + len(self.places)
        return self.look.bytes + 4 * numbers


@dataclass(frozen=True)
class SampleLooks:
    """What the networks say of the samples of chunks of rays, each; None for those that see nothing."""

    each: tuple[Look | None, ...]

    @property
    def bytes(self) -> int:
        """Memory that they take."""
        return sum(look.bytes for look in self.each if look is not None)


def vertex_kernels_of(scene: Model, network: str, camera: Camera) -> VertexKernels | None:
    """Return the kernels that draw the scene from what networks say of vertices; None if it is drawn from samples."""
    if scene.vertices_a_cell == 0 or network == "base" or image_kernels_of(scene) is None:
        return None
    assert isinstance(scene.base.encoding, SparseLattice)
    if scene.settings.headlight == "point" and not camera.is_orthographic and _is_near(scene, camera):
        return None
    return None if math.prod(_shape(scene)) > MOST_PLACES else kernels_for(scene.base.encoding.table).VERTICES


def is_plain(scene: Model, network: str) -> bool:
    """Return whether an image of a scene with regions shows nothing that has sharp edges in space."""
    assert scene.palette_network is not None
    sharp = network != "pcn" or scene.palette_network.phong is not None or scene.lamp.shadow > 0.0
    sharp = sharp or (scene.parts is not None and scene.parts.active > 0)
    sharp = sharp or is_sectioned(scene) or has_section_lines(scene) or is_occluded(scene)
    sharp = sharp or any(cut.regions for cut in scene.cuts)
    return not (sharp or any(r.matcap is not None or r.seen_opacity == 0.0 for r in scene.regions))


def look_at_vertices(
    vertices: VertexKernels, images: ImageKernels, scene: Model, camera: Camera, found: Sequence[tuple[Samples, Rays]],
    network: str, always: bool,
) -> VertexLook | SampleLooks:  # fmt: skip
    """Return what the networks say of the vertices around the samples of a camera's rays, or of these samples.

    The latter if the image is not plain, or, unless vertices are ``always`` taken, if they do not pay.
    """
    pieces, plain = tuple(samples for samples, _ in found), is_plain(scene, network)
    positions = [samples.position for samples in pieces]
    most = PAYS_MOVING if plain and not scene.still else PAYS[plain]
    around = vertices.touched(positions, _shape(scene), _scale(scene), math.inf if always else most)
    if around is None or not len(around[1]):
        return SampleLooks(tuple(look_at(images, scene, samples, rays) for samples, rays in found))
    places, position = around
    samples, towards = _alone(position), _towards(scene, camera, position, found[0][1])
    look = _known_look(vertices, scene, places, samples, towards) or look_at(images, scene, samples, towards)
    assert look is not None
    if plain:
        return VertexLook(pieces, places, look)
    light = look.raw[:, :0] if look.light is None else look.light
    each = [vertices.interpolate(own, places, _shape(scene), _scale(scene), light, look.raw) for own in positions]
    lit = look.light is not None
    looks = (Look(own, raw, light if lit else None) for own, (light, raw) in zip(pieces, each, strict=True))
    return SampleLooks(tuple(one if len(one.samples) else None for one in looks))


def _known_look(vertices: VertexKernels, scene: Model, places: Tensor, samples: Samples, towards: Rays) -> Look | None:
    """Return what the networks say of vertices at ``places`` of the grid; None if nothing of them may be kept."""
    palette, geometry = scene.palette_network, scene.base.encoding
    assert palette is not None and isinstance(palette.encoding, SparseLattice) and isinstance(geometry, SparseLattice)
    if palette.lighting_mlp is None or len(places) > MOST:
        return None
    weights, layout = palette.palette_mlp.weights, geometry.layout
    known = known_vertices(palette.encoding, [geometry.table, palette.encoding.table, *weights], _shape(scene))
    if known is None:
        return None
    tables = both_tables(geometry.table, palette.encoding)
    rows, features, raw = known.rows_of(
        places, samples.position, lambda position: vertices.unlit(position, layout, tables, weights)
    )
    light = vertices.light(features, rows, towards.lit_along, palette.lighting_mlp.weights)
    return Look(samples, raw.index_select(0, rows), light)


def draw_from_vertices(
    vertices: VertexKernels, images: ImageKernels, scene: Model, camera: Camera, look: VertexLook,
    drawn: Sequence[tuple[Rays, Images]],
) -> None:  # fmt: skip
    """Render chunks of rays, of whose samples there is a look, into RGBA (R, 4), depth (R,) and region (R,) of each."""
    beams = partial(Beams.of, scene.lamp, camera, drawn[0][0])
    surface, _ = shade(images, scene, look.look, "pcn", beams)
    opacities = [r.seen_opacity for r in scene.regions]
    opacity = None
    if any(factor != 1.0 for factor in opacities):
        opacity = numbers_on(opacities, surface.colour.device)[surface.region]
    pieces = [(samples, rays.origins, into) for samples, (rays, into) in zip(look.pieces, drawn, strict=True)]
    colours = surface.colour, opacity, surface.region
    grid, size = (_shape(scene), _scale(scene)), scene.occupancy.box.size
    vertices.composite(pieces, look.places, *grid, colours, len(scene.regions), size)


def _alone(position: Tensor) -> Samples:
    """Return positions (V, 3) as samples, each on a ray of its own."""
    count, zeros = len(position), torch.zeros(len(position))
    number = torch.arange(count)
    return Samples(position, zeros, zeros, number.int(), number, torch.ones_like(number), zeros, 1.0)


def _towards(scene: Model, camera: Camera, position: Tensor, rays: Rays) -> Rays:
    """Return the rays of a camera through positions (V, 3), by which a light at the camera shines on them."""
    if rays.axes is not None or camera.is_orthographic:
        along = rays.lit_along[:1].expand(len(position), 3)
    else:
        along = torch.nn.functional.normalize(position - rays.origins[:1], dim=1)
    return Rays(position, along, along)


def _is_near(scene: Model, camera: Camera) -> bool:
    """Return whether the direction of a light at the camera turns too much within a cell beside it."""
    box = scene.occupancy.box
    eye = box.to_box(camera.position)
    return float(np.linalg.norm(eye - np.clip(eye, 0.0, box.extent))) * _scale(scene) < NEAR


def _scale(scene: Model) -> float:
    """Return the vertices of the grid per box unit."""
    assert isinstance(scene.base.encoding, SparseLattice)
    return scene.vertices_a_cell * float(scene.base.encoding.layout.scales[-1])


def _shape(scene: Model) -> tuple[int, int, int]:
    """Return the number of vertices of the grid along x, y and z."""
    assert isinstance(scene.base.encoding, SparseLattice)
    x, y, z = (scene.vertices_a_cell * (n - 1) + 1 for n in scene.base.encoding.layout.shapes[-1].tolist())
    return x, y, z
