"""The record of a scene, and what follows from its values alone; :mod:`svv.fields.scene.scene` offers the rest."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.core.colour.colour import shift_colours
from svv.core.colour.light import COEFFICIENTS, Lamp
from svv.core.colour.oklab import shift_in_oklab
from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, CameraRig
from svv.core.geometry.cuts import Cut
from svv.core.strokes.strokes import Floats
from svv.errors import BadInput
from svv.fields.radiance.kept_values import KeptValues
from svv.fields.radiance.networks import BaseField, FieldSettings, PaletteField, UnrestrictedField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, RayCaster
from svv.fields.radiance.time_steps import TimeSteps
from svv.fields.radiance.value_function import ValueFunction
from svv.fields.scene.expected import ExpectedErrors
from svv.fields.scene.history import History
from svv.fields.scene.parts import Parts
from svv.fields.scene.region import Region, of_layer
from svv.fields.scene.stroke_edits import UNEDITED, edited_field, edits_of_strokes, entries_of
from svv.kernels.constants import numbers_on
from svv.kernels.types import Samples

if TYPE_CHECKING:
    from typing_extensions import Self

S = TypeVar("S", bound="Model")
"""A scene: functions that change one return one of its kind."""

NETWORKS = ("base", "pcn", "styled")
"""Names of a scene's networks, the plainest first."""

MOST_VERTICES_A_CELL = 4
"""Most vertices along a cell whose colours images interpolate."""

JOINED_WEIGHT = 1.0 / 64.0
"""Weight in the pixel up to which samples are joined: halves the colours evaluated in a translucent scene at a cost of
0.02 dB (an opaque one: 0.07 dB); 1/32 would cost 0.1 to 0.2 dB."""

UNNAMED = "styled"
"""Name of a variant for which no name was given."""


@dataclass(frozen=True)
class Variant:
    """A painting of a scene that is not the one being shown."""

    name: str
    network: UnrestrictedField
    styles: tuple[str | None, ...]
    """Name of each region's style; None for a region that is not painted. Parts that were split off later have none."""
    made: dict[str, Any]
    """Record of how it was painted."""
    glazes: tuple[float, ...] = ()
    """How far opacity follows each region's strokes where nobody edits that; 0 for regions beyond."""


@dataclass(frozen=True)
class Model:
    """What was learned of a scene, how it looks, its paintings, and its members. Letters: S samples, P regions."""

    # --- what was learned ---
    settings: FieldSettings
    occupancy: Occupancy
    marching: Marching
    base: BaseField
    palette_network: PaletteField | None = None
    styled: UnrestrictedField | None = None
    """The painting that is shown."""
    values: ValueFunction | None = None
    """Its extinction as a function of its volume's values; None for a scene that learned its extinction otherwise."""
    steps: TimeSteps | None = None
    """The values themselves, at one or several time steps; None for a scene that is no function of them."""
    camera_rig: CameraRig | None = None
    """Placement of the cameras of its training views."""
    made: dict[str, Any] = field(default_factory=dict)
    expected: ExpectedErrors | None = None
    """The errors that its pictures are expected to have; None for scenes of older files, and of other time steps."""
    stride: float = 1.0
    """Sample distance of images, as a multiple of the training step; chosen by :mod:`svv.train.base.sampling`."""
    joined: float = JOINED_WEIGHT
    """Weight in a pixel up to which samples are joined; chosen by :mod:`svv.train.base.sampling`."""
    vertices_a_cell: int = 0
    """Vertices along each cell of the finest features whose colours images interpolate where they can
    (:mod:`svv.fields.scene.vertices`); 0 computes the colour of every sample. Chosen by the same."""
    kept: KeptValues | None = None
    """Its volume's values, to be read off; None for a scene that has ``steps``, or was trained without keeping them."""

    # --- its look ---
    regions: tuple[Region, ...] = ()
    unsplit: tuple[Region, ...] = ()
    """Regions whose splits were undone and may be redone."""
    parts: Parts | None = None
    """Where regions that are parts of others are; None if no region was ever split."""
    lamp: Lamp = field(default_factory=Lamp)
    """The light of a scene whose lighting is ``phong``, and of the shadows of any."""
    cuts: tuple[Cut, ...] = ()
    """What is cut off, in world units."""
    history: History = field(default_factory=History)
    """The steps that can be undone and redone."""

    # --- its paintings ---
    painting: str | None = None
    """Name of the variant whose network is ``styled``."""
    others: tuple[Variant, ...] = ()
    """Variants that are not shown."""

    # --- its members ---
    layers: tuple[Self, ...] = ()
    """Further scenes that are drawn with it, without regions of their own; see :mod:`svv.fields.scene.joined`."""

    # --- how it is drawn now ---
    casters: tuple[Self, ...] = ()
    """Members of a joined scene, itself among them, that cast shadows on it; only itself if there are none."""
    still: bool = True
    """Whether an image may take longer to show strokes in full detail."""
    resolved: float = 0.0
    """Width in box units of the pixels in which strokes themselves are shown; 0 shows the lattice of their paint."""

    def check_alone(self, what: str) -> None:
        """Raise BadInput if the scene shows several transfer functions, which ``what`` does not support."""
        if any(region.layer for region in self.regions):
            raise BadInput(f"{what} works with scenes of one transfer function: do it before svv join.")

    @property
    def every_layer(self) -> list[Self]:
        """The scene without its layers, and these, all with time steps; only the first has regions, those of all."""
        return [replace(self, layers=()), *(replace(s, steps=s.steps or self.steps) for s in self.layers)]

    @property
    def every_region(self) -> tuple[Region, ...]:
        """Its regions, and then those whose split was undone."""
        return self.regions + self.unsplit

    @property
    def palette_regions(self) -> tuple[Region, ...]:
        """The regions of the palette, without those that were split off."""
        return tuple(region for region in self.regions if region.part_of is None)

    @property
    def roots(self) -> list[int]:
        """Number of the palette colour of each region. (regions,)"""
        roots: list[int] = []
        for number, region in enumerate(self.regions):
            roots.append(number if region.part_of is None else roots[region.part_of])
        return roots

    def regions_at(self, position: Tensor) -> Tensor | None:
        """Return the region to which each palette colour belongs at positions (S, 3), int64 (S, P).

        None if every palette colour is a region everywhere.
        """
        if self.parts is None or not self.parts.active:
            return None
        count = len(self.palette_regions)
        parents = [region.part_of for region in self.regions[count:] if region.part_of is not None]
        return self.parts.regions_at(position, count, parents)

    def region_of(self, position: Tensor, weights: Tensor) -> Tensor:
        """Return the region of samples from their positions (S, 3) and palette weights (S, P), int64. (S,)"""
        return of_colour(self.regions_at(position), weights.argmax(dim=1))

    @property
    def networks(self) -> tuple[str, ...]:
        """Which of the networks ``base``, ``pcn`` and ``styled`` it holds, the plainest first."""
        there = {name for layer in self.every_layer for name, network in own_networks(layer) if network is not None}
        return tuple(name for name in NETWORKS if name in there)

    @property
    def variant(self) -> str | None:
        """Name of the variant that is shown; None for a scene that was not painted."""
        return None if self.styled is None else self.painting or UNNAMED

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of all variants, in alphabetical order."""
        return tuple(variant.name for variant in self.every_variant)

    @property
    def every_variant(self) -> tuple[Variant, ...]:
        """All variants, in alphabetical order."""
        every = list(self.others)
        if self.styled is not None and self.variant is not None:
            styles = tuple(region.style for region in self.every_region)
            glazes = tuple(region.glaze for region in self.every_region)
            every.append(Variant(self.variant, self.styled, styles, self.made.get("stylized", {}), glazes))
        return tuple(sorted(every, key=lambda variant: variant.name))

    @property
    def rig(self) -> CameraRig:
        """Its camera rig; raises BadInput if the scene has none because it was not trained from views."""
        if self.camera_rig is None:
            raise BadInput("The scene does not record where the cameras of its views stood; train it again.")
        return self.camera_rig

    @property
    def has_extinction(self) -> bool:
        """Whether its extinction is on a lattice, where light through the scene can be computed."""
        return self.base.density is not None

    @property
    def has_normals(self) -> bool:
        """Whether it has surfaces with normals: those of the explicit light, or of its extinction."""
        return self.palette_network is not None and (self.palette_network.phong is not None or self.has_extinction)

    @property
    def box(self) -> Box:
        """The box of what was learned, without its members."""
        return self.occupancy.box

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner of what it shows, with all its members, in world units. (2, 3)"""
        every = np.stack([layer.occupancy.box.bounds for layer in self.every_layer])
        return np.stack([every[:, 0].min(axis=0), every[:, 1].max(axis=0)])

    @property
    def device(self) -> torch.device:
        """The device on which it is rendered."""
        return self.base.encoding.table.device

    def caster(self, cameras: Sequence[Camera]) -> RayCaster:
        """Return what makes the rays of cameras of one image size, on the scene's device."""
        return RayCaster(cameras, self.occupancy.box, self.device, self.settings.headlight)

    @property
    def marching_for_images(self) -> Marching:
        """How rays are sampled for images of the unedited scene."""
        return replace(self.marching, step=self.stride * self.marching.step, least_weight=self.joined, merge=True)

    @torch.no_grad()
    def cut_open(self, sigma: Tensor, samples: Samples, region: Tensor) -> Tensor:
        """Return the extinction (S,) of samples, without that of regions (S,) that are cut off where the samples lie.

        Cuts of all regions are not looked at: nothing of what they take away is sampled. No sample lies across the face
        of one (:func:`svv.fields.radiance.cutting.march_uncut`).
        """
        for cut in self.cuts:
            if cut.regions:
                inside = cut.in_box(self.occupancy.box).depth(samples.position) > 0.0
                sigma = torch.where(inside & self.in_cut(cut, region), 0.0, sigma)
        return sigma

    def in_cut(self, cut: Cut, region: Tensor) -> Tensor:
        """Return which samples are of a region (S,) that a cut opens; parts of a region are cut with it. (S,)"""
        own = [not cut.regions or k in cut.regions or r.part_of in cut.regions for k, r in enumerate(self.regions)]
        return torch.tensor(own, device=region.device)[region.long()]

    def coefficients(self) -> Tensor | None:
        """Return each region's edited ambient, diffuse, specular and shininess (regions, 4); None without such light.

        :func:`for_colours` gives those of palette colours, which samples mix.
        """
        if self.palette_network is None or self.palette_network.phong is None:
            return None
        learned = self.palette_network.phong.coefficients()
        learned = learned if len(learned) == len(self.regions) else learned[self.roots]
        edited = numbers_on([
            [torch.nan if (v := getattr(r, name)) is None else v for name in COEFFICIENTS] for r in self.regions
        ], learned.device)  # fmt: skip
        return torch.where(edited.isnan(), learned, edited)

    def edited_colours(self, offsets: Tensor, here: Tensor | None = None) -> Tensor:
        """Return palette colours with their offsets (S, P, 3), recoloured by the regions' edits. (S, P, 3)

        ``here``: region to which each palette colour belongs (:meth:`regions_at`). (S, P)
        """
        assert self.palette_network is not None
        colours = self.palette_network.colours + offsets
        for number, root, shown, target in self.colour_edits():
            rows = slice(None) if here is None else (here[:, root] == number).nonzero()[:, 0]
            shift = shift_in_oklab if self.regions[number].recolour_in == "oklab" else shift_colours
            colours[rows, root] = shift(colours[rows, root, None], shown[None], target[None])[:, 0]
        return colours

    def colour_edits(self) -> Iterator[tuple[int, int, Tensor, Tensor]]:
        """Yield the number of each region whose colour is edited, its root, and its colour before and after (3,)."""
        assert self.palette_network is not None
        palette, roots = self.palette_network.colours, self.roots
        for number, region in enumerate(self.regions):
            if region.edited_colour is None:
                continue
            own, target = palette[roots[number]].detach(), numbers_on(region.edited_colour, palette.device)
            # The user edits the region's colour as shown; the palette may have drifted from it in training.
            shown = numbers_on(region.colour, palette.device)
            yield number, roots[number], shown, torch.where((target == own).all(), shown, target)

    def paint(self, samples: Samples, network: str, region: Tensor) -> Tensor | None:
        """Return the UCN's colours (S, 3) of samples, also of unstyled regions; None for other networks.

        Where strokes are to be resolved, those of each sample's region (S,) lie over these colours.
        """
        shown = self.paint_shown
        if network != "styled" or shown is None:
            return None
        if not self.resolved or shown.brushed is None:
            return shown(samples.position)
        colours = None if shown.brushed.complete else shown(samples.position)
        roots = self._with_strokes_of(shown)
        return shown.brushed.over(colours, samples, region, roots, self.roots, self.resolved)

    @property
    def stroked(self) -> dict[int, int]:
        """Regions with strokes, each with the number of the region whose strokes it has: itself, or its whole."""
        return self._with_strokes_of(self.styled)

    @property
    def regions_with_strokes(self) -> tuple[int, ...]:
        """Numbers of the regions that are painted by strokes."""
        found: list[int] = []
        for number, layer in enumerate(self.every_layer):
            own = [k for k, region in enumerate(self.regions) if region.layer == number]
            found += [own[k] for k in replace(layer, regions=of_layer(self.regions, number)).stroked]
        return tuple(sorted(found))

    def _with_strokes_of(self, network: UnrestrictedField | None) -> dict[int, int]:
        found: dict[int, int] = {}
        strokes = () if network is None or network.brushed is None else network.brushed.regions
        for number, region in enumerate(self.regions):
            if number in strokes:
                found[number] = number
            elif region.part_of in found:
                found[number] = found[region.part_of]
        return found

    @property
    def paint_shown(self) -> UnrestrictedField | None:
        """The network ``styled`` with the edits of its strokes."""
        roots = self.stroked
        if self.styled is None or all(edits_of_strokes(self.regions[k]) == UNEDITED for k in roots):
            return self.styled
        parts = None if self.parts is None else (self.parts.digest, self.parts.active)
        entries = entries_of(self.regions, roots)
        return edited_field(self.styled, self.regions, entries, (str(self.device), parts), self.painted_region)

    @torch.no_grad()
    def painted_region(self, place: Floats) -> NDArray[np.int64]:
        """Return the painted region with the largest palette weight at box coordinates (V, 3), -1 for none. (V,)"""
        assert self.palette_network is not None
        painted, found = torch.tensor([r.style is not None for r in self.regions], device=self.device), []
        for piece in torch.from_numpy(place).split(1 << 17):
            position = piece.to(self.device)
            here, weights = self.regions_at(position), self.palette_network.material(position)[1]
            best, which = weights.masked_fill(~for_colours(painted, here), -1.0).max(dim=1)
            region = which if here is None else here.gather(1, which[:, None])[:, 0]
            found.append(torch.where(best > 0.0, region, -1).cpu().numpy())
        return np.concatenate(found) if found else np.zeros(0, np.int64)

    def with_style(self, diffuse: Tensor, region: Tensor, paint: Tensor | None) -> Tensor:
        """Return diffuse colour (S, 3), replaced by the paint's (S, 3) where the sample's region (S,) is styled."""
        if paint is None:
            return diffuse
        return torch.lerp(diffuse, paint, self.paint_shares[region][:, None])

    @property
    def paint_shares(self) -> Tensor:
        """Weight of the paint in each region's colour, in [0, 1]. (regions,)"""
        shares = [0.0 if r.style is None else r.strength for r in self.regions]
        return numbers_on(shares, self.device)


def on_device(scene: S, device: torch.device) -> S:
    """Return the scene on a device: itself if it is there already, otherwise a copy of its networks."""
    if device.type == scene.device.type:
        return scene
    base, palette, styled, others = copy.deepcopy((scene.base, scene.palette_network, scene.styled, scene.others))
    return replace(
        scene,
        base=base.to(device),
        palette_network=None if palette is None else palette.to(device),
        styled=None if styled is None else styled.to(device),
        others=tuple(replace(other, network=other.network.to(device)) for other in others),
        layers=tuple(on_device(layer, device) for layer in scene.layers),
    )


def own_networks(scene: Model) -> list[tuple[str, nn.Module | None]]:
    """Return the scene's own networks by name, without those of layers and other variants."""
    return [*zip(NETWORKS, (scene.base, scene.palette_network, scene.styled), strict=True)]


def of_colour(here: Tensor | None, colour: Tensor) -> Tensor:
    """Return the region of samples by their palette colours (S,), from :meth:`Model.regions_at`. (S,)"""
    return colour if here is None else here.gather(1, colour[:, None])[:, 0]


def for_colours(values: Tensor, here: Tensor | None) -> Tensor:
    """Return values of regions (regions, ...) as those of palette colours: (P, ...), or of each sample (S, P, ...).

    ``here``: region to which each palette colour belongs (:meth:`Model.regions_at`); None without parts. (S, P)
    """
    return values if here is None else values[here]


MOST_NAMES = 12
"""Largest number of regions that are named in words."""


def in_words(scene: Model, network: str | None = None) -> str:
    """Return what a picture of a scene shows, for those who do not see it: 'A rendering of 2 regions: core, region 1'.

    Hidden regions are left out. ``network`` draws the picture; by default the last one of the scene.
    """
    kind = "painting" if (network or scene.networks[-1]) == "styled" else "rendering"
    names = [region.name or f"region {number}" for number, region in enumerate(scene.regions) if not region.hidden]
    if not names:
        return f"A {kind} of a scene" + ", all of whose regions are hidden" * bool(scene.regions)
    said = f"A {kind} of {len(names)} region{'s' * (len(names) > 1)}: {', '.join(names[:MOST_NAMES])}"
    return said + (f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else "")
