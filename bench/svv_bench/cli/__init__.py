"""``svv bench``: the commands that measure the rest of the package, one module per group."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.options import examples
from svv_bench import results
from svv_bench.cli import blind, chart, gpu, legibility, profile, sheets, stability, styles

app = typer.Typer(name="bench", no_args_is_help=True)

COMMANDS: dict[str, tuple[Callable[..., None], Sequence[str]]] = {
    "chart": (chart.chart, chart.CHART),
    "stability": (stability.stability, stability.STABILITY),
    "profile": (profile.profile, profile.PROFILE),
    "gpu": (gpu.gpu, gpu.GPU),
    "consistency": (styles.consistency, styles.CONSISTENCY),
    "compare": (styles.compare, styles.COMPARE),
    "ablate": (styles.ablate, styles.ABLATE),
    "sheet": (sheets.sheet, sheets.SHEET),
    "figures": (sheets.figures, sheets.FIGURES),
    "blind": (blind.blind, blind.BLIND),
    "legibility": (legibility.legibility, legibility.LEGIBILITY),
    "volumes": (legibility.volumes, legibility.VOLUMES),
    "tasks": (legibility.tasks, legibility.TASKS),
}
"""Each command's name, its function and the examples in its help, in the order of the help."""


@app.callback(
    epilog=examples(
        "svv bench chart views --out chart", "svv bench consistency styled.svv --out frames",
        "svv bench --results results.csv stability --preset fast --out stable",
    )
)  # fmt: skip
def bench(
    context: typer.Context,
    into: Annotated[
        Path | None,
        typer.Option(
            "--results", metavar="FILE.csv", help="Append what the command measures to a file, one row a figure."
        ),
    ] = None,
) -> None:
    """Measure accuracy against time, stability, consistency between frames, and the effect of each part."""
    if into is not None:
        from svv.io.files.atomic import check_writable

        if into.exists():
            results.read(into)
        check_writable(into)
        token = results.FILE.set(into)
        context.call_on_close(lambda: results.FILE.reset(token))


for _name, (_command, _examples) in COMMANDS.items():
    app.command(_name, epilog=examples(*_examples))(_command)
