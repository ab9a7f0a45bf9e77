"""A painted, translucent scene on a GPU and on the CPU: differences of images under edits, and seconds.

python docs/measurements/gpu_edits.py painted.svv
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import numpy as np
import torch

import svv
from svv.core.geometry.cameras import Camera
from svv.fields.scene.view_cache import disable_view_cache
from svv.styles.gallery import gallery_picture

WHITE = (1.0, 1.0, 1.0)
REPEATS = 6


def apart(one: svv.Scene, other: svv.Scene, cameras: Sequence[Camera]) -> str:
    """Return the mean and largest difference of RGBA in [0, 1], and the share above 0.02."""
    away = np.stack([np.abs(one.render(c, None, WHITE).rgba - other.render(c, None, WHITE).rgba) for c in cameras])
    return f"{away.mean():.1e} | {away.max():.3f} | {(away > 0.02).mean():.1e}"


@disable_view_cache()
def seconds(scene: svv.Scene, camera: Camera) -> float:
    """Return the mean seconds of an image, after one that is not counted."""
    scene.render(camera, None, WHITE)
    begun = time.perf_counter()
    for _ in range(REPEATS):
        scene.render(camera, None, WHITE)
    return (time.perf_counter() - begun) / REPEATS


def main(path: str) -> None:
    """Print both tables for a scene whose region 0 is painted by strokes."""
    gpu = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    here = svv.Scene.load(path)
    there = here.on(gpu)
    few, large = here.rig.orbit(9, 400, [1, 5]), here.rig.orbit(9, 800, [3])[0]
    edits = {
        "as painted": lambda s: s,
        "while the camera moves": lambda s: s.while_moving(),
        "stroke opacity -0.7": lambda s: s.with_stroke_opacity(-0.7),
        "half the strength": lambda s: s.with_strength(0.5),
        "MatCap jade": lambda s: s.edited(0, matcap="jade"),
        "MatCap toon": lambda s: s.edited(0, matcap="toon"),
    }
    print("| scene | mean | largest | share above 0.02 |\n|---|---|---|---|")
    for name, edit in edits.items():
        print(f"| {name} | {apart(edit(there), edit(here), few)} |")
    for hand in ("oil", "watercolour"):
        begun = time.perf_counter()
        painted, _ = svv.stylize_scene(there, [gallery_picture("oil", 300)], "draft", hand=hand)
        took = time.perf_counter() - begun
        print(f"| painted there in {took:.1f} s: {hand} | {apart(painted, painted.on(torch.device('cpu')), few)} |")
    print("\n| image of 800 x 800 | seconds |\n|---|---|")
    for name in ("as painted", "MatCap jade"):
        print(f"| {name} | {seconds(edits[name](there), large):.3f} |")


if __name__ == "__main__":
    main(sys.argv[1])
