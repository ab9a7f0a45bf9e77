"""Painting of scenes of several transfer functions (:mod:`svv.fields.scene.joined`), function by function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from svv.errors import BadInput, Progress, part
from svv.fields.scene.joined import members, with_members
from svv.fields.scene.scene import Scene
from svv.io.scene_file import checkpoint_of_layer
from svv.options.making import PaintOptions
from svv.train.paint.ink import StyleInput
from svv.train.paint.plan import ordered
from svv.train.run.previews import Show
from svv.train.run.report import Report

Paint = Callable[[Scene, Sequence[StyleInput], PaintOptions, Progress, Path | None, Show | None], tuple[Scene, Report]]
"""Paints a scene of one function: scene, styles, options, progress, checkpoint and preview -> scene and report."""


def stylize_layers(
    scene: Scene,
    inputs: Sequence[StyleInput],
    asked: PaintOptions,
    paint: Paint,
    progress: Progress,
    checkpoint: Path | None,
    preview: Show | None,
) -> tuple[Scene, Report]:
    """Paint the regions of a joined scene with ``paint``, member by member; raises BadInput as ``stylize_scene``.

    Its one painting is replaced, or continued with ``go_on``; members' checkpoints lie beside the file.
    """
    every, go_on = list(members(scene)), asked.go_on
    if go_on and all(member.styled is None for member in every):
        raise BadInput("The scene holds no styled network to continue with: leave out --continue.")
    order = ordered(scene, inputs, replace(asked, go_on=False))
    work, notes = _parted(scene, order.pairs), [*order.notes]
    for number in [k for k, (_, pairs) in work.items() if not any(every[k].regions[r].seen_opacity for r in pairs)]:
        if len(work) > 1:  # the last one says that nothing is visible
            numbers, pairs = work.pop(number)
            said = ", ".join(str(numbers[own]) for own in pairs)
            notes.append(f"Not painted, because nothing of its transfer function is visible: region {said}.")
    reports: dict[int, Report] = {}
    for number, member in enumerate(every):
        goes_on = go_on and member.styled is not None
        for name in () if goes_on else member.variants:
            every[number] = every[number].without_variant(name)
        if number not in work:
            continue
        pairs = work[number][1]
        used = sorted(set(pairs.values()))
        mapping = {region: used.index(style) for region, style in pairs.items()}
        options = replace(asked, mapping=mapping, keep=(), go_on=goes_on, variant=None if goes_on else asked.variant)
        done = part(progress, len(reports) / len(work), (len(reports) + 1) / len(work))
        saved = None if checkpoint is None else checkpoint_of_layer(checkpoint, number)
        show = None if preview is None else partial(_show, preview, scene, every, number)
        styles = [inputs[style] for style in used]
        every[number], reports[number] = paint(every[number], styles, options, done, saved, show)
    styled = with_members(scene, every)
    report = _as_one(styled, reports, {number: own for number, (own, _) in work.items()}, notes)
    return replace(styled, made={**scene.made, "stylized": report}), report


def _parted(scene: Scene, pairs: Mapping[int, int]) -> dict[int, tuple[list[int], dict[int, int]]]:
    """Return the numbers of the regions of each layer to paint, and the style of each region, by its own number."""
    work = {}
    for layer in range(len(scene.layers) + 1):
        numbers = [k for k, region in enumerate(scene.regions) if region.layer == layer]
        own = {k: pairs[number] for k, number in enumerate(numbers) if number in pairs}
        if own:
            work[layer] = numbers, own
    return work


def _show(preview: Show, scene: Scene, every: Sequence[Scene], number: int, painted: Scene) -> None:
    """Show a joined scene with the present state of one member's painting."""
    preview(with_members(scene, [*every[:number], painted, *every[number + 1 :]]))


def _as_one(
    scene: Scene, reports: Mapping[int, Report], numbers: Mapping[int, Sequence[int]], notes: Sequence[str]
) -> Report:
    """Return the report of a joined scene from those of its members, whose regions have these ``numbers``."""
    each = list(reports.values())
    seconds: dict[str, float] = {}
    for report in each:
        for stage, spent in report["seconds"].items():
            seconds[stage] = seconds.get(stage, 0.0) + spent
    gpu = [report["peak_gpu_bytes"] for report in each if report["peak_gpu_bytes"] is not None]
    told: Mapping[int, Any] = reports
    styles, manner, hand = (
        {str(numbers[k][int(own)]): how for k, report in told.items() for own, how in report.get(key, {}).items()}
        for key in ("styles", "manner", "hand")
    )
    return {
        **each[0],
        "seconds": seconds,
        "peak_rss_bytes": max(report["peak_rss_bytes"] for report in each),
        "peak_gpu_bytes": max(gpu) if gpu else None,
        "parameters": scene.info()["parameters"]["total"],
        "styles": styles,
        "manner": manner,
        "hand": hand,
        "masked": sorted({style for report in each for style in report["masked"]}),
        "continued": [numbers[k][own] for k, report in reports.items() for own in report["continued"]],
        "previews": [seconds for report in each for seconds in report["previews"]],
        "notes": list(dict.fromkeys([*notes, *(note for report in each for note in report["notes"])])),
    }
