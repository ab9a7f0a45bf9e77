"""What the parts of the measurement share: its folder, its views, the device, and the file of results."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from svv.core.geometry.cameras import sphere_cameras
from svv.fields.devices.gpu import device_named
from svv.fields.scene.scene import Scene
from svv.fields.scene.view_cache import disable_view_cache
from svv.io.views.viewset import ViewSet
from svv.train.run.config import Preset, preset

RESULTS = "results.jsonl"
"""File of results, one JSON object a line: part, device, name, value, and the seconds since the beginning."""

BEGUN = "SVV_BENCH_BEGUN"
"""Environment variable: when the measurement began, in seconds since 1970."""

SEED = 1

DISTANCE = 3.2
"""Distance of the cameras from the middle of the generated volume, whose torus has a radius of about 0.6."""


@dataclass(frozen=True)
class Context:
    """A measurement, as its parts see it."""

    out: Path
    """Folder of the results."""
    views: Path
    """Folder of the views: a training and a test split."""
    device: str
    """``cpu`` or ``cuda``: the device that is measured."""
    shrink: int = 1
    """Every how many pixels of the views are used along each axis."""
    steps: float = 1.0
    """Factor on the steps of all trainings, for a trial of the command itself."""

    @property
    def torch_device(self) -> torch.device:
        """The device, with its number."""
        return device_named(self.device)

    def read(self, split: str) -> ViewSet:
        """Read a split of the views, in the size that is measured."""
        views, k = ViewSet.read(self.views, split), self.shrink
        if k == 1:
            return views
        height, width = views.images.shape[1] // k, views.images.shape[2] // k
        images = np.ascontiguousarray(views.images[:, : height * k : k, : width * k : k])
        return replace(views, images=images, cameras=tuple(c.resized(width, height) for c in views.cameras))

    def preset(self, name: str = "fast", first: int | None = None, second: int | None = None) -> Preset:
        """Return the settings of a training, with other numbers of steps if they are given."""
        chosen = preset(name)
        one = self.scaled(first or chosen.reconstruct.iterations)
        two = self.scaled(second or chosen.recolour.iterations)
        return replace(
            chosen,
            reconstruct=replace(chosen.reconstruct, iterations=one),
            recolour=replace(chosen.recolour, iterations=two),
        )

    def scaled(self, steps: int) -> int:
        """Return a number of steps for this measurement."""
        return max(6, round(self.steps * steps))

    def scene_file(self, device: str) -> Path:
        """Return where the scene that a device has trained is kept."""
        return self.out / f"fast-{device}.svv"

    def scene(self) -> Scene:
        """Return a trained scene on the device: the one that it has trained itself, otherwise another device's."""
        others = [self.scene_file(name) for name in (self.device, "cuda", "cpu")]
        return Scene.load(next(path for path in others if path.exists())).on(self.torch_device)

    def say(self, part: str, name: str, value: Any) -> None:
        """Add a result to the file at once, so that nothing is lost if the part ends early."""
        add_result(self.out, part, self.device, name, value)

    def wait(self) -> None:
        """Wait until the GPU has done all its work."""
        if self.device == "cuda":
            torch.cuda.synchronize()

    def seconds(self, work: Callable[[], object], repeats: int) -> list[float]:
        """Return how long each of some repetitions takes, until the GPU has done it."""
        found = []
        for _ in range(repeats):
            self.wait()
            begin = time.perf_counter()
            with disable_view_cache():
                work()
            self.wait()
            found.append(time.perf_counter() - begin)
        return found


def add_result(out: Path, part: str, device: str, name: str, value: Any) -> None:
    """Add a line to the results."""
    at = round(time.time() - float(os.environ.get(BEGUN, time.time())), 1)
    line = {"part": part, "device": device, "at": at, "name": name, "value": value}
    with (out / RESULTS).open("a", encoding="utf-8") as file:
        file.write(json.dumps(line, default=float) + "\n")


def read_results(out: Path) -> list[dict[str, Any]]:
    """Return all results so far."""
    file = out / RESULTS
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.exists() else []


def spread_of(seconds: list[float]) -> dict[str, float]:
    """Return median, least and most of some times, in milliseconds."""
    return {
        "median_ms": 1e3 * float(np.median(seconds)), "least_ms": 1e3 * min(seconds), "most_ms": 1e3 * max(seconds),
        "repeats": len(seconds),
    }  # fmt: skip


def draw_views(folder: Path, size: int, train: int = 92, test: int = 16, side: int = 128) -> None:
    """Draw views of a generated volume with our own ray caster, which needs no VTK, and write them to a folder.

    The volume is a torus among shells (:class:`svv_bench.volume_size.generated.GeneratedSource`): one opaque region
    inside a translucent one.
    """
    from svv.bricks.caster import BrickCaster, Look
    from svv.core.colour.shading import Shading
    from svv.core.geometry.cameras import CameraRig
    from svv.measure import usable_cpus
    from svv_bench.volume_size.generated import GeneratedSource

    values = np.linspace(0.0, 255.0, 256)
    table = np.zeros((256, 4), np.float32)
    for middle, width, opacity, colour in (
        (240.0, 30.0, 0.95, (0.9, 0.45, 0.15)),
        (150.0, 12.0, 0.03, (0.2, 0.5, 0.9)),
    ):
        near = np.abs(values - middle) < width
        table[near] = (*colour, opacity)
    ranges = np.array([[138.0, 162.0], [210.0, 255.0]])
    look = Look(0.0, 255.0, table, ranges, 2.0 / side, Shading(on=True))
    caster = BrickCaster(GeneratedSource(side), 0, look, 1 << 30, usable_cpus())
    rig = CameraRig((0.0, 0.0, 0.0), DISTANCE, float(np.radians(30.0)))
    for split, cameras in (
        ("train", sphere_cameras(train, rig.centre, rig.radius, rig.fov_x, size)),
        ("test", rig.orbit(181, size, [int(k) for k in np.linspace(5, 175, test)])),
    ):
        images = np.stack([_straight(caster.render(camera, 1.0 / side)) for camera in cameras])
        names = tuple(f"{split}_{k:04d}" for k in range(len(cameras)))
        ViewSet(tuple(cameras), images, names).write(folder, split)


def _straight(image: np.ndarray) -> np.ndarray:
    """Return 8-bit straight alpha of colours times opacity."""
    colour = image[..., :3] / np.maximum(image[..., 3:], 1e-6)
    return np.rint(255.0 * np.clip(np.concatenate([colour, image[..., 3:]], axis=2), 0.0, 1.0)).astype(np.uint8)
