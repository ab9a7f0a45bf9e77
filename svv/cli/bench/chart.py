"""The command ``svv bench chart``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.options import (
    Encoding,
    KernelChoice,
    Lighting,
    Mapper,
    MapperOption,
    Network,
    Out,
    Preset,
    Processor,
    Views,
    parse_choices,
    parse_limits,
    parse_whole,
)
from svv.progress import duration, shown

CHART = (
    "svv bench chart views --out chart",
    "svv bench chart views head.vti --tf skin.json --presets fast,balanced --time-limits 30,120,full --out chart",
    "svv bench chart head.vti --tf skin.json --encodings lattice --sizes 200,400 --seeds 0,1,2 --out chart",
    "svv bench chart views --presets balanced,paper --encodings hash --time-limits 600 --out paper",
    "svv bench chart views --presets fast --encodings lattice --lighting network,phong --time-limits 60 --out lights",
)


def chart(
    sources: Annotated[
        list[Path], typer.Argument(metavar="VIEWS|VOLUME ...", help="Folders of views with a test split, or volumes.")
    ],
    out: Out,
    tf: Annotated[
        list[Path] | None,
        typer.Option(metavar="TF.json", help="Transfer function of a volume; one for all, or one for each in order."),
    ] = None,
    presets: Annotated[
        str, typer.Option(metavar="A,B", help="Presets, of draft, fast, balanced and paper.")
    ] = "draft,fast",
    encodings: Annotated[str, typer.Option(metavar="A,B", help="Encodings, of lattice and hash.")] = "lattice,hash",
    time_limits: Annotated[
        str,
        typer.Option(
            metavar="SECONDS,...", help="Time limits, one run for each; 'full' is the preset's whole schedule."
        ),
    ] = "15,30,60",
    sizes: Annotated[
        str | None,
        typer.Option(metavar="N,...", help="Widths of training views; by default as they are, or 400 for a volume."),
    ] = None,
    render_sizes: Annotated[
        str | None, typer.Option(metavar="N,...", help="Widths of rendered views; by default the training views'.")
    ] = None,
    devices: Annotated[str, typer.Option(metavar="A,B", help=f"Of {', '.join(d.value for d in Processor)}.")] = "cpu",
    kernels: Annotated[
        str,
        typer.Option(
            metavar="A,B", help="Kernels, of auto (numba on a CPU, Triton on a GPU) and reference (plain torch)."
        ),
    ] = "auto",
    seeds: Annotated[str, typer.Option(metavar="N,...", help="Seeds, one run for each.")] = "0",
    lighting: Annotated[
        str, typer.Option(metavar="A,B", help="Lights, of network, phong (needs the lattice) and auto; see svv train.")
    ] = "network",
    network: Annotated[Network, typer.Option(help="Which network to score: base or pcn.")] = Network.pcn,
    test: Annotated[int, typer.Option(min=5, help="Number of unseen views that are scored and timed.")] = 8,
    n: Views = 92,
    mapper: MapperOption = Mapper.auto,
) -> None:
    """Chart accuracy against time and memory for presets, encodings, sizes, devices and time limits, on your scenes.

    Every combination is trained and measured on unseen views in a process of its own. The folder gets chart.html,
    three PNG charts, runs.csv and runs.json. A volume is also rendered directly, so that its own time stands beside the
    network's. After Ctrl-C, the same command resumes.
    """
    from svv.bench.chart.job import Chart
    from svv.bench.chart.plan import Grid, Measure
    from svv.bench.chart.result import make_chart

    grid = Grid(
        parse_choices(presets, "--presets", Preset),
        parse_choices(encodings, "--encodings", Encoding),
        parse_limits(time_limits, "--time-limits"),
        (None,) if sizes is None else parse_whole(sizes, "--sizes", 16),
        (None,) if render_sizes is None else parse_whole(render_sizes, "--render-sizes", 16),
        parse_choices(devices, "--devices", Processor),
        parse_choices(kernels, "--kernels", KernelChoice),
        parse_whole(seeds, "--seeds"),
        parse_choices(lighting, "--lighting", Lighting),
    )
    plan = Chart(sources, tf or [], out, grid, Measure(test, network.value, n, mapper.value))
    left = [step for step in plan.steps if not plan.is_done(step)]
    runs, guess = sum(step.rendering is None and not step.draw for step in left), sum(step.expected for step in left)
    print(f"{runs} runs to train, about {duration(guess)}.", file=sys.stderr)

    with shown("Charting") as progress:
        page = make_chart(plan, progress)
    print(page)
