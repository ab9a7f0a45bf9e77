"""The commands ``svv figure`` and ``svv check-colours``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import typer

from svv.cli.files import check_targets, load
from svv.cli.option_group import spread
from svv.cli.options import Json, parse_angles
from svv.errors import BadInput
from svv.options.described import Setting
from svv.options.figures import FigureOptions
from svv.options.making import DeviceName
from svv.progress import shown

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from svv.core.geometry.cameras import Camera
    from svv.fields.scene.scene import Scene
    from svv.fields.scene.seen_colours import Seen
    from svv.job.looks.look import Look
    from svv.render.figures.figure import Panel

FIGURE = (
    "svv figure head.svv --unit mm --value-unit HU --out head.pdf",
    "svv figure plain.svv painted.svv --columns double --title before --title after --out both.svg",
    "svv figure painted.svv --variant oil --variant ink --dpi 600 --out paintings.tiff",
    "svv figure scene.svv --view 0,0 --view 90,0 --view 0,80 --journal ieee --out views.pdf",
    "svv figure painted.svv --panel dvr --columns double --out beside.pdf",
    "svv figure same.svv --look look.json --out same.pdf",
    "svv figure series.svv --time 0 --time 0.5 --time 1 --across 3 --transparent --out times.png",
)


CHECK_COLOURS = (
    "svv check-colours scene.svv",
    "svv check-colours scene.svv --background black --json colours.json",
    "svv check-colours figure.png --out simulated.png",
)


PanelName = Literal["dvr"]
"""What else panels show."""


@dataclass(frozen=True)
class PanelOptions:
    """What the panels of a figure show: each scene with each painting, at each time, by each camera."""

    variant: Annotated[tuple[str, ...], Setting(metavar="NAME")] = ()
    """Show this painting, in a panel of its own."""
    time: Annotated[tuple[float, ...], Setting(metavar="TIME")] = ()
    """Show this time of a scene that has time steps, in a panel of its own."""
    camera: Annotated[tuple[str, ...], Setting(metavar="CAMERA.json")] = ()
    """Look through the cameras of this file, as in `svv render`, a panel each; by default from the front."""
    view: Annotated[tuple[str, ...], Setting(metavar="AZ,EL")] = ()
    """Look from this side, in a panel of its own: degrees to the right of the front of the volume, and above it."""
    panel: tuple[PanelName, ...] = ()
    """Also show this from each camera, in a panel of its own: dvr, the volume rendering, or the palette network if the
    volume is not there."""
    volume: Annotated[tuple[Path, ...], Setting(metavar="FILE")] = ()
    """The volume of a scene, for --panel dvr; by default the file of its name beside the scene, or here."""
    frame_number: Annotated[int | None, Setting("--view-number", metavar="N", least=0)] = None
    """Number of the only view to show of those in a file given as --camera."""


@spread
def figure(
    scenes: Annotated[list[Path], typer.Argument(metavar="SCENE.svv ...", help="Trained scenes, a panel each.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="Where to write it: a .pdf, .svg, .png or .tiff.")
    ],
    panels: PanelOptions = PanelOptions(),
    options: FigureOptions = FigureOptions(),
    look: Annotated[
        str | None,
        typer.Option(
            metavar="LOOK.json|gallery:NAME",
            help="Take the camera and the settings of figures from this look; options that are given win.",
        ),
    ] = None,
    json: Json = None,
) -> None:
    """Make a figure of scenes for a paper: panels with a legend, a scale bar and orientation axes.

    The legend shows each region's name (`svv edit --name`), range of values, and a small painted sphere. Text in PDF
    and SVG stays text. Several scenes, paintings, times and cameras are panels with letters, at one scale if the
    scenes are of one volume. Regions that look alike are named in the legend, on the screen, and in the file of --json.
    """
    from svv.io.files.atomic import write_json
    from svv.job.looks.look import Look, changed_settings
    from svv.render.figures.figure import drawing_of, need_matplotlib
    from svv.render.figures.files import check_kind

    need_matplotlib()
    check_kind(out)
    check_targets(out, json)
    chosen = None if look is None else Look.load(look)
    if chosen is not None:
        options = replace(options, **{**chosen.figure, **changed_settings(options)})
    if panels.volume and not panels.panel:
        raise BadInput("--volume names the volume for --panel dvr: give both.")
    every = [panel for path in scenes for panel in _panels(path, load(path, options.device), panels, chosen)]
    with shown("Drawing") as progress:
        drawn = drawing_of(every, out, options, progress, tell=lambda said: print(f"svv: {said}", file=sys.stderr))
    if json is not None:
        write_json(json, drawn.report())
    if options.scale_bar and not options.parallel and any(not _parallel(panel) for panel in every):
        print(
            "The scale bar holds in the plane through the middle of the volume; --parallel makes it hold everywhere.",
            file=sys.stderr,
        )
    print(out)


def _panels(path: Path, scene: Scene, options: PanelOptions, look: Look | None) -> list[Panel]:
    """Return a scene's panels: the volume rendering and each painting at each time by each camera."""
    from svv.fields.following.followed_scene import at_time
    from svv.render.figures.figure import Panel

    if options.time and (scene.steps is None or len(scene.steps) < 2):
        raise BadInput("The scene has no time steps: add them with svv follow, or leave out --time.")
    cameras: list[Camera | None] = [*_cameras(scene, options)] or [None if look is None else look.camera_for(scene)]
    found = []
    if options.panel:
        from svv.job.volume_panels import panel_of, remembered

        shown = [at_time(scene, time) for time in options.time] or [scene]
        volumes = [remembered(one, options.volume, [path.parent, Path()]) for one in shown]
        found = [panel_of(one, volume, camera) for one, volume in zip(shown, volumes) for camera in cameras]
    painted = [scene.with_variant(name) for name in options.variant] or [scene]
    timed = [at_time(one, time) for one in painted for time in options.time] or painted
    return found + [Panel(one, camera) for one in timed for camera in cameras]


def _cameras(scene: Scene, options: PanelOptions) -> list[Camera]:
    """Return the cameras of a scene's panels."""
    from svv.io.views.camera_file import read_camera, read_cameras
    from svv.render.frames import seen_from

    number, files = options.frame_number, map(Path, options.camera)
    read = [read_cameras(file) if number is None else [read_camera(file, None, number)] for file in files]
    given = [camera for cameras in read for camera in cameras]
    return given + [seen_from(scene, *parse_angles(text, "--view"), 800, 800) for text in options.view]


def _parallel(panel: Panel) -> bool:
    """Return whether a panel's rays are parallel."""
    from svv.core.geometry.given_cameras import camera_of

    rig = panel.scene.camera_rig
    if panel.camera is None:
        return rig is not None and rig.span_x is not None
    return camera_of(panel.camera, panel.scene).is_orthographic


@dataclass(frozen=True)
class CheckOptions:
    """How colours are checked."""

    least: Annotated[float, Setting(metavar="DE", least=0, most=100)] = 12.0
    """CIEDE2000 below which two regions count as merging."""
    background: Annotated[tuple[float, float, float] | None, Setting(metavar="COLOUR", syntax="colour")] = None
    """Background of a scene; white by default."""
    device: Annotated[DeviceName, Setting(result=False)] = "auto"
    """Where to run; auto takes a GPU whose kernels pass a check, 25 s on its first use, otherwise the CPU."""


@spread
def check_colours(
    source: Annotated[Path, typer.Argument(metavar="SCENE.svv|FIGURE", help="A scene, or a figure as PNG or TIFF.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE.png", help="Also write the picture in all simulations.")
    ] = None,
    options: CheckOptions = CheckOptions(),
    json: Json = None,
) -> None:
    """Check whether everybody can tell the regions of a scene or figure apart, as rendered.

    Regions are compared in pairs (CIEDE2000) for normal colour vision, protanopia, deuteranopia and tritanopia (Machado
    et al. 2009), and in grey. `svv edit --distinct` recolours those that merge.
    """
    from svv.cli.table import print_table
    from svv.io.files.atomic import write_json
    from svv.io.pictures.output import write_png
    from svv.render.emptiness import SHOW
    from svv.render.figures.colour_check import report_on, seen_in_picture, simulation_sheet

    check_targets(out, json)
    behind = (1.0, 1.0, 1.0) if options.background is None else options.background
    if source.suffix.lower() == ".svv":
        panels, picture = _scene_colours(source, behind, options.device, out is not None)
    else:
        panels, picture = seen_in_picture(source), None if out is None else read_over(source, behind)
    if not any(panels):
        raise BadInput(f"No region of {source} is visible, so there are no colours to compare: {SHOW}.")
    reports = [report_on(panel, options.least) for panel in panels]
    for number, report in enumerate(reports):
        if len(reports) > 1:
            print(f"panel {chr(ord('a') + number)}")
        if len(report["regions"]) < 2:
            few = "Fewer than two regions are" if report["regions"] else "No region is"
            print(f"{few} visible, so none can be mistaken for another.")
            continue
        print_table({
            vision: f"{told['difference']:.1f}  {' and '.join(told['between'])}"
            for vision, told in report["smallest"].items()
        })  # fmt: skip
        for pair in report["merging"]:
            print(f"{pair['first']} and {pair['second']} merge: {pair['difference']:.1f} ({pair['vision']})")
    if json is not None:
        write_json(json, {"panels": reports})
    if out is not None and picture is not None:
        write_png(out, simulation_sheet(picture))
        print(out)


def _scene_colours(
    path: Path, background: tuple[float, float, float], device: str, wanted: bool
) -> tuple[list[list[Seen]], NDArray[np.floating] | None]:
    """Return the colours of a scene's regions, and its picture from the front if it is wanted."""
    from svv.core.colour.colour import over
    from svv.fields.scene.seen_colours import seen_in
    from svv.render.frames import orbit

    scene = load(path, device)
    with shown("Looking") as progress:
        seen = list(seen_in(scene, None, background, progress=progress).values())
        picture = over(scene.render(orbit(scene, 181, 400, 400)[90]).rgba, background) if wanted else None
    return [seen], picture


def read_over(path: Path, background: tuple[float, float, float]) -> NDArray[np.floating]:
    """Return a picture over a background, RGB in [0, 1]. (h, w, 3)"""
    from PIL import Image

    from svv.core.colour.colour import over

    with Image.open(path) as picture:
        return over(np.asarray(picture.convert("RGBA"), np.float32) / 255.0, background)
