"""Chart how an image's time grows with its size, the scene's and the number of threads.

python docs/measurements/scaling.py SCENE.svv... --out docs/measurements/scaling.csv --chart docs/images/scaling.png

Every number of threads is a process of its own. The times are medians of five images
(of more than 800 x 800 pixels: of one) after one that is not counted.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import median

SIZES = 200, 400, 800, 1600, 4000


def seconds(path: Path, sizes: list[int]) -> list[float]:
    """Draw a scene's front with the threads that the environment sets; return the seconds of each size."""
    import time

    from svv.fields.scene.scene import Scene
    from svv.render.frames import orbit

    scene, found = Scene.load(path), []
    for size in sizes:
        camera, taken = orbit(scene, 181, size, size)[90], []
        for _ in range(6 if size <= 800 else 2):
            begun = time.perf_counter()
            scene.render(camera)
            taken.append(time.perf_counter() - begun)
        found.append(median(taken[1:]))
    return found


def measured(path: Path, threads: int, sizes: list[int]) -> list[float]:
    """Return what :func:`seconds` returns in a process with that many threads."""
    told = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), str(threads))
    done = subprocess.run(
        [sys.executable, __file__, "--one", str(path), "--sizes", ",".join(map(str, sizes))],
        env={**os.environ, **told}, check=True, capture_output=True, text=True,
    )  # fmt: skip
    found: list[float] = json.loads(done.stdout)
    return found


def chart(rows: list[dict[str, object]], path: Path) -> None:
    """Draw seconds against pixels, and the gain of threads."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    most = max(int(str(r["threads"])) for r in rows)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for name in dict.fromkeys(str(r["scene"]) for r in rows):
        own = [r for r in rows if r["scene"] == name]
        line = [(int(str(r["size"])) ** 2, float(str(r["seconds"]))) for r in own if r["threads"] == most]
        left.loglog(*zip(*line, strict=True), marker="o", label=f"{name}, {own[0]['megabytes']} MB")
        at = {int(str(r["threads"])): float(str(r["seconds"])) for r in own if r["size"] == 800}
        right.plot(list(at), [at[1] / t for t in at.values()], marker="o", label=name)
    left.loglog([200**2, 4000**2], [0.01, 4.0], color="0.7", linestyle=":", label="proportional to the pixels")
    left.set(xlabel="pixels", ylabel="seconds of an image", title=f"{most} threads")
    right.plot([1, most], [1, most], color="0.7", linestyle=":", label="ideal")
    right.set(xlabel="threads", ylabel="times as fast as one", title="800 x 800 pixels")
    left.legend(loc="lower right", fontsize="small")
    right.legend()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure the scenes, write the table, and draw the chart."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("scenes", nargs="*", type=Path, metavar="SCENE.svv")
    options.add_argument("--sizes", default=",".join(map(str, SIZES)), help="Widths and heights in pixels.")
    options.add_argument("--out", type=Path, default=Path("scaling.csv"))
    options.add_argument("--chart", type=Path, default=Path("scaling.png"))
    options.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    given = options.parse_args()
    sizes = [int(size) for size in given.sizes.split(",")]
    if given.one:
        print(json.dumps(seconds(given.one, sizes)))
        return
    counts = [n for n in (1, 2, 4, 8, 16, 32, 64) if n <= (os.cpu_count() or 1)]
    rows: list[dict[str, object]] = [
        {"scene": path.stem, "megabytes": round(path.stat().st_size / 1e6, 1), "threads": n, "size": size, "seconds": t}
        for path in given.scenes
        for n in counts
        for size, t in zip(sizes, (round(t, 4) for t in measured(path, n, sizes)), strict=True)
    ]
    with given.out.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    chart(rows, given.chart)


if __name__ == "__main__":
    main()
