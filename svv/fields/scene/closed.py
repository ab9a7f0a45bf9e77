"""A scene whose networks stay in its file: how it looks, and the edits that need to know no more.

It reads a header instead of building networks, which takes a tenth of the time. What it does not know, it does not
guess: asking for anything else raises :class:`NeedsNetworks`, and the scene has to be loaded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svv.core.colour.light import COEFFICIENTS, Lamp
from svv.core.geometry.cameras import CameraRig
from svv.core.json_values import text_in
from svv.errors import BadInput
from svv.fields.scene import edits
from svv.fields.scene.array_sizes import check_array_sizes
from svv.fields.scene.history import History, cuts_in
from svv.fields.scene.region import Region, label_of
from svv.fields.scene.scene_validation import box_of, check_finite, occupied_of, values_of
from svv.fields.scene.style_pictures import made_in
from svv.io.scene_file import info_in, parse_scene, scene_content, told_of, write_with_header

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from svv.core.geometry.box import Box
    from svv.core.geometry.cuts import Cut


class NeedsNetworks(Exception):
    """What was asked for needs the whole scene: load it."""


@dataclass(frozen=True)
class Settings:
    """What is known of the architecture of the networks."""

    lighting: str
    """What lights the scene: ``network``, ``phong`` or ``none``."""


@dataclass(frozen=True)
class ClosedScene:
    """A scene of one transfer function without parts; fields and methods are those of :class:`svv.Scene`."""

    content: bytes
    """The content of its file."""
    header: Mapping[str, Any]
    told: Mapping[str, Any]
    """What its file says of it, as :meth:`svv.Scene.info`."""
    settings: Settings
    box: Box
    made: Mapping[str, Any]
    camera_rig: CameraRig | None
    regions: tuple[Region, ...]
    lamp: Lamp
    cuts: tuple[Cut, ...]
    history: History
    unsplit: tuple[Region, ...] = ()
    layers: tuple[ClosedScene, ...] = ()
    parts: None = None

    edited = edits.edited
    with_light = edits.with_light
    cut = edits.cut
    uncut = edits.uncut
    hidden = edits.hidden
    shown = edits.shown
    isolated = edits.isolated
    with_strength = edits.with_strength
    with_paint_light = edits.with_paint_light
    with_stroke_opacity = edits.with_stroke_opacity
    with_section = edits.with_section
    with_outline = edits.with_outline
    with_shadow = edits.with_shadow
    with_occlusion = edits.with_occlusion
    with_strokes = edits.with_strokes
    reset = edits.reset
    undone = edits.undone
    redone = edits.redone
    as_one_step = edits.as_one_step

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise NeedsNetworks(name)

    @property
    def every_layer(self) -> list[ClosedScene]:
        """Itself, because it shows one transfer function."""
        return [self]

    @property
    def every_region(self) -> tuple[Region, ...]:
        """Its regions."""
        return self.regions

    @property
    def roots(self) -> list[int]:
        """Number of the palette colour of each region. (regions,)"""
        return list(range(len(self.regions)))

    @property
    def has_extinction(self) -> bool:
        """Whether its extinction is on a lattice."""
        return self.header["density_resolutions"] is not None

    @property
    def has_normals(self) -> bool:
        """Whether it has surfaces with normals."""
        return "pcn" in self.header["networks"] and (
            self.header["normal_resolutions"] is not None or self.has_extinction
        )

    @property
    def regions_with_strokes(self) -> tuple[int, ...]:
        """Numbers of the regions that are painted by strokes."""
        painted = self.header.get("brushed", {}).get("styled", {"regions": {}})["regions"]
        return tuple(number for number in range(len(self.regions)) if str(number) in painted)

    @property
    def bounds(self) -> NDArray[Any]:
        """Lowest and highest corner of what it shows, in world units. (2, 3)"""
        return self.box.bounds

    @property
    def rig(self) -> CameraRig:
        """Its camera rig; raises NeedsNetworks if it has none, because the whole scene says what to do then."""
        if self.camera_rig is None:
            raise NeedsNetworks("rig")
        return self.camera_rig

    def save(self, path: str | Path) -> None:
        """Write what :meth:`svv.Scene.save` writes; raises NeedsNetworks, or BadInput if it cannot be written."""
        looks = {
            "lamp": self.lamp.to_json(),
            "cuts": [vars(cut) for cut in self.cuts],
            "regions": [vars(region) for region in self.regions],
            "history": self.history.to_json(),
        }
        write_with_header(path, {**self.header, **looks, **told_of(self.info())}, self.content)

    def info(self) -> dict[str, Any]:
        """Describe the scene as :meth:`svv.Scene.info` does; raises NeedsNetworks if the edits change more than that.

        These are edits of coefficients of light, and of the name of a region where it is not clear which.
        """
        before, lit = _regions_in(self.header), self.settings.lighting == "phong"
        if lit and _reflected(before) != _reflected(self.regions):
            raise NeedsNetworks("coefficients")
        told = dict[str, Any]()
        for name, value in self.told.items():
            if name != "shadows":
                told[name] = value
            if name == "lighting" and not lit and self.lamp.shadow:
                told["shadows"] = self.lamp.describe_shadow()
        return {
            **told,
            **({"light": self.lamp.describe()} if lit else {}),
            "regions": [vars(region) for region in self.regions],
            "cuts": [cut.describe() for cut in self.cuts],
            "undo": [step.what for step in self.history.past],
            "redo": [step.what for step in self.history.future],
            "doubt": _renamed(self.told["doubt"], before, self.regions),
        }


def _regions_in(header: Mapping[str, Any]) -> tuple[Region, ...]:
    return tuple(Region(**values_of(Region, one)) for one in header["regions"])


def _lamp_in(header: Mapping[str, Any]) -> Lamp:
    return Lamp(**values_of(Lamp, header["lamp"]))


def _reflected(regions: Sequence[Region]) -> list[list[float | None]]:
    """Return the edited coefficients of the light of each region."""
    return [[getattr(region, name) for name in COEFFICIENTS] for region in regions]


def _renamed(doubt: str | None, before: tuple[Region, ...], after: tuple[Region, ...]) -> str | None:
    """Return what is said of expected errors, which names a region; raises NeedsNetworks unless it is clear which."""
    if doubt is None or [r.name for r in before] == [r.name for r in after]:
        return doubt
    said = [f" in {label_of(before, number)}, where it is most" for number in range(len(before))]
    which = [number for number, words in enumerate(said) if words in doubt]
    if len(which) != 1 or doubt.count(said[which[0]]) != 1:
        raise NeedsNetworks("doubt")
    return doubt.replace(said[which[0]], f" in {label_of(after, which[0])}, where it is most")


def read_closed(path: str | Path) -> ClosedScene | None:
    """Read a scene without building its networks; None for one that has to be loaded.

    These are scenes from another version of svv, of several transfer functions, with parts of regions, or damaged
    ones, of which :meth:`svv.Scene.load` says what is wrong. Raises BadInput as it does if the file is missing, not
    whole, not a scene or of another format.
    """
    content = scene_content(Path(path))
    header, tensors = parse_scene(content, str(path))
    told = info_in(content, str(path), len(content))
    if told is None or {"layers", "parts"} & set(header) or header.get("undone"):
        return None
    try:
        check_finite(tensors)
        check_array_sizes(header, tensors, occupied_of(header, tensors, box_of(header["box"])))
        regions, rig = _regions_in(header), header["camera_rig"]
        if any(region.layer or region.part_of is not None for region in regions):
            return None
        return ClosedScene(
            content, header, told, Settings(text_in(header["settings"]["lighting"], "lighting")), box_of(header["box"]),
            made_in(header["made"], tensors), CameraRig.from_json(rig) if rig else None, regions, _lamp_in(header),
            cuts_in(header["cuts"]), History.from_json(header["history"], regions),
        )  # fmt: skip
    except (BadInput, KeyError, TypeError, ValueError, AttributeError):
        return None
