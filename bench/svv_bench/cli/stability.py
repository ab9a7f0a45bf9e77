"""The command ``svv bench stability``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.option_group import spread
from svv.errors import BadInput
from svv.options.described import Setting
from svv.options.making import PRESET_NAMES, PresetName
from svv.progress import shown
from svv_bench.results import record

if TYPE_CHECKING:
    from svv_bench.stability.cases import BenchSettings

STABILITY = (
    "svv bench stability",
    "svv bench stability --case nested --case wires --seeds 2",
    "svv bench stability --preset draft --preset paper --size 400 --time-limit 60 --out stable",
    "svv bench stability --steps draft=300+150 --steps paper=60+40 --samples 8192",
    "svv bench stability --case 'regions-*' --case '*-views' --preset draft --seeds 1",
    "svv bench stability --list",
)
"""Examples in the help."""


@dataclass(frozen=True)
class Runs:
    """Cases to run, and the number and size of their runs."""

    case: Annotated[tuple[str, ...], Setting(metavar="NAME")] = ()
    """A case, or a pattern of names; by default all except 'regions-*'."""
    preset: tuple[PresetName, ...] = ()
    """A preset; by default fast and balanced."""
    seeds: Annotated[int, Setting(least=1)] = 5
    """Runs of each case, with the seeds 0, 1, ..."""
    n: Annotated[int, Setting(least=3)] = 92
    """Number of training views, except for cases that vary it."""
    test: Annotated[int, Setting(least=2)] = 6
    """Number of test views."""
    size: Annotated[int, Setting(least=64)] = 200
    """Width and height of the views in pixels."""
    resolution: Annotated[int, Setting(least=24)] = 64
    """Voxels along each side of the volumes."""
    time_limit: Annotated[float | None, Setting(least=1, metavar="SECONDS")] = None
    """Training time of each run, the same for every preset; by default each preset has its own steps."""
    steps: Annotated[tuple[str, ...], Setting(metavar="PRESET=A+B")] = ()
    """Steps of the two stages, such as draft=300+150."""
    samples: Annotated[int | None, Setting(least=512)] = None
    """Maximum number of visible samples per step."""

    def settings(self) -> BenchSettings:
        """Return the settings in the form that the layers below take."""
        from svv_bench.stability.cases import BenchSettings

        steps = tuple(map(parse_steps, self.steps))
        return BenchSettings(self.n, self.test, self.size, self.resolution, self.time_limit, steps, self.samples)


@spread
def stability(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of the results.")] = Path("stability"),
    runs: Runs = Runs(),
    listed: Annotated[bool, typer.Option("--list", help="List the cases and exit.")] = False,
) -> None:
    """Train on generated scenes that are known to be hard, compare with the ground truth and report failures.

    The results are a table (stability.md, .csv, .json) and a heat map (stability.png). Each run is kept in a file;
    after Ctrl-C, the same command resumes.
    """
    import svv.dvr  # noqa: F401  # says how to get VTK
    from svv_bench.charts import need_matplotlib
    from svv_bench.stability.cases import CASES, USUAL
    from svv_bench.stability.runs import Matrix, run_stability
    from svv_bench.stability.table import FILES, figures, write_summary

    if listed:
        wide = max(map(len, CASES))
        print("\n".join(f"{name:<{wide}}  {one.title}" for name, one in CASES.items()))
        return
    need_matplotlib()
    matrix = Matrix(runs.case or USUAL, list(dict.fromkeys(runs.preset or ("fast", "balanced"))), runs.seeds)
    settings = runs.settings()
    with shown("Stability") as progress:
        records = run_stability(out, matrix, settings, progress)
    rows = write_summary(out, records)
    record(figures(rows))
    for row in rows:
        if row.failed:
            what = ", ".join(f"{word} ({count}/{row.runs})" for word, count in row.failed.items())
            print(f"{CASES[row.case].title}, {row.preset}: {what}")
    print(f"{len(records)} runs: {', '.join(str(out / name) for name in FILES)}")


def parse_steps(text: str) -> tuple[str, int, int]:
    """Return 'draft=300+150' as (preset, steps of stage 1, steps of stage 2).

    Raises:
        BadInput: The text has another form.
    """
    name, _, numbers = text.partition("=")
    parts = numbers.split("+")
    if name in PRESET_NAMES and len(parts) == 2 and all(p.isascii() and p.isdigit() and int(p) for p in parts):
        return name, int(parts[0]), int(parts[1])
    raise BadInput(f"'{text}' does not give steps; write PRESET=A+B, for example --steps draft=300+150.")
