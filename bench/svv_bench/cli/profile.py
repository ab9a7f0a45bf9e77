"""The command ``svv bench profile``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.option_group import spread
from svv.cli.options import Json
from svv.options.described import Setting
from svv.options.making import PresetName
from svv.progress import shown
from svv_bench.results import record

PROFILE = (
    "svv bench profile views",
    "svv bench profile views --preset balanced --steps 400 --json profile.json",
)
"""Examples in the help."""


@dataclass(frozen=True)
class Profiling:
    """Preset, steps and seed of the run that is timed."""

    preset: PresetName = "fast"
    """Preset whose settings are used."""
    steps: Annotated[int, Setting(least=8)] = 200
    """Steps of stage 1; stage 2 takes half as many."""
    timed: Annotated[int, Setting(least=1)] = 15
    """Number of steps of each kind, and of images, that are timed."""
    seed: Annotated[int, Setting(least=0)] = 0
    """The same seed gives the same result."""


@spread
def profile(
    views: Annotated[
        Path,
        typer.Argument(metavar="VIEWS", help="Folder with transforms_train.json or transforms.json, and its images."),
    ],
    how: Profiling = Profiling(),
    json: Json = None,
) -> None:
    """Show where the time of training and rendering goes on this CPU, compared with the least it could take.

    It trains for some steps and renders an image. For each part, it prints milliseconds, bytes moved, operations, and
    the lower bound by the machine's measured peak rates.
    """
    # Otherwise PyTorch's profiler logs its start and stop to standard error; it reads this when torch is imported.
    os.environ.setdefault("KINETO_LOG_LEVEL", "5")
    from svv.io.files.atomic import check_writable, write_json
    from svv.io.views.viewset import ViewSet
    from svv_bench.profile.profile import profile_views
    from svv_bench.profile.table import as_text, figures

    if json is not None:
        check_writable(json)
    with shown("Reading") as progress:
        view_set = ViewSet.read(views, "train", progress)
    with shown("Profiling") as progress:
        found = profile_views(view_set, how.preset, how.steps, how.timed, how.seed, progress)
    if json is not None:
        plain = {k: v for k, v in found.items() if k not in ("profiles", "ceilings")}
        plain["ceilings"] = found["ceilings"].to_json()
        write_json(json, {**plain, "profiles": [p.to_json() for p in found["profiles"]]})
    print(as_text(found["profiles"], found["ceilings"]))
    record(figures(found["profiles"]))
