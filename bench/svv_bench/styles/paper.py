"""The paper's own measure of consistency beside ours, and LPIPS over the pixels that ours compares.

StyleRF-VolVis (section "Evaluation metrics") moves one whole frame to another by softmax splatting along an optical
flow estimated with RAFT and reports MSE and LPIPS. It states neither the background nor what is done where nothing
arrives. Here frames are over white, the background counts, the flow is the protocol's estimated one (RAFT's weights may
not be distributed), and where nothing arrives, MSE leaves pixels out, and LPIPS sees the later frame in both pictures.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray

from svv.errors import Progress, silent
from svv.io.files.atomic import write_json
from svv.render.pictures import over_white, read_png
from svv.train.lpips import MIN_SIZE, Lpips, load_lpips, lpips
from svv_bench.keys import key_of_measure
from svv_bench.styles.flow import splatted
from svv_bench.styles.path import LEAST_ARRIVED, OrbitPath

PAPER = ("paper mse", "paper lpips")
"""Figures by the paper's protocol."""
SEEN = ("lpips", *PAPER)
"""All figures of this module."""
FORM = 1
"""To be raised when the meaning of a figure changes; saved figures are then measured again."""

Picture = NDArray[np.floating]


def lpips_within(network: Lpips | None, one: Picture, two: Picture, mask: NDArray[np.bool_]) -> float | None:
    """Return the LPIPS of two pictures (h, w, 3) in [0, 1], averaged over the pixels of a mask (h, w) alone.

    Elsewhere both pictures are white, because each activation depends on its surroundings. Each layer's distances are
    weighted by the share of the mask in their cells.

    Returns:
        The distance; None without a network or a pixel, or if a side is shorter than 31 pixels.
    """
    if network is None or not mask.any() or min(mask.shape) < MIN_SIZE:
        return None
    shown = np.stack([np.where(mask[..., None], p, 1.0) for p in (one, two)]).astype(np.float32)
    pair = torch.from_numpy(shown).permute(0, 3, 1, 2) * 2 - 1
    inside = torch.from_numpy(mask.astype(np.float32))[None, None]
    total = 0.0
    with torch.no_grad():
        for values, head in zip(network.activations(pair), network.heads, strict=True):
            unit = values / (values.norm(dim=1, keepdim=True) + 1e-10)
            distance = ((unit[:1] - unit[1:]).square() * head).sum(1)[0]
            weight = F.adaptive_avg_pool2d(inside, distance.shape)[0, 0]
            total += float((distance * weight).sum() / weight.sum())
    return total


def paper_figures(
    network: Lpips | None, one: Picture, two: Picture, flow: NDArray[np.floating], importance: NDArray[np.floating]
) -> dict[str, float | None]:
    """Compare a whole frame, moved along the flow, with another; see the module.

    Args:
        network: LPIPS; None leaves it out.
        one: The first frame, in [0, 1]. (h, w, 3)
        two: The second frame. (h, w, 3)
        flow: Flow from the first to the second, in pixels. (h, w, 2)
        importance: Which pixel wins where several arrive. (h, w)

    Returns:
        ``paper mse`` and ``paper lpips``; None where nothing can be compared.
    """
    moved, arrived = splatted(one, flow, importance)
    mask = (arrived >= LEAST_ARRIVED) & np.isfinite(moved).all(axis=-1)
    if not mask.any():
        return dict.fromkeys(PAPER)
    filled = np.where(mask[..., None], moved, two)
    seen = None if network is None or min(mask.shape) < MIN_SIZE else lpips(network, filled, two)
    return {"paper mse": float(np.square(moved - two)[mask].mean()), "paper lpips": seen}


def seen_means(path: OrbitPath, frames: Path, progress: Progress = silent) -> dict[tuple[str, int], dict[str, Any]]:
    """Measure LPIPS and the paper's figures of all pairs in a folder of an orbit's frames.

    Args:
        path: The orbit.
        frames: Folder of its frames, in which the result is kept.
        progress: Called before each pair.

    Returns:
        By kind of flow and interval, the means of :data:`SEEN`; None where a figure cannot be measured: the paper's for
        the flow of the depth, and LPIPS without its weights.
    """
    network = load_lpips()
    file = frames / f"seen-{key_of_measure(path.key, FORM, network is not None)}.json"
    if file.exists():
        kept = json.loads(file.read_text(encoding="utf-8"))
        return {(r["flow"], r["interval"]): {name: r[name] for name in SEEN} for r in kept}
    found: dict[tuple[str, int], list[dict[str, Any]]] = {}
    wanted = [(kind, *pair) for kind in path.protocol.flows for pair in path.protocol.pairs]
    for index, (kind, interval, first, second) in enumerate(wanted):
        progress(index / len(wanted), f"LPIPS, frames {first} and {second}")
        shown = [read_png(frames / f"{number:04d}.png") for number in (first, second)]
        straight = [picture[..., :3] for picture in shown]
        compared = path.warp(kind, first, second).compared(*straight)
        values: dict[str, Any] = {"lpips": lpips_within(network, *compared)}
        if kind != "depth":
            flow, _, importance = path.estimated(kind, first, second)
            one, two = (over_white(picture) / 255.0 for picture in shown)
            values |= paper_figures(network, one, two, flow, importance)
        found.setdefault((kind, interval), []).append(values)
    means = {group: mean_of(values, SEEN) for group, values in found.items()}
    write_json(file, [{"flow": kind, "interval": n, **values} for (kind, n), values in means.items()])
    return means


def mean_of(records: Sequence[dict[str, Any]], names: Sequence[str]) -> dict[str, float | None]:
    """Return the mean of each figure over the records that have it; None if none has."""
    result: dict[str, float | None] = {}
    for name in names:
        values = [r[name] for r in records if r.get(name) is not None and np.isfinite(r[name])]
        result[name] = float(np.mean(values)) if values else None
    return result
