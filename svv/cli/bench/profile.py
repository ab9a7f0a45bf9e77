"""The command ``svv bench profile``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.options import Json, Preset, PresetOption, Seed
from svv.progress import shown

PROFILE = (
    "svv bench profile views",
    "svv bench profile views --preset balanced --steps 400 --json profile.json",
)


def profile(
    views: Annotated[Path, typer.Argument(metavar="VIEWS", help="Folder with transforms_train.json and its images.")],
    preset: PresetOption = Preset.fast,
    steps: Annotated[int, typer.Option(min=8, help="Steps of stage 1; stage 2 takes half as many.")] = 200,
    timed: Annotated[
        int, typer.Option(min=1, help="Number of steps of each kind, and of images, that are timed.")
    ] = 15,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Show where the time of training and rendering goes on this CPU, beside the least that it could take.

    Trains for some steps and renders an image. For each part: milliseconds, bytes that must move, operations, and the
    lower bound that follows from the machine's measured peak rates.
    """
    # Torch's profiler would say on standard error when it starts and stops; it asks for this as torch is loaded.
    os.environ.setdefault("KINETO_LOG_LEVEL", "5")
    from svv.bench.profile.profile import profile_views
    from svv.bench.profile.table import as_text
    from svv.io.atomic import check_writable, write_json
    from svv.io.viewset import ViewSet

    if json is not None:
        check_writable(json)
    with shown("Reading") as progress:
        view_set = ViewSet.read(views, "train", progress)
    with shown("Profiling") as progress:
        found = profile_views(view_set, preset.value, steps, timed, seed, progress)
    if json is not None:
        plain = {k: v for k, v in found.items() if k not in ("profiles", "ceilings")}
        plain["ceilings"] = found["ceilings"].to_json()
        write_json(json, {**plain, "profiles": [p.to_json() for p in found["profiles"]]})
    print(as_text(found["profiles"], found["ceilings"]))
