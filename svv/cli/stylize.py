"""The command that paints a scene; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.files import check_targets, finish, load
from svv.cli.option_group import spread
from svv.cli.options import Json, Out, SceneFile
from svv.cli.style import read_styles
from svv.cli.swatches import print_swatches
from svv.options.making import DeviceOptions, PaintOptions
from svv.progress import shown

STYLIZE = (
    "svv stylize scene.svv --style brush.jpg --out styled.svv",
    "svv stylize scene.svv --style brush.jpg --map 0=sky --out styled.svv",
    "svv stylize scene.svv --style a.png --style gallery:mosaic --map 0=0,2=1 --keep 1 --out styled.svv",
    "svv stylize scene.svv --style a.png --style a.png --style-mask 0=sky.png --style-mask 1=sea.png -o styled.svv",
    "svv stylize styled.svv --style a.png --style-mask 0=sky.png --map 0=0 --continue --out again.svv",
    "svv stylize styled.svv --style ink.png --variant ink --out two.svv",
    "svv stylize scene.svv --style brush.jpg --preview now.png --out styled.svv",
    "svv stylize scene.svv --style ink:hatching --style ink:stippling --out drawn.svv",
)


@spread
def stylize(
    scene: SceneFile,
    style: Annotated[
        list[str],
        typer.Option(
            metavar="IMG|gallery:NAME|ink:NAME",
            help="A style picture, or ink:stippling, ink:hatching or ink:cross-hatching; may be repeated.",
        ),
    ],
    out: Out,
    style_mask: Annotated[
        list[str] | None,
        typer.Option("--style-mask", metavar="K=MASK.png", help="Learn style K only where the mask is white."),
    ] = None,
    options: PaintOptions = PaintOptions(),
    where: DeviceOptions = DeviceOptions(),
    preview: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Regularly write a picture of the unfinished painting to this file."),
    ] = None,
    json: Json = None,
) -> None:
    """Paint a scene's regions in the style of pictures, or draw them in ink.

    After Ctrl-C, the same command resumes.
    """
    from svv.fields.devices.gpu import device_named
    from svv.io.scene_file import checkpoint_of
    from svv.job.request import Paint, Request, paint
    from svv.render.frames import previews_in
    from svv.train.run.config import settings_of

    check_targets(out, json)
    show = None if preview is None else previews_in(preview)
    settings_of(options)  # reports bad options before pictures of the gallery are painted
    device_named(where.device)
    styles = read_styles(style, style_mask or [])
    checkpoint = checkpoint_of(out)
    with shown("Stylizing") as progress:
        base = load(scene, where.device)
        request = Request(base, paint=Paint.of(styles, options), device=where.device)
        styled, report = paint(request, base, progress, checkpoint, show)
    for note in report["notes"]:
        print(note, file=sys.stderr)
    print_swatches(report["divided"], styled.regions)
    finish(styled, report, out, json, checkpoint)
