"""The commands that train a scene on views, score it and show its contents; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from svv.cli.files import check_targets, finish, load
from svv.cli.option_group import spread
from svv.cli.options import Json, Out, SceneFile
from svv.cli.table import print_table
from svv.errors import BadInput, Progress, part
from svv.options.making import DeviceName, NetworkName, TrainOptions
from svv.progress import shown

if TYPE_CHECKING:
    from svv.io.views.viewset import ViewSet

TRAIN = (
    "svv train views --out scene.svv",
    "svv train views -o scene.svv --preset fast --json f.json",
    "svv train views -o scene.svv --sketch",
    "torchrun --nproc-per-node 4 -m svv train views -o scene.svv",
)
EVALUATE = ("svv evaluate scene.svv --views views --json scores.json",)
INFO = ("svv info scene.svv", "svv info scene.svv --json info.json")


@spread
def train(
    views: Annotated[
        Path,
        typer.Argument(
            metavar="VIEWS",
            help="Folder with transforms_train.json or transforms.json, and its images, or a Cinema database.",
        ),
    ],
    out: Out,
    options: TrainOptions = TrainOptions(),
    sketch: Annotated[
        bool, typer.Option("--sketch", help="First write sketches to OUT.sketch, which svv view --follow OUT shows.")
    ] = False,
    json: Json = None,
) -> None:
    """Train a scene on views.

    Training starts from the volume's extinction, which `svv views` stores. With --views-only, or without a volume,
    everything is learned from views. A folder with the views of several transfer functions, arrays or volumes gives one
    scene of all, with named regions, and one of each beside it. After Ctrl-C, the same command resumes. torchrun trains
    with several processes on one machine or more.
    """
    from svv.fields.devices.gpu import device_named
    from svv.fields.scene.joined import joined, named
    from svv.io.cinema.views import read_views
    from svv.io.scene_file import checkpoint_of, sketch_of
    from svv.io.views.empty_views import check_shown, empty_views
    from svv.io.views.equal_views import equal_views
    from svv.job.request import Request, learn
    from svv.measure import use_little_memory
    from svv.train.run import ranks
    from svv.train.run.config import settings_of

    def read(folder: Path) -> ViewSet:
        check_targets(out, json)
        settings_of(options)  # errors in the options are reported before the views are read
        device_named(options.device)
        with shown("Reading") as progress:
            view_set = read_views(folder, "train", progress)
        assumed, empty = view_set.meta.assumed, check_shown(view_set)
        for said in (assumed, equal_views(view_set), None if assumed and empty and empty in assumed else empty):
            if said is not None:
                print(said, file=sys.stderr)
        return view_set

    use_little_memory()
    folders = _folders(views)
    files = {folder: out if len(folders) < 2 else out.with_name(f"{out.stem}.{folder.name}.svv") for folder in folders}
    made = []
    with ranks.joined(options.device):
        for folder, file in files.items():
            view_set = ranks.once(lambda folder=folder: read(folder))  # type: ignore[misc]
            with shown("Training", quiet=not ranks.is_first()) as progress:
                if sketch and len(files) == 1 and ranks.is_first() and not checkpoint_of(file).exists():
                    _sketch(view_set, options, file, progress)
                made.append(learn(Request(view_set, train=options), progress, checkpoint_of(file)))
            if ranks.is_first():
                for said in set(made[-1][1]["warnings"]) - {equal_views(view_set), empty_views(view_set)}:
                    print(said, file=sys.stderr)
        if ranks.is_first():
            for (scene, report), file in zip(made, files.values(), strict=True):
                told = json if json is None or file == out else json.with_name(f"{json.stem}.{file.stem}{json.suffix}")
                finish(scene, report, file, told, checkpoint_of(file))
                sketch_of(file).unlink(missing_ok=True)
            if len(made) > 1:
                joined([named(scene, folder.name) for folder, (scene, _) in zip(folders, made, strict=True)]).save(out)
                print(f"{out}: the scenes of {len(made)} layers")


def _sketch(views: ViewSet, options: TrainOptions, file: Path, progress: Progress) -> None:
    """Write sketches of a scene beside its file; if one cannot be trained, the training itself says why."""
    from svv.io.scene_file import sketch_of
    from svv.train.value_sketch import sketches_of

    with suppress(BadInput):
        for scene in sketches_of(views, options, part(progress, 0.0, 0.02)):
            scene.save(sketch_of(file))


def _folders(views: Path) -> list[Path]:
    """Return the folders of views in a folder: itself, or those of several transfer functions."""
    from svv.io.views.transforms import transforms_file

    if not views.is_dir() or transforms_file(views, "train") is not None:
        return [views]
    inside = sorted(path for path in views.iterdir() if path.is_dir() and transforms_file(path, "train") is not None)
    return inside if len(inside) > 1 else [views]


SEEN = (
    "{views} has no test views, so these are scores on the training views, which are better than on views that were "
    "not trained on: move every eighth frame of transforms_train.json to transforms_test.json, and train again."
)


def _has_test(views: Path) -> bool:
    """Return whether a folder of views, or a Cinema database, may have views for measuring."""
    from svv.io.cinema.table import is_database
    from svv.io.views.transforms import transforms_file

    folder = is_database(views) or transforms_file(views, "train") is None  # without any, reading says what is missing
    return folder or transforms_file(views, "test") is not None


@dataclass(frozen=True)
class Scoring:
    """Views, network and device with which a scene is scored."""

    split: str | None = None
    """Split of the views: train, test or val; by default test, or train if there is none, which is said."""
    network: NetworkName | None = None
    """Network to score, base or pcn; by default pcn."""
    device: DeviceName = "auto"
    """Where to run; auto takes a GPU whose kernels pass a check, 25 s on its first use, otherwise the CPU."""


@spread
def evaluate(
    scene: SceneFile,
    views: Annotated[
        Path, typer.Option("--views", metavar="VIEWS", help="Folder with views that were not trained on.")
    ],
    scoring: Scoring = Scoring(),
    json: Json = None,
) -> None:
    """Score a scene against views of the volume: PSNR, SSIM, FLIP and LPIPS.

    If the folder contains the classified volume, region_overlap is the intersection over union of each region with its
    range of values, over all that the views show; regions found in views alone are matched to ranges first. LPIPS needs
    weights (`svv features --get alexnet`). doubt_rank, doubt_area and doubt_ratio say how well the scene knows its
    errors: rank correlation, sparsification error, and the mean expected error divided by the true one.
    """
    from svv.io.cinema.views import read_views
    from svv.io.files.atomic import write_json
    from svv.io.views.viewset import read_classified
    from svv.styles.weights import NO_LPIPS
    from svv.train.doubt_scores import doubt_scores
    from svv.train.evaluate import check_views
    from svv.train.palette.ranges import region_overlaps
    from svv.train.pipeline import evaluate_scene

    check_targets(json)
    loaded = load(scene, scoring.device)
    with shown("Reading") as progress:
        split = scoring.split or ("test" if _has_test(views) else "train")
        view_set = read_views(views, split, progress)
    if scoring.split is None and split == "train":
        print(SEEN.format(views=views), file=sys.stderr)
    volume = read_classified(views)  # before minutes of work, in case it is damaged
    for said in check_views(loaded, view_set):
        print(said, file=sys.stderr)
    with shown("Evaluating") as progress:
        scores = evaluate_scene(loaded, view_set, scoring.network or "pcn", progress)
    if volume is not None and loaded.palette_network is not None:
        scores = replace(scores, region_overlap=tuple(region_overlaps(loaded, view_set, volume)))
    told = scores.to_json()
    if loaded.expected is not None and not loaded.layers:
        with shown("Evaluating") as progress:
            told |= doubt_scores(loaded, view_set, progress).to_json()
    if json is not None:
        write_json(json, told)
    print_table(told)
    if scores.lpips is None:
        print(NO_LPIPS, file=sys.stderr)


def info(scene: SceneFile, json: Json = None) -> None:
    """Show what a scene contains: its regions, networks and size, and how it was made."""
    from svv.core.colour.hex_codes import to_hex
    from svv.fields.scene.region import Region
    from svv.io.files.atomic import write_json
    from svv.io.scene_file import read_scene_info

    content = read_scene_info(scene) or load(scene).info()
    if json is not None:
        write_json(json, content)
    colours, usual = ("colour", "edited_colour"), {field.name: _plain(field.default) for field in fields(Region)}
    regions = [
        {
            k: to_hex(v) if k in colours else v
            for k, v in {"name": None, **r}.items()
            if _plain(v) not in (None, "", usual.get(k))
        }
        for r in content["regions"]
    ]
    print_table(_axis_by_axis({**content, "regions": regions}))


def _plain(value: object) -> object:
    """Return a value as JSON has it: tuples are lists."""
    return list(value) if isinstance(value, tuple) else value


def _axis_by_axis(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is to be printed, with bounds, of the scene and of its views, as ParaView has them: by axes."""
    told = {name: _axis_by_axis(value) if isinstance(value, dict) else value for name, value in content.items()}
    if told.get("bounds"):
        told["bounds"] = {x: f"{low:.4g} to {high:.4g}" for x, low, high in zip("xyz", *told["bounds"], strict=True)}
    return told
