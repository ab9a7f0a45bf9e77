"""Compare trainings of two checkouts in turn: seconds of the whole command, memory, and scores on unseen views.

usage: python docs/measurements/builds.py OLD_CHECKOUT VIEWS... [--presets fast] [--runs 1] [--chart chart.png]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

SCORES = "psnr", "ssim", "flip"
CACHES = Path(tempfile.gettempdir(), "svv-builds")


def run(checkout: Path, *words: str) -> tuple[float, float, float]:
    """Run a command of a checkout; return its seconds, CPU seconds and peak in MB."""
    begun = time.perf_counter()
    own = {"PYTHONPATH": str(checkout), "SVV_CACHE": str(CACHES / checkout.name), "OMP_WAIT_POLICY": "PASSIVE"}
    command, quiet = [sys.executable, "-m", "svv", *words], subprocess.DEVNULL
    process = subprocess.Popen(command, env=os.environ | own, cwd=checkout, stdout=quiet, stderr=quiet)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{checkout}: svv {' '.join(words)} failed")
    return time.perf_counter() - begun, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def compared(builds: dict[str, Path], views: Path, preset: str, runs: int) -> dict[str, dict[str, float]]:
    """Train in turn; return medians of seconds, CPU seconds and MB for each build, and its scores."""
    taken: dict[str, list[tuple[float, float, float]]] = {name: [] for name in builds}
    found: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(runs):
            for name in list(builds)[:: 1 if number % 2 == 0 else -1]:
                scene, scores = str(Path(folder, f"{name}{number}.svv")), Path(folder, "scores.json")
                taken[name].append(run(builds[name], "train", str(views.resolve()), "--preset", preset, "--out", scene))
                if number == 0:
                    run(builds[name], "evaluate", scene, "--views", str(views.resolve()), "--json", str(scores))
                    found[name] = {key: json.loads(scores.read_text())[key] for key in SCORES}
    for name, each in taken.items():
        found[name] |= dict(zip(("s", "CPU s", "MB"), map(median, zip(*each, strict=True)), strict=True))
    return found


def chart(found: dict[str, dict[str, dict[str, dict[str, float]]]], path: Path) -> None:
    """Draw PSNR against seconds, an axis for each scene, a line through the presets for each build."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, len(found), figsize=(4 * len(found), 3.4), layout="constrained", squeeze=False)
    for axis, (scene, presets) in zip(axes[0], found.items(), strict=True):
        for name, colour in (("before", "0.6"), ("now", "#005b96")):
            points = [(each[name]["s"], each[name]["psnr"]) for each in presets.values()]
            axis.plot(*zip(*points, strict=True), color=colour, marker="o", label=name)
            for preset, at in zip(presets, points, strict=True):
                axis.annotate(preset, at, xytext=(5, -11), textcoords="offset points", fontsize="small", color=colour)
        axis.set(title=scene, xlabel="seconds of svv train")
        axis.margins(0.18)
        axis.grid(color="0.9")
    axes[0][0].set_ylabel("PSNR of unseen views, dB")
    axes[0][0].legend()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Print a line for each scene, preset and build, and draw the chart if one is asked for."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("old", type=Path)
    options.add_argument("views", type=Path, nargs="+")
    options.add_argument("--presets", nargs="+", default=["fast"])
    options.add_argument("--runs", type=int, default=1)
    options.add_argument("--chart", type=Path)
    given = options.parse_args()
    builds = {"before": given.old.resolve(), "now": Path(__file__).resolve().parents[2]}
    found: dict[str, dict[str, dict[str, dict[str, float]]]] = {}
    for preset in given.presets:
        for views in given.views:
            own = found.setdefault(views.name, {})[preset] = compared(builds, views, preset, given.runs)
            for name, values in own.items():
                short = {key: float(f"{value:.4g}") for key, value in values.items()}
                print(views.name, preset, name, short, flush=True)
    if given.chart:
        chart(found, given.chart)


if __name__ == "__main__":
    main()
