"""Train and score synema on views with parallel rays, for the comparison in accuracy.md.

synema (`pip install 'pycinema[synema]'`, in an environment of its own) ships as filters of pycinema. This script runs
their model, optimiser, training step and renderer on a folder of views that `svv import` wrote:

    python rival_synema.py head-views --seconds 800 --json head-synema.json

Time is that of the CPU, over all cores and without compilation, so that other programs disturb it little. As in
synema's own trainer, a step takes 4,096 random pixels of one random image, the cameras are at a distance of half the
picture's height from the centre, and lengths are in units of that height. Its images are over black.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import resource
import sys
import time
import types
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from skimage.io import imread

STEP_PIXELS = 4096
"""Pixels of a training step, as in synema's trainer."""


def filter_class(name: str) -> type:
    """Return a filter class from its file: importing pycinema's package of filters needs a display."""
    if "pycinema" not in sys.modules:
        package = types.ModuleType("pycinema")
        package.Filter = object  # type: ignore[attr-defined]
        sys.modules["pycinema"] = package
    folder = next(Path(p) / "pycinema/filters/synema" for p in sys.path if (Path(p) / "pycinema/filters").is_dir())
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, name)  # type: ignore[no-any-return]


def views_of(folder: Path, split: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the poses (N, 4, 4) and premultiplied images (N, H, W, 4) in [0, 1] of a split."""
    content = json.loads((folder / f"transforms_{split}.json").read_text())
    if "span_x" not in content:
        raise SystemExit("synema's filters have parallel rays only: these views have perspective.")
    poses, images = [], []
    for frame in content["frames"]:
        pose = np.array(frame["transform_matrix"])
        pose[:3, 3] = 0.5 * pose[:3, 2]
        poses.append(pose)
        path = folder / (frame["file_path"].removesuffix(".png") + ".png")
        image = imread(path).astype(np.float32) / 255.0
        image[..., :3] *= image[..., 3:]
        images.append(image)
    return np.stack(poses), np.stack(images)


class Rival:
    """Model, training step and renderer of synema for the views of a folder."""

    def __init__(self, folder: Path) -> None:
        """Read the views and create an untrained model."""
        from synema.models.cinema import CinemaRGBAImage
        from synema.renderers.ray_gen import Parallel
        from synema.renderers.volume import Hierarchical

        self.poses, self.images = views_of(folder, "train")
        self.test_poses, self.test_images = views_of(folder, "test")
        self.height, self.width = self.images.shape[1:3]
        model, renderer = CinemaRGBAImage(aabb=((-1, -1, -1), (1, 1, 1))), Hierarchical()
        self.state = filter_class("SynemaColorImageModelFactory").create_empty_state(model)  # type: ignore[attr-defined]
        self._step = filter_class("SynemaColorImageModelTrainer").create_train_steps(model)  # type: ignore[attr-defined]
        self._rays = Parallel(width=self.width, height=self.height, viewport_height=1.0)
        self._draw, self._key = np.random.default_rng(0), jax.random.PRNGKey(1377)

        @jax.jit
        def render(params, bundle, key):  # type: ignore[no-untyped-def]
            field = model.bind(params)
            found = renderer(coarse_field=field, fine_field=field, ray_bundle=bundle, rng_key=key)
            return found["fine_rgb"], found["alpha"]

        self._render = render

    def _bundle(self, pose: np.ndarray, pixels: np.ndarray) -> object:
        return self._rays(jnp.asarray(pixels, jnp.float32), jnp.asarray(pose), t_near=0.0, t_far=1.0)

    def step(self) -> tuple[float, float]:
        """Take one step; return its seconds and CPU seconds."""
        draw, number = self._draw, int(self._draw.integers(len(self.images)))
        pixels = np.stack([draw.integers(0, n, STEP_PIXELS) for n in (self.height, self.width)], axis=1)
        truth = jnp.asarray(self.images[number][pixels[:, 0], pixels[:, 1]])
        self._key, own = jax.random.split(self._key)
        begun, before = time.monotonic(), cpu_seconds()
        targets = {"rgb": truth[:, :3], "alpha": truth[:, 3]}
        self.state, loss = self._step(self.state, self._bundle(self.poses[number], pixels), targets, own)
        float(loss)  # waits for the step
        return time.monotonic() - begun, cpu_seconds() - before

    def score(self, count: int) -> tuple[float, float, float]:
        """Return the mean PSNR in dB over white and over black, and the seconds of a whole view.

        Args:
            count: Number of random pixels of each test view that are scored.
        """
        found, begun = [], time.monotonic()
        for pose, image in zip(self.test_poses, self.test_images, strict=True):
            fixed = np.random.default_rng(1)
            places = np.stack([fixed.integers(0, n, count) for n in (self.height, self.width)], axis=1)
            errors = []
            for part in np.split(places, range(STEP_PIXELS, count, STEP_PIXELS)):
                parts = self._render(self.state.params, self._bundle(pose, part), jax.random.PRNGKey(2))
                rgb, alpha = (np.asarray(v) for v in parts)
                truth = image[part[:, 0], part[:, 1]]
                behind = np.array([1.0, 0.0])[:, None, None]
                shown = np.clip(rgb + behind * (1.0 - alpha[:, None]), 0.0, 1.0)
                errors.append(np.square(shown - (truth[:, :3] + behind * (1.0 - truth[:, 3:]))))
            found.append(-10.0 * np.log10(np.concatenate(errors, axis=1).mean(axis=(1, 2))))
        white, black = np.mean(found, axis=0).tolist()
        seconds = (time.monotonic() - begun) / len(self.test_poses)
        return white, black, seconds * self.width * self.height / count


def cpu_seconds() -> float:
    """Return the CPU time of this process so far, over all threads."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    """Train for some time, and print the scores on the way."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("views", type=Path)
    parser.add_argument("--seconds", type=float, default=800.0, help="CPU seconds to train")
    parser.add_argument("--steps", type=int, default=1000, help="most steps; synema's own example takes 1,000")
    parser.add_argument("--pixels", type=int, default=4096, help="random pixels of each test view that are scored")
    parser.add_argument("--scores", type=int, default=3, help="number of times to score, evenly spread")
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    rival, rows, done, seconds, cpu = Rival(chosen.views), [], 0, 0.0, 0.0
    marks = [chosen.seconds * (k + 1) / chosen.scores for k in range(chosen.scores)]
    while done < chosen.steps and cpu < chosen.seconds:
        wall, own = rival.step()
        if done:  # the first step compiles
            seconds, cpu = seconds + wall, cpu + own
        done += 1
        if cpu >= marks[len(rows)] or done == chosen.steps:
            white, black, view = rival.score(chosen.pixels)
            rows.append({"steps": done, "seconds": seconds, "cpu_seconds": cpu, "psnr_white": white,
                         "psnr_black": black, "seconds_per_view": view})  # fmt: skip
            print(json.dumps(rows[-1]), flush=True)
    if chosen.json:
        chosen.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
