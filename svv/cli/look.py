"""``svv look``: the commands that save how a scene looks, and give other scenes that look; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from svv.cli.app import guarded
from svv.cli.files import check_targets, load
from svv.cli.option_group import spread
from svv.cli.options import Out, SceneFile, examples, parse_angles
from svv.cli.swatches import print_swatches
from svv.errors import BadInput
from svv.options.described import Setting
from svv.options.figures import FigureOptions
from svv.options.making import DeviceOptions, PresetName
from svv.progress import shown

if TYPE_CHECKING:
    from svv.core.geometry.cameras import Camera
    from svv.fields.scene.scene import Scene
    from svv.job.looks.look import Look

SAVE = (
    "svv look save painted.svv --out look.json",
    "svv look save painted.svv --about 'Blue shell' --view 40,20 --journal science --unit mm --out look.json",
)
APPLY = (
    "svv look apply look.json other.svv --dry-run",
    "svv look apply look.json other.svv --out same.svv",
    "svv look apply look.json other.svv --map 0=1,1=0 --camera camera.json --out same.svv",
    "svv look apply gallery:porcelain scene.svv --out porcelain.svv",
)
SHOW = ("svv look show look.json", "svv look show gallery:porcelain")
LIST = ("svv look list",)

LOOK = (SAVE[0], APPLY[1])

LookFile = Annotated[str, typer.Argument(metavar="LOOK.json|gallery:NAME", help="A look; `svv look list` lists some.")]


@dataclass(frozen=True)
class Kept:
    """What a look keeps beside the scene's own: a line, pictures of styles, and the side that it is seen from."""

    about: Annotated[str, Setting(metavar="TEXT")] = ""
    """One line about the look."""
    style: Annotated[tuple[str, ...], Setting(metavar="IMG|gallery:NAME")] = ()
    """Picture of a style, for scenes that were painted before scenes kept them."""
    view: Annotated[str | None, Setting(metavar="AZ,EL")] = None
    """Keep this side as the look's camera: degrees to the right of the front of the volume, and above it."""
    camera: Annotated[Path | None, Setting(metavar="CAMERA.json")] = None
    """Keep this camera, as in `svv render`."""
    frame_number: Annotated[int | None, Setting("--view-number", metavar="N", least=0)] = None
    """Number of the view, if the camera's file has several."""


@spread
def save(
    scene: SceneFile,
    out: Out,
    kept: Kept = Kept(),
    figure: FigureOptions = FigureOptions(),
) -> None:
    """Save how a scene looks: names, colours, opacities, light, styles, strokes, outlines, camera and figure settings.

    The file is plain data with the pictures of its styles inside. Options of figures that are given here are kept for
    `svv figure --look`.
    """
    from svv.cli.style import read_styles
    from svv.fields.scene.closed import NeedsNetworks, read_closed
    from svv.job.looks.look import Look

    check_targets(out)
    given = {str(one.name): one for one in read_styles(kept.style, [])} if kept.style else {}

    def look_of(scene: Scene) -> Look:
        return Look.of(scene, _camera(scene, kept), figure, given, kept.about)

    closed = read_closed(scene)
    try:
        look = look_of(load(scene) if closed is None else cast("Scene", closed))
    except NeedsNetworks:
        look = look_of(load(scene))
    look.save(out)
    print(out)


def _camera(scene: Scene, side: Kept) -> Camera | None:
    """Return the camera that a look keeps; None for none."""
    from svv.io.views.camera_file import read_camera
    from svv.render.frames import seen_from

    if side.view is not None and side.camera is not None:
        raise BadInput("Give --view or --camera, not both.")
    if side.frame_number is not None and side.camera is None:
        raise BadInput("--view-number needs --camera, a file of cameras.")
    if side.camera is not None:
        return read_camera(side.camera, None, side.frame_number)
    return None if side.view is None else seen_from(scene, *parse_angles(side.view, "--view"), 800, 800)


@dataclass(frozen=True)
class ApplyOptions:
    """How a look is applied."""

    map: Annotated[dict[int, int] | None, Setting(metavar="0=1,1=0", syntax="pairs")] = None
    """Pairs of the scene's region and the look's; by default by name, by values, by colour."""
    preset: PresetName = "balanced"
    """How to paint, as in `svv stylize`."""
    variant: Annotated[str | None, Setting(metavar="NAME")] = None
    """Add the painting under this name and keep the others."""
    dry_run: Annotated[bool, Setting("--dry-run")] = False
    """Only say which regions match."""
    camera: Annotated[Path | None, Setting("--camera", metavar="CAMERA.json")] = None
    """Also write the look's camera, placed for this scene, for `svv render --camera`."""


@spread
def apply(
    look: LookFile,
    scene: SceneFile,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Where to write the scene.")] = None,
    options: ApplyOptions = ApplyOptions(),
    where: DeviceOptions = DeviceOptions(),
) -> None:
    """Give a scene a look: its regions are painted and edited like those of the look that they match.

    Regions match by name, by overlapping values, or by colour; a table says which did, and what did not. Edits are one
    step of the history, which `svv edit --undo` takes back. After Ctrl-C, the same command resumes.
    """
    from svv.fields.scene.closed import read_closed
    from svv.io.files.atomic import write_json
    from svv.io.scene_file import checkpoint_of
    from svv.job.looks.look import Look

    if out is None and not options.dry_run:
        raise BadInput("Give --out SCENE.svv, or --dry-run to see which regions match.")
    check_targets(out, options.camera)
    chosen = Look.load(look)
    closed = read_closed(scene) if options.dry_run else None  # what matches, its header says
    loaded = load(scene, where.device) if closed is None else cast("Scene", closed)
    matches = chosen.matched(loaded, options.map)
    print("\n".join(matches.describe(chosen, loaded)))
    camera = chosen.camera_for(loaded)
    if options.camera is not None and camera is None:
        raise BadInput(f"{look} has no camera: save it with --view or --camera, or leave --camera out.")
    if options.dry_run or out is None:
        return
    checkpoint = checkpoint_of(out)
    with shown("Painting") as progress:
        result = chosen.applied(
            loaded, options.map, progress, checkpoint, preset=options.preset, variant=options.variant
        )
    for note in result.notes:
        print(note, file=sys.stderr)
    print_swatches(result.scene.made.get("stylized", {}).get("divided", {}), result.scene.regions)
    result.scene.save(out)
    if options.camera is not None and camera is not None:
        write_json(options.camera, camera_to_json(camera))
    print(out)


def camera_to_json(camera: Camera) -> dict[str, object]:
    """Return a camera as :func:`svv.io.views.camera_file.read_camera` reads it."""
    from math import degrees

    lens = {"fov": degrees(camera.fov_x)} if camera.span_x is None else {"span_x": camera.span_x}
    size = {"width": camera.width, "height": camera.height}
    return {"camera_to_world": camera.camera_to_world.tolist(), **lens, **size}


def show(look: LookFile) -> None:
    """Show what a look holds: its regions, styles, light, camera and figure settings."""
    from svv.cli.table import print_table
    from svv.job.looks.look import Look

    print_table(described(Look.load(look)))


def described(look: Look) -> dict[str, object]:
    """Return what a look holds, for people to read."""
    from svv.core.colour.hex_codes import to_hex
    from svv.train.paint.ink import Ink

    regions = {}
    for number, region in enumerate(look.regions):
        told: dict[str, object] = {} if region.shown_colour is None else {"colour": to_hex(region.shown_colour)}
        told |= {} if region.values is None else {"values": "{:g} to {:g}".format(*region.values)}
        told |= {} if region.style is None else {"style": region.style}
        told |= {key: value for key, value in region.edits.items() if key not in ("name", "edited_colour")}
        regions[f"region {number}" + (f" ({region.name})" if region.name else "")] = told
    styles = {
        name: "an ink" if isinstance(style.style, Ink) else "{1} x {0} pixels".format(*style.style.shape)
        for name, style in look.styles.items()
    }
    found: dict[str, object] = {"title": look.title or None, **regions, "styles": styles or None}
    found["light"] = None if look.lamp is None else look.lamp.describe()
    found["camera"] = None if look.camera is None else "kept"
    found["figure"] = dict(look.figure) or None
    return {key: value for key, value in found.items() if value is not None}


def list_() -> None:
    """List the looks that ship, for one, two and three regions."""
    from svv.job.looks.offered import LOOKS
    from svv.options.making import PREFIX

    for name, look in LOOKS.items():
        print(f"{PREFIX}{name:<14} {len(look['regions'])} region{'s' * (len(look['regions']) > 1)}: {look['title']}")


app = typer.Typer(name="look", no_args_is_help=True)

COMMANDS: dict[str, tuple[Callable[..., None], Sequence[str]]] = {
    "save": (save, SAVE),
    "apply": (apply, APPLY),
    "show": (show, SHOW),
    "list": (list_, LIST),
}
"""Each command's name, its function and the examples in its help, in the order of the help."""


@app.callback(epilog=examples(*LOOK))
def look() -> None:
    """Save how a scene looks to a file, and give other scenes that look: colours, styles, light, outlines."""


for _name, (_command, _examples) in COMMANDS.items():
    app.command(_name, epilog=examples(*_examples))(guarded(_command))
