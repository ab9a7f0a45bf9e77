"""The commands ``svv edit`` and ``svv palette``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.files import checkpoint_path, finish
from svv.cli.options import (
    Device,
    DeviceOption,
    Json,
    Out,
    Preset,
    PresetOption,
    SceneFile,
    Seed,
    TimeLimit,
    parse_colour,
    parse_light,
    parse_whole,
)
from svv.errors import BadInput
from svv.progress import shown

EDIT = (
    "svv edit scene.svv --region 0 --colour '#d02020' --out red.svv",
    "svv edit scene.svv --region 1 --opacity 0.3 --lighting 1.5 --out thin.svv",
    "svv edit scene.svv --isolate 0 --out alone.svv",
    "svv edit alone.svv --show all --out all.svv",
    "svv edit red.svv --undo --out scene.svv",
    "svv edit phong.svv --light 50,20 --intensity 1.2 --out side.svv",
    "svv edit phong.svv --region 0 --specular 0.4 --shininess 30 --out shiny.svv",
    "svv edit painted.svv --show-variant ink --strength 0.5 --out faint.svv",
    "svv edit painted.svv --paint-light 1 --out lit.svv",
    "svv edit painted.svv --stroke-opacity 0.6 --out strokes.svv",
    "svv edit painted.svv --outline 1 --outline-width 3 --out inked.svv",
)
PALETTE = (
    "svv palette scene.svv --views views --add '#f2a319' --out two.svv",
    "svv palette scene.svv --views views --merge 0,1 --set 0='#d0a060' --out one.svv",
    "svv palette scene.svv --views views --remove 2 --preset fast --out less.svv",
)


def edit(
    scene: SceneFile,
    out: Out,
    region: Annotated[int | None, typer.Option(min=0, help="Number of the region; `svv info` lists them.")] = None,
    colour: Annotated[str | None, typer.Option(metavar="'#rrggbb'", help="The region's new colour.")] = None,
    opacity: Annotated[
        float | None, typer.Option(min=0, help="Factor on the region's opacity; 1 is as trained.")
    ] = None,
    lighting: Annotated[
        float | None, typer.Option(min=0, help="Factor on the region's shading; 0 is flat, 1 is as trained.")
    ] = None,
    ambient: Annotated[float | None, typer.Option(min=0, help="Ambient reflection (a).")] = None,
    diffuse: Annotated[float | None, typer.Option(min=0, help="Diffuse reflection (a).")] = None,
    specular: Annotated[float | None, typer.Option(min=0, help="Specular reflection (a).")] = None,
    shininess: Annotated[float | None, typer.Option(min=1, help="Exponent of the specular highlight (a).")] = None,
    light: Annotated[
        str | None,
        typer.Option(
            metavar="headlight|AZ,EL|X,Y,Z",
            help="Degrees to the right of and above the camera, or a vector in world coordinates (a).",
        ),
    ] = None,
    intensity: Annotated[float | None, typer.Option(min=0, help="Factor on the brightness of the light (a).")] = None,
    strength: Annotated[
        float | None,
        typer.Option(min=0, max=1, help="How strongly styles show, from 0 to 1; of --region, or of all regions."),
    ] = None,
    paint_light: Annotated[
        float | None,
        typer.Option(min=0, max=1, help="How strongly paint is shaded, from 0 to 1; of --region, or of all regions."),
    ] = None,
    stroke_opacity: Annotated[
        float | None,
        typer.Option(
            min=-1,
            max=1,
            help="How much opacity follows strokes, of the region or of all; above 0 dark ones "
            "are more opaque, below 0 light ones.",
        ),
    ] = None,
    outline: Annotated[
        float | None,
        typer.Option(min=0, max=1, help="Strength of ink outlines, from 0 to 1; of --region, or of all regions."),
    ] = None,
    outline_width: Annotated[
        float | None, typer.Option(metavar="PX", help="Width of outlines in pixels of an 800 x 800 image.")
    ] = None,
    outline_colour: Annotated[str | None, typer.Option(metavar="'#rrggbb'", help="Colour of outlines.")] = None,
    isolate: Annotated[str | None, typer.Option(metavar="K,...", help="Show only these regions.")] = None,
    hide: Annotated[
        str | None, typer.Option(metavar="K,...", help="Hide these regions and keep their opacity.")
    ] = None,
    show: Annotated[str | None, typer.Option(metavar="K,...|all", help="Show hidden regions again.")] = None,
    reset: Annotated[str | None, typer.Option(metavar="K,...|all", help="Undo all edits of these regions.")] = None,
    undo: Annotated[int, typer.Option("--undo", count=True, help="Undo the last edit; may be repeated.")] = 0,
    redo: Annotated[
        int, typer.Option("--redo", count=True, help="Redo the edit that was undone last; may be repeated.")
    ] = 0,
    show_variant: Annotated[str | None, typer.Option(metavar="NAME", help="Show this painting.")] = None,
    drop_variant: Annotated[
        str | None, typer.Option(metavar="NAME", help="Remove this painting from the file.")
    ] = None,
) -> None:
    """Edit a scene's regions: colour, opacity, light, outlines, visibility. Nothing is trained.

    All changes of one command are one step of the history in the scene's file, which --undo takes back. Of several
    options, --reset applies first, then those that hide and show. (a): for scenes trained with --lighting phong.
    """
    from svv.fields.scene import Scene
    from svv.io.atomic import check_writable

    reflects = {"ambient": ambient, "diffuse": diffuse, "specular": specular, "shininess": shininess}
    own = (colour, opacity, lighting, *reflects.values())
    owned = any(change is not None for change in own)
    painted = (strength, paint_light, stroke_opacity)
    drawn = any(change is not None for change in (outline, outline_width, outline_colour))
    changes = (*painted, isolate, hide, show, reset, light, intensity)
    edits = owned or drawn or any(change is not None for change in changes)
    if (undo or redo) and (edits or (undo and redo)):
        raise BadInput("Undo or redo alone: --undo, or --redo, or edits.")
    if region is None and owned:
        raise BadInput("Say which region with --region K; `svv info` lists them.")
    if region is not None and not owned and not drawn and all(change is None for change in painted):
        raise BadInput(
            "Nothing to change: give --colour, --opacity, --lighting, --strength, --paint-light, --stroke-opacity or "
            "--outline for the region."
        )
    if not (edits or undo or redo or show_variant or drop_variant):
        raise BadInput("Nothing to change: give an edit, for example --region 0 --opacity 0.5, or --undo.")
    rgb = None if colour is None else parse_colour(colour)
    ink = None if outline_colour is None else parse_colour(outline_colour)
    named = {name: regions_in(text, name) for name, text in
             (("--isolate", isolate), ("--hide", hide), ("--show", show), ("--reset", reset)) if text}  # fmt: skip
    lamp = {} if light is None else parse_light(light)
    check_writable(out)
    result = before = Scene.load(scene)
    if reset:
        result = result.reset(*named["--reset"])
    if isolate:
        result = result.isolated(*named["--isolate"])
    if hide:
        result = result.hidden(*named["--hide"])
    if show:
        result = result.shown(*named["--show"])
    if region is not None and owned:
        result = result.edited(region, rgb, opacity, lighting, **reflects)
    if light is not None or intensity is not None:
        result = result.with_light(**(vars(result.lamp) if light is None else lamp) | {"intensity": intensity})
    if strength is not None:
        result = result.with_strength(strength, *(() if region is None else (region,)))
    if paint_light is not None:
        result = result.with_paint_light(paint_light, *(() if region is None else (region,)))
    if stroke_opacity is not None:
        result = result.with_stroke_opacity(stroke_opacity, *(() if region is None else (region,)))
    if drawn:
        chosen = () if region is None else (region,)
        result = result.with_outline(outline, *chosen, width=outline_width, colour=ink)
    result = result.as_one_step(before)
    for _ in range(undo):
        result = result.undone()
    for _ in range(redo):
        result = result.redone()
    if drop_variant is not None:
        result = result.without_variant(drop_variant)
    if show_variant is not None:
        result = result.with_variant(show_variant)
    result.save(out)
    print(out)


def palette(
    scene: SceneFile,
    views: Annotated[Path, typer.Option(metavar="VIEWS", help="Folder of the views that the scene was trained on.")],
    out: Out,
    add: Annotated[
        list[str] | None, typer.Option(metavar="'#rrggbb'", help="Add a region of this colour; may be repeated.")
    ] = None,
    merge: Annotated[
        list[str] | None, typer.Option(metavar="K,K,...", help="Merge these regions; may be repeated.")
    ] = None,
    remove: Annotated[list[int] | None, typer.Option(metavar="K", help="Remove this region; may be repeated.")] = None,
    colours: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="K='#rrggbb'", help="Set a region's palette colour; may be repeated."),
    ] = None,
    split: Annotated[
        list[int] | None,
        typer.Option(metavar="K", help="Split this region into one region for each of its ranges of values."),
    ] = None,
    preset: PresetOption = Preset.balanced,
    time_limit: TimeLimit = None,
    seed: Seed = 0,
    views_only: Annotated[
        bool, typer.Option("--views-only", help="Use the palette as given, even if the volume says otherwise.")
    ] = False,
    device: DeviceOption = Device.cpu,
    json: Json = None,
) -> None:
    """Correct a scene's palette by hand and train its regions again; the base network is kept.

    If two parts of similar hue were taken for one, add the missing colour. Regions are numbered as in
    `svv info SCENE.svv`. If the volume is known, each region still consists of ranges of the transfer function.
    After Ctrl-C, the same command resumes.
    """
    from dataclasses import replace

    from svv.core.correction import Correction
    from svv.fields.scene import Scene
    from svv.io.atomic import check_writable
    from svv.io.viewset import ViewSet
    from svv.kernels.dispatch import device_named
    from svv.train.correct import correct_palette

    correction = Correction(
        tuple(parse_whole(text, "--merge") for text in merge or ()), tuple(remove or ()),
        dict(parse_set(text) for text in colours or ()), tuple(split or ()), tuple(map(parse_colour, add or ())),
    )  # fmt: skip
    for path in filter(None, (out, json)):
        check_writable(path)
    loaded = Scene.load(scene).on(device_named(device.value))
    with shown("Reading") as progress:
        view_set = ViewSet.read(views, "train", progress)
    if views_only:
        view_set = replace(view_set, classified=None)
    checkpoint = checkpoint_path(out)
    with shown("Palette") as progress:
        result, report = correct_palette(
            loaded, view_set, correction, preset.value, time_limit, seed, progress, checkpoint
        )
    print("\n".join(report["notes"][:-1]), file=sys.stderr)
    finish(result, report, out, json, checkpoint)


def parse_set(text: str) -> tuple[int, tuple[float, float, float]]:
    """'0=#rrggbb' as region and colour.

    Raises:
        BadInput: anything else.
    """
    region, _, colour = text.partition("=")
    if not (region.strip().isascii() and region.strip().isdigit() and colour):
        raise BadInput(f"'{text}' sets no colour; write region=colour, for example --set 0='#ff8800'.")
    return int(region), parse_colour(colour)


def regions_in(text: str, option: str) -> tuple[int, ...]:
    """'0,2' as regions; 'all', which only --show and --reset take, as none.

    Raises:
        BadInput: anything else.
    """
    if text == "all" and option in ("--show", "--reset"):
        return ()
    return parse_whole(text, option)
