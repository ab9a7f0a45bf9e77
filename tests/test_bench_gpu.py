"""``svv bench gpu``: parts that fail, hang or are killed end alone, and the page says so."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.errors import BadInput, Cancelled, silent
from svv.io.views.viewset import ViewSet
from svv_bench.gpu import parts
from svv_bench.gpu.context import Context, add_result, draw_views, read_results
from svv_bench.gpu.page import figures, tables, write_report, wrong_kernels
from svv_bench.gpu.parts import Part, parts_named, run_parts

DOES = {
    "works": "import json, sys, pathlib; a = json.loads(sys.argv[-1]); pathlib.Path(a['out'], 'worked').touch()",
    "fails": "raise SystemExit('torch.AcceleratorError: CUDA error: an illegal memory access was encountered')",
    "hangs": "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(1000)",
    "is_killed": "import os; os.kill(os.getpid(), 9)",
    "has_no_memory": "raise MemoryError('CUDA out of memory. Tried to allocate 2.00 GiB')",
}


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parts, "command", lambda part: [sys.executable, "-c", DOES[part.name]])
    monkeypatch.setattr(parts, "GRACE", 0.5)


def context(folder: Path, device: str = "cuda") -> Context:
    return Context(folder, folder / "views", device, 1, 0.01)


def ended(folder: Path) -> dict[str, str]:
    return {r["part"]: r["value"]["why"] for r in read_results(folder) if r["name"] == "ended"}


@pytest.mark.usefixtures("pretend")
def test_each_part_ends_alone_and_the_page_says_how(tmp_path: Path) -> None:
    some = [Part(name, name, 1.0 if name == "hangs" else 60.0) for name in (*list(DOES)[1:], "works")]
    run_parts(context(tmp_path), 600.0, silent, some)
    why = ended(tmp_path)
    assert why["fails"].startswith("failed: torch.AcceleratorError: CUDA error")
    assert why["hangs"] == "stopped after 1 s"
    assert why["is_killed"] == "killed (SIGKILL)"
    assert "out of memory" in why["has_no_memory"]
    assert why["works"] == ""
    assert (tmp_path / "worked").exists()
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert all(text in page for text in ("stopped after 1 s", "killed (SIGKILL)", "illegal memory access", "done"))


@pytest.mark.usefixtures("pretend")
def test_what_does_not_fit_into_the_limit_is_left_out(tmp_path: Path) -> None:
    run_parts(context(tmp_path), 4.0, silent, [Part("works", "", 60.0)])
    assert ended(tmp_path) == {"works": "left out: the time limit was reached"}
    assert not (tmp_path / "worked").exists()


@pytest.mark.usefixtures("pretend")
def test_stopping_ends_the_part_and_keeps_the_results(tmp_path: Path) -> None:
    def stop(fraction: float, label: str) -> None:
        if label == "second":
            raise Cancelled

    with pytest.raises(Cancelled):
        run_parts(context(tmp_path), 600.0, stop, [Part("works", "first", 60.0), Part("hangs", "second", 600.0)])
    assert ended(tmp_path) == {"works": ""}


@pytest.mark.usefixtures("pretend")
def test_the_cpu_is_not_measured_twice(tmp_path: Path) -> None:
    run_parts(context(tmp_path, "cpu"), 600.0, silent, [Part("works", "", 60.0, "cpu")])
    assert ended(tmp_path) == {}


def test_parts_are_chosen_by_name() -> None:
    assert parts_named("all") == parts.PARTS
    assert [part.name for part in parts_named("images, kernels")] == ["kernels", "images"]
    with pytest.raises(BadInput, match="no part 'speed'; choose among versions, kernels"):
        parts_named("speed")


def test_the_generated_views_have_an_opaque_and_a_translucent_region(tmp_path: Path) -> None:
    draw_views(tmp_path, 48, 6, 3, side=32)
    train, test = (ViewSet.read(tmp_path, split) for split in ("train", "test"))
    assert (len(train), len(test)) == (6, 3)
    alpha = train.images[..., 3]
    assert (alpha > 240).mean() > 0.02
    assert ((alpha > 5) & (alpha < 120)).mean() > 0.02
    assert (alpha == 0).mean() > 0.2
    assert not np.array_equal(train.images[0], test.images[0])


def fill(folder: Path, wrong: str = "") -> None:
    """Write results as a run on a card leaves them."""
    spread = {"median_ms": 3.3, "least_ms": 3.2, "most_ms": 4.5, "repeats": 20}
    scores = {"psnr": 35.4, "foreground": 25.2, "ssim": 0.987, "flip": 0.02, "s_per_view": 0.007, "views": 16}
    peaks = {"peak_gpu_bytes": 2e8, "peak_rss_bytes": 2e9}
    seconds = {"base": 3.4, "pcn": 2.0, "total": 11.0}
    content: list[tuple[str, str, Any]] = [
        ("versions", "versions", {"torch": "2.11.0"}),
        ("versions", "card 0", {"name": "Card A"}),
        ("kernels", "kernels", "triton"),
        ("kernels", "march", {"seconds": 1.0, "wrong": wrong}),
        (
            "train",
            "warm",
            {"wall_s": 11.5, "compiled": 0, "seconds": seconds, **peaks},
        ),
        ("train", "score pcn", scores),
        ("compare", "pcn", {"mean": 1e-5, "largest": 0.1, "above_2_levels": 1e-6}),
        ("images", "pcn 800", {**spread, "device_ms": 3.3}),
        ("paint", "warm", {"wall_s": 4.1, "peak_gpu_bytes": 1e8}),
        ("paint", "image", spread),
        ("chart", "250 + 120", {"wall_s": 8.0, "seconds": seconds, **scores}),
        ("profile", "stage-1", {**spread, "device_ms": 0.4, "launches": 54.0, "waits": {"batches.py:85": 1}}),
        ("poison", "unwritten memory", {"steps": 60, "loss is no number": 0}),
        ("memory", "64 MB", "BadInput: The GPU ran out of memory"),
    ]
    for part, name, value in content:
        add_result(folder, part, "cuda", name, value)


def test_the_page_sums_all_up(tmp_path: Path) -> None:
    fill(tmp_path)
    page = write_report(tmp_path).read_text(encoding="utf-8")
    for text in ("On Card A: all 1 results of the triton kernels are those of plain torch", "11.5 s", "35.40", "3.3 ms",
                 "batches.py:85", "ran out of memory"):  # fmt: skip
        assert text in page, text
    found = [table for table in tables(read_results(tmp_path)) if table.rows]
    assert all(len(row) == len(table.columns) for table in found for row in table.rows)
    kept = {(one.table, one.row, one.column): (one.value, one.unit) for one in figures(read_results(tmp_path))}
    assert kept["gpu/training", "cuda, warm", "in all"] == ("11.5", "s")
    assert kept["gpu/scores", "cuda, pcn", "PSNR"] == ("35.40", "")


def test_a_wrong_kernel_is_the_headline(tmp_path: Path) -> None:
    fill(tmp_path, wrong="AssertionError: 7 of 40 rays have other samples")
    assert wrong_kernels(read_results(tmp_path)) == ["march"]
    assert "1 of 1 kernels differ from plain torch: march" in write_report(tmp_path).read_text(encoding="utf-8")


def test_the_page_of_nothing(tmp_path: Path) -> None:
    assert "have not been checked" in write_report(tmp_path).read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_whole_command_on_the_cpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from svv.cli import app

    argv = ["svv", "bench", "gpu", "--device", "cpu", "--size", "64", "--steps", "0.02", "--out", str(tmp_path / "o")]
    monkeypatch.setattr(sys, "argv", argv)
    with pytest.raises(SystemExit) as done:
        app.main()
    assert done.value.code == 0
    assert set(ended(tmp_path / "o").values()) == {""}
    lines = (tmp_path / "o" / "results.jsonl").read_text(encoding="utf-8").splitlines()
    assert {json.loads(line)["part"] for line in lines} == {part.name for part in parts.PARTS}
