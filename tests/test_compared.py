"""The table of DVR against palette networks: where the curves cross, and what does not fit."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("vtkmodules")

from svv_bench.volume_size.comparison import Row, crossing, table


def row(side: str, volume: int, seconds: float) -> Row:
    likeness = {"psnr": 30.0, "psnr_foreground": 20.0, "ssim": 0.9, "lpips": 0.01} if side == "PCN" else {}
    times = {f"seconds_{name}": seconds for name in ("median", "least", "most")}
    return {"side": side, "volume": volume, "image": 400, "memory_bytes": 2e9, "data_bytes": 1e6, **times, **likeness}


ROWS = [row("DVR", 128, 0.5), *(row("bricks", n, 0.1) for n in (128, 512)), *(row("PCN", n, 1.0) for n in (128, 512))]


def test_curves_cross_at_the_geometric_mean_of_symmetric_ratios() -> None:
    rows = [row("DVR", 128, 0.5), row("DVR", 512, 2.0), row("PCN", 128, 1.0), row("PCN", 512, 1.0)]
    assert "VTK's ray caster passes the PCN at about 256^3 voxels" in crossing(rows, "DVR", "seconds_median", "time")
    assert "the ray caster of bricks takes less at all volumes that were measured, 128^3 to 512^3" in crossing(
        ROWS, "bricks", "seconds_median", "time"
    )
    assert "no volume fits" in crossing(ROWS[1:], "DVR", "seconds_median", "time")


def test_a_volume_that_does_not_fit_says_so() -> None:
    lines = table(ROWS).splitlines()
    assert lines[0].count("|") == lines[2].count("|") == lines[3].count("|")
    assert "| 500 ms (500 to 500) | 2.00 GB | 100 ms" in lines[2]
    assert "does not fit" in lines[3] and "does not fit" not in lines[2]
    assert lines[3].endswith("| 30.00 dB | 20.00 dB | 0.9000 | 0.0100 |")


def test_the_comparison_needs_no_paraview() -> None:
    script = Path(__file__).parents[1] / "bench" / "paraview_scripts" / "compare_dvr_pcn.py"
    done = subprocess.run([sys.executable, script, "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "--volume FILE" in done.stdout
