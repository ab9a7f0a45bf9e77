"""Reports of training and painting: the same figures under the same names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from svv.fields.scene.scene import Scene
from svv.kernels.dispatch import device_report
from svv.measure import Cost
from svv.train.config import Preset


def report_on(
    scene: Scene, seconds: Mapping[str, float], cost: Cost, chosen: Preset, seed: int, **more: Any
) -> dict[str, Any]:
    """Return the figures of a finished run, as the command writes them (JSON).

    Args:
        scene: Resulting scene.
        seconds: Duration of each stage, and ``total``.
        cost: Time and memory of the run.
        chosen: Settings of the run.
        seed: Seed of the run.
        more: Figures that only this kind of run has.
    """
    return {
        "seconds": dict(seconds),
        "peak_rss_bytes": cost.peak_rss_bytes,
        "parameters": scene.info()["parameters"]["total"],
        **device_report(scene.device),
        "threads": torch.get_num_threads(),
        "seed": seed,
        "preset": chosen.name,
        **more,
    }
