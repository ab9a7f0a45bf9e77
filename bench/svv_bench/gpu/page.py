"""The page that sums the measurement up: ``report.html``, from the results so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from svv.job.page import Page, Table, write_page
from svv_bench.gpu.context import read_results
from svv_bench.gpu.parts import PARTS
from svv_bench.results import Figure

Results = Sequence[Mapping[str, Any]]
REPORT = "report.html"


def write_report(out: Path) -> Path:
    """Write the page into the folder of results; returns its path.

    Raises:
        BadInput: It cannot be written.
    """
    results = read_results(out)
    parts = [table for table in tables(results) if table.rows]
    facts = [(name, str(value)) for name, value in _value(results, "versions", "versions").items()]
    page = Page(
        "GPU: are the kernels right, and how fast are they?", _headline(results), _numbers(results), None, parts, facts
    )
    write_page(out / REPORT, page)
    return out / REPORT


def tables(results: Results) -> list[Table]:
    """Return all tables that the results fill."""
    poison = "Training steps in memory that is NaN until it is written; all counts but the steps must be 0."
    return [
        *(made(results) for made in (_ended, _kernels, _training, _scores, _compared, _images, _painting, _chart)),
        *(made(results) for made in (_steps, _waits)),
        _plain(results, "poison", "Unwritten memory", poison),
        _plain(results, "memory", "Little memory", "Training on a GPU of which only so much memory may be used."),
        _plain(results, "two_cards", "Two cards", "The second card beside the first one."),
    ]


def figures(results: Results) -> list[Figure]:
    """Return training times and scores, for the file of results."""
    return [
        Figure(f"gpu/{table.heading.lower()}", row[0], column, *value.split(" "))
        for table in (_training(results), _scores(results))
        for row in table.rows
        for column, value in zip(table.columns[1:], row[1:])
        if value
    ]


def wrong_kernels(results: Results) -> list[str]:
    """Return the kernels that differ from plain torch."""
    return [
        r["name"]
        for r in results
        if r["part"] == "kernels" and isinstance(r["value"], dict) and r["value"].get("wrong")
    ]


def _of(results: Results, part: str) -> Results:
    return [r for r in results if r["part"] == part and r["name"] != "ended"]


def _value(results: Results, part: str, name: str, device: str | None = None) -> Any:
    return next((r["value"] for r in _of(results, part) if r["name"] == name and device in (None, r["device"])), {})


def _headline(results: Results) -> str:
    wrong, checked = wrong_kernels(results), [r for r in _of(results, "kernels") if isinstance(r["value"], dict)]
    card = _value(results, "versions", "card 0")
    where = card.get("name") or _value(results, "versions", "versions").get("cpu", "this machine")
    if not checked:
        return f"On {where}: the kernels have not been checked."
    if wrong:
        return f"On {where}: {len(wrong)} of {len(checked)} kernels differ from plain torch: {', '.join(wrong)}."
    name = _value(results, "kernels", "kernels")
    return (
        f"On {where}: all {len(checked)} results of the {name} kernels are those of plain torch, in value and gradient."
    )


def _numbers(results: Results) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    own = next((r["device"] for r in _of(results, "train")), "cpu")
    warm = _value(results, "train", "warm", own)
    if warm:
        found.append((f"{warm['wall_s']:.1f} s", f"training, preset fast, on the {'GPU' if own == 'cuda' else 'CPU'}"))
    scored = _value(results, "train", "score pcn", own)
    if scored:
        found.append((f"{scored['psnr']:.2f} dB", "palette network on unseen views"))
    image = _value(results, "images", "pcn 800")
    if image:
        found.append((f"{image['median_ms']:.1f} ms", "an image of 800 x 800"))
    return found


def _ended(results: Results) -> Table:
    titles = {(p.name, p.device): p.title for p in PARTS}
    rows = []
    for r in results:
        if r["name"] == "ended":
            title = titles.get((r["part"], r["device"])) or titles.get((r["part"], None)) or r["part"]
            seconds = r["value"].get("seconds")
            rows.append(
                (title, r["device"], "" if seconds is None else f"{seconds:.0f} s", r["value"]["why"] or "done")
            )
    return Table("Parts", "Each ran in a process of its own.", ("part", "device", "took", "ended"), rows)


def _kernels(results: Results) -> Table:
    rows = [
        (r["name"], f"{r['value']['seconds']:.2f} s", r["value"]["wrong"] or "as plain torch")
        for r in _of(results, "kernels") if isinstance(r["value"], dict)
    ]  # fmt: skip
    text = "Values and gradients against plain torch on the CPU; the first use of a kernel compiles it."
    return Table("Kernels", text, ("kernel", "took", "result"), rows)


def _training(results: Results) -> Table:
    rows = []
    for r in _of(results, "train"):
        if r["name"] in ("cold", "warm"):
            v, each = r["value"], r["value"]["seconds"]
            begins = sum(each.get(name, 0.0) for name in ("hull", "extinction"))
            stages = (f"{each.get(name, 0.0):.1f} s" for name in ("base", "palette", "pcn"))
            peaks = _megabytes(v["peak_gpu_bytes"]), _megabytes(v["peak_rss_bytes"])
            name = f"{r['device']}, {r['name']}"
            rows.append((name, f"{v['wall_s']:.1f} s", f"{begins:.1f} s", *stages, str(v["compiled"] or ""), *peaks))
    text = "Preset fast. Cold: nothing is compiled yet for the GPU; the last columns are peaks of memory."
    columns = ("", "in all", "beginning", "stage 1", "palette", "stage 2", "compiled", "GPU", "memory")
    return Table("Training", text, columns, rows)


def _scores(results: Results) -> Table:
    rows = [
        (f"{r['device']}, {r['name'].removeprefix('score ')}", *_scored(r["value"]))
        for r in _of(results, "train") if r["name"].startswith("score")
    ]  # fmt: skip
    columns = ("", "PSNR", "foreground", "SSIM", "FLIP", "s a view")
    return Table("Scores", "Unseen views on white; the mean of the images' PSNR.", columns, rows)


def _scored(v: Mapping[str, float]) -> tuple[str, ...]:
    return (
        f"{v['psnr']:.2f}",
        f"{v['foreground']:.2f}",
        f"{v['ssim']:.4f}",
        f"{v['flip']:.4f}",
        f"{v['s_per_view']:.4f}",
    )


def _compared(results: Results) -> Table:
    rows = [
        (r["name"], f"{r['value']['mean']:.1e}", f"{r['value']['largest']:.1e}", f"{r['value']['above_2_levels']:.1e}")
        for r in _of(results, "compare")
    ]  # fmt: skip
    text = "Absolute difference of RGB in [0, 1] between two drawings of one scene on white."
    return Table("Pictures", text, ("", "mean", "largest", "share above 2/255"), rows)


def _images(results: Results) -> Table:
    rows = [
        (r["name"], *_times(r["value"]), _milliseconds(r["value"].get("device_ms"))) for r in _of(results, "images")
    ]
    text = (
        "Complete images on white, as svv evaluate makes them, and the time between two events of the GPU's own clock."
    )
    return Table("Images", text, ("network, size", "median", "range", "by events"), rows)


def _painting(results: Results) -> Table:
    rows = []
    for r in _of(results, "paint"):
        v = r["value"]
        if "wall_s" in v:
            rows.append((r["name"], f"{v['wall_s']:.1f} s", _megabytes(v["peak_gpu_bytes"])))
        else:
            rows.append((r["name"], *_times(v)[:1], ""))
    return Table("Painting", "With a picture of the gallery.", ("", "took", "peak on the GPU"), rows)


def _chart(results: Results) -> Table:
    rows = []
    for r in _of(results, "chart"):
        v = r["value"]
        times = (f"{seconds:.1f} s" for seconds in (v["wall_s"], v["seconds"]["base"], v["seconds"]["pcn"]))
        rows.append((r["name"], *times, *_scored(v)[:3]))
    text = "Palette network on eight unseen views after as many steps of stages 1 and 2 of the preset balanced."
    columns = ("steps", "in all", "stage 1", "stage 2", "PSNR", "foreground", "SSIM")
    return Table("Accuracy against time", text, columns, rows)


def _steps(results: Results) -> Table:
    rows = []
    for r in _of(results, "profile"):
        v = r["value"]
        counts = f"{v['launches']:.0f}", str(sum(v["waits"].values()))
        rows.append((r["name"], *_times(v), _milliseconds(v["device_ms"] or None), *counts))
    text = "Traces lie beside this page; chrome://tracing and Perfetto show them."
    return Table("Steps", text, ("", "median", "range", "the GPU works", "launches", "waits"), rows)


def _waits(results: Results) -> Table:
    rows = [
        (r["name"], line, str(count)) for r in _of(results, "profile") for line, count in r["value"]["waits"].items()
    ]
    return Table("Waits", "Lines that wait for the GPU, in a step or an image.", ("", "line", "times"), rows)


def _plain(results: Results, part: str, heading: str, text: str) -> Table:
    rows = []
    for r in _of(results, part):
        value = r["value"]
        said = ", ".join(f"{k}: {v}" for k, v in value.items()) if isinstance(value, dict) else str(value)
        rows.append((r["name"], said))
    return Table(heading, text, ("", "result"), rows)


def _times(v: Mapping[str, float]) -> tuple[str, str]:
    return f"{v['median_ms']:.1f} ms", f"{v['least_ms']:.1f} to {v['most_ms']:.1f}"


def _milliseconds(value: float | None) -> str:
    return "" if value is None else f"{value:.2f} ms"


def _megabytes(value: float | None) -> str:
    return "" if not value else f"{value / 1e6:.0f} MB"
