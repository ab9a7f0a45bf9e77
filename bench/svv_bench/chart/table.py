"""The table of all runs, one row per run and rendered size, and the runs that no other run beats."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from svv.io.files.atomic import atomic_path, write_json

LIMIT_REACHED = 0.1
"""Relative difference from the time limit up to which a training counts as having reached it."""


@dataclass(frozen=True)
class Row:
    """A run at one rendered size; the names of the fields are the columns of the CSV file."""

    scene: str
    preset: str
    encoding: str
    lighting: str
    """Requested lighting: network, phong or auto."""
    light: str
    """Lighting of the scene: network, phong, or none if the views show no light."""
    train_size: int
    """Width of the training views in pixels."""
    render_size: int
    """Width of the rendered views in pixels."""
    time_limit: float | None
    """Time limit of training in seconds; None for the preset's whole schedule."""
    device: str
    kernels: str
    """Kernels that ran: numba, triton or torch."""
    seed: int
    network: str
    psnr: float
    """PSNR over white in dB, mean over the unseen views."""
    psnr_foreground: float
    """PSNR in dB over the pixels whose true alpha is above 0."""
    ssim: float
    test_views: int
    train_seconds: float
    """Time of all stages of training."""
    train_cpu_seconds: float
    """CPU time of all threads during training; far below seconds x CPUs if others used the machine."""
    check_seconds: float
    """Time of comparing pictures and cameras; 0 in runs of versions that did not count it."""
    hull_seconds: float
    base_seconds: float
    palette_seconds: float
    lighting_seconds: float
    """Time of the trial by which ``auto`` decides."""
    pcn_seconds: float
    sampling_seconds: float
    view_seconds: float
    """Time of a rendered view, median."""
    view_seconds_least: float
    view_seconds_most: float
    view_cpu_seconds: float
    """CPU time of all threads for a rendered view, median."""
    dvr_seconds: float | None
    """Time of volume rendering for the same view, measured right before it, median; None without the volume."""
    dvr_seconds_least: float | None
    dvr_seconds_most: float | None
    dvr_cpu_seconds: float | None
    dvr_ratio: float | None
    """Median over the views of the view's time / the time of volume rendering."""
    dvr_mapper: str | None
    scene_bytes: int
    parameters: int
    train_peak_bytes: int
    """Peak resident memory of training."""
    render_peak_bytes: int
    """Peak resident memory of rendering a view."""
    load_average: float
    """Load average of the machine when training began; above 0 if others used it."""
    threads: int
    resumed: bool
    """Whether training was stopped and resumed; its peak memory is then that of the last part."""
    run: str
    """Name of its folder."""
    doubt_seconds: float = 0.0
    """Time in which the expected errors of pictures are learned."""

    @property
    def training_cost(self) -> float:
        """Training time in seconds by which runs are compared: the limit if it was reached, as the rest is chance."""
        if self.time_limit is not None and abs(self.train_seconds / self.time_limit - 1.0) < LIMIT_REACHED:
            return self.time_limit
        return self.train_seconds

    @property
    def kind(self) -> str:
        """Its encoding, its lighting unless it is the network, and its kernels if they are the reference."""
        light = "" if self.lighting == "network" else f", {self.lighting}"
        return f"{self.encoding}{light}" + ", reference kernels" * (self.kernels == "reference")

    @property
    def limit(self) -> str:
        """The time limit as text."""
        return "full" if self.time_limit is None else f"{self.time_limit:g} s"


COLUMNS = tuple(field.name for field in fields(Row))


def read_row(training: Path, rendering: Path) -> Row:
    """Read the row of a run from its two JSON files."""
    made, shown = (json.loads(path.read_text(encoding="utf-8")) for path in (training, rendering))
    run, seconds, view = made["run"], made["seconds"], shown["seconds_per_view"]
    dvr: dict[str, Any] = shown.get("dvr") or {}
    theirs = dvr.get("seconds_per_view") or {}
    return Row(
        scene=run["scene"],
        preset=run["preset"],
        encoding=run["encoding"],
        lighting=run["lighting"],
        light=made["lighting"],
        train_size=run["size"],
        render_size=shown["size"][0],
        time_limit=run["limit"],
        device=made["device"],
        kernels=made["kernels"],
        seed=run["seed"],
        network=shown["network"],
        psnr=_number(shown["psnr"]),
        psnr_foreground=_number(shown["psnr_foreground"]),
        ssim=_number(shown["ssim"]),
        test_views=shown["test_views"],
        train_seconds=seconds["total"],
        train_cpu_seconds=made["cpu_seconds"],
        check_seconds=seconds.get("check", 0.0),
        hull_seconds=seconds["hull"],
        base_seconds=seconds["base"],
        palette_seconds=seconds["palette"],
        lighting_seconds=seconds.get("lighting", 0.0),
        pcn_seconds=seconds["pcn"],
        sampling_seconds=seconds["sampling"],
        doubt_seconds=seconds["doubt"],
        view_seconds=view["median"],
        view_seconds_least=view["least"],
        view_seconds_most=view["most"],
        view_cpu_seconds=view["cpu_median"],
        dvr_seconds=theirs.get("median"),
        dvr_seconds_least=theirs.get("least"),
        dvr_seconds_most=theirs.get("most"),
        dvr_cpu_seconds=theirs.get("cpu_median"),
        dvr_ratio=dvr.get("ratio"),
        dvr_mapper=dvr.get("mapper"),
        scene_bytes=made["scene_bytes"],
        parameters=made["parameters"],
        train_peak_bytes=made["peak_rss_bytes"],
        render_peak_bytes=shown["render_peak_rss_bytes"],
        load_average=made["load_average"],
        threads=made["threads"],
        resumed=made["resumed"],
        run=training.parent.name,
    )


def _number(value: float | None) -> float:
    """Return a number of a JSON file; null stands for infinities and NaN, which JSON does not have."""
    return math.nan if value is None else float(value)


def front(cost: Sequence[float], gain: Sequence[float]) -> list[bool]:
    """Find the points that no other point beats by being at least as good in both values and better in one.

    Args:
        cost: Seconds or bytes; less is better.
        gain: Accuracy of the same points; more is better.

    Returns:
        For each point whether it is on the Pareto front. Points with NaN are not.
    """
    best, on = -math.inf, [False] * len(cost)
    known = [k for k in range(len(cost)) if not (math.isnan(cost[k]) or math.isnan(gain[k]))]
    reached = math.inf
    for k in sorted(known, key=lambda k: (cost[k], -gain[k])):
        on[k] = gain[k] > best or (gain[k] == best and cost[k] == reached)
        if on[k]:
            best, reached = gain[k], cost[k]
    return on


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write all rows as CSV, completely or not at all; unknown values are empty."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([[getattr(row, name) for name in COLUMNS] for row in rows])


def write_all(folder: Path, rows: Sequence[Row], protocol: str) -> None:
    """Write ``runs.csv`` and ``runs.json``."""
    write_csv(folder / "runs.csv", rows)
    content = [{name: getattr(row, name) for name in COLUMNS} for row in rows]
    write_json(folder / "runs.json", {"protocol": protocol, "runs": content})
