"""The command ``svv bench stability``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from svv.cli.options import Preset
from svv.errors import BadInput
from svv.progress import shown

STABILITY = (
    "svv bench stability",
    "svv bench stability --case nested --case wires --seeds 2",
    "svv bench stability --preset draft --preset fast --preset paper --size 400 --time-limit 60 --out stable",
    "svv bench stability --steps draft=300+150 --steps paper=60+40 --samples 8192",
    "svv bench stability --case 'regions-*' --preset draft --seeds 1",
    "svv bench stability --list",
)


def stability(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of the results.")] = Path("stability"),
    case: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="A case, or a pattern of names; may be repeated. By default all but 'regions-*'.",
        ),
    ] = None,
    preset: Annotated[
        list[Preset] | None,
        typer.Option(help="A preset; may be repeated. By default draft and paper."),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each case, with the seeds 0, 1, ...")] = 5,
    n: Annotated[int, typer.Option("--n", min=3, help="Number of training views, unless the case is about them.")] = 92,
    test: Annotated[int, typer.Option("--test", min=2, help="Number of test views.")] = 6,
    size: Annotated[int, typer.Option("--size", min=64, help="Width and height of the views in pixels.")] = 200,
    resolution: Annotated[int, typer.Option(min=24, help="Voxels along each side of the volumes.")] = 64,
    time_limit: Annotated[
        float, typer.Option(metavar="SECONDS", min=1, help="Training time of each run, the same for every preset.")
    ] = 15.0,
    steps: Annotated[
        list[str] | None,
        typer.Option(metavar="PRESET=A+B", help="Steps of the two stages instead of a time limit: draft=300+150."),
    ] = None,
    samples: Annotated[int | None, typer.Option(min=512, help="Most visible samples per step.")] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the cases and exit.")] = False,
) -> None:
    """Train on generated scenes with known truth, where methods of this kind fail, and report what failed.

    Each run is a file; after Ctrl-C, the same command resumes. The result is a table
    (stability.md, .csv, .json) and a heat map (stability.png).
    """
    from svv.bench.charts import need_matplotlib
    from svv.bench.stability.cases import CASES, USUAL, BenchSettings
    from svv.bench.stability.runs import Matrix, run_stability
    from svv.bench.stability.table import FILES, write_summary

    if listed:
        wide = max(map(len, CASES))
        print("\n".join(f"{name:<{wide}}  {one.title}" for name, one in CASES.items()))
        return
    need_matplotlib()
    names = [p.value for p in dict.fromkeys(preset or (Preset.draft, Preset.paper))]
    matrix = Matrix(tuple(case or USUAL), names, seeds)
    settings = BenchSettings(n, test, size, resolution, time_limit, tuple(map(parse_steps, steps or ())), samples)
    with shown("Stability") as progress:
        records = run_stability(out, matrix, settings, progress)
    rows = write_summary(out, records)
    for row in rows:
        if row.failed:
            what = ", ".join(f"{word} ({count}/{row.runs})" for word, count in row.failed.items())
            print(f"{CASES[row.case].title}, {row.preset}: {what}")
    print(f"{len(records)} runs: {', '.join(str(out / name) for name in FILES)}")


def parse_steps(text: str) -> tuple[str, int, int]:
    """'draft=300+150' as (preset, steps of stage 1, of stage 2).

    Raises:
        BadInput: anything else.
    """
    name, _, numbers = text.partition("=")
    parts = numbers.split("+")
    if name in Preset.__members__ and len(parts) == 2 and all(p.isascii() and p.isdigit() and int(p) for p in parts):
        return name, int(parts[0]), int(parts[1])
    raise BadInput(f"'{text}' are no steps; write PRESET=A+B, for example --steps draft=300+150.")
