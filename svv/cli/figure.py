"""The commands ``svv figure`` and ``svv check-colours``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.files import load
from svv.cli.option_group import spread
from svv.errors import BadInput
from svv.options.described import Setting
from svv.options.figures import FigureOptions
from svv.progress import shown

if TYPE_CHECKING:
    from svv.core.cameras import Camera
    from svv.fields.scene import Scene
    from svv.render.figures.figure import Panel

FIGURE = (
    "svv figure head.svv --unit mm --value-unit HU --out head.pdf",
    "svv figure plain.svv painted.svv --columns double --title before --title after --out both.svg",
    "svv figure painted.svv --variant oil --variant ink --dpi 600 --out paintings.tiff",
    "svv figure scene.svv --view 0,0 --view 90,0 --view 0,80 --journal ieee --out views.pdf",
    "svv figure series.svv --time 0 --time 0.5 --time 1 --across 3 --transparent --out times.png",
)
"""Examples in the help."""


@dataclass(frozen=True)
class PanelOptions:
    """What the panels of a figure show: each scene with each painting, at each time, by each camera."""

    variant: Annotated[tuple[str, ...], Setting(metavar="NAME")] = ()
    """Show this painting, in a panel of its own."""
    time: Annotated[tuple[float, ...], Setting(metavar="TIME")] = ()
    """Show this time of a scene that has time steps, in a panel of its own."""
    camera: Annotated[tuple[str, ...], Setting(metavar="CAMERA.json")] = ()
    """Look through this camera, as in `svv render`, in a panel of its own; by default from the front."""
    view: Annotated[tuple[str, ...], Setting(metavar="AZ,EL")] = ()
    """Look from this side, in a panel of its own: degrees to the right of the front of the volume, and above it."""
    frame_number: Annotated[int, Setting("--view-number", metavar="N", least=0)] = 0
    """Number of the view in a transforms file given as --camera."""


@spread
def figure(
    scenes: Annotated[list[Path], typer.Argument(metavar="SCENE.svv ...", help="Trained scenes, a panel each.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="Where to write it: a .pdf, .svg, .png or .tiff.")
    ],
    panels: PanelOptions = PanelOptions(),
    options: FigureOptions = FigureOptions(),
) -> None:
    """Make a figure of scenes for a paper: panels with a legend, a scale bar and orientation axes.

    The legend shows each region's name (`svv edit --name`), its range of values, and a small sphere in its paint and
    light. Text in PDF and SVG stays text, with its fonts inside. Several scenes, paintings, times and cameras are
    panels with letters; all are shown at one scale.
    """
    from svv.render.figures.figure import figure as draw
    from svv.render.figures.figure import need_matplotlib
    from svv.render.figures.files import check_kind

    need_matplotlib()
    check_kind(out)
    every = [panel for path in scenes for panel in _panels(load(path, options.device), panels)]
    with shown("Drawing") as progress:
        draw(every, out, options, progress)
    if options.scale_bar and not options.parallel and any(not _parallel(panel) for panel in every):
        print(
            "The scale bar holds in the plane through the middle of the volume; --parallel makes it hold everywhere.",
            file=sys.stderr,
        )
    print(out)


def _panels(scene: Scene, options: PanelOptions) -> list[Panel]:
    """Return a scene's panels: each painting at each time by each camera."""
    from svv.fields.following import at_time
    from svv.render.figures.figure import Panel

    if options.time and (scene.steps is None or len(scene.steps) < 2):
        raise BadInput("The scene has no time steps: add them with svv follow, or leave out --time.")
    painted = [scene.with_variant(name) for name in options.variant] or [scene]
    timed = [at_time(one, time) for one in painted for time in options.time] or painted
    cameras: list[Camera | None] = [*_cameras(scene, options)] or [None]
    return [Panel(one, camera) for one in timed for camera in cameras]


def _cameras(scene: Scene, options: PanelOptions) -> list[Camera]:
    """Return the cameras of a scene's panels."""
    from svv.cli.options import parse_angles
    from svv.io.camera_file import read_camera
    from svv.render.frames import seen_from

    given = [read_camera(Path(path), None, options.frame_number) for path in options.camera]
    return given + [seen_from(scene, *parse_angles(text, "--view"), 800, 800) for text in options.view]


def _parallel(panel: Panel) -> bool:
    """Return whether a panel's rays are parallel."""
    rig = panel.scene.camera_rig
    return panel.camera.is_orthographic if panel.camera is not None else rig is not None and rig.span_x is not None
