"""The command that paints a scene; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.files import check_targets, checkpoint_path, finish, load
from svv.cli.options import (
    Device,
    DeviceOption,
    Json,
    Out,
    Preset,
    PresetOption,
    SceneFile,
    Seed,
    parse_mapping,
)
from svv.cli.style import read_styles
from svv.progress import shown

STYLIZE = (
    "svv stylize scene.svv --style brush.jpg --out styled.svv",
    "svv stylize scene.svv --style a.png --style gallery:mosaic --map 0=0,2=1 --keep 1 --out styled.svv",
    "svv stylize scene.svv --style a.png --style a.png --style-mask 0=sky.png --style-mask 1=sea.png -o styled.svv",
    "svv stylize styled.svv --style a.png --style-mask 0=sky.png --map 0=0 --continue --out again.svv",
    "svv stylize styled.svv --style ink.png --variant ink --out two.svv",
    "svv stylize scene.svv --style brush.jpg --preview now.png --out styled.svv",
    "svv stylize scene.svv --style ink:hatching --style ink:stippling --out drawn.svv",
)
"""Examples of the help."""


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
    mapping: Annotated[
        str | None,
        typer.Option(
            "--map",
            metavar="0=0,1=1|colour",
            help="Pairs of region and style, or colour to pair them by likeness; in turn by default.",
        ),
    ] = None,
    keep: Annotated[
        list[int] | None, typer.Option(metavar="K", help="A region to leave unpainted; may be repeated.")
    ] = None,
    style_mask: Annotated[
        list[str] | None,
        typer.Option("--style-mask", metavar="K=MASK.png", help="Learn style K only from where the mask is white."),
    ] = None,
    stroke_size: Annotated[float, typer.Option(metavar="F", help="Scale of the strokes, from 0.25 to 4.")] = 1.0,
    strength: Annotated[
        float, typer.Option(metavar="F", help="How strongly the style shows, up to 1; can be edited afterwards.")
    ] = 1.0,
    go_on: Annotated[
        bool, typer.Option("--continue", help="Continue from the scene's painting instead of starting afresh.")
    ] = False,
    preset: PresetOption = Preset.balanced,
    seed: Seed = 0,
    features: Annotated[
        str,
        typer.Option(
            metavar="auto|embedded|vgg16|FILE",
            help="Which features to match; auto uses VGG-16 if its weights can be had.",
        ),
    ] = "auto",
    variant: Annotated[
        str | None, typer.Option(metavar="NAME", help="Add a painting of this name and keep the others.")
    ] = None,
    preview: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Keep a picture of the painting there while it is made."),
    ] = None,
    device: DeviceOption = Device.cpu,
    json: Json = None,
) -> None:
    """Paint a scene's regions in the style of pictures, or draw them in ink.

    After Ctrl-C, the same command resumes.
    """
    from svv.kernels.dispatch import device_named
    from svv.render.frames import previews_in
    from svv.train.pipeline import stylize_scene

    pairs = None if mapping is None else parse_mapping(mapping)
    check_targets(out, json)
    show = None if preview is None else previews_in(preview)
    device_named(device.value)  # said before pictures of the gallery are painted
    names, styles, masks = read_styles(style, style_mask or [])
    loaded = load(scene, device)
    checkpoint = checkpoint_path(out)
    with shown("Stylizing") as progress:
        styled, report = stylize_scene(
            loaded, styles, pairs, set(keep or ()), preset.value, seed, progress, checkpoint, names, features,
            masks=masks, stroke_size=stroke_size, strength=strength, go_on=go_on, variant=variant, preview=show,
        )  # fmt: skip
    for note in report["notes"]:
        print(note, file=sys.stderr)
    finish(styled, report, out, json, checkpoint)
