"""Compare scenes whose opacities were edited with the volume rendering of the edited transfer functions.

python docs/measurements/opacities.py SCENE.svv VOLUME TF.json...    # a row for each function, on 10 unseen views
"""

from __future__ import annotations

import sys
import time

from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.job.opacities import with_opacities
from svv.train.evaluate import evaluate_scene


def row(scene: Scene, volume: str, file: str, size: int = 400) -> str:
    """Edit the scene, and score it and the scene as it was."""
    image, function, begun = read_volume(volume), TransferFunction.read(file), time.process_time()
    try:
        changed = with_opacities(scene, function, image)
    except BadInput as error:
        return f"| {function.name} | {error} |"
    spent = time.process_time() - begun
    _, test = make_views(volume, file, n=3, test=10, size=size, mapper="cpu")
    assert test is not None
    after, before = (evaluate_scene(s, test, "pcn").psnr for s in (changed, scene))
    said = " ".join(changed.made.get("approximate", []))
    return f"| {function.name} | {after:.2f} | {before:.2f} | {spent:.1f} s | {said} |"


if __name__ == "__main__":
    scene_file, volume_file, *functions = sys.argv[1:]
    print("| function | changed, dB | as it was, dB | CPU | what is said |")
    for name in functions:
        print(row(Scene.load(scene_file), volume_file, name), flush=True)
