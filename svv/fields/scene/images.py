"""Images of a scene: rendered alone or together with its members, still or while a camera moves.

Letters: R rays, S samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.colour.palette_shading import lit
from svv.core.geometry.cameras import Camera
from svv.core.geometry.given_cameras import GivenCamera, camera_of
from svv.core.images.edges import VIEW
from svv.core.images.outlines import Pen, outlined
from svv.core.rays.compositing import LEAST_ALPHA
from svv.errors import BadInput, Progress, silent
from svv.fields.devices.gpu import gpu_errors
from svv.fields.radiance.cutting import march_uncut
from svv.fields.radiance.networks import PaletteColours, encode_directions
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import (
    Marching,
    RayCaster,
    Rays,
    composite,
    empty_images,
    ended,
    new_images,
    not_hidden,
    on_cpu,
    show_nothing,
)
from svv.fields.scene.image import draw, image_kernels_of, look_at
from svv.fields.scene.joined import members
from svv.fields.scene.matcaps import dress
from svv.fields.scene.model import Model, S, for_colours, of_colour
from svv.fields.scene.occlusion import occlude
from svv.fields.scene.open_cells import open_cells_of
from svv.fields.scene.paint_light import lights_of
from svv.fields.scene.sections import face_shares, faces, has_section_lines, show_sections, with_lines
from svv.fields.scene.shadows import cast_shadows
from svv.fields.scene.stroke_opacity import fade_of, followed
from svv.fields.scene.vertices import (
    SampleLooks,
    VertexLook,
    draw_from_vertices,
    is_plain,
    look_at_vertices,
    vertex_kernels_of,
)
from svv.fields.scene.view_cache import Look, View, key_of
from svv.fields.strokes.stroke_paint import shared_width
from svv.kernels.constants import numbers_on
from svv.kernels.dispatch import kernels_of
from svv.kernels.types import ImageKernels, Samples

MOVING_JOINED = 1.0 / 16.0
"""Weight in a pixel up to which a moving scene's samples are joined, unless its own is larger. More, or longer steps,
lose what a smaller picture would not (docs/measurements/limits.md)."""

CHUNKS_AT_ONCE = 8
"""Chunks of rays that share the vertices around their samples: with 32,768 rays each, a view of 800 x 800 is whole."""

FINER = 0.8
"""Width of pixels, in cells of the paint, below which a still image shows the strokes themselves."""

SOFT = 1.5
"""Width of the soft edges of strokes in pixels: sharper ones are restless from frame to frame."""


@dataclass(frozen=True)
class Rendering:
    """One image of a scene.

    ``rgba`` (H, W, 4) float32, straight alpha, in [0, 1]; ``depth`` (H, W) float32, mean distance from the camera in
    world units, NaN where nothing is visible; ``region`` (H, W) int16, -1 where nothing is visible.

    >>> image = scene.render(svv.orbit(scene, 8, 64, 48)[0])
    >>> image.rgba.shape, image.depth.shape, image.region.shape
    ((48, 64, 4), (48, 64), (48, 64))
    """

    rgba: NDArray[np.float32]
    depth: NDArray[np.float32]
    region: NDArray[np.int16]


def while_moving(scene: S) -> S:
    """Return the scene as it is drawn while a camera moves, with fewer colours along each ray.

    Shadows that follow the camera are computed for every frame, and therefore have sharp edges.
    """
    layers = tuple(while_moving(layer) for layer in scene.layers)
    lamp = replace(scene.lamp, shadow_softness=0.0) if scene.lamp.shadows_follow else scene.lamp
    return replace(scene, joined=max(scene.joined, MOVING_JOINED), lamp=lamp, layers=layers, still=False)


def resolving(scene: S, camera: Camera) -> S:
    """Return the scene as a still image of a camera shows it: with its strokes.

    Where other paint lies beside them, only if the lattice is too coarse for strokes.
    """
    if scene.layers:
        layers = tuple(resolving(layer, camera) for layer in scene.layers)
        return replace(scene, still=False, layers=layers)
    if scene.styled is None or scene.styled.brushed is None:
        return replace(scene, still=False)
    box = scene.occupancy.box
    away = float(np.linalg.norm(camera.position - np.asarray(box.bounds, np.float64).reshape(3, 2).mean(1)))
    pixel = shared_width(float(camera.pixel_at(max(away - 0.25 * box.size, 0.1 * box.size))) / box.size)
    finer = scene.styled.brushed.complete or pixel < FINER / scene.styled.resolutions[-1]
    return replace(scene, still=False, resolved=SOFT * pixel if finer else 0.0)


def render(
    scene: Model,
    camera: GivenCamera,
    network: str | None = None,
    background: Sequence[float] | None = None,
    progress: Progress = silent,
) -> Rendering:
    """Render one image.

    Args:
        scene: The scene.
        camera: Camera in world units, also a plotter's, or the name of a side such as ``xy``
            (:func:`svv.core.geometry.given_cameras.camera_of`).
        network: ``base``, ``pcn`` or ``styled``; by default the last one that the scene has.
        background: RGB in [0, 1] to blend over (alpha becomes 1); None keeps straight alpha.
        progress: Called before every chunk of rays and at the end.

    Raises:
        BadInput: The scene does not have that network, or the camera is none.
    """
    camera, network = camera_of(camera, scene), network or scene.networks[-1]
    if network not in scene.networks:
        raise BadInput(f"The scene has no network '{network}', only {', '.join(scene.networks)}.")
    if network == "styled" and scene.still:
        return render(resolving(scene, camera), camera, network, background, progress)
    outlines, shape = network != "base" and any(r.outline for r in scene.regions), (camera.height, camera.width)
    with gpu_errors(scene.device):
        share = torch.zeros(shape, device=scene.device) if network != "base" and has_section_lines(scene) else None
        images = _draw(scene, camera, network, progress, None if share is None else share.view(-1))
        drawn_over = outlines or share is not None
        if background is not None and not drawn_over:
            _blend(images[0], background)
        rgba, depth, region = on_cpu(images)
        rgba, depth, region = rgba.reshape(*shape, 4), depth.reshape(shape), region.reshape(shape)
    if outlines:
        pens = [Pen(r.outline, r.outline_width, r.outline_colour) for r in scene.regions]
        size = scene.occupancy.box.size
        rgba, depth, region = outlined(rgba, depth, region, pens, camera.pixel_at, size)
    if share is not None:
        rgba = with_lines(rgba, share.cpu().numpy(), region, scene.regions, VIEW)
    if background is not None and drawn_over:
        _blend(torch.from_numpy(rgba).view(-1, 4), background)
    progress(1.0, "rendering")
    return Rendering(rgba, depth, region)


def render_pixels(scene: Model, camera: Camera, pixels: Tensor, network: str) -> NDArray[np.float32]:
    """Return straight RGBA of some pixels, ascending flat indices int64 (N,), as :func:`render` draws large images.

    Wherever it can interpolate colours, it does. (N, 4)
    """
    with gpu_errors(scene.device):
        return _draw(scene, camera, network, silent, None, pixels)[0][pixels.to(scene.device)].cpu().numpy()


def _draw(
    scene: Model, camera: Camera, network: str, progress: Progress, share: Tensor | None, among: Tensor | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """Return straight RGBA (pixels, 4), depth and region (pixels,) of a view, on the scene's device.

    The light from faces of cuts is written into ``share`` (pixels,), 0 before, if it is there. If there are pixels
    ``among`` which to stay, nothing else is drawn.
    """
    together = Together(scene, camera, network) if scene.layers else None
    caster = scene.caster([camera])
    alone = together is None and network != "base" and image_kernels_of(scene) is not None
    vertices = vertex_kernels_of(scene, network, camera) if alone else None
    drawn_from = None if vertices is None else (scene.vertices_a_cell, is_plain(scene, network), scene.still)
    view = View(key_of(scene, camera, marching_as_edited(scene, network), drawn_from) if alone else None)
    pixels, chunk = camera.width * camera.height, kernels_of(scene.device.type).RAYS
    if among is not None:
        in_sight, view = among, View(None)
    else:
        in_sight = caster.in_sight(scene.occupancy) if together is None else together.in_sight()
    in_order = len(in_sight) == pixels  # if so, a chunk is a slice of the images; otherwise it is scattered
    images = (new_images if alone and in_order else empty_images)(pixels, scene.device)
    at_once = chunk if vertices is None else CHUNKS_AT_ONCE * chunk
    for first in range(0, len(in_sight), at_once):
        progress(first / len(in_sight), "rendering")
        own = in_sight[first : first + at_once]
        piece = [image[first : first + at_once] for image in images]
        parts = piece if in_order else (new_images if alone else empty_images)(len(own), scene.device)
        faces_seen = None if share is None else torch.zeros(len(own), device=scene.device)
        if together is not None:
            together.draw(own, parts[0], parts[1], parts[2], faces_seen)
        elif vertices is not None:
            chunks = [caster.rays(each) for each in own.split(chunk)]
            into, known = (parts[0], parts[1], parts[2]), partial(view.look, first)
            _render_from_vertices(scene, camera, chunks, network, into, known, faces_seen, among is not None)
        else:
            rays = caster.rays(own)
            beams = partial(Beams.of, scene.lamp, camera, rays)
            _render_rays(scene, rays, beams, network, (parts[0], parts[1], parts[2]), view, first, faces_seen)
        if share is not None and faces_seen is not None:
            share.index_copy_(0, own, faces_seen)
        if not in_order:
            for image, part in zip(images, parts, strict=True):
                image.index_copy_(0, own, part)
    view.drawn()
    return images


@torch.no_grad()
def _render_from_vertices(
    scene: Model, camera: Camera, rays: Sequence[Rays], network: str, images: tuple[Tensor, Tensor, Tensor],
    known: Callable[[Callable[[], VertexLook | SampleLooks]], VertexLook | SampleLooks], share: Tensor | None,
    always: bool,
) -> None:  # fmt: skip
    """Do what :func:`_render_rays` does for chunks of rays, from what networks say of vertices near their samples.

    ``known`` returns what was kept of that, or makes it; ``always``: even if vertices take longer than samples.
    """
    kernels, vertices, chunk = image_kernels_of(scene), vertex_kernels_of(scene, network, camera), len(rays[0])
    assert kernels is not None and vertices is not None

    def look() -> VertexLook | SampleLooks:
        found = [(visible_samples(scene, own, network), own) for own in rays]
        return look_at_vertices(vertices, kernels, scene, camera, found, network, always)

    seen, drawn = known(look), list(zip(*(image.split(chunk) for image in images), strict=True))
    if isinstance(seen, VertexLook):
        draw_from_vertices(vertices, kernels, scene, camera, seen, list(zip(rays, drawn, strict=True)))
        return
    shares = [None] * len(rays) if share is None else share.split(chunk)
    for one, own, into, faces_seen in zip(seen.each, rays, drawn, shares, strict=True):
        beams = partial(Beams.of, scene.lamp, camera, own)
        _show_look(kernels, scene, one, own, network, beams, into, faces_seen)


@torch.no_grad()
def _render_rays(
    scene: Model, rays: Rays, beams: Callable[[], Beams], network: str, images: tuple[Tensor, Tensor, Tensor],
    view: View, first: int, share: Tensor | None,
) -> None:  # fmt: skip
    """Render rays into the images; the kernels for images also empty what shows nothing, others leave it as it is.

    ``first``: number of the first of these rays among those of the ``view``; ``share`` (R,): as for :func:`draw`.
    """
    kernels = None if network == "base" else image_kernels_of(scene)
    if kernels is not None:
        look = view.look(first, lambda: look_at(kernels, scene, visible_samples(scene, rays, network), rays))
        _show_look(kernels, scene, look, rays, network, beams, images, share)
        return
    samples = visible_samples(scene, rays, network)
    if not len(samples):
        return
    colour, of, sigma = shade(scene, samples, rays, network, beams())
    distance = (samples.position - rays.origins[samples.ray.long()]).norm(dim=1)
    _show(samples, sigma, (colour, distance, of), max(len(scene.regions), 1), scene.occupancy.box.size, images)
    if share is not None:
        share.copy_(face_shares(scene, samples, sigma, of))


def _show_look(
    kernels: ImageKernels, scene: Model, look: Look | None, rays: Rays, network: str, beams: Callable[[], Beams],
    images: tuple[Tensor, Tensor, Tensor], share: Tensor | None,
) -> None:  # fmt: skip
    """Draw rays of which a look is known; None empties their pixels."""
    if look is not None:
        draw(kernels, scene, look, rays, network, beams, images, share)
    else:
        show_nothing(images)


def _show(
    samples: Samples, sigma: Tensor, seen: tuple[Tensor, Tensor, Tensor], regions: int, size: float,
    images: tuple[Tensor, Tensor, Tensor],
) -> None:  # fmt: skip
    """Composite colours (S, 3), distances (S,), of which ``size`` is a unit, and regions (S,) into the images."""
    (colour, distance, of), (rgba, depth, region) = seen, images
    values = [colour, distance[:, None], torch.nn.functional.one_hot(of, regions).float()]
    out, transmittance, _ = composite(samples, sigma, torch.cat(values, dim=1))
    alpha = 1.0 - transmittance
    shown = torch.nonzero(alpha > LEAST_ALPHA)[:, 0]
    mean = out[shown] / alpha[shown, None]
    rgba[shown, :3] = mean[:, :3].clamp(0.0, 1.0)
    rgba[shown, 3] = alpha[shown]
    depth[shown] = mean[:, 3] * size
    region[shown] = mean[:, 4:].argmax(1).to(torch.int16)


def pixel_in(camera: Camera, pixel: tuple[float, float]) -> tuple[int, int]:
    """Return column and row of a pixel of a camera's picture; raises BadInput if it is outside."""
    column, row = (int(np.floor(value)) for value in pixel)
    if not (0 <= column < camera.width and 0 <= row < camera.height):
        raise BadInput(f"The pixel {column},{row} is outside the picture of {camera.width} x {camera.height} pixels.")
    return column, row


@torch.no_grad()
def point_at(
    scene: Model, camera: GivenCamera, pixel: tuple[float, float], network: str | None = None
) -> tuple[float, float, float]:
    """Return the world point that a pixel shows, where the region that it belongs to is most visible, for ``split_at``.

    ``pixel``: column from the left and row from the top of the picture; ``camera`` and ``network``: as for
    :func:`render`. Raises BadInput if the pixel is outside the picture, or nothing is visible there.
    """
    camera = camera_of(camera, scene)
    column, row = pixel_in(camera, pixel)
    found = Together(scene, camera, network or scene.networks[-1]).most_visible(
        torch.tensor([row * camera.width + column])
    )
    if found is not None:
        return found.point
    raise BadInput(f"Nothing is visible at the pixel {column},{row}: click on something visible.")


def _blend(rgba: Tensor, background: Sequence[float]) -> None:
    """Blend straight RGBA (N, 4) over a colour, in place and on its device; alpha becomes 1."""
    alpha = rgba[:, 3:].clone()
    rgba[:, :3].mul_(alpha).add_(numbers_on(background, rgba.device) * (1.0 - alpha))
    rgba[:, 3] = 1.0


# --- what samples look like -------------------------------------------------------------------------------------------


Seen = tuple[Samples, Tensor, Tensor, Tensor]
"""S samples, their colours (S, 3), regions (S,) and edited extinctions (S,)."""


def marching_as_edited(scene: Model, network: str) -> Marching:
    """Return how rays are sampled; they go deeper where edits make regions more transparent."""
    return replace(scene.marching_for_images, fade=fade_of(scene, network))


@torch.no_grad()
def visible_samples(scene: Model, rays: Rays, network: str) -> Samples:
    """Return the samples of rays for an image; without a known extinction, ``sigma`` is the part of a step of each."""
    how = marching_as_edited(scene, network)
    # Without regions, as the base network draws, nothing is cut off for some only.
    cuts = scene.cuts if network != "base" else [cut for cut in scene.cuts if not cut.regions]
    opened = open_cells_of(scene) if network != "base" else None
    samples = march_uncut(rays, scene.occupancy, scene.base.density, how, cuts, opened)
    if scene.base.density is None:
        # What is cut off or hidden must not end a ray.
        how = how if opened is None else replace(how, fade=0.0)
        share = samples.sigma
        samples, rows = not_hidden(samples, scene.base.extinction(samples) * share, how)
        return replace(samples, sigma=share[rows])
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
    if scene.base.density is None:
        sigma = sigma * samples.sigma
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
    sigma = scene.cut_open(sigma, samples, region)
    if any(r.seen_opacity != 1.0 for r in scene.regions):
        sigma = sigma * numbers_on([r.seen_opacity for r in scene.regions], sigma.device)[region]
    diffuse = scene.with_style(parts.diffuse(scene.edited_colours(parts.offsets, here)), region, paint)
    occlude(scene, diffuse, samples.position, region)
    colour = light(scene, parts, diffuse, region, network)
    if any(r.matcap is not None for r in scene.regions):
        dress(scene, colour, samples.position, region, samples.ray, seen)
    cast_shadows(scene, colour, samples.position, network, seen.shadows_from)
    show_sections(scene, colour, samples, region, network)
    return colour, region, sigma


def light(scene: Model, parts: PaletteColours, diffuse: Tensor, region: Tensor, network: str) -> Tensor:
    """Light diffuse colours (S, 3) with the brightness that the edits of their regions (S,) set. (S, 3)"""
    if network != "styled":
        factor = numbers_on([r.lighting for r in scene.regions], diffuse.device)[region]
        return lit(diffuse, parts.specular, parts.shade, factor)
    return lit(diffuse, parts.specular, parts.shade, *lights_of(scene, network)[region].unbind(1))


# --- several scenes together ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Visible:
    """What a pixel shows of a scene: a region, and where that is most visible. S samples are of it."""

    point: tuple[float, float, float]
    """That place, in world coordinates."""
    away: float
    """Its distance from the camera along the pixel's ray, world units."""
    region: int
    share: float
    """Part of what is visible in the pixel that the region is, in (0, 1]."""
    alpha: float
    """The pixel's opacity."""
    colour: tuple[float, float, float]
    """The pixel's colour, RGB in [0, 1], straight."""
    along: NDArray[np.float64]
    """World points of the region's samples along the ray. (S, 3)"""
    weights: NDArray[np.float32]
    """Their weights in the pixel. (S,)"""


class Together:
    """Draws a joined scene from one camera; a plain scene is one of one member."""

    def __init__(self, scene: Model, camera: Camera, network: str) -> None:
        """Prepare the members that are visible."""
        self.camera, self.count = camera, len(scene.regions)
        self.shown: list[tuple[Tensor, Model, RayCaster, str]] = []
        """Number in the whole of each region of a member (or 0 without regions), the member, its rays and network."""
        for number, member in enumerate(members(scene)):
            if network == "base" or any(r.seen_opacity > 0.0 for r in member.regions):
                caster = member.caster([camera])
                own = network if network in member.networks else member.networks[-1]
                numbers = [k for k, r in enumerate(scene.regions) if r.layer == number] or [0]
                self.shown.append((torch.tensor(numbers, device=member.device), member, caster, own))

    def in_sight(self) -> Tensor:
        """Return the pixels that may show something, ascending. (R,)"""
        found = [caster.in_sight(member.occupancy) for _, member, caster, _ in self.shown]
        return torch.cat(found).unique() if found else torch.zeros(0, dtype=torch.int64)

    def samples(self, pixels: Tensor) -> tuple[Samples, Tensor, Tensor, Tensor, Tensor] | None:
        """Return the samples of all members along the rays of pixels (R,), in the order of their distances, if any.

        The samples' ``sigma`` is their edited optical depth, and their step is 1; their colours are (S, 3), regions
        (S,), distances from the camera in world units (S,), and how far they show faces of cuts (S,).
        """
        parts: list[tuple[Tensor, ...]] = []
        tail = torch.zeros(len(pixels), device=pixels.device)
        for numbers, member, caster, network in self.shown:
            rays = caster.rays(pixels)
            beams = Beams.of(member.lamp, self.camera, rays)
            found = seen_along(member, rays, beams, network)
            if found is None:
                continue
            samples, colour, of, sigma = found
            size = member.occupancy.box.size
            distance = size * (samples.position - rays.origins[samples.ray.long()]).norm(dim=1)
            face, _ = faces(member, samples, of)
            parts.append((samples.ray, distance, samples.skipped, sigma * samples.step, colour, numbers[of], face))
            tail = tail.to(samples.tail) + samples.tail
        if not parts:
            return None
        ray, distance, skipped, thickness, colour, of, face = (torch.cat(each) for each in zip(*parts, strict=True))
        order = distance.argsort(stable=True)
        order = order[ray[order].argsort(stable=True)]
        count = torch.bincount(ray, minlength=len(pixels))
        found_there = Samples(
            colour[order], thickness[order], skipped[order], ray[order], count.cumsum(0) - count, count, tail, 1.0
        )
        return found_there, colour[order], of[order], distance[order], face[order]

    @torch.no_grad()
    def draw(self, pixels: Tensor, rgba: Tensor, depth: Tensor, region: Tensor, share: Tensor | None) -> None:
        """Draw pixels (R,) into RGBA (R, 4), depth, region and ``share`` (R,), all of them empty before."""
        found = self.samples(pixels)
        if found is not None:
            samples, colour, of, distance, face = found
            _show(samples, samples.sigma, (colour, distance, of), self.count, 1.0, (rgba, depth, region))
            if share is not None:
                share.copy_(composite(samples, samples.sigma, face[:, None])[0][:, 0])

    @torch.no_grad()
    def places(self, pixels: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return which of some pixels (R,) show something, the distance of each from :meth:`most_visible`, and region.

        The distances are along the pixels' rays, in world units. (K,) each
        """
        found = self.samples(pixels)
        if found is None:
            return pixels[:0], torch.zeros(0), pixels[:0]
        samples, _, of, distance, _ = found
        _, transmittance, weights = composite(samples, samples.sigma, samples.sigma[:, None])
        ray, rays = samples.ray.long(), len(pixels)
        shares = weights.new_zeros(rays, max(self.count, 1)).index_put_((ray, of), weights, accumulate=True)
        region = shares.argmax(dim=1)
        own = torch.where(of == region[ray], weights, -1.0)
        most = own.new_full((rays,), -1.0).scatter_reduce(0, ray, own, "amax")
        number = torch.arange(len(ray), device=ray.device)
        first = number.new_full((rays,), len(ray)).scatter_reduce(
            0, ray, torch.where(own == most[ray], number, len(ray)), "amin"
        )
        shown = torch.nonzero((1.0 - transmittance > LEAST_ALPHA) & (most > 0.0))[:, 0]
        return pixels.to(shown.device)[shown], distance[first[shown]], region[shown]

    @torch.no_grad()
    def most_visible(self, pixel: Tensor) -> Visible | None:
        """Return the region that a pixel (1,) shows, and where it is most visible; None if nothing is."""
        found = self.samples(pixel)
        if found is None:
            return None
        samples, colour, of, distance, _ = found
        out, transmittance, weights = composite(samples, samples.sigma, colour)
        alpha = float(1.0 - transmittance)
        if alpha <= LEAST_ALPHA or float(weights.max()) <= 0.0:
            return None
        shares = torch.bincount(of, weights)
        region = int(shares.argmax())
        own = of == region
        origin, direction = (vectors.reshape(-1, 3)[int(pixel)] for vectors in self.camera.rays())
        away = float(distance[torch.where(own, weights, -1.0).argmax()])
        along = origin + distance[own].cpu().numpy()[:, None] * direction
        r, g, b = (out[0] / alpha).clamp(0.0, 1.0).tolist()
        x, y, z = (origin + away * direction).tolist()
        share = float(shares[region] / shares.sum())
        return Visible((x, y, z), away, region, share, alpha, (r, g, b), along, weights[own].cpu().numpy())
