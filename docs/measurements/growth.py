"""How a training's seconds and memory grow with samples, cells and views: the exponents of power laws.

usage: python docs/measurements/growth.py VIEWS

Each training is a process of its own. Seconds are those of stage 1's steps on all threads, bytes the process's peak.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from svv import ViewSet

STEPS = 60
FEW = (
    f"reconstruct.iterations={STEPS}",
    "reconstruct.doublings=0",
    "reconstruct.known_part=1",
    "recolour.iterations=1",
)
SAMPLES, CELLS, PARTS = (8192, 16384, 32768, 65536, 131072), (32, 64, 128, 256), (4, 2, 1)


def trained(views: Path, *changes: str) -> tuple[float, float]:
    """Return the seconds of stage 1 and the peak in MB of a training with some settings changed."""
    with tempfile.TemporaryDirectory() as folder:
        report, told = Path(folder, "report.json"), [word for change in (*FEW, *changes) for word in ("--set", change)]
        out = ["--out", str(Path(folder, "scene.svv")), "--json", str(report)]
        command = [sys.executable, "-m", "svv", "train", str(views), "--preset", "fast", *told, *out]
        subprocess.run(command, check=True, capture_output=True)
        found = json.loads(report.read_text())
    return found["seconds"]["base"], found["peak_rss_bytes"] / 1e6


def said(name: str, values: Sequence[float], found: Sequence[tuple[float, float]]) -> None:
    """Print what was found for each value, and the exponents of growth from the second value on."""
    seconds, peaks = np.array(found).T
    for value, second, peak in zip(values, seconds, peaks, strict=True):
        print(f"{name} {value:g}: {1000.0 * second / STEPS:.1f} ms a step, {peak:.0f} MB", flush=True)
    of_time = np.polyfit(np.log(values[1:]), np.log(seconds[1:]), 1)[0]
    of_bytes = np.polyfit(np.log(values[1:]), np.log(peaks[1:]), 1)[0]
    print(f"{name}: seconds to the power {of_time:.2f}, bytes to the power {of_bytes:.2f}", flush=True)


def main(folder: Path) -> None:
    """Measure one number at a time, the others as in the preset ``fast``."""
    trained(folder)  # compiles kernels and fills the disk's cache
    said("samples a step", SAMPLES, [
        trained(folder, f"reconstruct.samples={n}", f"reconstruct.rays={n}") for n in SAMPLES
    ])  # fmt: skip
    said("cells along a side", CELLS, [
        trained(folder, f"reconstruct.most_cells={n}", "reconstruct.pixels_a_cell=0.5") for n in CELLS
    ])  # fmt: skip
    views, found = ViewSet.read(folder), []
    for part in PARTS:
        with tempfile.TemporaryDirectory() as some:
            views.take(range(0, len(views), part)).write(some)
            found.append(trained(Path(some)))
    said("views", [len(range(0, len(views), part)) for part in PARTS], found)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
