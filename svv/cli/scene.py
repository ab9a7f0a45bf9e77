"""The commands that make a scene from views, measure it and say what it holds; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.files import check_targets, checkpoint_path, finish, load
from svv.cli.options import (
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
)
from svv.cli.table import print_table
from svv.progress import shown

TRAIN = (
    "svv train views --out scene.svv",
    "svv train views -o scene.svv --preset fast --json f.json",
)
"""Examples of the help."""
EVALUATE = ("svv evaluate scene.svv --views views --json scores.json",)
"""Examples of the help."""
INFO = (
    "svv info scene.svv",
    "svv info scene.svv --json info.json",
)
"""Examples of the help."""


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
        bool, typer.Option("--views-only", help="Learn from the images alone, even if the folder knows its volume.")
    ] = False,
    json: Json = None,
) -> None:
    """Train a scene on views.

    Views made by `svv views` carry the volume's extinction, and training starts from it. For other views, the
    extinction is learned as well. After Ctrl-C, the same command resumes.
    """
    from svv.io.viewset import ViewSet
    from svv.kernels.dispatch import device_named
    from svv.train import config
    from svv.train.pipeline import train_scene

    check_targets(out, json)
    where = device_named(device.value)
    name = None if encoding is None else encoding.value
    config.lit_by(config.preset(preset.value, name), lighting.value)  # said before the views are read
    with shown("Reading") as progress:
        view_set = ViewSet.read(views, "train", progress)
    if view_set.meta.assumed is not None:
        print(view_set.meta.assumed, file=sys.stderr)
    if views_only:
        view_set = replace(view_set, classified=None)
    checkpoint = checkpoint_path(out)
    with shown("Training") as progress:
        scene, report = train_scene(
            view_set, preset.value, time_limit, seed, progress, checkpoint, where, name, lighting.value
        )
    finish(scene, report, out, json, checkpoint)


def evaluate(
    scene: SceneFile,
    views: Annotated[Path, typer.Option(metavar="VIEWS", help="Folder with views that were not trained on.")],
    split: Annotated[str, typer.Option(help="Which views of the folder: train, test or val.")] = "test",
    network: Annotated[
        Network | None, typer.Option(help="Which network to score: base or pcn, by default pcn.")
    ] = None,
    device: DeviceOption = Device.cpu,
    json: Json = None,
) -> None:
    """Score a scene against views of the volume: PSNR, SSIM, FLIP and LPIPS.

    If the folder holds the classified volume, region_overlap says how well each region matches the values that it
    stands for: the intersection over union, over all that the views show.
    """
    from svv.io.atomic import write_json
    from svv.io.viewset import ViewSet, read_classified
    from svv.train.pipeline import evaluate_scene
    from svv.train.ranges import region_overlaps

    check_targets(json)
    loaded = load(scene, device)
    with shown("Reading") as progress:
        view_set = ViewSet.read(views, split, progress)
    volume = read_classified(views)  # before minutes of work, should it be damaged
    with shown("Evaluating") as progress:
        scores = evaluate_scene(loaded, view_set, (network or Network.pcn).value, progress)
    if volume is not None and any(region.values for region in loaded.regions):
        scores = replace(scores, region_overlap=tuple(region_overlaps(loaded, view_set, volume)))
    if json is not None:
        write_json(json, scores.to_json())
    print_table(scores.to_json())


def info(scene: SceneFile, json: Json = None) -> None:
    """Show what a scene contains: its regions, networks and size, and how it was made."""
    from svv.io.atomic import write_json
    from svv.render.pictures import hex_colour

    content = load(scene).info()
    if json is not None:
        write_json(json, content)
    colours = ("colour", "edited_colour")
    regions = [{**r, **{k: hex_colour(r[k]) for k in colours if r[k]}} for r in content["regions"]]
    print_table({**content, "regions": regions})
