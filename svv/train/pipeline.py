"""From views to a scene, and from a scene to a stylized one: the stages in order, measured, resumable."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from svv import __version__
from svv.errors import BadInput, Progress, part, silent
from svv.fields.rendering import Marching
from svv.fields.scene import Region, Scene
from svv.io.viewset import ViewSet
from svv.measure import measured
from svv.train.checkpoint import Checkpoint
from svv.train.config import Preset, fitted_field, preset
from svv.train.evaluate import evaluate_scene as evaluate_scene
from svv.train.recolour import palette_of, recolour
from svv.train.reconstruct import hull, reconstruct

LEAST_VIEWS = 3
BASE_PART = 0.68
"""Part of a time limit that goes to stage 1; the rest, less what comes between, is stage 2's."""


def train_scene(
    views: ViewSet,
    preset_name: str = "balanced",
    time_limit: float | None = None,
    seed: int = 0,
    progress: Progress = silent,
    checkpoint: Path | None = None,
) -> tuple[Scene, dict[str, Any]]:
    """Stages 1 and 2: base field, palette, palette colour network.

    Args:
        views: Training views.
        preset_name: ``draft``, ``fast``, ``balanced`` or ``paper``.
        time_limit: Seconds for the whole training; longer schedules are shortened to fit.
        seed: The same views, preset, seed and number of threads give the same scene (without a time limit).
        progress: Called several times a second; stops the training when it raises.
        checkpoint: File to save to now and then, and to go on from if it is there. The caller removes it once the
            scene is safe.

    Returns:
        The scene, and a report: ``seconds`` a stage and ``total``, ``peak_rss_bytes``, ``parameters``, ``device``,
        ``seed``, ``preset``, ``notes`` (why the model has the size it has).

    Raises:
        BadInput: fewer than 3 views, nothing visible in all of them, an unknown preset, no time.
    """
    chosen = preset(preset_name)
    if len(views.cameras) < LEAST_VIEWS:
        raise BadInput(
            f"{len(views.cameras)} views are too few to train on; give at least {LEAST_VIEWS} (92 are usual)."
        )
    if time_limit is not None and not time_limit > 0:
        raise BadInput(f"The time limit must be more than 0 seconds, not {time_limit}.")
    saved = None if checkpoint is None else Checkpoint(checkpoint, _key(views, chosen, time_limit, seed))
    with measured() as cost:
        scene, seconds, notes = _train(views, chosen, time_limit, seed, progress, saved)
    seconds["total"] = sum(seconds.values())
    report = {
        "seconds": seconds,
        "peak_rss_bytes": cost.peak_rss_bytes,
        "parameters": scene.info()["parameters"]["total"],
        "device": "cpu",
        "threads": torch.get_num_threads(),
        "seed": seed,
        "preset": chosen.name,
        "notes": notes,
    }
    made = {
        **report,
        "svv": __version__,
        "torch": torch.__version__,
        "views": len(views.cameras),
        "source": views.meta,
    }
    return Scene(**{**vars(scene), "made": made}), report


def _train(
    views: ViewSet,
    chosen: Preset,
    limit: float | None,
    seed: int,
    progress: Progress,
    saved: Checkpoint | None,
) -> tuple[Scene, dict[str, float], list[str]]:
    seconds: dict[str, float] = {}
    notes: list[str] = []
    if saved is not None and "base" in saved.finished:
        values = saved.finished["base"]
        scene, seconds, notes = (
            Scene.from_arrays(values["header"], saved.arrays),
            values["seconds"],
            values["notes"],
        )
    else:
        with _timed(seconds, "hull"):
            occupancy = hull(views, chosen.reconstruct.cells, part(progress, 0.0, 0.02))
        notes.append(
            f"the visual hull of {len(views.cameras)} views fills {occupancy.fraction:.1%} of the box"
        )
        field = chosen.field
        if chosen.fitted:
            field, reason = fitted_field(field, views.cameras, occupancy.box)
            notes.append(reason)
        first = None if limit is None else max(0.1, (limit - seconds["hull"]) * BASE_PART)
        base, occupancy, marching, seconds["base"] = reconstruct(
            views, field, chosen.reconstruct, occupancy, seed, first, part(progress, 0.02, 0.7), saved
        )
        notes.append(
            f"{occupancy.fraction:.1%} of the box is left after pruning what the density showed empty"
        )
        scene = Scene(field, occupancy, marching, base, camera_rig=camera_rig(views))
        if saved is not None:
            header, arrays = scene.to_arrays()
            saved.finish("base", {"header": header, "seconds": seconds, "notes": notes}, arrays)
    with _timed(seconds, "palette"):
        palette = palette_of(views, scene.occupancy, seed)
    notes.extend(palette.steps)
    left = None if limit is None else max(0.1, limit - sum(seconds.values()))
    network, shares, seconds["pcn"] = recolour(
        views, scene.base, scene.occupancy, scene.marching, palette.colours, scene.settings, chosen.recolour, seed,
        left, part(progress, 0.7, 1.0), saved,
    )  # fmt: skip
    regions = tuple(
        Region(tuple(colour), float(share))
        for colour, share in zip(network.colours.tolist(), shares, strict=True)
    )
    return Scene(**{**vars(scene), "palette": network, "regions": regions}), seconds, notes


def camera_rig(views: ViewSet) -> dict[str, Any]:
    """Where the training cameras stand: ``centre`` (3,), ``radius`` (median, world units), ``fov_x`` (radians), ``size``."""
    positions = np.stack([c.camera_to_world[:3, 3] for c in views.cameras])
    axes = np.stack([-c.camera_to_world[:3, 2] for c in views.cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    centre = np.linalg.lstsq(across.sum(0), np.einsum("nij,nj->i", across, positions), rcond=None)[0]
    return {
        "centre": [float(v) for v in centre],
        "radius": float(np.median(np.linalg.norm(positions - centre, axis=1))),
        "fov_x": float(np.median([c.fov_x for c in views.cameras])),
        "size": [views.cameras[0].width, views.cameras[0].height],
    }


@contextmanager
def _timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    begin = time.monotonic()
    yield
    seconds[name] = time.monotonic() - begin


def _key(views: ViewSet, chosen: Preset, limit: float | None, seed: int) -> dict[str, Any]:
    """What a training run depends on: a checkpoint of anything else is not gone on from."""
    pixels = views.images[:: max(1, len(views.images) // 8), ::16, ::16].astype(np.int64)
    return {
        "cameras": math.fsum(
            float(np.abs(c.camera_to_world).sum()) * (k + 1) for k, c in enumerate(views.cameras)
        ),
        "pixels": int((pixels * np.arange(1, pixels.size + 1).reshape(pixels.shape)).sum()),
        "views": views.images.shape,
        "preset": asdict(chosen),
        "limit": limit,
        "seed": seed,
        "version": __version__,
    }
