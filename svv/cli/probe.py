"""The command that reads values off a scene; see :mod:`svv.cli.app`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from svv.cli.files import check_targets, load
from svv.cli.option_group import spread
from svv.cli.options import Json, SceneFile, parse_angles, parse_points
from svv.errors import BadInput
from svv.options.probing import ProbeOptions

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


@spread
def probe(
    scene: SceneFile,
    options: ProbeOptions = ProbeOptions(),
    json: Json = None,
) -> None:
    """Read off what pixels of a scene's picture show: the region, its place in the world and the volume's value there.

    Values need a scene trained with --keep-values, or of the encoding values; each comes with its uncertainty. Of two
    pixels or more, also the distances from place to place are told, and of three the angle at the middle one.
    """
    from svv.fields.scene.probing import describe_measures, measure
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


def _shown(scene: Scene, options: ProbeOptions) -> Scene:
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


def _camera(scene: Scene, options: ProbeOptions) -> Camera:
    """Return the camera of the picture."""
    from svv.io.views.camera_file import read_camera
    from svv.render.frames import orbit, seen_from

    size = options.size or (800, 800)
    if options.camera is not None:
        return read_camera(options.camera, options.size, options.frame)
    if options.view is not None:
        return seen_from(scene, *parse_angles(options.view, "--view"), *size)
    return orbit(scene, 181, *size)[90]  # as `svv render` without a camera
