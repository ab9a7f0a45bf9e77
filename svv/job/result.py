"""The results of a job as a page (:mod:`svv.job.page`)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from svv.core.colour.hex_codes import to_hex
from svv.core.interval_text import interval_text
from svv.fields.scene.region import label_of
from svv.fields.scene.scene import Scene
from svv.io.views.view_meta import ViewMeta, known
from svv.io.views.viewset import read_meta
from svv.job.page import Page, Picture, Table, cost_table, write_page
from svv.job.source import Drawn, ViewSource
from svv.job.steps import Job
from svv.progress import duration
from svv.train.evaluate import Scores

SCORES = {
    "psnr": ("PSNR", "{:.2f} dB"),
    "psnr_foreground": ("PSNR, foreground", "{:.2f} dB"),
    "ssim": ("SSIM", "{:.4f}"),
    "flip": ("FLIP", "{:.4f}"),
    "lpips": ("LPIPS", "{:.4f}"),
    "seconds_per_view": ("Time for a view", "{:.2f} s"),
}
"""Field of :class:`svv.train.evaluate.Scores` -> column heading and number format."""

LIGHT = {
    "network": "learned by a network, at the camera",
    "phong": "explicit, can be moved",
    "none": "none in the views",
}
"""Lighting of a scene -> its description for people."""

DARK_TO_LIGHT = ("Dark", "Middle", "Light")
"""Headings of the colours of a part of a picture."""

PROTOCOL = (
    "Views that were not trained on, truth and prediction over white. PSNR is the mean over the images; the "
    "foreground is where the true opacity is above 0. Higher is better for PSNR and SSIM, lower for FLIP and LPIPS; "
    "a dash means that a metric is not available."
)


def write_result(path: Path, job: Job) -> None:
    """Write the page of a finished job; raises BadInput if the file cannot be written."""
    scene = Scene.load(job.variants.get("styled", ("", None))[1] or job.scene)
    training, styling = _read(job, "train", "train.json"), _read(job, "stylize", "stylize.json")
    scores = {k: Scores.from_json(v) for k, v in _read(job, "evaluate", "scores.json").items()}
    styles = (
        [Picture("Styles", "The styles with which the regions are painted.", job.out / "styles.png")] if styling else []
    )
    parts: list[Picture | Table] = [
        Picture("All around", "The same views of every variant.", job.out / "contact.png"),
        _regions(scene),
        *styles,
        *_shared(scene),
        Picture("Region by region", "Each region alone, with the others made transparent.", job.out / "regions.png"),
    ]
    if scores:
        parts += [
            _scores(scores),
            Picture("Unseen views", "The error is the largest of the three channels.", job.out / "unseen.png"),
        ]
    parts.append(cost_table(list(job.stages.costs.values())))
    page = Page(
        "From a volume to a stylized orbit",
        "A radiance field learned from views of a volume rendering: seen from any side, recoloured and restyled.",
        _numbers(training, scores),
        job.out / "orbit.mp4",
        parts,
        _facts(job, scene, training, styling),
        (job.out / "scene.html", "Turn and edit the scene in this browser"),
    )
    write_page(path, page)


def _numbers(training: dict[str, Any], scores: dict[str, Scores]) -> list[tuple[str, str]]:
    numbers = []
    if scores:
        pcn = scores["pcn"]
        numbers.append((f"{pcn.psnr:.1f} dB", "PSNR on unseen views"))
        numbers.append((f"{pcn.psnr_foreground:.1f} dB", "PSNR of the foreground"))
        numbers.append((f"{pcn.seconds_per_view:.2f} s", f"for a view of {' x '.join(map(str, pcn.size))} pixels"))
    numbers.append((duration(training["seconds"]["total"]), "of training"))
    numbers.append((f"{training['scene_bytes'] / 1e6:.1f} MB", "scene file"))
    numbers.append((f"{training['peak_rss_bytes'] / 1e9:.1f} GB", "peak memory of training"))
    return numbers


def _regions(scene: Scene) -> Table:
    rows, styled = [], "styled" in scene.networks
    known = all(r.values for r in scene.regions)
    for index, region in enumerate(scene.regions):
        row = [str(index), to_hex(region.colour), f"{region.share:.0%}"]
        if known:
            row.append(interval_text(*(region.values or ())))
        rows.append([*row, region.style or "as it is"] if styled else row)
    columns = ["Region", "Colour", "Share"] + ["Values"] * known + ["Style"] * styled
    text = "The regions of the palette: each can be recoloured, relit, thinned out or stylized on its own."
    return Table("Regions", text, columns, rows, swatch=(1,))


def _shared(scene: Scene) -> list[Table]:
    """Return the table of the parts of a picture that regions share; none if no picture was divided."""
    divided = scene.made.get("stylized", {}).get("divided", {})
    if not divided:
        return []
    rows = [
        [label_of(scene.regions, int(k)), *one["colours"], one["part"], one["style"], f"{one['share']:.0%}"]
        for k, one in divided.items()
    ]
    text = "What of a picture paints each region that shares it: its colours from dark to light. --map chooses others."
    columns = ("Region", *DARK_TO_LIGHT, "Part", "Style", "Share of the strokes")
    return [Table("Parts of the picture", text, columns, rows, swatch=(1, 2, 3))]


def _scores(scores: dict[str, Scores]) -> Table:
    names = {"base": "Base network", "pcn": "Palette network"}
    rows, shown = [], {k: v for k, v in SCORES.items() if any(getattr(s, k) is not None for s in scores.values())}
    for key, values in scores.items():
        found = [(form, getattr(values, name)) for name, (_, form) in shown.items()]
        rows.append([names[key], *("-" if v is None or np.isnan(v) else form.format(v) for form, v in found)])
    return Table("Scores", PROTOCOL, ["Network", *(name for name, _ in shown.values())], rows)


def _facts(job: Job, scene: Scene, training: dict[str, Any], styling: dict[str, Any]) -> list[tuple[str, str]]:
    facts, s = [], job.settings.train
    if isinstance(job.source, Drawn):
        meta = read_meta(job.views)
        grid, distance = known(meta.grid, "grid"), known(meta.sample_distance, "sample_distance")
        facts.append(("Volume", f"{meta.volume}, {' x '.join(map(str, grid.dimensions))}, {grid.type}"))
        facts.append(("Transfer function", str(known(meta.tf, "tf")["Name"])))
        drawn = job.settings.views
        said = f"{drawn.n} for training, {drawn.test} for the scores, {drawn.size} x {drawn.size} pixels"
        facts.append(("Views", said))
        if meta.assumed is not None:
            facts.append(("Assumed", meta.assumed))
        facts.append(("Ray caster", f"VTK {meta.vtk}, {meta.mapper}, sample distance {distance:.4g}"))
    elif isinstance(job.source, ViewSource):
        facts.append(("Views", str(job.source.folder)))
    assumed = ViewMeta.from_json(scene.made["source"], "source").assumed
    if assumed is not None:
        facts.append(("Assumed" if isinstance(job.source, ViewSource) else "Note", assumed))
    if "learned_from" in training:  # not in the reports of older versions
        facts.append(("Learned from", training["learned_from"]))
        facts += [("Warning", said) for said in training["warnings"]]
    facts.append(("Preset", s.preset if s.time_limit is None else f"{s.preset}, at most {duration(s.time_limit)}"))
    facts.append(("Light", LIGHT[scene.settings.lighting] + " (by held-out views)" * (s.lighting == "auto")))
    facts.append(("Seed", str(s.seed)))
    facts.append(("Parameters", f"{int(training['parameters']):,}"))
    facts.append(("Device", training.get("gpu") or training["device"]))
    looked = _read(job, "look", "look.json")
    facts += [("Look", line) for line in looked.get("matches", [])] + [("Note", n) for n in looked.get("notes", [])]
    if styling:
        facts.append(("Stylization", duration(styling["seconds"]["total"])))
        facts.append(("Styles", ", ".join(style.name for style in job.styles)))
        if styling["features"] != "none":
            facts.append(("Style features", styling["features"]))
        facts += [("Note", note) for note in styling["notes"]]
    return facts


def _read(job: Job, stage: str, name: str) -> dict[str, Any]:
    """Read what a stage wrote; empty if the stage was not part of the job."""
    return dict(json.loads((job.out / name).read_text(encoding="utf-8"))) if stage in job.stages.costs else {}
