"""The command ``svv bench chart``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from svv.cli.option_group import spread
from svv.cli.options import Out, parse_choices, parse_limits, parse_whole
from svv.options.described import Setting
from svv.options.making import LIGHTINGS, PRESET_NAMES, EncodingName, MapperName, NetworkName
from svv.progress import duration, shown

if TYPE_CHECKING:
    from svv.bench.chart.plan import Grid

CHART = (
    "svv bench chart views --out chart",
    "svv bench chart views head.vti --tf skin.json --presets fast,balanced --time-limits 30,120,full --out chart",
    "svv bench chart head.vti --tf skin.json --encodings lattice --sizes 200,400 --seeds 0,1,2 --out chart",
    "svv bench chart views --presets balanced,paper --encodings hash --time-limits 600 --out paper",
    "svv bench chart views --presets fast --encodings lattice --lighting network,phong --time-limits 60 --out lights",
)


PROCESSORS = ("cpu", "cuda")
"""Devices by name, for ``auto`` would be another one on another machine."""
KERNELS = ("auto", "reference")


@dataclass(frozen=True)
class Axes:
    """What is combined: every value of one with every value of the others."""

    presets: Annotated[str, Setting(metavar="A,B")] = "draft,fast"
    """Presets, of draft, fast, balanced and paper."""
    encodings: Annotated[str, Setting(metavar="A,B")] = "lattice,hash"
    """Encodings, of lattice and hash."""
    time_limits: Annotated[str, Setting(metavar="SECONDS,...")] = "15,30,60"
    """Time limits, one run for each; 'full' is the preset's whole schedule."""
    sizes: Annotated[str | None, Setting(metavar="N,...")] = None
    """Widths of training views; by default as they are, or 400 for a volume."""
    render_sizes: Annotated[str | None, Setting(metavar="N,...")] = None
    """Widths of rendered views; by default the training views'."""
    devices: Annotated[str, Setting(metavar="A,B")] = "cpu"
    """Devices, of cpu and cuda."""
    kernels: Annotated[str, Setting(metavar="A,B")] = "auto"
    """Kernels, of auto (numba on a CPU, Triton on a GPU) and reference (plain torch)."""
    seeds: Annotated[str, Setting(metavar="N,...")] = "0"
    """Seeds, one run for each."""
    lighting: Annotated[str, Setting(metavar="A,B")] = "network"
    """Lights, of network, phong (needs the lattice) and auto; see svv train."""

    def grid(self) -> Grid:
        """As the layers below take them."""
        from svv.bench.chart.plan import Grid

        return Grid(
            parse_choices(self.presets, "--presets", PRESET_NAMES),
            parse_choices(self.encodings, "--encodings", get_args(EncodingName)),
            parse_limits(self.time_limits, "--time-limits"),
            (None,) if self.sizes is None else parse_whole(self.sizes, "--sizes", 16),
            (None,) if self.render_sizes is None else parse_whole(self.render_sizes, "--render-sizes", 16),
            parse_choices(self.devices, "--devices", PROCESSORS),
            parse_choices(self.kernels, "--kernels", KERNELS),
            parse_whole(self.seeds, "--seeds"),
            parse_choices(self.lighting, "--lighting", LIGHTINGS),
        )


@dataclass(frozen=True)
class Scored:
    """What is measured of each combination, and on which views."""

    network: NetworkName = "pcn"
    """Which network to score: base or pcn."""
    test: Annotated[int, Setting(least=5)] = 8
    """Number of unseen views that are scored and timed."""
    n: Annotated[int, Setting(least=3)] = 92
    """Number of training views of a volume."""
    mapper: MapperName = "auto"
    """VTK's ray caster; auto picks the GPU if OpenGL runs on hardware."""


@spread
def chart(
    sources: Annotated[
        list[Path], typer.Argument(metavar="VIEWS|VOLUME ...", help="Folders of views with a test split, or volumes.")
    ],
    out: Out,
    tf: Annotated[
        list[Path] | None,
        typer.Option(metavar="TF.json", help="Transfer function of a volume; one for all, or one for each in order."),
    ] = None,
    axes: Axes = Axes(),
    scored: Scored = Scored(),
) -> None:
    """Chart accuracy against time and memory for presets, encodings, sizes, devices and time limits, on your scenes.

    Every combination is trained and measured on unseen views in a process of its own. The folder gets chart.html,
    three PNG charts, runs.csv and runs.json. A volume is also rendered directly, so that its own time stands beside the
    network's. After Ctrl-C, the same command resumes.
    """
    from svv.bench.chart.job import Chart
    from svv.bench.chart.plan import Measure
    from svv.bench.chart.result import make_chart

    measure = Measure(scored.test, scored.network, scored.n, scored.mapper)
    plan = Chart(sources, tf or [], out, axes.grid(), measure)
    left = [step for step in plan.steps if not plan.is_done(step)]
    runs, guess = sum(step.rendering is None and not step.draw for step in left), sum(step.expected for step in left)
    print(f"{runs} runs to train, about {duration(guess)}.", file=sys.stderr)

    with shown("Charting") as progress:
        page = make_chart(plan, progress)
    print(page)
