"""The command that reads values off a scene; see :mod:`svv.cli.app`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from svv.cli.files import check_targets, load
from svv.cli.option_group import spread
from svv.cli.options import Json, SceneFile, parse_angles, parse_points
from svv.errors import BadInput
from svv.options.described import Setting
from svv.options.making import DeviceName, NetworkName

if TYPE_CHECKING:
    from svv.core.geometry.cameras import Camera
    from svv.fields.scene.scene import Scene

PROBE = (
    "svv probe scene.svv --at 410,320",
    "svv probe head.svv --at 410,320 --unit mm --value-unit HU",
    "svv probe scene.svv --at 410,320 --at 512,288 --view 30,20 --size 1280x720",
    "svv probe scene.svv --at 410,320 --at 512,288 --at 390,500 --camera camera.json --json angle.json",
    "svv probe series.svv --at 410,320 --time 0.5",
)


@dataclass(frozen=True)
class Probed:
    """In which picture of a scene pixels are read off, and in which units."""

    at: Annotated[tuple[str, ...], Setting(metavar="X,Y")] = ()
    """Read off the pixel in this column from the left and row from the top."""
    camera: Annotated[Path | None, Setting(metavar="CAMERA.json")] = None
    """Camera of the picture, as in `svv render`; by default the orbit's middle, from the front."""
    frame: Annotated[int | None, Setting(least=0)] = None
    """Number of the picture's view, if the camera's file has several."""
    view: Annotated[str | None, Setting(metavar="AZ,EL")] = None
    """Side from which the picture is taken: degrees to the right of the front and above it."""
    size: Annotated[tuple[int, int] | None, Setting(metavar="N|WxH", syntax="size")] = None
    """Size of the picture in pixels; 800 by default."""
    network: Annotated[NetworkName | None, Setting()] = None
    """Network of the picture, as in `svv render`; by default the scene's last."""
    variant: Annotated[str | None, Setting(metavar="NAME")] = None
    """Painting that the picture shows; by default the scene's own."""
    time: Annotated[float | None, Setting(metavar="TIME")] = None
    """Time of a scene that has time steps."""
    unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's lengths, such as mm or µm."""
    value_unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's values, such as HU."""
    device: Annotated[DeviceName, Setting(result=False)] = "auto"
    """Where to run; auto takes a GPU that passes a check (25 s on its first use), otherwise the CPU."""


@spread
def probe(
    scene: SceneFile,
    options: Probed = Probed(),
    json: Json = None,
) -> None:
    """Read off what pixels of a scene's picture show: the region, its place in the world and the volume's value there.

    Values need a scene trained with --keep-values, or of the encoding values; each comes with its uncertainty. Of two
    pixels or more, also the distances from place to place are told, and of three the angle at the middle one.
    """
    from svv.io.files.atomic import write_json

    pixels = parse_points(options.at, "--at")
    if not pixels:
        raise BadInput("Give at least one pixel, for example --at 410,320.")
    ways = [f"--{name}" for name in ("camera", "view") if getattr(options, name) is not None]
    if len(ways) > 1:
        raise BadInput("Give --camera or --view, not both.")
    if options.frame is not None and options.camera is None:
        raise BadInput("--frame needs --camera, a file of cameras.")
    check_targets(json)
    loaded = _shown(load(scene, options.device), options)
    from svv.fields.scene.probing import describe_measures, measure

    camera = _camera(loaded, options)
    found = [loaded.probe(camera, pixel, options.network) for pixel in pixels]
    for one, (column, row) in zip(found, pixels, strict=True):
        nothing = f"{column:g},{row:g}: nothing is visible there"
        print(nothing if one is None else one.describe(options.unit, options.value_unit))
    places = [one.point for one in found if one is not None]
    if len(places) == len(found) > 1:
        print(describe_measures(places, options.unit))
    if json is not None:
        lengths, angle = measure(places) if len(places) == len(found) else ([], None)
        told = [None if one is None else vars(one) for one in found]
        units = {"unit": options.unit, "value_unit": options.value_unit}
        write_json(json, {"pixels": told, "distances": lengths, "angle": angle, **units})


def _shown(scene: Scene, options: Probed) -> Scene:
    """Return the scene with the painting, and at the time, that the options name."""
    from svv.fields.following.followed_scene import at_time

    if options.variant is not None:
        if options.network not in (None, "styled"):
            raise BadInput(f"A variant is a painting: leave out --network {options.network}.")
        scene = scene.with_variant(options.variant)
    if options.time is None:
        return scene
    if scene.steps is None or len(scene.steps) < 2:
        raise BadInput("The scene has no time steps: add them with svv follow.")
    return at_time(scene, options.time)


def _camera(scene: Scene, options: Probed) -> Camera:
    """Return the camera of the picture."""
    from svv.io.views.camera_file import read_camera
    from svv.render.frames import orbit, seen_from

    size = options.size or (800, 800)
    if options.camera is not None:
        return read_camera(options.camera, options.size, options.frame)
    if options.view is not None:
        return seen_from(scene, *parse_angles(options.view, "--view"), *size)
    return orbit(scene, 181, *size)[90]  # as `svv render` without a camera
