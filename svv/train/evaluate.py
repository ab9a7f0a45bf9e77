"""Scores of a scene on views, by the protocol that stands beside every number of this project."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from svv.core.colour import over
from svv.core.metrics import flip, psnr, psnr_foreground, ssim
from svv.errors import Progress, silent
from svv.fields.scene import Scene
from svv.io.viewset import ViewSet
from svv.kernels.dispatch import device_report, forget_gpu_peak
from svv.train.lpips import load_lpips, lpips

WHITE = (1.0, 1.0, 1.0)


def evaluate_scene(
    scene: Scene, views: ViewSet, network: str | None = None, progress: Progress = silent
) -> dict[str, Any]:
    """Mean scores over views that were not trained on.

    The truth is alpha-blended on white and the prediction clamped to [0, 1]; scores are means over the images.

    Args:
        scene: What is measured.
        views: The truth.
        network: ``base``, ``pcn`` or ``styled``; by default the last that the scene holds.
        progress: Called after every view.

    Returns:
        ``psnr``, ``psnr_foreground``, ``ssim``, ``flip``, ``lpips`` (None where its weights are not on this machine),
        ``views``, ``size``, ``seconds_per_view`` (median), ``network``, ``background``, and where it was rendered:
        ``device``, ``gpu``, ``kernels``, ``peak_gpu_bytes``.

    Raises:
        BadInput: the scene does not hold that network.
    """
    network = network or scene.networks[-1]
    measure = load_lpips()
    forget_gpu_peak(scene.device)
    scores: dict[str, list[float]] = {k: [] for k in ("psnr", "psnr_foreground", "ssim", "flip", "lpips", "seconds")}
    scene.render(views.cameras[0].resized(64, 64), network)  # warm-up: kernels are compiled on first use
    for number, (camera, image) in enumerate(zip(views.cameras, views.images, strict=True)):
        progress(number / len(views.cameras), f"evaluating {network}")
        begin = time.perf_counter()
        shown = scene.render(camera, network, WHITE).rgba[..., :3]
        scores["seconds"].append(time.perf_counter() - begin)
        truth = image.astype(np.float32) / np.float32(255.0)
        on_white = np.asarray(over(truth, WHITE))
        scores["psnr"].append(psnr(shown, on_white))
        scores["psnr_foreground"].append(psnr_foreground(shown, on_white, truth[..., 3]))
        scores["ssim"].append(ssim(shown, on_white))
        scores["flip"].append(flip(shown, on_white))
        if measure is not None:
            scores["lpips"].append(lpips(measure, shown, on_white))
    progress(1.0, f"evaluating {network}")
    report = device_report(scene.device)
    seconds = float(np.median(scores.pop("seconds")))
    means: dict[str, Any] = {k: float(np.nanmean(v)) if v else None for k, v in scores.items()}
    size = [views.cameras[0].width, views.cameras[0].height]
    return {**means, "views": len(views.cameras), "size": size, "seconds_per_view": seconds, "network": network,
            "background": "white", **report}  # fmt: skip
