"""Places in a scene that commands name: pixels of a picture, or points in the world."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from svv.cli.options import numbers_in
from svv.errors import BadInput
from svv.options.described import Setting

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

Place = tuple[float, ...]
"""A pixel (2) or a point in world coordinates (3)."""


@dataclass(frozen=True)
class PictureOptions:
    """The picture in which places are pixels."""

    camera: Annotated[Path | None, Setting(metavar="CAMERA.json")] = None
    """Camera of the picture in which a place is a pixel, as in `svv render`; by default the orbit's middle."""
    frame: Annotated[int | None, Setting(least=0)] = None
    """Number of that picture's view if the camera's file has several."""
    size: Annotated[tuple[int, int] | None, Setting(metavar="N|WxH", syntax="size")] = None
    """Size of that picture in pixels; 800 by default."""


def point_in(scene: Scene, place: Place, picture: PictureOptions) -> tuple[float, float, float]:
    """Return the point in the world that a place means: what a pixel shows, or the point itself.

    Raises BadInput if the place is no pixel of the picture that was named, or nothing is visible there.
    """
    from svv.io.views.camera_file import read_camera
    from svv.render.frames import orbit

    if len(place) == 3:
        if picture != PictureOptions():
            raise BadInput("--camera, --frame and --size belong to a pixel: name it by two numbers, not three.")
        x, y, z = place
        return x, y, z
    if picture.camera is not None:
        camera = read_camera(picture.camera, picture.size, picture.frame)
    else:
        camera = orbit(scene, 181, *(picture.size or (800, 800)))[90]  # as `svv render` without a camera
    return scene.point_at(camera, (place[0], place[1]))


def parse_pointed(text: str) -> tuple[Place, int | Place]:
    """Return what --point says: a place, and the region that is there or the other place; BadInput for another form.

    >>> parse_pointed("410,320=2"), parse_pointed("410,320=0.5,1,-2")
    (((410.0, 320.0), 2), ((410.0, 320.0), (0.5, 1.0, -2.0)))
    """
    place, _, said = text.partition("=")
    if said.strip().isascii() and said.strip().isdigit():
        return _place(place, text), int(said)
    return _place(place, text), _place(said, text)


def _place(numbers: str, text: str) -> Place:
    found = numbers_in(numbers)
    if len(found) not in (2, 3):
        raise BadInput(
            f"'{text}' does not point at a place: write place=region, such as --point 410,320=1, or place=place, such "
            "as --point 410,320=150,90."
        )
    return found
