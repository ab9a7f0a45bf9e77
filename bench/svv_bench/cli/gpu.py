"""The command ``svv bench gpu``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from svv.cli.option_group import spread
from svv.options.described import Setting
from svv.progress import shown
from svv_bench.results import record

GPU = (
    "svv bench gpu --out gpu",
    "svv bench gpu --views views --time-limit 300 --out gpu",
    "svv bench gpu --short",
    "svv bench gpu --device cpu --shrink 4 --out cpu",
)
"""Examples in the help."""


@dataclass(frozen=True)
class Measuring:
    """What `svv bench gpu` measures, and how long."""

    device: Literal["cuda", "cpu"] = "cuda"
    """Device that is measured; cpu measures the CPU, to compare or to try the command."""
    time_limit: Annotated[float, Setting(least=10, metavar="SECONDS")] = 480.0
    """Seconds for all parts together; those for which no time is left are left out."""
    size: Annotated[int, Setting(least=32, most=4096)] = 800
    """Width and height of the views that are drawn if no folder is given."""
    shrink: Annotated[int, Setting(least=1, most=16)] = 1
    """Use every how many pixels of the views along each axis."""
    steps: Annotated[float, Setting(least=0.01, most=10)] = 1.0
    """Factor on the steps of all trainings."""
    parts: Annotated[str, Setting(metavar="A,B")] = "all"
    """Parts to measure, in their order here: versions, kernels, train, compare, images, paint, chart, profile, poison,
    memory and two_cards."""


@spread
def gpu(
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the page, the results and the traces.")
    ] = None,
    views: Annotated[
        Path | None,
        typer.Option(
            "--views", metavar="VIEWS",
            help="Folder of views with a training and a test split; by default, views of a generated volume are drawn.",
        ),
    ] = None,
    short: Annotated[
        bool, typer.Option("--short", help="Only check the kernels, as on the GPU's first use, and keep the result.")
    ] = False,
    how: Measuring = Measuring(),
) -> None:  # fmt: skip
    """Check the kernels on this GPU against plain torch, and time training, images and painting on it and on the CPU.

    Each part runs in a process of its own, so that a fault ends only that part. Results are results.jsonl, tests.log
    and traces, as they come, and report.html. Needs neither VTK nor a network.
    """
    from svv.errors import BadInput
    from svv.fields.devices.gpu import device_named

    device = device_named(how.device)
    if short:
        _check(device)
        return
    if out is None:
        raise BadInput("Name a folder for the results with --out, or give --short.")
    from svv.io.files.atomic import make_folder
    from svv.io.views.transforms import transforms_file
    from svv_bench.gpu.context import Context, draw_views, read_results
    from svv_bench.gpu.page import figures, write_report, wrong_kernels
    from svv_bench.gpu.parts import parts_named, run_parts

    make_folder(out)
    folder = views or out / "views"
    if views is None and transforms_file(folder, "test") is None:
        with shown("Drawing views"):
            draw_views(folder, how.size)
    for split in ("train", "test"):
        if transforms_file(folder, split) is None:
            raise BadInput(f"{folder} has no {split} views; `svv views` draws both splits.")
    chosen = parts_named(how.parts)
    context = Context(out, folder, how.device, how.shrink, how.steps)
    try:
        with shown("Measuring") as progress:
            run_parts(context, how.time_limit, progress, chosen)
    finally:
        page = write_report(out)
    measured = read_results(out)
    record(figures(measured))
    wrong = wrong_kernels(measured)
    print(page)
    if wrong:
        raise BadInput(f"{len(wrong)} kernels differ from plain torch on this device: {', '.join(wrong)}; see {page}.")


def _check(device: Any) -> None:
    """Check the kernels on a device and keep the result."""
    from svv.errors import BadInput
    from svv.fields.devices.gpu import check_gpu

    if device.type != "cuda":
        raise BadInput("Only a GPU is checked: leave out --device.")
    verdict = check_gpu(device)
    if not verdict.passed:
        raise BadInput(f"The GPU cannot be trusted: {verdict.reason}.")
    print(verdict.reason)
