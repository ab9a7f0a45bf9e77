"""Cross-view consistency: frames of an orbit are warped onto each other and compared.

The protocol, after StyleRF-VolVis (section "Evaluation metrics"): pairs of frames an interval apart on the 181-view
path, 1 for short-range and 10 for long-range consistency; the earlier frame is moved onto the later one by softmax
splatting along the optical flow. Only pixels that are visible in both frames, pass the forward-backward check and are
not on a motion boundary are compared. The flow is computed once from the scene's expected depth and once by an
estimator that sees only pictures of the unstyled scene.

Straight colours are compared, without a background. The opacity of a translucent scene changes with the view, and over
white, two frames of a scene of one grey therefore differed by as much as the frames of any style.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.errors import Progress, part, silent
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import write_json
from svv.io.files.keyed_results import make_keyed_folder
from svv.io.pictures.output import write_png
from svv.render.pictures import read_png
from svv_bench.keys import key_of_measure
from svv_bench.styles.flow import camera_flow, is_consistent
from svv_bench.styles.paper import seen_means
from svv_bench.styles.path import METRICS, OrbitPath, Protocol, finely

Frame = Callable[[int], NDArray[np.floating]]
"""RGBA of a frame of the orbit, straight alpha in [0, 1] (h, w, 4), by its number."""

SAVE_EVERY = 20
"""Number of pairs that are measured before results are saved."""


def draw_frames(folder: Path, key: str, numbers: Sequence[int], make: Frame, progress: Progress = silent) -> Path:
    """Write missing frames as ``folder/0000.png`` and so on; frames of another key are removed first."""
    make_keyed_folder(folder, key)
    for index, number in enumerate(numbers):
        progress(index / len(numbers), f"frame {index + 1} of {len(numbers)}")
        path = folder / f"{number:04d}.png"
        if not path.exists():
            write_png(path, make(number))
    progress(1.0, "frames")
    return folder


def measure_frames(path: OrbitPath, frames: Path, progress: Progress = silent) -> list[dict[str, Any]]:
    """Measure the differences of pairs in a folder of frames that are not yet in its ``pairs.json``.

    Returns:
        Records per pair and kind of flow: ``flow``, ``interval``, ``first``, ``second``, ``rmse``, ``mse``, ``flip``,
        ``share`` (of the image's pixels that were compared).
    """
    file = frames / "pairs.json"
    records = _read(file, path.key)
    found = {(r["flow"], r["first"], r["second"]) for r in records}
    wanted = [(kind, n, a, b) for kind in path.protocol.flows for n, a, b in path.protocol.pairs]
    left = [pair for pair in wanted if (pair[0], *pair[2:]) not in found]
    for index, (kind, interval, first, second) in enumerate(left):
        progress(index / len(left), f"{kind} flow, frames {first} and {second}")
        one, two = (straight(frames, number) for number in (first, second))
        values = path.warp(kind, first, second).differences(one, two)
        records.append({"flow": kind, "interval": interval, "first": first, "second": second, **values})
        if index % SAVE_EVERY == 0 or index == len(left) - 1:
            write_json(file, {"key": path.key, "pairs": records})
    progress(1.0, "measured")
    return records


def straight(frames: Path, number: int) -> NDArray[np.uint8]:
    """Return the straight colour levels (h, w, 3) of a frame, without its alpha."""
    return read_png(frames / f"{number:04d}.png")[..., :3]


def means(records: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a row per kind of flow and interval: means over its pairs with any pixels to compare."""
    groups = dict.fromkeys((r["flow"], r["interval"]) for r in records)
    rows = []
    for flow, interval in groups:
        own = [r for r in records if (r["flow"], r["interval"]) == (flow, interval) and r["share"] > 0]
        names = (*METRICS, "share")
        values = {name: float(np.mean([r[name] for r in own])) if own else None for name in names}
        rows.append({"flow": flow, "interval": interval, "pairs": len(own), **values})
    return rows


def flow_error(path: OrbitPath, kind: str) -> dict[int, float]:
    """Return the mean distance in pixels of an estimator's flow from the depth's, where that is consistent.

    Returns:
        The distance by interval.
    """
    result: dict[int, list[float]] = {}
    for interval, first, second in path.protocol.pairs:
        exact, guess = path.warp("depth", first, second), path.warp(kind, first, second)
        back = camera_flow(path.cameras[second], path.cameras[first], path.view(second)[0])
        checked = is_consistent(exact.flow, back)
        distance = np.linalg.norm(guess.flow - exact.flow, axis=-1)[checked]
        result.setdefault(interval, []).append(float(np.nanmean(distance)))
    return {interval: float(np.mean(values)) for interval, values in result.items()}


def consistency(
    scene: Scene, network: str, protocol: Protocol, out: Path, key: str, progress: Progress = silent
) -> dict[str, Any]:
    """Measure the short- and long-range consistency of a scene on its orbit.

    Args:
        scene: Scene to measure.
        network: ``base``, ``pcn`` or ``styled``.
        protocol: The frames and their comparison.
        out: Folder of frames, geometry and results; results with the same key are reused.
        key: Key that identifies the scene.
        progress: Called several times per second; the work stops if it raises, and the same call resumes it.

    Returns:
        ``rows``: the result of :func:`means`, with the figures of :func:`svv_bench.styles.paper.seen_means`;
        ``flow_error``: the result of :func:`flow_error` for each estimator.
    """
    how = key_of_measure({"scene": key, "protocol": asdict(protocol)})
    path = OrbitPath(scene, protocol, out / "geometry", how, part(progress, 0.0, 0.2))
    frames = draw_frames(
        out / "frames", f"{how}-{network}", protocol.frames,
        partial(path.render, finely(scene), network), part(progress, 0.2, 0.4),
    )  # fmt: skip
    rows = means(measure_frames(path, frames, part(progress, 0.4, 0.9)))
    seen = seen_means(path, frames, part(progress, 0.9, 0.95))
    rows = [{**row, **seen[row["flow"], row["interval"]]} for row in rows]
    errors = {}
    for kind in protocol.flows:
        if kind != "depth":
            progress(0.95, f"{kind} against depth")
            errors[kind] = flow_error(path, kind)
    progress(1.0, "measured")
    return {"rows": rows, "flow_error": errors}


def _read(file: Path, key: str) -> list[dict[str, Any]]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        return list(content["pairs"]) if content["key"] == key else []
    except (OSError, ValueError, KeyError, TypeError):
        return []  # not begun, or damaged
