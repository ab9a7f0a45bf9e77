"""Time views of volumes by bricks beside VTK's CPU ray caster, in turn in one process, and compare the pictures.

python docs/measurements/view_casters.py headsq.vti headsq.json [--size 800]

Prints CPU seconds of a view, all threads: least and most of five, and the mean difference of a pixel in levels of 255.
Samples are half a voxel apart with both. The first view, which reads the bricks, does not count.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import sphere_cameras
from svv.dvr.draw.frame import Stage, set_stage
from svv.dvr.draw.large import Opened
from svv.dvr.draw.views import Caster, open_caster
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.volumes import read_volume

VIEWS, STEP = 6, 0.5


def opened_by(mapper: str, volume: str, tf_file: str) -> tuple[Caster, Stage]:
    """Return a ray caster for a volume, and its stage."""
    opened = Opened.of(read_volume(volume), mapper, None)
    tf = TransferFunction.read(tf_file).fitted(*opened.range, rescale=False)
    tf = replace(tf, unit_distance=tf.unit_distance or opened.unit_distance)
    stage = set_stage(opened.image, tf)
    return open_caster(stage, "cpu", Shading(), STEP, opened.caster(tf))[0], stage


def main() -> None:
    """Draw the same views by both, in turn."""
    options = argparse.ArgumentParser()
    options.add_argument("files", nargs=2)
    options.add_argument("--size", type=int, default=800)
    asked = options.parse_args()
    found = {mapper: opened_by(mapper, *asked.files) for mapper in ("bricks", "cpu")}
    stage = found["cpu"][1]
    away = 2.2 * float(np.linalg.norm(stage.visible_size))
    cameras = sphere_cameras(VIEWS, stage.centre, away, np.radians(30.0), asked.size)
    taken: dict[str, list[float]] = {mapper: [] for mapper in found}
    differences = []
    for camera in cameras:
        pictures = []
        for mapper, (caster, _) in found.items():
            begun = time.process_time()
            pictures.append(caster.render(camera).astype(float))
            taken[mapper].append(time.process_time() - begun)
        differences.append(np.abs(pictures[0] - pictures[1]).mean())
    seconds = {mapper: f"{min(each[1:]):.3f} to {max(each[1:]):.3f}" for mapper, each in taken.items()}
    print(asked.files[0], seconds, f"mean difference {np.mean(differences):.2f}")


if __name__ == "__main__":
    main()
