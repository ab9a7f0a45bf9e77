"""Long runs inside the real ParaView: what thousands of operations leave behind, beside the same of ParaView's own.

    python -m campaign.paraview_long --operations 5000 --seed 1

Each row of the table is a process of its own. ``svv`` does the operations with StyleRF's filters, ``ParaView`` does as
many with ParaView's own filters, whose growth is not ours. Memory is measured after all that is free has been given
back (``malloc_trim``); bytes an operation are the median slope (Theil and Sen) over the second half of the run.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import tempfile
from collections.abc import Iterable, Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from svv.io.files.cache import NAME
from svv.io.pictures.output import write_png
from svv.pv.launch import programs
from tests.cube import cube_scene

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
KINDS = {"ours": "svv", "theirs": "ParaView"}
COUNTS = {"operations": 5000, "cameras": 2000, "states": 200, "trainings": 50}
SAMPLES = 50
"""Samples of a row."""
HOLDS = ("handles", "threads", "files")
"""What must be at the end as it was after the first tenth."""

Sample = Mapping[str, Any]


def slope(samples: Iterable[Sample], what: str) -> float:
    """Return the median slope of all pairs of samples, per operation (Theil 1950, Sen 1968); 0 for a single sample."""
    pairs = combinations([(one["done"], one[what]) for one in samples], 2)
    return statistics.median([(b - a) / (n - m) for (m, a), (n, b) in pairs] or [0.0])


def write_files(folder: Path) -> None:
    """Write what the operations work on: a small scene, and a picture."""
    cube_scene().save(folder / "cube.svv")
    picture = np.full((60, 80, 3), (0.85, 0.2, 0.1), np.float32)
    picture[:, 40:] = (0.1, 0.7, 0.25)
    write_png(folder / "halves.png", picture)
    for name in ("tmp", "cache"):
        (folder / name).mkdir()


def run(kind: str, counts: Mapping[str, int], environ: Mapping[str, str], folder: Path, **options: Any) -> list[Sample]:
    """Do operations in a ParaView of their own, and return the samples.

    Args:
        kind: One of :data:`KINDS`.
        counts: Phase -> number of operations.
        environ: Variables with which ParaView finds the plugin and a display.
        folder: An empty folder.
        options: ``seed``; ``samples``, the number of samples of a phase; ``seconds`` of a training; ``minutes`` after
            which a phase ends even if it is not through.

    Raises:
        subprocess.CalledProcessError: An operation failed.
        AssertionError: An unfinished file was left in the cache.
    """
    write_files(folder)
    given: dict[str, Any] = {
        "kind": kind,
        "counts": dict(counts),
        "folder": str(folder),
        "temporary": [str(folder / "tmp")],
    }
    given |= {"out": str(folder / "samples.jsonl"), "seed": 1, "samples": SAMPLES, "seconds": 5.0}
    given |= {"minutes": math.inf, **options}
    program = programs.find().program("pvpython")
    ours = {**environ, "TMPDIR": str(folder / "tmp"), "SVV_CACHE": str(folder / "cache")}
    subprocess.run([program, HERE / "inside_paraview.py", json.dumps(given)], env=ours, check=True)
    assert all(NAME.fullmatch(path.stem) or NAME.fullmatch(path.name) for path in (folder / "cache").iterdir())
    return [json.loads(line) for line in (folder / "samples.jsonl").read_text().splitlines()]


def row(kind: str, samples: list[Sample]) -> dict[str, Any]:
    """Return a row of the table for the samples of a phase."""
    begin, warm, end = samples[0], samples[max(len(samples) // 10, 1)], samples[-1]
    half = samples[len(samples) // 2 :]
    sizes = [f"{one['resident'] / 1e6:.1f}" for one in (begin, warm, end)]
    return {
        "phase": end["phase"],
        "filters": KINDS[kind],
        "operations": end["done"],
        "seconds": round(end["seconds"] - begin["seconds"]),
        "resident MB: start, warm, end": ", ".join(sizes),
        "resident bytes an operation": round(slope(half, "resident")),
        "malloc bytes an operation": round(slope(half, "malloc")),
        "Python blocks an operation": round(slope(half, "python"), 2),
        **{f"{what}: warm, end": f"{warm[what]}, {end[what]}" for what in HOLDS},
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Return rows as a Markdown table."""
    lines = [list(rows[0]), ["---"] * len(rows[0]), *([str(value) for value in one.values()] for one in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def main() -> None:
    """Do all phases, and print the table after each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for phase, count in COUNTS.items():
        parser.add_argument(f"--{phase}", type=int, default=count, help=f"number of them; 0: none (default: {count})")
    parser.add_argument("--seconds", type=float, default=5.0, help="of a training (default: 5)")
    parser.add_argument("--minutes", type=float, default=math.inf, help="most for a phase (default: no limit)")
    parser.add_argument("--seed", type=int, default=1, help="of the operations' order and values")
    parser.add_argument("--out", type=Path, default=Path("paraview-long.md"), help="file for the table")
    chosen = parser.parse_args()
    paraview = programs.find()
    display, name = programs.start_display()
    rows: list[dict[str, Any]] = []
    try:
        environ = {**programs.environ_for(paraview), "DISPLAY": name}
        for phase in COUNTS:
            for kind in KINDS:
                count = getattr(chosen, phase)
                if not count or (phase == "trainings" and kind == "theirs"):  # ParaView trains nothing
                    continue
                with tempfile.TemporaryDirectory() as folder:
                    options = {"seed": chosen.seed, "seconds": chosen.seconds, "minutes": chosen.minutes}
                    rows.append(row(kind, run(kind, {phase: count}, environ, Path(folder), **options)))
                chosen.out.write_text(f"ParaView {'.'.join(map(str, paraview.version))}\n\n{table(rows)}")
                print(table(rows), flush=True)
    finally:
        display.terminate()


if __name__ == "__main__":
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    main()
