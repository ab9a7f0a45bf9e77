"""Reports of training and painting: the same figures under the same names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypedDict

import torch

from svv.fields.scene.scene import Scene
from svv.kernels.dispatch import device_report
from svv.measure import Cost
from svv.train.run.config import Preset


class Report(TypedDict, total=False):
    """Figures of a run, as the command writes them (JSON); those of one kind of run are missing from others."""

    seconds: dict[str, float]
    """Duration of each stage, and ``total``."""
    cpu_seconds: float
    """Processor time, the sum over all threads: below ``total`` if other programs kept the machine busy."""
    peak_rss_bytes: int
    parameters: int
    device: str
    gpu: str | None
    kernels: str
    peak_gpu_bytes: int | None
    threads: int
    seed: int
    preset: str
    notes: list[str]
    encoding: str
    lighting: str
    learned_from: str
    warnings: list[str]
    confidence: list[float]
    features: str
    styles: dict[str, str]
    """Style of each painted region, by its number, as ``manner`` and ``hand``."""
    manner: dict[str, str]
    hand: dict[str, str]
    masked: list[str]
    divided: dict[str, dict[str, Any]]
    """Part of a divided picture that paints each region, by its number (:mod:`svv.train.paint.dividing`)."""
    stroke_size: float
    strength: float
    continued: list[int]
    previews: list[float]


def report_on(scene: Scene, seconds: Mapping[str, float], cost: Cost, chosen: Preset, seed: int) -> Report:
    """Return the figures that every finished run has; ``seconds`` are those of each stage, and ``total``."""
    used = device_report(scene.device)
    return Report(
        seconds=dict(seconds),
        cpu_seconds=cost.cpu_seconds,
        peak_rss_bytes=cost.peak_rss_bytes,
        parameters=scene.info()["parameters"]["total"],
        device=used["device"],
        gpu=used["gpu"],
        kernels=used["kernels"],
        peak_gpu_bytes=used["peak_gpu_bytes"],
        threads=torch.get_num_threads(),
        seed=seed,
        preset=chosen.name,
    )
