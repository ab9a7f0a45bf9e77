"""The table of DVR against palette networks: what crosses where, what does not fit, and what a paper has to say."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("vtkmodules")

from svv_bench.volume_size.circumstances import circumstances
from svv_bench.volume_size.comparison import Row, crossing, idle, measured_on, table

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "bench" / "paraview_scripts" / "compare_dvr_pcn.py"

ABOUT = {
    "processor": "Example 9000", "cores": 2, "memory_bytes": 24e9, "gpu": "", "system": "Debian 12, x86_64",
    "python": "3.11.7", "svv": "0.2.0", "commit": "abcdef0", "vtk": "9.1.0", "paraview": "5.11.0", "torch": "2.13.0",
    "volume": "generated field", "preset": "fast", "time_limit": None, "learned_from": "views only", "views": 92,
    "views_side": 800, "images": [400], "unseen_views": 7, "repeats": 5, "seed": 3, "ray_caster": "cpu",
    "date": "2026-11-28",
}  # fmt: skip


def row(side: str, volume: int, seconds: float, spread: float = 0.0, own: float = 2e9, **more: Any) -> Row:
    likeness = {"psnr": 30.0, "psnr_foreground": 20.0, "ssim": 0.9, "lpips": 0.01} if side == "PCN" else {}
    times = {"seconds_median": seconds, "seconds_least": seconds - spread, "seconds_most": seconds + spread}
    memory = {"own_bytes": own, "idle_bytes": 4e8, "memory_bytes": own + 4e8}
    return {"side": side, "volume": volume, "image": 400, "data_bytes": 1e6, **memory, **times, **likeness, **more}


ROWS = [row("DVR", 128, 0.5), *(row("bricks", n, 0.1) for n in (128, 512)), *(row("PCN", n, 1.0) for n in (128, 512))]


def against(*times: float, spread: float = 0.1) -> str:
    """Return what is said of a side with these times at 64, 128, ... voxels, where the PCN takes a second."""
    sizes = [64 << k for k in range(len(times))]
    rows = [row("DVR", n, seconds, spread) for n, seconds in zip(sizes, times, strict=True)]
    return crossing([*rows, *(row("PCN", n, 1.0, spread) for n in sizes)], "DVR", "time")


def test_curves_cross_between_volumes_at_which_the_spreads_are_apart() -> None:
    where = "In time, at 400^2 pixels, VTK's ray caster takes less up to"
    assert against(0.5, 2.0) == f"{where} 64^3 voxels, the PCN from 128^3: they cross between them."
    assert against(0.5, 0.9, 1.15, 2.0) == f"{where} 64^3 voxels, the PCN from 512^3: they cross between them."
    assert "the PCN takes less up to 64^3 voxels, VTK's ray caster from 128^3" in against(2.0, 0.5)


def test_no_crossing_is_claimed_that_the_spreads_do_not_carry() -> None:
    said = against(0.5, 1.1)  # the medians cross
    assert "no crossing was seen from 64^3 to 128^3: VTK's ray caster takes less at 64^3" in said
    assert said.endswith("; the spreads overlap at 128^3.")
    assert "their spreads overlap at all volumes measured, 64^3 to 128^3" in against(0.9, 1.1)
    assert "neither VTK's ray caster nor the PCN takes less" in against(0.9, 1.1)
    assert "no crossing was seen from 64^3 to 128^3: the PCN takes less at 64^3, 128^3." in against(2.0, 3.0)
    assert (
        "the order changes more than once: VTK's ray caster takes less at 64^3, 256^3; the PCN takes less at 128^3."
        in (against(0.5, 2.0, 0.5))
    )
    assert "no volume fits" in crossing(ROWS[1:], "DVR", "time")


def test_memory_that_crosses_is_that_of_volume_and_scene_and_not_of_programs() -> None:
    rows = [row("DVR", 64, 1.0, own=1e8, memory_bytes=9e9), row("DVR", 128, 1.0, own=9e8, memory_bytes=9e9)]
    rows += [row("PCN", n, 1.0, own=3e8, memory_bytes=1e9) for n in (64, 128)]
    assert "In memory, at 400^2 pixels, VTK's ray caster takes less up to 64^3 voxels" in crossing(
        rows, "DVR", "memory"
    )
    assert idle([*rows, row("PCN", 256, 1.0, idle_bytes=5.5e8)]) == (
        "Held before: VTK's ray caster 0.40 GB, the PCN 0.40 to 0.55 GB."
    )


def test_a_volume_that_does_not_fit_says_so() -> None:
    lines = table(ROWS, ABOUT).splitlines()
    assert lines[0].count("|") == lines[2].count("|") == lines[3].count("|")
    assert "| 500 ms (500 to 500) | 2000 MB | 100 ms" in lines[2]
    assert "does not fit" in lines[3] and "does not fit" not in lines[2]
    assert lines[3].endswith("| 30.00 dB | 20.00 dB | 0.9000 | 0.0100 |")


def test_without_lpips_there_is_no_column_but_the_reason() -> None:
    rows = [{name: value for name, value in one.items() if name != "lpips"} for one in ROWS]
    without, with_ = table(rows, ABOUT), table(ROWS, ABOUT)
    assert "LPIPS" in with_.splitlines()[0] and "not measured" not in with_
    assert "LPIPS" not in without.splitlines()[0]
    assert "LPIPS was not measured because AlexNet's weights are missing; svv features --get alexnet" in without


def test_the_table_says_on_what_and_how_was_measured() -> None:
    said = table(ROWS, ABOUT)
    for fact in (
        "2026-11-28", "Example 9000", "2 cores", "24 GB", "svv 0.2.0 (abcdef0)", "ParaView 5.11.0", "VTK 9.1.0",
        "torch 2.13.0", "Python 3.11.7", "Debian 12", "generated field", "preset fast", "views only",
        "92 training views of 800^2", "seed 3", "5 repeats", "7 views", "the median (smallest to largest)",
    ):  # fmt: skip
        assert fact in said, fact
    elsewhere = measured_on({**ABOUT, "paraview": "", "commit": "", "gpu": "Card", "time_limit": 30.0})
    assert (
        "ParaView" not in elsewhere
        and "svv 0.2.0," in elsewhere
        and "Card" in elsewhere
        and "30 s at most" in elsewhere
    )


def test_the_circumstances_are_those_of_this_process() -> None:
    import torch
    from vtkmodules.vtkCommonCore import vtkVersion

    here = circumstances()
    assert here["torch"] == torch.__version__ and here["vtk"] == vtkVersion.GetVTKVersion()
    assert here["processor"] and int(here["cores"]) >= 1 and int(here["memory_bytes"]) > 1 << 28
    assert here.keys() <= ABOUT.keys()


def test_the_chart_is_as_wide_as_a_column_and_its_text_is_text(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from PIL import Image

    (tmp_path / "compare.json").write_text(json.dumps({"about": ABOUT, "rows": ROWS}))
    done = subprocess.run(
        [sys.executable, "-m", "svv_bench.volume_size.chart", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    svg = (tmp_path / "compare.svg").read_text(encoding="utf-8")
    texts = " ".join(re.findall(r"<text[^>]*>([^<]*)</text>", svg))
    for word in ("voxels along a side", "seconds for an image", "Example 9000", "torch 2.13.0", "2026-11-28", "bricks"):
        assert word in " ".join(texts.split()), word
    width = re.search(r'<svg[^>]* width="([\d.]+)pt"', svg)
    assert width is not None and abs(float(width[1]) * 25.4 / 72 - 84.0) < 0.1
    sizes = [float(size) for size in re.findall(r"font(?:-size)?: ?([\d.]+)px", svg)]
    assert sizes and min(sizes) >= 6.0, "too small to be read in a column"
    pdf = (tmp_path / "compare.pdf").read_bytes()
    assert b"/Font" in pdf and b"DejaVu" in pdf
    with Image.open(tmp_path / "compare.png") as png:
        assert png.info["dpi"][0] >= 200 and abs(png.width / png.info["dpi"][0] * 25.4 - 84.0) < 0.5


def test_the_comparison_needs_no_paraview() -> None:
    done = subprocess.run([sys.executable, SCRIPT, "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "--volume FILE" in done.stdout


@pytest.mark.slow
def test_a_spread_needs_repeats(tmp_path: Path) -> None:
    command = [sys.executable, SCRIPT, "--repeats", "1", "--out", tmp_path / "out"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "A spread needs at least 2 repeats, not 1." in done.stderr
