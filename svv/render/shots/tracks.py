"""What is seen of a scene at any time between the key frames of a shot.

Each thing that key frames give has a track of its own: times and values. Numbers and colours follow the smooth curves
of :mod:`svv.core.geometry.key_curves` in a space in which equal steps look equal.
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.colour.light import COEFFICIENTS, Lamp, direction_of
from svv.core.colour.oklab import oklab_to_rgb, rgb_to_oklab
from svv.core.geometry.camera_path import CameraPath
from svv.core.geometry.cameras import Camera, look_at
from svv.core.geometry.cuts import Cut
from svv.core.geometry.key_curves import along, directed
from svv.errors import BadInput
from svv.fields.scene.edit_request import with_edit
from svv.options.editing import OcclusionEdit, OutlineEdit, PaintEdit, RegionEdit, SceneEdit, SectionEdit
from svv.options.shots import UNFILMED, CameraKey, KeyFrame, LightKey, RegionKey, eased
from svv.render.frames import seen_from
from svv.render.shots.moving_cuts import CutTrack

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

Array = NDArray[np.float64]

FADED = 0.05
"""Factor on the opacity below which steps of it are even rather than by equal factors, which would never reach 0. From
1 to 0, what is opaque then pales at an even pace; by even steps alone, it would vanish at the end."""

ALL = "all"
"""Every region, as the key of edits."""


@dataclass(frozen=True)
class Moment:
    """What is seen at a time of a shot."""

    camera: Camera
    regions: dict[int, dict[str, Any]]
    """Fields of regions, by number, that differ from the scene's."""
    cuts: tuple[Cut, ...]
    lamp: Lamp
    step: int | None
    """Time step of the data; None if the shot does not play them."""

    def of(self, scene: Scene) -> Scene:
        """Return a scene as it is seen."""
        regions = tuple(replace(r, **self.regions.get(k, {})) for k, r in enumerate(scene.regions))
        return replace(scene, regions=regions, cuts=self.cuts, lamp=self.lamp)

    def with_regions(self, given: dict[int, dict[str, Any]]) -> Moment:
        """Return the moment with further fields of regions."""
        return replace(self, regions={k: self.regions.get(k, {}) | given.get(k, {}) for k in (*self.regions, *given)})

    def value(self, scene: Scene, region: int, field: str) -> Any:
        """Return a field of a region as it is seen."""
        return self.regions.get(region, {}).get(field, getattr(scene.regions[region], field))

    def told(self) -> dict[str, object]:
        """Return what a frame depends on besides the camera and the scene, as plain values."""
        cuts, regions = [vars(cut) for cut in self.cuts], {str(k): v for k, v in sorted(self.regions.items())}
        return {"regions": regions, "cuts": cuts, "lamp": vars(self.lamp), "step": self.step}


@dataclass(frozen=True)
class Space:
    """Where a field is interpolated: functions to numbers (C,) there, and back."""

    to: Callable[[Any], Array]
    back: Callable[[Array], Any]


def _to_lab(colour: Sequence[float]) -> Array:
    return np.asarray(rgb_to_oklab(torch.tensor(colour, dtype=torch.float64)).numpy())


def _from_lab(lab: Array) -> tuple[float, ...]:
    return tuple(oklab_to_rgb(torch.from_numpy(lab)).clamp(0.0, 1.0).tolist())


EVEN = Space(lambda value: np.array([value], np.float64), lambda found: float(found[0]))
FACTOR = Space(lambda value: np.log([value]), lambda found: float(np.exp(found[0])))
FADE = Space(lambda value: np.log([value + FADED]), lambda found: max(0.0, float(np.exp(found[0])) - FADED))
COLOUR = Space(_to_lab, _from_lab)

SPACES: dict[str, Space | None] = {
    "edited_colour": COLOUR,
    "outline_colour": COLOUR,
    "opacity": FADE,
    "shininess": FACTOR,
    "stroke_width": FACTOR,
    "section": None,
}
"""Spaces of fields of regions that are not interpolated evenly; None for those that switch."""


@dataclass
class Track:
    """Values of one thing at times."""

    times: list[float]
    values: list[Any]
    space: Space | None = EVEN
    """None for what keeps the value of a key frame until the next one."""

    def at(self, time: float) -> Any:
        """Return the value at a time; exactly the key's at a key frame."""
        if time in self.times:
            return self.values[self.times.index(time)]
        if self.space is None:
            return self.values[max(bisect(self.times, time) - 1, 0)]
        keys = np.stack([self.space.to(value) for value in self.values])
        return self.space.back(along(keys, self.times, [time])[0])


class KeyFrames:
    """Everything between the key frames of a shot of a scene; raises BadInput for what the scene does not have."""

    def __init__(
        self, scene: Scene, keys: Sequence[KeyFrame], size: tuple[int, int], growing: Set[int] = frozenset()
    ) -> None:
        """Lay the tracks; ``size``: width and height of the pictures; ``growing``: regions whose paint a move grows."""
        self._scene, self._keys = scene, list(keys) or [KeyFrame(0.0)]
        first = self._keys[0].time
        self.cameras = self._camera_path(size, first)
        self.regions: dict[tuple[int, str], Track] = {}
        self._seen: dict[int, tuple[bool, float]] = {}  # whether a region is hidden, and its opacity where it is not
        thin = {
            k
            for key in self._keys
            for k, edit in edits_in(scene, key).items()
            if edit.strength is not None and edit.strength < 1.0
        }
        thin |= growing | {k for k, region in enumerate(scene.regions) if region.strength < 1.0}
        for key in self._keys:
            check_edits(scene, key, thin)
            self._add_regions(key, first)
        told = [(key.time, [Cut.parse(text, scene.bounds) for text in key.cuts])
                for key in self._keys if key.cuts is not None]  # fmt: skip
        told = [(first, list(scene.cuts)), *told] if told and told[0][0] > first else told
        self.cuts = CutTrack(told, scene.bounds, scene.rig.centre) if told else None
        self._lay_light(first)
        steps = [(key.time, key.step) for key in self._keys if key.step is not None]
        if steps and steps[0][0] > first and scene.steps is not None:
            steps.insert(0, (first, scene.steps.own))
        self.steps = Track([t for t, _ in steps], [s for _, s in steps]) if steps else None

    def at(self, time: float) -> Moment:
        """Return what is seen at a time."""
        time = self._eased(time)
        regions: dict[int, dict[str, Any]] = {}
        for (number, field), track in self.regions.items():
            regions.setdefault(number, {})[field] = track.at(time)
        for given in regions.values():
            if "opacity" in given:
                given["hidden"] = given["opacity"] == 0.0
        (camera,) = self.cameras.at([time])
        cuts = self._scene.cuts if self.cuts is None else self.cuts.at(time)
        step = (
            None if self.steps is None else int(np.floor(np.interp(time, self.steps.times, self.steps.values) + 1e-9))
        )
        return Moment(camera, regions, cuts, self._lamp(time), step)

    def _eased(self, time: float) -> float:
        """Return the time on the tracks, which the pace from one key frame to the next changes."""
        for key, after in zip(self._keys, self._keys[1:]):
            if key.time < time < after.time:
                span = after.time - key.time
                return key.time + span * eased(key.easing, (time - key.time) / span)
        return time

    def _camera_path(self, size: tuple[int, int], first: float) -> CameraPath:
        told = [(key.time, key.camera) for key in self._keys if key.camera is not None]
        if not told or told[0][0] > first:
            told.insert(0, (first, CameraKey(view=(0.0, 0.0))))
        cameras = [_placed_at(time, self._scene, camera, size) for time, camera in told]
        names = [f"at {time:g} s" for time, _ in told]
        return CameraPath(cameras, [time for time, _ in told], self._scene.rig.centre, names)

    def _add_regions(self, key: KeyFrame, first: float) -> None:
        """Add what a key frame gives of regions to their tracks, which begin with the scene's own values."""
        for number, edit in edits_in(self._scene, key).items():
            given = {"edited_colour" if name == "colour" else name: value for name, value in edit.given().items()}
            hidden, opacity = given.pop("hidden", None), given.pop("opacity", None)
            if hidden is not None or opacity is not None:
                region = self._scene.regions[number]
                was_hidden, shown = self._seen.get(number, (region.hidden, region.opacity))
                hidden, shown = was_hidden if hidden is None else hidden, shown if opacity is None else opacity
                self._seen[number] = hidden, shown
                given["opacity"] = 0.0 if hidden else shown
            for field, value in given.items():
                track = self.regions.setdefault((number, field), Track([], [], SPACES.get(field, EVEN)))
                if not track.times and key.time > first:
                    track.times.append(first)
                    track.values.append(self._own(number, field))
                track.times.append(key.time)
                track.values.append(value)

    def _own(self, number: int, field: str) -> Any:
        """Return what the scene itself has of a region."""
        region = self._scene.regions[number]
        if field == "edited_colour":
            return region.edited_colour or region.colour
        if field == "opacity":
            return region.seen_opacity
        if field in COEFFICIENTS:
            held = None if self._scene.layers else self._scene.coefficients()
            if held is None:
                raise BadInput(f"Give the {field} of region {number} in the first key frame as well.")
            return float(held[number][COEFFICIENTS.index(field)])
        return getattr(region, field)

    def _lay_light(self, first: float) -> None:
        """Lay the tracks of the light."""
        own = self._scene.lamp
        told = [(key.time, key.light) for key in self._keys if key.light is not None]
        if told and told[0][0] > first:
            told.insert(0, (first, LightKey(own.azimuth, own.elevation, own.direction)))
        self._lights = told
        if any((light.direction is None) != (told[0][1].direction is None) for _, light in told):
            raise BadInput("The light of a shot has angles relative to the camera in all key frames, or directions.")
        strong = [own.intensity if light.intensity is None else light.intensity for _, light in told]
        self._bright = Track([time for time, _ in told], strong)
        if len(told) > 1:
            self._lamp(0.5 * (told[0][0] + told[1][0]))  # says now if it is not known which way round the light turns

    def _lamp(self, time: float) -> Lamp:
        """Return the light at a time, with the scene's shadows."""
        if not self._lights:
            return self._scene.lamp
        casts = self._scene.lamp.casts
        times, intensity = self._bright.times, self._bright.at(time)
        if time in times or len(times) == 1:
            light = self._lights[times.index(time) if time in times else 0][1]
            return Lamp(light.azimuth, light.elevation, light.direction, intensity, **casts)
        turned = partial(directed, times=times, at=time, what="The light")
        if self._lights[0][1].direction is not None:
            x, y, z = (float(v) for v in turned([_unit(light.direction) for _, light in self._lights]))
            return Lamp(direction=(x, y, z), intensity=intensity, **casts)
        x, y, z = turned([direction_of(light.azimuth, light.elevation) for _, light in self._lights])
        above = float(np.degrees(np.arcsin(np.clip(y, -1.0, 1.0))))
        return Lamp(float(np.degrees(np.arctan2(x, z))), above, None, intensity, **casts)


def _unit(vector: Sequence[float] | None) -> Array:
    found = np.asarray(vector, np.float64)
    return found / np.linalg.norm(found)


def _placed_at(time: float, scene: Scene, key: CameraKey, size: tuple[int, int]) -> Camera:
    """Return the camera of a key frame; its time is in the BadInput that is raised where there is none."""
    try:
        return placed(scene, key, size)
    except BadInput as error:
        raise BadInput(f"Key frame at {time:g} s: {error}") from None


def placed(scene: Scene, key: CameraKey, size: tuple[int, int]) -> Camera:
    """Return the camera of a key frame for pictures of a size."""
    rig = scene.rig
    if key.view is not None:
        camera = seen_from(scene, *key.view, *size)
    else:
        if key.camera_to_world is not None:
            pose = np.asarray(key.camera_to_world, np.float64)
        else:
            pose = look_at(cast("Any", key.position), key.centre or rig.centre, key.up or (0.0, 1.0, 0.0))
        camera = Camera(pose, rig.fov_x, *size, rig.span_x)
    if key.fov is not None:
        camera = replace(camera, fov_x=float(np.radians(key.fov)), span_x=None)
    if key.span is not None:
        camera = replace(camera, span_x=key.span)
    if camera.span_x is not None:
        return replace(camera, span_x=camera.span_x / key.zoom)
    return replace(camera, fov_x=float(2.0 * np.arctan(np.tan(0.5 * camera.fov_x) / key.zoom)))


def region_named(scene: Scene, name: int | str) -> int:
    """Return the number of a region from it, as a number or text, or from the region's name.

    Raises BadInput if the scene has no such region, or several of that name.
    """
    text = str(name)
    found = [k for k, region in enumerate(scene.regions) if region.name == text]
    if not found and text.isascii() and text.isdigit():
        found = [int(text)] if int(text) < len(scene.regions) else []
    if len(found) != 1:
        names = ", ".join(str(k) if r.name is None else f"{k} ({r.name})" for k, r in enumerate(scene.regions))
        what = "several regions have that name" if found else "the scene does not have it"
        raise BadInput(f"The shot is of region '{text}', but {what}: its regions are {names or 'none'}.")
    return found[0]


def edits_in(scene: Scene, key: KeyFrame) -> dict[int, RegionKey]:
    """Return a key frame's edits by the number of the region; those of one region overrule those of all."""
    told = key.regions or {}
    found: dict[int, RegionKey] = {}
    for number, edit in _numbered(scene, told):
        old = {} if number not in found else found[number].given()
        found[number] = RegionKey(**(old | edit.given()))
    if key.strength is not None:
        for number, region in enumerate(scene.regions):
            if region.style is not None:
                found[number] = RegionKey(**({"strength": key.strength} | found.get(number, RegionKey()).given()))
    return found


def _numbered(scene: Scene, told: dict[str, RegionKey]) -> Iterator[tuple[int, RegionKey]]:
    if ALL in told:
        yield from ((number, told[ALL]) for number in range(len(scene.regions)))
    numbers: dict[int, str] = {}
    for name, edit in told.items():
        if name == ALL:
            continue
        number = region_named(scene, name)
        if number in numbers:
            raise BadInput(f"'{numbers[number]}' and '{name}' are one region: give its edits once.")
        numbers[number] = name
        yield number, edit


def check_edits(scene: Scene, key: KeyFrame, thin: Set[int] = frozenset()) -> None:
    """Raise BadInput, with the time of the key frame, for edits that the scene does not take.

    ``thin``: regions whose paint lets their own colours through at some time, so that these may be edited.
    """

    def part(kind: type[Any], edit: RegionKey) -> Any:
        return kind(**{f.name: getattr(edit, f.name) for f in fields(kind) if f.name not in UNFILMED})

    try:
        for number, edit in edits_in(scene, key).items():
            request = SceneEdit(
                {number: part(RegionEdit, edit)}, occlusion=part(OcclusionEdit, edit), paint=part(PaintEdit, edit),
                outline=part(OutlineEdit, edit), sections=part(SectionEdit, edit), of=(number,), outlined=(number,),
            )  # fmt: skip
            own = tuple(replace(r, style=None) if k in thin else r for k, r in enumerate(scene.regions))
            with_edit(replace(scene, regions=own) if edit.colour is not None else scene, request)
        if key.strength is not None and scene.styled is None:
            raise BadInput("The scene has no painting whose strength could change: paint it with svv stylize.")
        scene.uncut().cut(*(key.cuts or ()))
        if key.light is not None:
            light = key.light
            scene.with_light(light.azimuth, light.elevation, light.direction, light.intensity)
        if key.step is not None and (scene.steps is None or key.step >= len(scene.steps)):
            count = 0 if scene.steps is None else len(scene.steps)
            told = f"it has the steps 0 to {count - 1}" if count else "it has none; svv follow adds them"
            raise BadInput(f"The scene has no time step {key.step}: {told}.")
    except BadInput as error:
        raise BadInput(f"Key frame at {key.time:g} s: {error}") from None
