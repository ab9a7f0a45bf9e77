"""The ``svv`` command: reads arguments, calls the layers below, prints what came out.

Heavy imports stand inside the commands, so that ``svv --help`` answers at once.

Exit codes: 0 done, 2 bad use or bad input (one sentence on standard error), 130 stopped by the user.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from svv import (
    __version__,
    cli_blind,
    cli_cache,
    cli_chart,
    cli_consistency,
    cli_edit,
    cli_features,
    cli_job,
    cli_paraview,
    cli_profile,
    cli_sheet,
    cli_stability,
    cli_style,
)
from svv.cli_table import print_table
from svv.ending import end_with
from svv.errors import BadInput, Cancelled
from svv.measure import share_processors
from svv.options import (
    Device,
    DeviceOption,
    EncodingOption,
    Json,
    Lighting,
    LightingOption,
    Network,
    Out,
    Preset,
    PresetOption,
    SceneFile,
    Seed,
    TimeLimit,
    What,
    examples,
    parse_colour,
    parse_mapping,
    parse_size,
)
from svv.progress import duration, shown

if TYPE_CHECKING:
    from svv.fields.scene import Scene

app = typer.Typer(
    name="svv",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


UsageError: Any = typer.BadParameter.__base__
"""Bad use of the command; typer brings its own copy of click in some versions and needs the package in others."""


@app.callback(invoke_without_command=True)
def svv(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and stop.")] = False,
) -> None:
    """Volume renderings that look like something else: recoloured, relit, thinned out or painted, region by region.

    Views of a volume become a small scene file (.svv), which renders from any side, takes edits without training
    and learns the manner of pictures.
    """
    if version:
        print(f"svv {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        context.get_help()  # prints it
        raise typer.Exit


app.command(epilog=examples(*cli_job.DEMO))(cli_job.demo)
app.command(epilog=examples(*cli_job.RUN))(cli_job.run)
app.command(epilog=examples(*cli_job.VIEWS))(cli_job.views)


@app.command(
    epilog=examples("svv train views --out scene.svv", "svv train views -o scene.svv --preset fast --json f.json")
)
def train(
    views: Annotated[Path, typer.Argument(metavar="VIEWS", help="Folder with transforms_train.json and its images.")],
    out: Out,
    preset: PresetOption = Preset.balanced,
    time_limit: TimeLimit = None,
    seed: Seed = 0,
    device: DeviceOption = Device.cpu,
    encoding: EncodingOption = None,
    lighting: LightingOption = Lighting.network,
    views_only: Annotated[
        bool, typer.Option("--views-only", help="Learn from the images alone, not from the volume.")
    ] = False,
    json: Json = None,
) -> None:
    """Train a scene on views.

    Views that `svv views` drew carry the volume's extinction, and training begins with it; from views of other origin
    the extinction is learned, too. Stopped with Ctrl-C, the same command goes on where it was.
    """
    from svv.io.viewset import ViewSet
    from svv.kernels.dispatch import device_named
    from svv.train import config
    from svv.train.pipeline import train_scene

    _check_targets(out, json)
    where = device_named(device.value)
    name = None if encoding is None else encoding.value
    config.lit_by(config.preset(preset.value, name), lighting.value)  # said before the views are read
    with shown("Reading") as progress:
        view_set = ViewSet.read(views, "train", progress)
    if "assumed" in view_set.meta:
        print(view_set.meta["assumed"], file=sys.stderr)
    if views_only:
        view_set = replace(view_set, classified=None)
    checkpoint = checkpoint_path(out)
    with shown("Training") as progress:
        scene, report = train_scene(
            view_set, preset.value, time_limit, seed, progress, checkpoint, where, name, lighting.value
        )
    finish(scene, report, out, json, checkpoint)


app.command(epilog=examples(*cli_edit.EDIT))(cli_edit.edit)
app.command(epilog=examples(*cli_edit.PALETTE))(cli_edit.palette)


@app.command(
    epilog=examples(
        "svv stylize scene.svv --style brush.jpg --out styled.svv",
        "svv stylize scene.svv --style a.png --style gallery:mosaic --map 0=0,2=1 --keep 1 --out styled.svv",
        "svv stylize scene.svv --style a.png --style a.png --style-mask 0=sky.png --style-mask 1=sea.png -o styled.svv",
        "svv stylize styled.svv --style a.png --style-mask 0=sky.png --map 0=0 --continue --out again.svv",
        "svv stylize styled.svv --style ink.png --variant ink --out two.svv",
        "svv stylize scene.svv --style brush.jpg --preview now.png --out styled.svv",
        "svv stylize scene.svv --style ink:hatching --style ink:stippling --out drawn.svv",
    )
)
def stylize(
    scene: SceneFile,
    style: Annotated[
        list[str],
        typer.Option(
            metavar="IMG|gallery:NAME|ink:NAME",
            help="A picture, or ink:stippling, ink:hatching or ink:cross-hatching, which need none; may be repeated.",
        ),
    ],
    out: Out,
    mapping: Annotated[
        str | None,
        typer.Option("--map", metavar="0=0,1=1|colour", help="Region=style pairs, or by likeness; else in turn."),
    ] = None,
    keep: Annotated[list[int] | None, typer.Option(metavar="K", help="A region that stays as it is.")] = None,
    style_mask: Annotated[
        list[str] | None,
        typer.Option("--style-mask", metavar="K=MASK.png", help="Style K learns only where the mask is white."),
    ] = None,
    stroke_size: Annotated[float, typer.Option(metavar="F", help="Size of the strokes, 0.25 to 4.")] = 1.0,
    strength: Annotated[float, typer.Option(metavar="F", help="How much of the style is shown, up to 1.")] = 1.0,
    go_on: Annotated[
        bool, typer.Option("--continue", help="Go on with the styles of a styled scene instead of beginning anew.")
    ] = False,
    preset: PresetOption = Preset.balanced,
    seed: Seed = 0,
    features: Annotated[
        str, typer.Option(metavar="auto|embedded|vgg16|FILE", help="Which network's features are matched.")
    ] = "auto",
    variant: Annotated[
        str | None, typer.Option(metavar="NAME", help="Keep the scene's paintings and add one of this name.")
    ] = None,
    preview: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Show the painting there while it is made."),
    ] = None,
    device: DeviceOption = Device.cpu,
    json: Json = None,
) -> None:
    """Paint the regions of a scene in the manner of pictures, or draw them in ink.

    Stopped with Ctrl-C, the same command goes on where it was.
    """
    from svv.kernels.dispatch import device_named
    from svv.report.render import previews_in
    from svv.train.pipeline import stylize_scene

    pairs = None if mapping is None else parse_mapping(mapping)
    _check_targets(out, json)
    show = None if preview is None else previews_in(preview)
    device_named(device.value)  # said before pictures of the gallery are painted
    names, styles, masks = cli_style.read_styles(style, style_mask or [])
    loaded = _load(scene, device)
    checkpoint = checkpoint_path(out)
    with shown("Stylizing") as progress:
        styled, report = stylize_scene(
            loaded, styles, pairs, set(keep or ()), preset.value, seed, progress, checkpoint, names, features,
            masks=masks, stroke_size=stroke_size, strength=strength, go_on=go_on, variant=variant, preview=show,
        )  # fmt: skip
    for note in report["notes"]:
        print(note, file=sys.stderr)
    finish(styled, report, out, json, checkpoint)


@app.command(
    epilog=examples(
        "svv render scene.svv --orbit 181 --out orbit.mp4",
        "svv render scene.svv --orbit 60 --size 400 --background white --out frames",
        "svv render scene.svv --camera camera.json --size 1280x720 --out view.png",
        "svv render scene.svv --camera views/transforms_test.json --frame 3 --out view.vti",
    )
)
def render(
    scene: SceneFile,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR|FILE", help="A folder, or .png, .vti or .mp4.")],
    orbit: Annotated[int | None, typer.Option(min=2, help="That many views on the way around the scene.")] = None,
    camera: Annotated[
        Path | None,
        typer.Option(metavar="CAMERA.json", help="One view: camera_to_world (4 x 4) and fov, or a transforms file."),
    ] = None,
    frame: Annotated[int, typer.Option(min=0, help="Which view of a transforms file.")] = 0,
    size: Annotated[str | None, typer.Option(metavar="N|WxH", help="Pixels; 800 by default.")] = None,
    network: Annotated[Network | None, typer.Option(help="By default the last one trained.")] = None,
    variant: Annotated[str | None, typer.Option(metavar="NAME", help="Which of the scene's paintings.")] = None,
    background: Annotated[
        str | None, typer.Option(metavar="COLOUR", help="white, black or '#rrggbb'; movies: white, else transparent.")
    ] = None,
    what: Annotated[What, typer.Option(help="A .vti always holds all three.")] = What.rgba,
    fps: Annotated[float, typer.Option(min=1, help="Frames a second of a movie.")] = 30.0,
    device: DeviceOption = Device.cpu,
) -> None:
    """Render a scene: an orbit as movie or frames, or one view."""
    from svv.io.camera_file import read_camera
    from svv.report import render as views

    if orbit is not None and camera is not None:
        raise BadInput("Give --orbit or --camera, not both.")
    pixels = None if size is None else parse_size(size)
    behind = None if background is None else parse_colour(background)
    one_view = out.suffix.lower() in (".png", ".vti")
    if one_view and orbit is not None:
        raise BadInput("An orbit has many views: give --out as a folder or an .mp4 file.")
    if out.suffix.lower() not in ("", ".png", ".vti", ".mp4") and out.suffix[1:].isalpha() and not out.is_dir():
        raise BadInput(f"Cannot tell what to write into {out}: name it .png or .vti (one view), .mp4, or a folder.")
    loaded = _load(scene, device)
    if variant is not None:
        if network not in (None, Network.styled):
            raise BadInput(f"A variant is a painting: leave --network {network.value} away.")
        loaded = loaded.with_variant(variant)
    width, height = pixels or (800, 800)
    if camera is not None:
        cameras = [read_camera(camera, pixels, frame)]
    elif one_view:
        cameras = [views.orbit(loaded, 181, width, height)[90]]  # the middle of the way: from the front
    else:
        cameras = views.orbit(loaded, orbit or 181, width, height)
    name = None if network is None else network.value
    with shown("Rendering") as progress:
        if one_view:
            views.write_view(out, loaded, cameras[0], name, behind, what.value, progress)
        elif out.suffix.lower() == ".mp4":
            views.write_movie(out, loaded, cameras, name, behind, what.value, fps, progress)
        else:
            views.write_frames(out, loaded, cameras, name, behind, what.value, progress)
    print(out)


@app.command(epilog=examples("svv evaluate scene.svv --views views --json scores.json"))
def evaluate(
    scene: SceneFile,
    views: Annotated[Path, typer.Option(metavar="VIEWS", help="Folder with views that were not trained on.")],
    split: Annotated[str, typer.Option(help="train, test or val.")] = "test",
    network: Annotated[Network | None, typer.Option(help="base or pcn; by default pcn.")] = None,
    device: DeviceOption = Device.cpu,
    json: Json = None,
) -> None:
    """Compare a scene with views of the volume: PSNR, SSIM, FLIP, LPIPS.

    Where the folder holds the classified volume, region_overlap says how well each region is the values that it is
    said to show: intersection over union, over all that the views show.
    """
    from svv.io.atomic import write_json
    from svv.io.viewset import ViewSet, read_classified
    from svv.train.pipeline import evaluate_scene
    from svv.train.ranges import region_overlaps

    _check_targets(json)
    loaded = _load(scene, device)
    with shown("Reading") as progress:
        view_set = ViewSet.read(views, split, progress)
    volume = read_classified(views)  # before minutes of work, should it be damaged
    with shown("Evaluating") as progress:
        scores = evaluate_scene(loaded, view_set, (network or Network.pcn).value, progress)
    if volume is not None and any(region.values for region in loaded.regions):
        scores["region_overlap"] = region_overlaps(loaded, view_set, volume)
    if json is not None:
        write_json(json, scores)
    print_table(scores)


@app.command(epilog=examples("svv info scene.svv", "svv info scene.svv --json info.json"))
def info(scene: SceneFile, json: Json = None) -> None:
    """Show what a scene holds: its regions, networks, size, and how it was made."""
    from svv.io.atomic import write_json
    from svv.report.pictures import hex_colour

    content = _load(scene).info()
    if json is not None:
        write_json(json, content)
    colours = ("colour", "edited_colour")
    regions = [{**r, **{k: hex_colour(r[k]) for k in colours if r[k]}} for r in content["regions"]]
    print_table({**content, "regions": regions})


def checkpoint_path(out: Path) -> Path:
    """Where stopped work is kept until the same command goes on with it."""
    return out.with_name(out.name + ".checkpoint")


def _check_targets(*paths: Path | None) -> None:
    """Find out before minutes of work that a result could not be written."""
    from svv.io.atomic import check_writable

    for path in paths:
        if path is not None:
            check_writable(path)


def _load(path: Path, device: Device = Device.cpu) -> Scene:
    from svv.fields.scene import Scene
    from svv.kernels.dispatch import device_named

    where = device_named(device.value)
    return Scene.load(path).on(where)


def finish(scene: Scene, report: dict[str, Any], out: Path, json: Path | None, checkpoint: Path) -> None:
    """Save a trained scene and what its training reports, then drop the checkpoint that is no longer needed."""
    from svv.io.atomic import write_json

    scene.save(out)
    report = {**report, "scene_bytes": out.stat().st_size}
    if json is not None:
        write_json(json, report)
    checkpoint.unlink(missing_ok=True)
    total, size = duration(report["seconds"]["total"]), report["scene_bytes"] / 1e6
    print(f"{out}: {size:.1f} MB, {len(scene.regions)} regions, {total}")


app.command(epilog=examples(*cli_style.STYLES))(cli_style.styles)
app.command("style-mask", epilog=examples(*cli_style.STYLE_MASK))(cli_style.style_mask)
app.command(epilog=examples(*cli_features.FEATURES))(cli_features.features)
app.command("judge-features", epilog=examples(*cli_style.JUDGE))(cli_style.judge_features)
app.command(epilog=examples(*cli_sheet.SHEET))(cli_sheet.sheet)
app.command(epilog=examples(*cli_sheet.FIGURES))(cli_sheet.figures)
app.command(epilog=examples(*cli_chart.CHART))(cli_chart.chart)
app.command(epilog=examples(*cli_stability.STABILITY))(cli_stability.stability)
app.command(epilog=examples(*cli_consistency.CONSISTENCY))(cli_consistency.consistency)
app.command(epilog=examples(*cli_consistency.COMPARE))(cli_consistency.compare_styles)
app.command(epilog=examples(*cli_consistency.ABLATE))(cli_consistency.ablate)
app.command(epilog=examples(*cli_blind.BLIND))(cli_blind.blind)
app.command(epilog=examples(*cli_profile.PROFILE))(cli_profile.profile)
app.command(epilog=examples(*cli_cache.CACHE))(cli_cache.cache)
cli_paraview.add_to(app)  # last, as in the help


def main() -> NoReturn:
    """Run the command line; what went wrong becomes one sentence and an exit code."""
    share_processors(os.environ)

    def run() -> object:
        try:
            return app(prog_name="svv", standalone_mode=False)
        except UsageError as error:
            command = error.ctx.command_path if error.ctx else "svv"
            raise BadInput(f"{error.format_message()} Try: {command} --help") from None
        except typer.Abort:
            raise Cancelled from None

    end_with(run, "svv")
