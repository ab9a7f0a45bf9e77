"""Ready-made moves of a shot, each on top of what the key frames and the moves before it show.

A move has an amount at each time: 0 before it begins, then up to 1, where it stays unless it goes back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera, CameraRig
from svv.core.geometry.cuts import Cut
from svv.errors import BadInput, Progress, part, silent
from svv.options.shots import Grow, Move, Peel, Shot, Sweep, Swing, Turntable, Zoom, eased
from svv.render.shots.moving_cuts import between, nothing_of
from svv.render.shots.tracks import FADE, Moment, region_named

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

Array = NDArray[np.float64]

MEASURED = 64
"""Side in pixels of the pictures in which the place of a region is measured."""
CLEAR = 0.2
"""Part of its largest alpha in a picture from which on a pixel counts for the place of a region."""
OUTLIERS = 0.5
"""Percent of the points of a region at each end of an axis that do not count for its place: stray samples."""


@dataclass(frozen=True)
class Place:
    """Where a region is: centre (3,), and radius of what is around it, in world units."""

    centre: Array
    radius: float


class Moves:
    """The moves of a shot of a scene; raises BadInput for what the scene does not have."""

    def __init__(self, scene: Scene, shot: Shot, progress: Progress = silent) -> None:
        self._scene, self._shot = scene, shot
        self._places: dict[int, Place] = {}
        self._regions: list[tuple[int, ...]] = []
        for done, move in enumerate(shot.moves):
            told = getattr(move, "regions", ()) if not isinstance(move, Zoom) else (move.region,)
            numbers = tuple(region_named(scene, name) for name in told if name is not None)
            if isinstance(move, Grow):
                numbers = self._painted(numbers)
            if isinstance(move, Zoom) and numbers and numbers[0] not in self._places:
                each = part(progress, done / len(shot.moves), (done + 1) / len(shot.moves))
                self._places[numbers[0]] = place_of(scene, numbers[0], each)
            if isinstance(move, Sweep):
                scene.uncut().cut(move.cut)
            self._regions.append(numbers)

    @property
    def growing(self) -> set[int]:
        """Regions whose paint grows, so that the palette's colours are seen before."""
        told = [
            regions or [k for k, region in enumerate(self._scene.regions) if region.style is not None]
            for move, regions in zip(self._shot.moves, self._regions, strict=True)
            if isinstance(move, Grow)
        ]
        return {number for regions in told for number in regions}

    def _painted(self, numbers: tuple[int, ...]) -> tuple[int, ...]:
        painted = [k for k, region in enumerate(self._scene.regions) if region.style is not None]
        if not painted or not set(numbers) <= set(painted):
            what = f"Region {sorted(set(numbers) - set(painted))[0]}" if painted else "The scene"
            raise BadInput(f"{what} is not painted, so no paint can grow: paint it with svv stylize.")
        return numbers

    def at(self, time: float, moment: Moment) -> Moment:
        """Return what is seen at a time, from what the key frames show."""
        base = moment.camera
        for move, regions in zip(self._shot.moves, self._regions, strict=True):
            moment = self._moved(move, regions, self.amount(move, time), moment, base)
        return moment

    def amount(self, move: Move, time: float) -> float:
        """Return how far a move is at a time, in [0, 1]."""
        last = self._shot.seconds - move.start if move.duration is None else move.duration
        part = min(1.0, max(0.0, (time - move.start) / last))
        if move.back:
            part = 1.0 - abs(2.0 * part - 1.0)
        return eased(move.easing or ("linear" if isinstance(move, Turntable | Swing) else "smooth"), part)

    def _moved(
        self, move: Move, regions: tuple[int, ...], amount: float, moment: Moment, base: Camera
    ) -> Moment:  # fmt: skip
        """Return a moment with a move at an amount."""
        scene, centre = self._scene, np.asarray(self._scene.rig.centre, np.float64)
        if isinstance(move, Turntable):
            return replace(moment, camera=around(moment.camera, centre, 360.0 * (move.turns * amount % 1.0)))
        if isinstance(move, Swing):
            swung = np.sin(2.0 * np.pi * (move.swings * amount % 1.0))
            return replace(moment, camera=around(moment.camera, centre, move.angle * float(swung)))
        if isinstance(move, Zoom):
            if not regions:
                return replace(moment, camera=nearer(moment.camera, base, centre, centre, amount))
            place = self._places[regions[0]]
            aim = framed(moment.camera, place, move.fill)
            return replace(moment, camera=nearer(moment.camera, aim, centre, place.centre, amount))
        if isinstance(move, Peel):
            return moment.with_regions({
                k: _faded(moment.value(scene, k, "opacity") * (not moment.value(scene, k, "hidden")), share)
                for k, share in zip(regions, in_turn(amount, len(regions)), strict=True) if share
            })  # fmt: skip
        if isinstance(move, Sweep):
            if amount == 0.0:
                return moment
            cut = Cut.parse(move.cut, scene.bounds)
            rows = [nothing_of(cut, scene.bounds), cut]
            now = cut if amount == 1.0 else between(rows, (0.0, 1.0), amount, centre)
            return replace(moment, cuts=(*moment.cuts, now))
        assert isinstance(move, Grow)
        shares = in_turn(amount, len(regions))
        if not regions:
            regions = tuple(k for k, region in enumerate(scene.regions) if region.style is not None)
            shares = [amount] * len(regions)
        return moment.with_regions({
            k: {"strength": share * moment.value(scene, k, "strength")}
            for k, share in zip(regions, shares, strict=True) if share < 1.0
        })  # fmt: skip


def in_turn(amount: float, count: int) -> list[float]:
    """Return the amounts of parts of a move that take place one after the other.

    >>> in_turn(0.75, 2)
    [1.0, 0.5]
    """
    return [min(1.0, max(0.0, amount * count - k)) for k in range(count)]


def _faded(opacity: float, share: float) -> dict[str, object]:
    if share >= 1.0 or opacity == 0.0:
        return {"opacity": 0.0, "hidden": True}
    return {"opacity": FADE.back((1.0 - share) * FADE.to(opacity) + share * FADE.to(0.0)), "hidden": False}


def around(camera: Camera, centre: Array, degrees: float) -> Camera:
    """Return a camera turned around the vertical axis through a point, to the right of it by an angle."""
    if degrees == 0.0:
        return camera
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0.0, np.sin(a)], [0.0, 1.0, 0.0], [-np.sin(a), 0.0, np.cos(a)]])
    pose = np.eye(4)
    pose[:3, :3] = turn @ camera.camera_to_world[:3, :3]
    pose[:3, 3] = centre + turn @ (camera.position - centre)
    return replace(camera, camera_to_world=pose)


def framed(camera: Camera, place: Place, fill: float) -> Camera:
    """Return a camera that looks at a place from the same side; it fills a part of the picture's shorter side."""
    pose, short = camera.camera_to_world.copy(), min(camera.width, camera.height) / camera.width
    back = pose[:3, 2]
    if camera.span_x is not None:
        far = float((camera.position - place.centre) @ back)
        pose[:3, 3] = place.centre + far * back
        return replace(camera, camera_to_world=pose, span_x=2.0 * place.radius / (fill * short))
    half = np.arctan(fill * short * np.tan(0.5 * camera.fov_x))
    pose[:3, 3] = place.centre + place.radius / np.sin(half) * back
    return replace(camera, camera_to_world=pose)


def nearer(start: Camera, end: Camera, centre: Array, aim: Array, amount: float) -> Camera:
    """Return a camera on the way between two that look in nearly the same direction, at two points (3,).

    What is seen becomes larger by equal factors, and the point that it is seen around moves with that: all lines
    of sight through it pass one point, which stands still in the picture.
    """
    if amount in (0.0, 1.0):
        return end if amount else start
    backs = [camera.camera_to_world[:3, 2] for camera in (start, end)]
    far = [float((camera.position - point) @ back) for camera, point, back in zip((start, end), (centre, aim), backs)]
    if min(far) <= 0.0:
        raise BadInput("The camera of a shot that zooms must look at the scene: its centre is behind it.")
    wide = [c.span_x if c.span_x is not None else d * np.tan(0.5 * c.fov_x) for c, d in zip((start, end), far)]
    now = float(np.exp((1.0 - amount) * np.log(wide[0]) + amount * np.log(wide[1])))
    share = amount if abs(wide[0] - wide[1]) < 1e-6 * wide[0] else (wide[0] - now) / (wide[0] - wide[1])
    pivots = [c.position - d * back for c, d, back in zip((start, end), far, backs)]
    distance = float(np.exp((1.0 - amount) * np.log(far[0]) + amount * np.log(far[1])))
    pose = start.camera_to_world.copy()
    pose[:3, 3] = (1.0 - share) * pivots[0] + share * pivots[1] + distance * pose[:3, 2]
    if start.span_x is not None:
        return replace(start, camera_to_world=pose, span_x=now)
    return replace(start, camera_to_world=pose)


def place_of(scene: Scene, region: int, progress: Progress = silent) -> Place:
    """Return where a region is, from small pictures of it alone from six sides; BadInput if nothing of it is seen."""
    alone = scene.isolated(region).uncut()
    rig: CameraRig = scene.rig
    points: list[Array] = []
    for number, camera in enumerate(_six_sides(rig)):
        view = alone.render(camera, "pcn")
        alpha = view.rgba[..., 3]
        seen = np.isfinite(view.depth) & (alpha > CLEAR * max(float(alpha.max()), CLEAR))
        origins, directions = camera.rays()
        points.append((origins + view.depth[..., None] * directions)[seen])
        progress((number + 1) / 6, "measuring a region")
    every = np.concatenate(points)
    if not len(every):
        raise BadInput(f"Nothing is seen of region {region}, so the shot cannot zoom to it.")
    low, high = np.percentile(every, [OUTLIERS, 100.0 - OUTLIERS], axis=0)
    centre = 0.5 * (low + high)
    return Place(centre, float(np.percentile(np.linalg.norm(every - centre, axis=1), 100.0 - OUTLIERS)))


def _six_sides(rig: CameraRig) -> Sequence[Camera]:
    """Return cameras at the front, the back, the left, the right, below and above."""
    front = rig.orbit(181, MEASURED, frames=[90])[0].resized(MEASURED, MEASURED)
    centre = np.asarray(rig.centre, np.float64)
    level = [around(front, centre, degrees) for degrees in (0.0, 90.0, 180.0, 270.0)]
    ends = rig.orbit(181, MEASURED, frames=[0, 180])
    return [*level, *(camera.resized(MEASURED, MEASURED) for camera in ends)]
