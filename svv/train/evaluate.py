"""Scores of a scene on views, by the protocol used for all published figures of this project."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import WHITE
from svv.core.images.metrics import Likeness, flip, on_white
from svv.core.json_values import list_in, needed, number_in, numbers_in, object_in, text_in, whole_in
from svv.errors import Progress, silent
from svv.fields.scene.scene import Scene
from svv.fields.scene.view_cache import disable_view_cache
from svv.io.views.agreement import check_agreement
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import device_report, forget_gpu_peak
from svv.measure import usable_cpus
from svv.train.lpips import load_lpips, lpips

MOST_AT_A_TIME = 8
"""Maximum number of images whose metrics are computed side by side: FLIP needs memory for each."""

COMPARED, COMPARED_SIDE = 8, 64
"""Views whose outlines are compared with the scene's before it is scored, and the longer side of those, pixels."""

LEAST_SHARED = 0.5
"""Intersection over union of the outlines, in terms of alpha, below which views show something else."""

FIGURES = {"psnr", "psnr_foreground", "ssim", "flip"}
"""Scores that may be nan, which JSON does not have."""


def _size_in(value: object, name: str) -> tuple[int, ...]:
    return tuple(whole_in(side, name) for side in list_in(value, 2, name))


READERS: Mapping[str, Callable[[object, str], object]] = {
    "float": number_in, "int": whole_in, "str": text_in, "tuple[int, int]": _size_in, "tuple[float, ...]": numbers_in,
}  # fmt: skip
"""What reads the scores of each kind."""


@dataclass(frozen=True)
class Scores:
    """Mean scores of a scene over views; the field names are the keys of `svv evaluate --json`."""

    psnr: float
    """PSNR in dB, on white."""
    psnr_foreground: float
    """PSNR in dB over the pixels whose true alpha is above 0; nan if no view has such a pixel."""
    ssim: float
    """Structural similarity on white; 1 for equal images."""
    flip: float
    """FLIP error in [0, 1], on white; 0 for equal images."""
    lpips: float | None
    """LPIPS distance on white, 0 for equal images; None if its weights are not on this machine."""
    views: int
    """Number of views."""
    size: tuple[int, int]
    """Width and height of the views in pixels."""
    seconds_per_view: float
    """Median rendering time per view."""
    network: str
    """Network whose colours were rendered: ``base``, ``pcn`` or ``styled``."""
    background: str
    """Background of the comparison: ``white``."""
    device: str
    """Device that rendered: ``cpu`` or ``cuda``."""
    gpu: str | None
    """Name of the GPU; None on a CPU."""
    kernels: str
    """Name of the kernels that rendered."""
    peak_gpu_bytes: int | None
    """Peak GPU memory; None on a CPU."""
    region_overlap: tuple[float, ...] | None = None
    """Intersection over union of regions and ranges of values, if the volume is known
    (:func:`svv.train.palette.ranges.region_overlaps`)."""

    @classmethod
    def from_json(cls, content: object, name: str = "scores") -> Scores:
        """Read scores, called ``name`` in errors: the inverse of :meth:`to_json`, where null for a number becomes nan.

        Raises BadInput if a value is missing or of the wrong kind.
        """
        values, found = object_in(content, name), dict[str, Any]()
        for field in fields(cls):
            key, (kind, _, or_none) = field.name, str(field.type).partition(" | ")
            if or_none and values.get(key) is None:
                found[key] = None
            elif key in FIGURES and needed(values, key, name) is None:
                found[key] = float("nan")
            else:
                found[key] = READERS[kind](needed(values, key, name), f"{name}.{key}")
        return cls(**found)

    def to_json(self) -> dict[str, object]:
        """Return plain values under the names of the fields, without ``region_overlap`` if the volume is not known."""
        content = {field.name: getattr(self, field.name) for field in fields(self)}
        content["size"] = list(self.size)
        overlap = content.pop("region_overlap")
        return content if overlap is None else {**content, "region_overlap": list(overlap)}


def check_views(scene: Scene, views: ViewSet) -> list[str]:
    """Return what may be wrong with views to score with; raises BadInput if pictures contradict their cameras."""
    agreement = check_agreement(views.cameras, views.images, views.names)
    chosen = np.unique(np.linspace(0, len(views) - 1, COMPARED).round().astype(int)).tolist()
    shared = either = 0.0
    for number in chosen:
        camera, (height, width) = views.cameras[number], views.images.shape[1:3]
        size = [max(1, round(side * COMPARED_SIDE / max(width, height))) for side in (width, height)]
        ours = scene.render(camera.resized(*size), scene.networks[0]).rgba[..., 3]
        rows, columns = ((np.arange(n) + 0.5) * side / n for n, side in zip(size[::-1], (height, width)))
        theirs = views.images[number, ..., 3][np.ix_(rows.astype(int), columns.astype(int))] / 255.0
        shared, either = shared + np.minimum(ours, theirs).sum(), either + np.maximum(ours, theirs).sum()
    told = [agreement.doubt, agreement.fixed]
    if shared < LEAST_SHARED * either:
        told.append(
            f"The views and the scene have only {shared / either:.0%} of their outlines in common: either the scene "
            "was trained for too short a time, or the views show another volume, or their cameras are in other "
            "coordinates or units than those of its training."
        )
    return [said for said in told if said is not None]


def evaluate_scene(scene: Scene, views: ViewSet, network: str | None = None, progress: Progress = silent) -> Scores:
    """Return mean scores over views that were not trained on.

    The truth is alpha-blended on white and the prediction clamped to [0, 1]; scores are means over the images.

    Args:
        scene: Scene to evaluate.
        views: Views with the true images.
        network: ``base``, ``pcn`` or ``styled``; by default the last one that the scene holds.
        progress: Called for every view.

    Raises:
        BadInput: The scene does not hold that network.

    >>> scores = svv.evaluate_scene(scene, views)
    >>> scores.views, scores.size, scores.network, scores.psnr > 30.0
    (24, (56, 56), 'pcn', True)
    """
    network = network or scene.networks[-1]
    measure = load_lpips()
    forget_gpu_peak(scene.device)
    seconds: list[float] = []
    scene.render(views.cameras[0].resized(64, 64), network)  # warm-up: kernels are compiled on first use

    def compared(shown: NDArray[np.float32], truth: NDArray[np.uint8]) -> tuple[Likeness, float, float | None]:
        white = on_white(truth)
        distance = None if measure is None else lpips(measure, shown, white)
        return Likeness.of(shown, truth), flip(shown, white), distance

    # Images are timed, so nothing else runs beside them; the metrics of a few are then computed side by side.
    workers = min(usable_cpus(), MOST_AT_A_TIME)
    found: list[tuple[Likeness, float, float | None]] = []
    with ThreadPoolExecutor(workers) as pool:
        for first in range(0, len(views.cameras), workers):
            some, images = range(first, min(first + workers, len(views.cameras))), []
            for number in some:
                progress(number / len(views.cameras), f"evaluating {network}")
                begin = time.perf_counter()
                with disable_view_cache():
                    images.append(scene.render(views.cameras[number], network, WHITE).rgba[..., :3])
                seconds.append(time.perf_counter() - begin)
            found += pool.map(compared, images, [views.images[number] for number in some])
    progress(1.0, f"evaluating {network}")
    likeness, flips, distances = zip(*found, strict=True)
    mean = Likeness.mean(likeness)
    return Scores(
        psnr=mean.psnr,
        psnr_foreground=mean.psnr_foreground,
        ssim=mean.ssim,
        flip=float(np.nanmean(flips)),
        lpips=None if measure is None else float(np.nanmean(distances)),
        views=len(views.cameras),
        size=(views.cameras[0].width, views.cameras[0].height),
        seconds_per_view=float(np.median(seconds)),
        network=network,
        background="white",
        **device_report(scene.device),
    )
