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
    from svv_bench.chart.plan import Grid

CHART = (
    "svv bench chart views --out chart",
    "svv bench chart views head.vti --tf skin.json --presets fast,balanced --time-limits 30,120,full --out chart",
    "svv bench chart head.vti --tf skin.json --encodings lattice --sizes 200,400 --seeds 0,1,2 --out chart",
    "svv bench chart views --presets balanced,paper --encodings hash --time-limits 600 --out paper",
    "svv bench chart views --presets fast --encodings lattice --lighting network,phong --time-limits 60 --out lights",
)
"""Examples in the help."""


PROCESSORS = ("cpu", "cuda")
"""Devices by name, because ``auto`` depends on the machine."""
KERNELS = ("auto", "reference")
"""Values of ``--kernels``."""


@dataclass(frozen=True)
class Axes:
    """Settings whose values are all combined with each other."""

    presets: Annotated[str, Setting(metavar="A,B")] = "draft,fast"
    """Presets: draft, fast, balanced, best, paper."""
    encodings: Annotated[str, Setting(metavar="A,B")] = "lattice,hash"
    """Encodings: lattice, hash."""
    time_limits: Annotated[str, Setting(metavar="SECONDS,...")] = "15,30,60"
    """Time limits, one run for each; 'full' is the preset's whole schedule."""
    sizes: Annotated[str | None, Setting(metavar="N,...")] = None
    """Widths of training views; by default the original width, or 400 for a volume."""
    render_sizes: Annotated[str | None, Setting(metavar="N,...")] = None
    """Widths of rendered views; by default those of the training views."""
    devices: Annotated[str, Setting(metavar="A,B")] = "cpu"
    """Devices: cpu, cuda."""
    kernels: Annotated[str, Setting(metavar="A,B")] = "auto"
    """Kernels: auto (numba on a CPU, triton on a GPU), reference (plain PyTorch)."""
    seeds: Annotated[str, Setting(metavar="N,...")] = "0"
    """Seeds, one run for each."""
    lighting: Annotated[str, Setting(metavar="A,B")] = "network"
    """Lighting: network, phong (needs the lattice), auto; see svv train."""

    def grid(self) -> Grid:
        """Return the settings in the form that the layers below take."""
        from svv_bench.chart.plan import Grid

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
    """The network and views with which each combination is scored."""

    network: NetworkName = "pcn"
    """Network to score: base or pcn."""
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

    Each combination is trained and scored on unseen views in a process of its own. The results are chart.html, three
    PNG charts, runs.csv and runs.json. A volume is also rendered directly, to compare times. After Ctrl-C, the same
    command resumes.
    """
    from svv_bench.chart.job import Chart
    from svv_bench.chart.plan import Measure
    from svv_bench.chart.result import make_chart

    measure = Measure(scored.test, scored.network, scored.n, scored.mapper)
    plan = Chart(sources, tf or [], out, axes.grid(), measure)
    left = [step for step in plan.steps if not plan.is_done(step)]
    runs, guess = sum(step.rendering is None and not step.draw for step in left), sum(step.expected for step in left)
    print(f"{runs} runs to train, about {duration(guess)}.", file=sys.stderr)

    with shown("Charting") as progress:
        page = make_chart(plan, progress)
    print(page)
