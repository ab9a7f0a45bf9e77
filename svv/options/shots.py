"""A shot: what a film of a scene shows, by key frames and ready-made moves. Its file is JSON (:mod:`svv.io.shot_file`).

What a key frame leaves out goes on from the key frame before to the one after it; the first one has what the scene has.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from svv.errors import BadInput
from svv.options.described import Setting
from svv.options.editing import Colour, OcclusionEdit, OutlineEdit, PaintEdit, RegionEdit, SectionEdit

EasingName = Literal["linear", "ease-in", "ease-out", "smooth"]
Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]

UNFILMED = ("recolour_in", "matcap", "name", "stroke_light", "stroke_palette")
"""Edits of regions that have nothing in between: they belong into the scene, not into a shot."""

LONGEST = 86400.0
"""Longest shot, in seconds."""


@dataclass(frozen=True)
class CameraKey:
    """A camera: an angle, a position, or a matrix. Raises BadInput unless it is exactly one of them."""

    view: tuple[float, float] | None = None
    """Degrees to the right of the front, and above it, at the distance of the training views."""
    position: Vector | None = None
    """Place in the world."""
    centre: Vector | None = None
    """Point that a camera at a position looks at, by default the scene's centre."""
    up: Vector | None = None
    """Direction that is up in the picture of a camera at a position, by default y."""
    camera_to_world: tuple[Row, Row, Row, Row] | None = None
    """Matrix in OpenGL's convention."""
    fov: Annotated[float | None, Setting(least=0.1, most=179)] = None
    """Horizontal angle of view in degrees, by default that of the training views."""
    span: Annotated[float | None, Setting(least=1e-9)] = None
    """Width of the picture in world units, for parallel rays."""
    zoom: Annotated[float, Setting(least=0.01, most=1000)] = 1.0
    """How many times larger the picture is."""

    def __post_init__(self) -> None:
        ways = [name for name in ("view", "position", "camera_to_world") if getattr(self, name) is not None]
        if len(ways) != 1:
            given = f", not {' and '.join(ways)}" if ways else ""
            raise BadInput(f"A camera is given by one of view, position and camera_to_world{given}.")
        if self.view is not None and not (abs(self.view[0]) <= 180.0 and abs(self.view[1]) <= 90.0):
            raise BadInput("A camera's view lies from -180 to 180 degrees to the right and from -90 to 90 above.")
        if self.position is None and (self.centre is not None or self.up is not None):
            raise BadInput("A camera's centre and up need its position.")
        if self.fov is not None and self.span is not None:
            raise BadInput("A camera has a fov or, with parallel rays, a span, not both.")


@dataclass(frozen=True)
class LightKey:
    """A light as in ``svv edit --light``: it follows the camera at angles, or comes from a direction in the world."""

    azimuth: Annotated[float, Setting(least=-180, most=180)] = 0.0
    """Degrees to the right of the camera."""
    elevation: Annotated[float, Setting(least=-90, most=90)] = 0.0
    """Degrees above the camera."""
    direction: Vector | None = None
    """Direction in the world that it comes from instead."""
    intensity: Annotated[float | None, Setting(least=0)] = None
    """Factor on its brightness, by default the scene's."""

    def __post_init__(self) -> None:
        if self.direction is not None and (self.azimuth or self.elevation):
            raise BadInput("A light has angles or a direction, not both.")
        if self.direction is not None and not any(self.direction):
            raise BadInput("A light's direction is not 0, 0, 0.")


@dataclass(frozen=True)
class RegionKey(RegionEdit, OcclusionEdit, PaintEdit, OutlineEdit, SectionEdit):
    """Edits of a region at a key frame, as in ``svv edit``; its section switches there."""

    hidden: bool | None = None
    """Whether it is gone; it fades."""


@dataclass(frozen=True)
class KeyFrame:
    """What is seen at a time of a shot."""

    time: Annotated[float, Setting(least=0, most=LONGEST)]
    """Seconds from the beginning."""
    camera: CameraKey | None = None
    """The camera; the shot begins at the front."""
    regions: dict[str, RegionKey] | None = None
    """Edits by the region's number or name, or all."""
    cuts: tuple[str, ...] | None = None
    """All cuts, as in `svv edit --cut`; they move if they are of one kind, and the first and the last come from or go
    to where they cut nothing."""
    light: LightKey | None = None
    """The light; needs lighting phong."""
    step: Annotated[int | None, Setting(least=0)] = None
    """Number of the data's time step."""
    strength: Annotated[float | None, Setting(least=0, most=1)] = None
    """How strongly all painting shows."""
    easing: EasingName = "linear"
    """Pace from here to the next key frame."""


@dataclass(frozen=True)
class Move:
    """A ready-made change on top of the key frames; what it has reached at its end stays."""

    name: ClassVar[str] = ""
    start: Annotated[float, Setting(least=0, most=LONGEST)] = 0.0
    """Second at which it begins."""
    duration: Annotated[float | None, Setting(least=1e-3, most=LONGEST)] = None
    """Its seconds, by default until the end of the shot."""
    easing: EasingName | None = None
    """Its pace, by default linear for turntable and swing, otherwise smooth."""
    back: bool = False
    """Go back in the second half of the time."""


@dataclass(frozen=True)
class Turntable(Move):
    """Turn around the scene; after a full turn, the film repeats without a seam."""

    name: ClassVar[str] = "turntable"
    turns: Annotated[float, Setting(least=-1000, most=1000)] = 1.0
    """Full turns of the camera to the right; below 0 to the left."""


@dataclass(frozen=True)
class Swing(Move):
    """Swing to the right and to the left, and return."""

    name: ClassVar[str] = "swing"
    angle: Annotated[float, Setting(least=-180, most=180)] = 30.0
    """Degrees to each side."""
    swings: Annotated[float, Setting(least=0, most=1000)] = 1.0
    """How often."""


@dataclass(frozen=True)
class Zoom(Move):
    """Approach a region, until it fills the picture."""

    name: ClassVar[str] = "zoom"
    region: int | str | None = None
    """Its number or name; without one, return to the key frames' camera."""
    fill: Annotated[float, Setting(least=0.01, most=10)] = 0.8
    """Part of the picture's shorter side that it fills."""


@dataclass(frozen=True)
class Peel(Move):
    """Peel off regions, one after the other."""

    name: ClassVar[str] = "peel"
    regions: tuple[int | str, ...] = ()
    """Their numbers or names, the outermost first."""

    def __post_init__(self) -> None:
        if not self.regions:
            raise BadInput("The move peel needs regions.")


@dataclass(frozen=True)
class Sweep(Move):
    """Sweep a cut through the scene, from where it cuts nothing."""

    name: ClassVar[str] = "cut"
    cut: str = "x>50%"
    """Where it ends, as in `svv edit --cut`."""


@dataclass(frozen=True)
class Grow(Move):
    """Let the painting appear, one region after the other, or all at once."""

    name: ClassVar[str] = "paint"
    regions: tuple[int | str, ...] = ()
    """Numbers or names; by default all that are painted, at once."""


MOVES: tuple[type[Move], ...] = (Turntable, Swing, Zoom, Peel, Sweep, Grow)
"""Every kind of move."""


@dataclass(frozen=True)
class Shot:
    """What a film shows.

    Raises BadInput if key frames are at one time or out of order, or it is not known how long the shot lasts.

    >>> shot = svv.read_shot({"keys": [{"time": 0}, {"time": 2, "cuts": ["x>50%"]}], "moves": [{"move": "swing"}]})
    >>> shot.seconds, shot.keys[1].cuts, shot.moves[0].angle
    (2.0, ('x>50%',), 30.0)
    """

    duration: Annotated[float | None, Setting(least=1e-3, most=LONGEST)] = None
    """Its seconds, by default until the last key frame and the end of the moves."""
    keys: tuple[KeyFrame, ...] = ()
    """Key frames, in the order of their times."""
    moves: tuple[Turntable | Swing | Zoom | Peel | Sweep | Grow, ...] = ()
    """Ready-made moves, one on top of the other."""
    size: Annotated[tuple[int, int] | None, Setting(least=1, most=16384)] = None
    """Width and height in pixels, unless they are given otherwise; 800 by default."""
    painting: str | None = None
    """Painting that is shown, by default the scene's."""
    background: Annotated[Colour | None, Setting(syntax="colour")] = None
    """Colour behind the scene, unless it is given otherwise; movies are over white by default."""

    def __post_init__(self) -> None:
        if not (self.keys or self.moves):
            raise BadInput("A shot needs keys or moves.")
        for one, other in pairwise(self.keys):
            if one.time == other.time:
                raise BadInput(f"Two key frames are at {one.time:g} s: give each a time of its own.")
            if one.time > other.time:
                raise BadInput(f"The key frame at {other.time:g} s stands behind that at {one.time:g} s: order them.")
        ends = [("key frame", key.time) for key in self.keys[-1:]]
        ends += [(f"move {move.name}", move.start + (move.duration or 0.0)) for move in self.moves]
        what, last = max(ends, key=lambda end: end[1])
        if self.duration is not None and last > self.duration:
            raise BadInput(f"The shot lasts {self.duration:g} s, but a {what} ends at {last:g} s.")
        if not self.seconds > 0.0:
            raise BadInput("A shot with one key frame, or moves without a duration, needs a duration.")
        for move in self.moves:
            if move.duration is None and move.start >= self.seconds:
                raise BadInput(f"The move {move.name} begins when the shot ends, at {self.seconds:g} s.")

    @property
    def seconds(self) -> float:
        """How long it lasts."""
        if self.duration is not None:
            return self.duration
        return max([key.time for key in self.keys] + [move.start + (move.duration or 0.0) for move in self.moves])


def eased(easing: str, part: float) -> float:
    """Return how far a change is after a part of its time, both in [0, 1].

    >>> [eased(name, 0.5) for name in ("linear", "ease-in", "ease-out", "smooth")]
    [0.5, 0.25, 0.75, 0.5]
    """
    if easing == "ease-in":
        return part * part
    if easing == "ease-out":
        return part * (2.0 - part)
    return part * part * (3.0 - 2.0 * part) if easing == "smooth" else part
