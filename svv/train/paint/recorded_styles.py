"""What a painted scene keeps of its styles: their pictures, and how each was laid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from svv.fields.scene.scene import Scene
from svv.fields.scene.style_pictures import KEPT
from svv.io.pictures.picture_data import as_data, mask_as_data
from svv.options.making import PaintOptions
from svv.train.paint.ink import Ink, StyleInput
from svv.train.paint.plan import ordered
from svv.train.run.report import Report


def keep_styles(
    before: Scene, painted: Scene, inputs: Sequence[StyleInput], asked: PaintOptions, report: Report
) -> Scene:
    """Return a ``painted`` scene that keeps the pictures of its styles, painted as ``report`` tells."""
    order = ordered(before, inputs, replace(asked, go_on=False))
    told = before.made.get("stylized", {}).get(KEPT, {}) if asked.go_on else {}
    laid = {k: how for k, how in told.get("laid", {}).items() if int(k) not in order.pairs}
    styles = {how["style"]: told["styles"].get(how["style"], {}) for how in laid.values()}
    named = {
        number: f"{order.labels[number]} ({report['divided'][str(region)]['part']})"
        for region, number in order.pairs.items()
        if inputs[number].divided and str(region) in report["divided"]
    }
    keys: dict[int, str] = {}
    for number in sorted(set(order.pairs.values())):
        key, given = named.get(number, order.labels[number]), inputs[number]
        while key in styles:  # pictures of one name from several folders
            key += "'"
        keys[number], styles[key] = key, {}
        style, mask = order.styles[number], given.measured if given.divided else order.masks[number]
        if not isinstance(style, Ink):
            styles[key]["picture"] = as_data(style)
        if mask is not None:
            styles[key]["mask"] = mask_as_data(mask)
        if given.divided and given.mask is not None:
            styles[key]["part"] = mask_as_data(given.mask)
    for region, number in order.pairs.items():
        laid[str(region)] = {
            "style": keys[number],
            "manner": report["manner"].get(str(region), "auto"),
            "hand": report.get("hand", {}).get(str(region), "auto"),
            "stroke_size": asked.stroke_size,
        }
    made = {**painted.made["stylized"], KEPT: {"styles": styles, "laid": laid}}
    return replace(painted, made={**painted.made, "stylized": made})
