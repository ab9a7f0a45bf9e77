"""Compare scenes that learn their features with scenes that are functions of their volume's values.

python docs/measurements/values.py [PRESET] [SIZE] [NAME=VOLUME,TF.json ...]    # by default balanced, 240, stirred
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.dvr.draw.views import make_views
from svv.dvr.read.grids import from_array
from svv.io.views.viewset import ViewSet
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS
from tests.stirred_volume import stirred_transfer_function, stirred_volume


def row(name: str, train: ViewSet, test: ViewSet, encoding: str, preset: str) -> str:
    """Train on views, and score on others."""
    begun = time.process_time()
    scene, _ = train_scene(train, preset, encoding=encoding)
    spent = time.process_time() - begun
    with tempfile.TemporaryDirectory() as folder:
        scene.save(Path(folder) / "scene.svv")
        size = (Path(folder) / "scene.svv").stat().st_size
    begun = time.process_time()
    scores = {network: evaluate_scene(scene, test, network) for network in ("base", "pcn")}
    drawing = (time.process_time() - begun) / (2 * len(test.cameras))
    found = [f"{s.psnr:.2f} / {s.psnr_foreground:.2f}" for s in scores.values()]
    return f"| {name} | {encoding} | {' | '.join(found)} | {spent:.0f} s | {drawing:.2f} s | {size / 1e6:.2f} MB |"


def flow(time: float, voxels: int = 64) -> vtkImageData:
    """Five balls that wander around a ring and swell, with a wave between them."""
    axis = np.linspace(-1.0, 1.0, voxels)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    values = 0.12 * np.sin(9 * x + 0.3 * time) * np.sin(8 * y) * np.sin(7 * z - 0.2 * time)
    values = values * np.exp(-2.0 * (x**2 + y**2 + z**2))
    for a, b, c, radius in balls(time):
        values += np.exp(-0.5 * ((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) / radius**2)
    return from_array(values.astype(np.float32), (2.0 / (voxels - 1),) * 3, (-1.0,) * 3)


def balls(time: float) -> NDArray[np.float64]:
    """Return centre and radius of the balls of :func:`flow`. (5, 4)"""
    ball = np.arange(5)
    angle = 2.0 * np.pi * ball / 5 + 0.3 * time
    middle = 0.5 * np.cos(angle), 0.5 * np.sin(angle), 0.35 * np.sin(2 * angle + 0.2 * time)
    return np.stack([*middle, 0.16 + 0.03 * np.sin(ball + 0.2 * time)], axis=1)


if __name__ == "__main__":
    print("| volume | encoding | base network, dB | palette network, dB | training, CPU | an image, CPU | file |")
    words, preset, size = sys.argv[1:], "balanced", 240
    if words and words[0] in PRESETS:
        preset = words.pop(0)
    if words and words[0].isdigit():
        size = int(words.pop(0))
    for word in words or ["stirred"]:
        name, _, files = word.partition("=")
        volume, tf = files.split(",") if files else (stirred_volume(), stirred_transfer_function())
        train, test = make_views(volume, tf, n=60, test=10, size=size, mapper="cpu")
        assert test is not None
        for encoding in ("lattice", "values"):
            print(row(name, train, test, encoding, preset), flush=True)
