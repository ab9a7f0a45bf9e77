"""Compare scenes that learn their features with scenes that are functions of their volume's values.

python docs/measurements/values.py [NAME=VOLUME,TF.json ...]    # by default the demo's volume
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from svv.dvr.demo_volume import demo_transfer_function, demo_volume
from svv.dvr.views import make_views
from svv.io.viewset import ViewSet
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import train_scene


def row(name: str, train: ViewSet, test: ViewSet, encoding: str) -> str:
    """Train on 92 views, and score on 16 that were not trained on."""
    begun = time.process_time()
    scene, _ = train_scene(train, "balanced", encoding=encoding)
    spent = time.process_time() - begun
    with tempfile.TemporaryDirectory() as folder:
        scene.save(Path(folder) / "scene.svv")
        size = (Path(folder) / "scene.svv").stat().st_size
    begun = time.process_time()
    scores = {network: evaluate_scene(scene, test, network) for network in ("base", "pcn")}
    drawing = (time.process_time() - begun) / (2 * len(test.cameras))
    found = [f"{s.psnr:.2f} / {s.psnr_foreground:.2f}" for s in scores.values()]
    return f"| {name} | {encoding} | {' | '.join(found)} | {spent:.0f} s | {drawing:.2f} s | {size / 1e6:.2f} MB |"


if __name__ == "__main__":
    print("| volume | encoding | base network, dB | palette network, dB | training, CPU | an image, CPU | file |")
    for word in sys.argv[1:] or ["demo"]:
        name, _, files = word.partition("=")
        volume, tf = files.split(",") if files else (demo_volume(), demo_transfer_function())
        train, test = make_views(volume, tf, n=92, test=16, size=400, mapper="cpu")
        assert test is not None
        for encoding in ("lattice", "values"):
            print(row(name, train, test, encoding), flush=True)
