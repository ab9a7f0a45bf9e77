"""Splats of scenes: how close to the renderer's pictures, and how large their files are, by their number.

python docs/measurements/splats.py NAME=SCENE.svv ... [--counts 10000 60000] [--results docs/measurements/results.csv]

PSNR on white of 16 close pictures of 352 x 352 pixels from sides that were not fitted, drawn as viewers draw them.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

import svv
from svv.core.images.metrics import psnr
from svv.train.splats.fit import PIXELS
from svv.train.splats.raster import Eye, Gaussians, draw
from svv.train.splats.starting import ball_around, cameras_around, seen_of
from svv_bench.results import append, cells

COUNTS = (10_000, 25_000, 60_000, 100_000, 200_000)
VIEWS, TURNED = 16, 0.3
"""Pictures, and the angle by which they lie between those that are fitted."""

COLUMNS = (("PSNR", "dB", ".1f"), (".spz", "MB", ".2f"))


def likeness(splats: svv.Splats, scene: svv.Scene) -> float:
    """Return the mean PSNR of pictures that were not fitted, dB."""
    network = scene.networks[-1]
    drawn = Gaussians(splats.centres, splats.scales, splats.rotations, splats.opacities, splats.harmonics)
    found = []
    for camera in cameras_around(*ball_around(seen_of(scene, network)), VIEWS, PIXELS, TURNED):
        image = draw(drawn, Eye.of(camera, np.zeros(3), 1.0)).image
        shown = (image[:3] + 1.0 - image[3]).clip(0.0, 1.0).transpose(1, 2, 0)
        found.append(psnr(shown, scene.render(camera, network, (1.0, 1.0, 1.0)).rgba[..., :3]))
    return float(np.mean(found))


def megabytes(splats: svv.Splats) -> float:
    """Return the size of a .spz."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.spz"
        svv.write_splats(path, splats)
        return path.stat().st_size / 1e6


def main() -> None:
    """Fit, draw and write each number of splats of each scene."""
    options = argparse.ArgumentParser()
    options.add_argument("scenes", nargs="+", metavar="NAME=SCENE.svv")
    options.add_argument("--counts", nargs="+", type=int, default=COUNTS)
    options.add_argument("--results", type=Path)
    asked = options.parse_args()
    rows = []
    for name, _, path in (given.partition("=") for given in asked.scenes):
        scene = svv.Scene.load(path)
        for count in asked.counts:
            splats = svv.fit_splats(scene, svv.SplatOptions(count=count))
            figures = (likeness(splats, scene), megabytes(splats))
            rows.append((f"{name} | {count:,}", figures))
            print(*rows[-1], flush=True)
    if asked.results:
        append(
            asked.results, cells("large/splats", rows, COLUMNS),
            f"python docs/measurements/splats.py {' '.join(asked.scenes)}", "svv/train/splats svv/render/splats",
        )  # fmt: skip


if __name__ == "__main__":
    main()
