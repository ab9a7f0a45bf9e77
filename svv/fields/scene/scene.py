"""A scene: the result of training on views of a volume, with its edits; used by the command, scripts and ParaView."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.geometry.cameras import Camera
from svv.core.geometry.cuts import Cut
from svv.core.geometry.given_cameras import GivenCamera, camera_of
from svv.errors import Progress, silent
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import Rays
from svv.fields.scene import edits, images, variants
from svv.fields.scene.history import Step
from svv.fields.scene.images import Rendering as Rendering
from svv.fields.scene.joined import split_at
from svv.fields.scene.model import Model, on_device
from svv.fields.scene.scene_arrays import Arrays, arrays_of, info_of, restored, scene_of
from svv.io.scene_file import parse_scene, read_scene_file, scene_bytes, write_scene_file
from svv.kernels.types import Samples
from svv.options.editing import SPLIT_LEVEL, RecolourName

if TYPE_CHECKING:
    from typing_extensions import Self


@dataclass(frozen=True)
class Scene(Model):
    """Networks, geometry and edits of a scene. Every edit returns a new scene that shares the networks.

    Its fields are those of the record :class:`svv.fields.scene.model.Model`; its methods are what one does with it. The
    functions behind them work on any such record.

    >>> scene.save("balls.svv")
    >>> again = svv.Scene.load("balls.svv").hidden(0)
    >>> again.networks, [region.hidden for region in again.regions]
    (('base', 'pcn'), [True, False])
    """

    def on(self, device: torch.device) -> Self:
        """Return the scene on a device: itself if it is there already, otherwise a copy of its networks."""
        return on_device(self, device)

    def edited(
        self,
        region: int,
        colour: Sequence[float] | None = None,
        opacity: float | None = None,
        lighting: float | None = None,
        name: str | None = None,
        recolour_in: RecolourName | None = None,
        matcap: str | None = None,
        **reflects: float | None,
    ) -> Self:
        """Return a scene with one region's colour, opacity, lighting or name changed (photorealistic style editing).

        Args:
            region: Number of the region.
            colour: New palette colour of the region, RGB in [0, 1]; its shades change with it.
            opacity: Factor on the extinction, >= 0; 1 is as trained.
            lighting: Factor on the lighting, >= 0; 1 is as trained, 0 shows the flat material.
            recolour_in: Space in which its shades follow its colour, ``hsb`` or ``oklab``.
            name: What the region shows, such as ``bone``; empty takes its name away.
            matcap: Name of a MatCap, file of a square picture of a lit sphere, or ``none``.
            reflects: Under an explicit light, ``ambient``, ``diffuse`` and ``specular``, fractions of the light, >= 0,
                and ``shininess``, the highlight's exponent, >= 1.

        Raises:
            BadInput: Something does not exist or is out of range, or the region or its light cannot be changed so.
        """
        texts = {"recolour_in": recolour_in, "name": name, "matcap": matcap}
        return edits.edited(self, region, colour, {"opacity": opacity, "lighting": lighting}, texts, reflects)

    def with_light(
        self,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        direction: Sequence[float] | None = None,
        intensity: float | None = None,
    ) -> Self:
        """Return a scene with the light moved; without arguments it becomes a headlight of the same brightness again.

        Args:
            azimuth: Degrees to the right of the camera, which the light follows, in [-180, 180].
            elevation: Degrees above the camera, in [-90, 90].
            direction: World direction that the light comes from instead, x, y and z; it no longer follows the camera.
            intensity: Factor on its brightness, >= 0; 1 is the light of the views. Unchanged by default.

        Raises:
            BadInput: The lighting comes from a network, the scene has no light, or a number is out of range.
        """
        return edits.with_light(self, azimuth, elevation, direction, intensity)

    def cut(self, *cuts: Cut | str) -> Self:
        """Return a scene cut open: what is inside a shape, or outside of it, is not shown; nothing is trained.

        Args:
            cuts: Shapes in world units, or texts that :meth:`svv.Cut.parse` reads, such as ``"x>50%&y>50%"``.

        Raises:
            BadInput: A text is no cut, a region does not exist, or there are too many.
        """
        bounds = self.bounds
        return edits.cut(self, [Cut.parse(one, bounds) if isinstance(one, str) else one for one in cuts])

    def uncut(self) -> Self:
        """Return the scene without its cuts, as one edit."""
        return edits.uncut(self)

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner of what it shows, with all its members, in world units. (2, 3)"""
        every = np.stack([layer.occupancy.box.bounds for layer in self.every_layer])
        return np.stack([every[:, 0].min(axis=0), every[:, 1].max(axis=0)])

    def hidden(self, *regions: int) -> Self:
        """Return a scene in which these regions are hidden; their opacities are kept for when they are shown again.

        Raises:
            BadInput: No region is named, or a region does not exist.
        """
        return edits.hidden(self, regions)

    def shown(self, *regions: int) -> Self:
        """Return a scene in which these regions, by default all, are visible again, as opaque as they were.

        Raises:
            BadInput: There is no such region.
        """
        return edits.shown(self, regions)

    def isolated(self, *regions: int) -> Self:
        """Return a scene in which only these regions are visible; all opacities are kept.

        Raises:
            BadInput: No region is named, or a region does not exist.
        """
        return edits.isolated(self, regions)

    def split_at(self, point: Sequence[float], level: float = SPLIT_LEVEL, progress: Progress = silent) -> Self:
        """Return the scene with the connected part of a region at a point as a region of its own, the last one.

        It looks the same until one of the two is edited (:mod:`svv.fields.scene.splitting`).

        Args:
            point: World coordinates of a point in the part; :meth:`svv.fields.scene.scene.Scene.point_at` finds one.
            level: Fraction of the region's mean opacity from which its cells connect, in (0, 1].
            progress: Called several times a second.

        Raises:
            BadInput: Nothing is at the point, the region is in one piece, or the level is out of range.
        """
        return split_at(self, point, level, progress)

    def with_part(self, region: int, share: float) -> Self:
        """Return the scene with one more region, a part of this one; ``share``: fraction of the region's opacity."""
        return edits.with_part(self, region, share)

    def with_strength(self, strength: float, *regions: int) -> Self:
        """Return a scene with the styles of these regions, by default all, at a strength of 0 (palette colours) to 1.

        Raises BadInput if the strength is outside [0, 1], or a region does not exist.
        """
        return edits.with_amount(self, "strength", strength, regions, "The strength of a style")

    def with_paint_light(self, amount: float, *regions: int) -> Self:
        """Return a scene with more or less light on the paint of these regions, by default of all that are painted.

        Its mean brightness stays, because a fraction ``amount`` of the light's deviation from its mean is shown.

        Raises:
            BadInput: The amount is outside [0, 1], or a region does not exist.
        """
        return edits.with_amount(self, "paint_light", amount, regions, "The light on paint")

    def with_stroke_opacity(self, amount: float, *regions: int) -> Self:
        """Return a scene in which the opacity of these regions' paint, by default of all, follows its strokes.

        Nothing becomes more opaque (:mod:`svv.fields.scene.stroke_opacity`): above 0 pale paint becomes clearer,
        below 0 dark paint. Regions without paint or of one colour stay.

        Raises:
            BadInput: The amount is outside [-1, 1], or a region does not exist.
        """
        return edits.with_amount(self, "stroke_opacity", amount, regions, "The opacity of strokes", least=-1.0)

    def with_occlusion(self, amount: float, *regions: int) -> Self:
        """Return a scene in which cavities of these regions, by default of all, are darkened by an amount up to 1.

        Raises:
            BadInput: The amount is outside [0, 1], a region does not exist, or the extinction is in a hash grid.
        """
        return edits.with_occlusion(self, amount, regions)

    def with_strokes(
        self,
        *regions: int,
        relief: float | None = None,
        width: float | None = None,
        light: Sequence[float] | None = None,
        palette: Sequence[Sequence[float]] | None = None,
    ) -> Self:
        """Return a scene with other strokes in these regions, by default in all that have any, without laying them.

        Args:
            regions: Numbers of the regions.
            relief: Factor on the relief of thick paint, in [0, 4]. What is None does not change.
            width: Factor on the width of strokes, in [0.5, 2].
            light: World direction from which the relief is lit, x, y and z; empty for the painting's own.
            palette: Colours that strokes of the same tone get, RGB in [0, 1] (C, 3), for example of another picture
                (:func:`svv.styles.stroke_palette.palette_of`); empty for the painting's own.

        Raises:
            BadInput: A number, direction or colour is out of range, or a region does not exist or has no strokes.
        """
        return edits.with_strokes(self, regions, relief, width, light, palette)

    def with_outline(
        self,
        strength: float | None = None,
        *regions: int,
        width: float | None = None,
        colour: Sequence[float] | None = None,
    ) -> Self:
        """Return a scene with the silhouettes and creases of these regions, by default of all, drawn in ink.

        Args:
            strength: Opacity of the ink, from 0 (invisible) to 1. Unchanged by default, or 1 where it is 0.
            regions: Numbers of the regions.
            width: Width of silhouettes in (0, 16], in pixels of an image whose shorter side has 800; it scales with
                the image, and creases are thinner. Unchanged by default.
            colour: RGB in [0, 1]. Unchanged by default; initially nearly black.

        Raises:
            BadInput: A strength, width or colour is out of range, or a region does not exist.
        """
        return edits.with_outline(self, strength, regions, width, colour)

    def reset(self, *regions: int) -> Self:
        """Return a scene with these regions, by default all and the light, as trained and painted, with their names.

        Raises:
            BadInput: There is no such region.
        """
        return edits.reset(self, regions)

    def undone(self) -> Self:
        """Return the scene before the last edit.

        Raises:
            BadInput: Nothing was edited, or every edit is undone already.
        """
        return edits.undone(self)

    def redone(self) -> Self:
        """Return the scene with the most recently undone edit applied again.

        Raises:
            BadInput: Nothing was undone since the last edit.
        """
        return edits.redone(self)

    def as_step(self, what: str) -> Step:
        """Return the current edits as a step for the history."""
        return edits.as_step(self, what)

    def as_one_step(self, before: Model) -> Self:
        """Return the scene with all its edits since ``before``, an earlier state of it, as one step of the history."""
        return edits.as_one_step(self, before)

    def with_edits_of(self, other: Model) -> Self:
        """Return this scene with the edits, and their history, of another scene that has the same regions.

        Which regions are styled, and how strongly, does not change.
        """
        return edits.with_edits_of(self, other)

    # --- paintings -------------------------------------------------------------------------------------------------

    def with_variant(self, name: str) -> Self:
        """Return the scene showing this variant. Edits are kept; paint hides the edited colour of a region.

        Raises:
            BadInput: There is no such variant.
        """
        return variants.with_variant(self, name)

    def without_variant(self, name: str) -> Self:
        """Return the scene without this variant; if it was the one shown, the first remaining variant is shown.

        Raises:
            BadInput: There is no such variant.
        """
        return variants.without_variant(self, name)

    def painted(
        self, network: UnrestrictedField, styles: Mapping[int, str], made: dict[str, Any], name: str | None = None,
        glazes: Mapping[int, float] | None = None,
    ) -> Self:  # fmt: skip
        """Return the scene with a new variant, which is shown; it replaces an existing one of the same name.

        The regions get the mean light that the light on paint starts from (:mod:`svv.fields.scene.paint_light`).

        Args:
            network: The network of its diffuse colours.
            styles: Style name of each region that it paints; the other regions keep their palette colours.
            made: Record of how it was painted.
            name: Its name, by default :data:`UNNAMED`.
            glazes: How far opacity follows regions' strokes unless edited; by default as laid.
        """
        return variants.painted(self, network, styles, made, name, glazes)

    def free_name(self, name: str | None) -> str:
        """Return the name for a new variant; by default :data:`UNNAMED`, which may be overwritten.

        Raises:
            BadInput: The name is taken, empty or too long, or has characters that are not printable.
        """
        return variants.free_name(self, name)

    # --- rendering -------------------------------------------------------------------------------------------------

    def while_moving(self) -> Self:
        """Return the scene as it is drawn while a camera moves, with fewer colours along each ray."""
        return images.while_moving(self)

    def resolving(self, camera: Camera) -> Self:
        """Return the scene as a still image of a camera shows it: with its strokes.

        Where other paint lies beside them, only if the lattice is too coarse for strokes.
        """
        return images.resolving(self, camera)

    def render(
        self,
        camera: GivenCamera,
        network: str | None = None,
        background: Sequence[float] | None = None,
        progress: Progress = silent,
    ) -> Rendering:
        """Render one image.

        Args:
            camera: Camera in world units, also a plotter's, or the name of a side such as ``xy``
                (:func:`svv.core.geometry.given_cameras.camera_of`).
            network: ``base``, ``pcn`` or ``styled``; by default the last one that the scene has.
            background: RGB in [0, 1] to blend over (alpha becomes 1); None keeps straight alpha.
            progress: Called before every chunk of rays and at the end.

        Raises:
            BadInput: The scene does not have that network, or the camera is none.
        """
        return images.render(self, camera_of(camera, self), network, background, progress)

    def point_at(
        self, camera: GivenCamera, pixel: tuple[float, float], network: str | None = None
    ) -> tuple[float, float, float]:
        """Return the point that a pixel shows: where the region that the pixel belongs to is most visible.

        Args:
            camera: Camera of the picture, as for :meth:`render`.
            pixel: Column from the left and row from the top of the picture, in pixels.
            network: As in :meth:`render`.

        Returns:
            World coordinates, for :meth:`split_at`.

        Raises:
            BadInput: The pixel is outside the picture, or nothing is visible there.
        """
        return images.point_at(self, camera_of(camera, self), pixel, network)

    def visible_samples(self, rays: Rays, network: str) -> Samples:
        """Return the samples of rays for an image."""
        return images.visible_samples(self, rays, network)

    def shade(
        self, samples: Samples, rays: Rays, network: str, beams: Beams | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return colour (S, 3), region (S,) and edited extinction (S,) of samples; by default lit along the rays."""
        return images.shade(self, samples, rays, network, beams)

    # --- files -----------------------------------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write the scene to one ``.svv`` file, completely or not at all; raises BadInput if it cannot be written."""
        header, tensors = arrays_of(self, packed=True, whole=False)
        write_scene_file(path, header, tensors)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a scene; raises BadInput if the file is missing, damaged, not a scene or of another version."""
        return restored(cls, *read_scene_file(path), str(path))

    def to_bytes(self, whole: bool = True) -> bytes:
        """Return what :meth:`save` writes, tables uncompressed, with those that follow from strokes if ``whole``."""
        return scene_bytes(*arrays_of(self, packed=True, whole=whole))

    @classmethod
    def from_bytes(cls, content: bytes, name: str = "The scene") -> Self:
        """Read the content from :meth:`to_bytes`; raises BadInput as :meth:`load` does."""
        return restored(cls, *parse_scene(content, name), name)

    def to_arrays(self, packed: bool = True) -> tuple[dict[str, Any], Arrays]:
        """Return header and arrays of the file.

        ``packed`` tables of lattices are bytes, and those of the hash grid in half precision.
        """
        return arrays_of(self, packed)

    @classmethod
    def from_arrays(cls, header: dict[str, Any], tensors: Arrays) -> Self:
        """Restore a scene from the result of :meth:`to_arrays`."""
        return scene_of(cls, header, tensors)

    def info(self) -> dict[str, Any]:
        """Describe the scene and how it was made, as plain values."""
        return info_of(self)
