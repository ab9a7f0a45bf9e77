"""The work of one process for a chart: train a scene, or render and score one.

Each run has a separate process, whose peak memory is therefore that of the run. The task is read as JSON from standard
input; progress is written as lines of JSON, ``[fraction, label]``, to standard output; an error is one sentence on
standard error.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv._version import __version__
from svv.core.colour.colour import WHITE
from svv.core.geometry.cameras import Camera
from svv.core.images.metrics import Likeness
from svv.ending import end_with
from svv.errors import BadInput, Progress, part, silent
from svv.fields.devices.gpu import device_named
from svv.fields.scene.scene import Scene
from svv.fields.scene.view_cache import disable_view_cache
from svv.io.files.atomic import write_json
from svv.io.scene_file import checkpoint_of
from svv.io.views.view_meta import known
from svv.io.views.viewset import ViewSet, read_meta
from svv.job.compile_ahead import ball_views
from svv.job.source import VolumeSource
from svv.measure import measured
from svv.render.frames import orbit
from svv.train.pipeline import train_scene
from svv.train.run.config import Preset, preset
from svv.train.run.report import Report
from svv_bench.chart.plan import Training
from svv_bench.chart.scenes import shrunk, spread_over, unseen_cameras
from svv_bench.chart.tasks import RenderTask, TrainTask


def train(task: TrainTask, progress: Progress) -> None:
    """Train a scene and write ``scene.svv`` and ``train.json`` into the run's folder."""
    run, folder = task.run, task.folder
    warm_up(run)
    views = shrunk(ViewSet.read(task.views, "train", part(progress, 0.0, 0.05)), run.size)
    scene_file = folder / "scene.svv"
    checkpoint = checkpoint_of(scene_file)
    resumed, load, begin = checkpoint.exists(), os.getloadavg()[0], time.process_time()
    scene, report = _train(views, run, run.preset, run.limit, part(progress, 0.05, 1.0), checkpoint)
    scene.save(scene_file)
    extra = {
        "scene_bytes": scene_file.stat().st_size,
        "views": len(views),
        "cpu_seconds": time.process_time() - begin,
        "resumed": resumed,
        "load_average": load,
        "svv": __version__,
    }
    write_json(folder / "train.json", {**report, "run": run.settings, **extra})
    checkpoint.unlink(missing_ok=True)


def warm_up(run: Training) -> None:
    """Train briefly on a ball to exclude compiling from the run's seconds."""
    draft = preset("draft", run.encoding)
    few_cells = replace(draft, reconstruct=replace(draft.reconstruct, cells=32))
    _train(ball_views(), run, few_cells, 0.2, silent, None)


def _train(
    views: ViewSet,
    run: Training,
    chosen: str | Preset,
    limit: float | None,
    progress: Progress,
    checkpoint: Path | None,
) -> tuple[Scene, Report]:
    return train_scene(
        views,
        chosen,
        progress,
        checkpoint,
        time_limit=limit,
        seed=run.seed,
        device=run.device,
        encoding=run.encoding,
        lighting=run.lighting or "network",
    )


@disable_view_cache()
def render(task: RenderTask, progress: Progress) -> None:
    """Render and time unseen views of a trained scene, with DVR of the volume if it is available; write the figures."""
    folder, size, network = task.folder, task.size, task.network
    scene = Scene.load(folder / "scene.svv").on(device_named(task.device))
    first = orbit(scene, 2, size, size)[0]
    with measured() as cost:  # before views and volume are in memory; also serves as the warm-up
        scene.render(first, network, WHITE)
    if task.volume is not None:
        cameras, truth = unseen_cameras(task.views, task.test, size), None
        dvr = Dvr(task.volume, task.views)
        dvr.draw(cameras[0])
    else:
        views = ViewSet.read(task.views, "test", part(progress, 0.0, 0.1))
        views = shrunk(views.take(spread_over(len(views), task.test)), size)
        cameras, truth, dvr = list(views.cameras), views.images, None
    load = os.getloadavg()[0]
    figures = race(scene, network, cameras, truth, dvr, part(progress, 0.1, 1.0))
    if dvr is not None:
        dvr.close()
    extra = {
        "network": network,
        "test_views": len(cameras),
        "size": [cameras[0].width, cameras[0].height],
        "background": "white",
        "render_peak_rss_bytes": cost.peak_rss_bytes,
        "load_average": load,
        "svv": __version__,
    }
    write_json(folder / task.file, {**figures, **extra})


class Dvr:
    """Direct volume rendering of the volume, with the settings of its views."""

    def __init__(self, volume: Path, views: Path) -> None:
        from svv.dvr.draw.frame import set_stage
        from svv.dvr.draw.large import Opened
        from svv.dvr.draw.views import open_caster
        from svv.dvr.functions.transfer_functions import TransferFunction

        meta = read_meta(views)
        mapper, function = known(meta.mapper, "mapper"), TransferFunction.from_dict(known(meta.tf, "tf"))
        opened = Opened.of(VolumeSource(volume).image(), mapper, None)
        stage, shading = set_stage(opened.image, function), known(meta.shading, "shading")
        self._caster, _ = open_caster(stage, mapper, shading, only=opened.caster(function))
        self.name = self._caster.name

    def draw(self, camera: Camera) -> NDArray[np.uint8]:
        """Draw an image, straight alpha. (height, width, 4) uint8"""
        return self._caster.render(camera)

    def close(self) -> None:
        """Release its graphics resources."""
        self._caster.close()


@dataclass
class Times:
    """Time of a task and CPU time of all its threads, in seconds, one value per view."""

    seconds: list[float]
    cpu: list[float]

    def of(self, work: Callable[[], Any]) -> Any:
        """Do the work, record its times, and return its result."""
        begin, begin_cpu = time.perf_counter(), time.process_time()
        result = work()
        self.seconds.append(time.perf_counter() - begin)
        self.cpu.append(time.process_time() - begin_cpu)
        return result

    def summary(self) -> dict[str, Any]:
        """Return the median, least, most and all times, and the median of the CPU times."""
        return {
            "median": float(np.median(self.seconds)),
            "least": min(self.seconds),
            "most": max(self.seconds),
            "all": self.seconds,
            "cpu_median": float(np.median(self.cpu)),
        }


def race(
    scene: Scene,
    network: str,
    cameras: list[Camera],
    truth: NDArray[np.uint8] | None,
    dvr: Dvr | None,
    progress: Progress,
) -> dict[str, Any]:
    """Score and time the network's views, each one right after the volume rendering of the same camera.

    Args:
        scene: Scene to measure.
        network: Network whose colours are scored.
        cameras: Cameras that the scene was not trained on.
        truth: Their images (n, h, w, 4), straight alpha; None to use the volume renderings.
        dvr: The volume's renderer, if available.
        progress: Called before each view and at the end.

    Returns:
        ``psnr``, ``psnr_foreground``, ``ssim`` (means over the views), ``seconds_per_view``, and ``dvr``: its
        ``seconds_per_view``, ``mapper`` and ``ratio``, the median over the views of network time / its time.
    """
    scores = []
    ours, theirs = Times([], []), Times([], [])
    for number, camera in enumerate(cameras):
        progress(number / len(cameras), "unseen views")
        drawn = None if dvr is None else theirs.of(partial(dvr.draw, camera))
        shown = ours.of(partial(scene.render, camera, network, WHITE)).rgba[..., :3]
        straight = drawn if truth is None else truth[number]
        assert straight is not None
        scores.append(Likeness.of(shown, straight))
    progress(1.0, "unseen views")
    result: dict[str, Any] = asdict(Likeness.mean(scores))
    result["seconds_per_view"] = ours.summary()
    if dvr is not None:
        ratio = np.median(np.divide(ours.seconds, theirs.seconds))
        result["dvr"] = {"seconds_per_view": theirs.summary(), "mapper": dvr.name, "ratio": float(ratio)}
    return result


WORKS: dict[str, Callable[[dict[str, Any], Progress], None]] = {
    "train": lambda content, progress: train(TrainTask.from_json(content), progress),
    "render": lambda content, progress: render(RenderTask.from_json(content), progress),
}
"""Name of a task -> function that does it."""


def main() -> None:
    """Do the task on standard input."""
    out, sys.stdout = sys.stdout, sys.stderr  # keeps other output out of the lines of progress

    def progress(fraction: float, label: str) -> None:
        print(json.dumps([fraction, label]), file=out, flush=True)

    task = json.load(sys.stdin)
    if task["work"] not in WORKS:
        raise BadInput(f"There is no work '{task['work']}'.")
    WORKS[task["work"]](task, progress)


if __name__ == "__main__":
    end_with(main, "chart")
