"""A scene: the result of training on views of a volume, with its edits; used by the command, scripts and ParaView."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.colour.light import COEFFICIENTS
from svv.core.colour.palette_shading import lit
from svv.core.geometry.cameras import Camera
from svv.core.images.outlines import Pen, outlined
from svv.core.rays.compositing import LEAST_ALPHA
from svv.errors import BadInput, Progress, silent
from svv.fields.radiance.image import draw, image_kernels_of, look_at
from svv.fields.radiance.kept_views import View, key_of
from svv.fields.radiance.matcaps import dress
from svv.fields.radiance.networks import PaletteColours, encode_directions
from svv.fields.radiance.occlusion import occlude
from svv.fields.radiance.paint_light import lights_of
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import Marching, Rays, composite, empty_images, ended, march, not_hidden, on_cpu
from svv.fields.scene.history import History
from svv.fields.scene.joined import Shaded, Together, members, split_in_a_layer
from svv.fields.scene.kept_styles import without_kept
from svv.fields.scene.model import NETWORKS, for_colours, of_colour
from svv.fields.scene.scene_arrays import arrays_of, layers_of, parts_of
from svv.fields.scene.variants import PaintedModel
from svv.fields.strokes.stroke_opacity import fade_of, followed
from svv.fields.strokes.stroke_paint import shared_width
from svv.io.scene_file import parse_scene, read_scene_file, scene_bytes, write_scene_file
from svv.kernels.constants import numbers_on
from svv.kernels.dispatch import kernels_of
from svv.kernels.gpu import gpu_errors
from svv.kernels.types import Samples
from svv.options.editing import SPLIT_LEVEL

MOVING_JOINED = 1.0 / 16.0
"""Weight in a pixel up to which a moving scene's samples are joined, unless its own is larger. More, or longer steps,
lose what a smaller picture would not (docs/measurements/limits.md)."""

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


@dataclass(frozen=True)
class Scene(PaintedModel):
    """Networks, geometry and edits of a scene. Every edit returns a new scene that shares the networks.

    :class:`svv.fields.scene.model.Model` documents its fields, :class:`svv.fields.scene.edits.EditedModel` its edits,
    and :class:`svv.fields.scene.variants.PaintedModel` its paintings.

    >>> scene.save("balls.svv")
    >>> again = svv.Scene.load("balls.svv").hidden(0)
    >>> again.networks, [region.hidden for region in again.regions]
    (('base', 'pcn'), [True, False])
    """

    def on(self, device: torch.device) -> Scene:
        """Return the scene on a device: itself if it is there already, otherwise a copy of its networks."""
        if device.type == self.device.type:
            return self
        base, palette, styled, others = copy.deepcopy((self.base, self.palette_network, self.styled, self.others))
        return replace(
            self,
            base=base.to(device),
            palette_network=None if palette is None else palette.to(device),
            styled=None if styled is None else styled.to(device),
            others=tuple(replace(other, network=other.network.to(device)) for other in others),
            layers=tuple(cast(Scene, layer).on(device) for layer in self.layers),
        )

    @property
    def networks(self) -> tuple[str, ...]:
        """Which of the networks ``base``, ``pcn`` and ``styled`` it holds, the plainest first."""
        there = {*super().networks, *(name for layer in self.layers for name in layer.networks)}
        return tuple(name for name in NETWORKS if name in there)

    def shaded(self, rays: Rays, beams: Beams, network: str) -> Shaded | None:
        """Return what an image shows of rays, as samples; None if that is nothing."""
        samples = self.visible_samples(rays, network)
        return (samples, *self.shade(samples, rays, network, beams)) if len(samples) else None

    # --- rendering -------------------------------------------------------------------------------------------------

    def while_moving(self) -> Scene:
        """Return the scene as it is drawn while a camera moves, with fewer colours along each ray."""
        layers = tuple(cast(Scene, layer).while_moving() for layer in self.layers)
        return replace(self, joined=max(self.joined, MOVING_JOINED), layers=layers, still=False)

    def resolving(self, camera: Camera) -> Scene:
        """Return the scene as a still image of a camera shows it: with its strokes.

        Where other paint lies beside them, only if the lattice is too coarse for strokes.
        """
        if self.layers:
            layers = tuple(cast(Scene, layer).resolving(camera) for layer in self.layers)
            return replace(self, still=False, layers=layers)
        if self.styled is None or self.styled.brushed is None:
            return replace(self, still=False)
        box = self.occupancy.box
        away = float(np.linalg.norm(camera.position - np.asarray(box.bounds, np.float64).reshape(3, 2).mean(1)))
        pixel = shared_width(float(camera.pixel_at(max(away - 0.25 * box.size, 0.1 * box.size))) / box.size)
        finer = self.styled.brushed.complete or pixel < FINER / self.styled.resolutions[-1]
        return replace(self, still=False, resolved=SOFT * pixel if finer else 0.0)

    def render(
        self,
        camera: Camera,
        network: str | None = None,
        background: Sequence[float] | None = None,
        progress: Progress = silent,
    ) -> Rendering:
        """Render one image.

        Args:
            camera: Camera in world units.
            network: ``base``, ``pcn`` or ``styled``; by default the last one that the scene has.
            background: RGB in [0, 1] to blend over (alpha becomes 1); None keeps straight alpha.
            progress: Called before every chunk of rays and at the end.

        Raises:
            BadInput: The scene does not have that network.
        """
        network = network or self.networks[-1]
        if network not in self.networks:
            raise BadInput(f"The scene has no network '{network}', only {', '.join(self.networks)}.")
        if network == "styled" and self.still:
            return self.resolving(camera).render(camera, network, background, progress)
        outlines, shape = network != "base" and any(r.outline for r in self.regions), (camera.height, camera.width)
        with gpu_errors(self.device):
            images = self._draw(camera, network, progress)
            if background is not None and not outlines:
                _blend(images[0], background)
            rgba, depth, region = (image.reshape(*shape, *image.shape[1:]) for image in on_cpu(images))
        if outlines:
            pens = [Pen(r.outline, r.outline_width, r.outline_colour) for r in self.regions]
            size = self.occupancy.box.size
            rgba, depth, region = outlined(rgba, depth, region, pens, camera.pixel_at, size)
            if background is not None:
                _blend(torch.from_numpy(rgba).view(-1, 4), background)
        progress(1.0, "rendering")
        return Rendering(rgba, depth, region)

    def _draw(self, camera: Camera, network: str, progress: Progress) -> tuple[Tensor, Tensor, Tensor]:
        """Return straight RGBA (pixels, 4), depth and region (pixels,) of a view, on the scene's device."""
        together = Together(self, camera, network, Scene.shaded) if self.layers else None
        caster = self.caster([camera])
        alone = together is None and network != "base" and image_kernels_of(self) is not None
        view = View(key_of(self, camera, self._marching_as_edited(network)) if alone else None)
        pixels, chunk = camera.width * camera.height, kernels_of(self.device.type).RAYS
        images = empty_images(pixels, self.device)
        in_sight = caster.in_sight(self.occupancy) if together is None else together.in_sight()
        in_order = len(in_sight) == pixels  # if so, a chunk is a slice of the images; otherwise it is scattered
        for first in range(0, len(in_sight), chunk):
            progress(first / len(in_sight), "rendering")
            own = in_sight[first : first + chunk]
            piece = [image[first : first + chunk] for image in images]
            parts = piece if in_order else empty_images(len(own), self.device)
            if together is not None:
                together.draw(own, *parts)
            else:
                rays = caster.rays(own)
                beams = Beams.of(self.lamp, camera, rays)
                self._render_rays(rays, beams, network, (parts[0], parts[1], parts[2]), view, first)
            if not in_order:
                for image, part in zip(images, parts, strict=True):
                    image.index_copy_(0, own, part)
        view.drawn()
        return images

    @torch.no_grad()
    def _render_rays(
        self, rays: Rays, beams: Beams, network: str, images: tuple[Tensor, Tensor, Tensor], view: View, first: int
    ) -> None:
        """Render rays into the images; pixels in which nothing is visible are left unchanged.

        ``first``: number of the first of these rays among those of the ``view``.
        """
        kernels = None if network == "base" else image_kernels_of(self)
        if kernels is not None:
            look = view.look(first, lambda: look_at(kernels, self, self.visible_samples(rays, network), rays))
            if look is not None:
                draw(kernels, self, look, rays, network, beams, images)
            return
        samples = self.visible_samples(rays, network)
        if not len(samples):
            return
        rgba, depth, region = images
        colour, of, sigma = self.shade(samples, rays, network, beams)
        distance = (samples.position - rays.origins[samples.ray.long()]).norm(dim=1)
        values = [colour, distance[:, None]]
        if self.palette_network is not None:
            values.append(torch.nn.functional.one_hot(of, len(self.regions)).float())
        out, transmittance, _ = composite(samples, sigma, torch.cat(values, dim=1))
        alpha = 1.0 - transmittance
        seen = torch.nonzero(alpha > LEAST_ALPHA)[:, 0]
        mean = out[seen] / alpha[seen, None]
        rgba[seen, :3] = mean[:, :3].clamp(0.0, 1.0)
        rgba[seen, 3] = alpha[seen]
        depth[seen] = mean[:, 3] * self.occupancy.box.size
        region[seen] = mean[:, 4:].argmax(1).to(torch.int16) if self.palette_network is not None else 0

    @torch.no_grad()
    def visible_samples(self, rays: Rays, network: str) -> Samples:
        """Return the samples of rays for an image."""
        how = self._marching_as_edited(network)
        samples = march(rays, self.occupancy, self.base.density, how)
        if self.base.density is None:
            samples, _ = not_hidden(samples, self.base.extinction(samples), how)
            return samples
        return ended(samples)

    @torch.no_grad()
    def point_at(
        self, camera: Camera, pixel: tuple[float, float], network: str | None = None
    ) -> tuple[float, float, float]:
        """Return the point that a pixel shows: where the region that the pixel belongs to is most visible.

        Args:
            camera: Camera of the picture, in world units.
            pixel: Column from the left and row from the top of the picture, in pixels.
            network: As in :meth:`render`.

        Returns:
            World coordinates, for :meth:`split_at`.

        Raises:
            BadInput: The pixel is outside the picture, or nothing is visible there.
        """
        column, row = (int(np.floor(value)) for value in pixel)
        if not (0 <= column < camera.width and 0 <= row < camera.height):
            raise BadInput(
                f"The pixel {column},{row} is outside the picture of {camera.width} x {camera.height} pixels."
            )
        found = Together(self, camera, network or self.networks[-1], Scene.shaded).most_visible(
            torch.tensor([row * camera.width + column])
        )
        if found is not None:
            return found
        raise BadInput(f"Nothing is visible at the pixel {column},{row}: click on something visible.")

    def shade(
        self, samples: Samples, rays: Rays, network: str, beams: Beams | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return colour (S, 3), region (S,) and edited extinction (S,) of samples; by default lit along the rays."""
        sigma, geometry = self.base.geometry(samples)
        directions = encode_directions(rays.lit_along, samples.ray)
        if network == "base" or self.palette_network is None:
            region = torch.zeros_like(samples.ray, dtype=torch.int64)
            return self.base(geometry, directions), region, sigma
        seen = beams or Beams.headlight(-rays.lit_along)
        at = None if self.palette_network.phong is None else seen.at(samples.ray)  # a network's light cannot be moved
        here, coefficients = self.regions_at(samples.position), self.coefficients()
        coefficients = None if coefficients is None else for_colours(coefficients, here)
        parts = self.palette_network(samples.position, geometry, directions, at, coefficients)
        region = of_colour(here, parts.region)
        paint = self.paint(samples, network, region)
        sigma = followed(self, sigma, region, paint)
        if any(r.seen_opacity != 1.0 for r in self.regions):
            sigma = sigma * numbers_on([r.seen_opacity for r in self.regions], sigma.device)[region]
        diffuse = self.with_style(parts.diffuse(self.edited_colours(parts.offsets, here)), region, paint)
        occlude(self, diffuse, samples.position, region)
        colour = self.light(parts, diffuse, region, network)
        if any(r.matcap is not None for r in self.regions):
            dress(self, colour, samples.position, region, samples.ray, seen)
        return colour, region, sigma

    def light(self, parts: PaletteColours, diffuse: Tensor, region: Tensor, network: str) -> Tensor:
        """Light diffuse colours (S, 3) with the brightness that the edits of their regions (S,) set. (S, 3)"""
        if network != "styled":
            factor = numbers_on([r.lighting for r in self.regions], diffuse.device)[region]
            return lit(diffuse, parts.specular, parts.shade, factor)
        return lit(diffuse, parts.specular, parts.shade, *lights_of(self, network)[region].unbind(1))

    def _marching_as_edited(self, network: str) -> Marching:
        """Return how rays are sampled; they go deeper where edits make regions more transparent."""
        return replace(self.marching_for_images, fade=fade_of(self, network))

    def split_at(self, point: Sequence[float], level: float = SPLIT_LEVEL, progress: Progress = silent) -> Scene:
        """Return the scene with a connected part as a region of its own; see :meth:`EditedModel.split_at`."""
        if self.layers:
            return split_in_a_layer(self, point, level, progress)
        return super().split_at(point, level, progress)

    # --- files -----------------------------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write the scene to one ``.svv`` file, completely or not at all; raises BadInput if it cannot be written."""
        header, tensors = arrays_of(self, packed=True, whole=False)
        write_scene_file(path, header, tensors)

    @classmethod
    def load(cls, path: str | Path) -> Scene:
        """Read a scene; raises BadInput if the file is missing, damaged, not a scene or of another version."""
        return cls._restored(*read_scene_file(path), str(path))

    def to_bytes(self) -> bytes:
        """Return the content that :meth:`save` writes, with uncompressed tables."""
        return scene_bytes(*self.to_arrays())

    @classmethod
    def from_bytes(cls, content: bytes, name: str = "The scene") -> Scene:
        """Read the content from :meth:`to_bytes`; raises BadInput as :meth:`load` does."""
        return cls._restored(*parse_scene(content, name), name)

    @classmethod
    def _restored(cls, header: dict[str, Any], tensors: dict[str, NDArray[Any]], name: str) -> Scene:
        try:
            return cls.from_arrays(header, tensors)
        except Exception as error:  # a damaged file may say anything, and so fail anywhere
            raise BadInput(f"{name} is damaged ({type(error).__name__}: {error}): train it again.") from error

    def to_arrays(self, packed: bool = True) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return header and arrays of the file.

        Args:
            packed: Whether to store tables of lattices as bytes and those of the hash grid in half precision;
                otherwise they keep full precision.
        """
        return arrays_of(self, packed)

    @classmethod
    def from_arrays(cls, header: dict[str, Any], tensors: dict[str, NDArray[Any]]) -> Scene:
        """Restore a scene from the result of :meth:`to_arrays`."""
        model = cls(**parts_of(header, tensors))
        layers = (cls.from_arrays(*layer) for layer in layers_of(header, tensors, model))
        model = replace(model, layers=tuple(replace(layer, regions=(), unsplit=()) for layer in layers))
        if "history" not in header:
            return model
        return replace(model, history=History.from_json(header["history"], model.every_region))

    def info(self) -> dict[str, Any]:
        """Describe the scene and how it was made, as plain values."""
        networks = dict(zip(NETWORKS, (self.base, self.palette_network, self.styled), strict=True))
        networks |= {f"variant {other.name}": other.network for other in self.others}
        parameters = {k: sum(p.numel() for p in n.parameters()) for k, n in networks.items() if n is not None}
        return {
            "networks": self.networks,
            "parameters": {**parameters, "total": sum(parameters.values())},
            "encoding": self.settings.encoding,
            "resolutions": self.settings.resolutions,
            "paint_resolutions": None if self.styled is None else self.styled.resolutions,
            "finest_world_units": self.occupancy.box.size / self.settings.resolutions[-1],
            "occupied_fraction": self.occupancy.fraction,
            "image_step_world_units": self.stride * self.marching.step * self.occupancy.box.size,
            "bounds": self.occupancy.box.bounds.tolist(),
            "regions": [vars(r) for r in self.regions],
            **self._light_info(),
            "times": [] if self.steps is None or len(self.steps) < 2 else self.steps.times,
            "variant": self.variant,
            "variants": {v.name: {str(k): s for k, s in enumerate(v.styles) if s} for v in self.every_variant},
            "undo": [step.what for step in self.history.past],
            "redo": [step.what for step in self.history.future],
            "camera_rig": {} if self.camera_rig is None else self.camera_rig.to_json(),
            "made": without_kept(self.made),
        }

    def _light_info(self) -> dict[str, Any]:
        every = [member.coefficients() for member in members(self)]
        if any(coefficients is None for coefficients in every):
            return {"lighting": self.settings.lighting}
        rows = [row for coefficients in every if coefficients is not None for row in coefficients.tolist()]
        reflects = [dict(zip(COEFFICIENTS, row, strict=True)) for row in rows]
        return {"lighting": self.settings.lighting, "light": self.lamp.said(), "reflects": reflects}


def _blend(rgba: Tensor, background: Sequence[float]) -> None:
    """Blend straight RGBA (N, 4) over a colour, in place and on its device; alpha becomes 1."""
    alpha = rgba[:, 3:].clone()
    rgba[:, :3].mul_(alpha).add_(numbers_on(background, rgba.device) * (1.0 - alpha))
    rgba[:, 3] = 1.0
