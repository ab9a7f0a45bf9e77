"""Time images of scenes, of a view that is new and of one whose scene is edited, and VTK's images of the same volumes.

python docs/measurements/image_seconds.py headsq.svv [headsq.vti headsq.json] [--size 800]

Prints CPU seconds of the whole process, all threads: least and most of five images, in turn. The first image of a new
view follows one of another view; the edited ones are the third and later of one view.
"""

from __future__ import annotations

import argparse
import resource
from collections.abc import Callable
from dataclasses import replace

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.frame import set_stage
from svv.dvr.draw.large import Opened
from svv.dvr.draw.views import open_caster
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.volumes import read_volume
from svv.fields.scene.scene import Scene

ROUNDS = 5


def cpu_seconds() -> float:
    """Return the CPU seconds that this process has used, in its own code and in the system's."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def by_vtk(volume: str, tf_file: str) -> Callable[[Camera], object]:
    """Return what draws a volume."""
    opened = Opened.of(read_volume(volume), "cpu", None)
    tf = TransferFunction.read(tf_file).fitted(*opened.range, rescale=False)
    stage = set_stage(opened.image, replace(tf, unit_distance=tf.unit_distance or opened.unit_distance))
    return open_caster(stage, "cpu", Shading())[0].render


def main() -> None:
    """Draw all kinds of images in turn."""
    options = argparse.ArgumentParser()
    options.add_argument("files", nargs="+")
    options.add_argument("--size", type=int, default=800)
    asked = options.parse_args()
    scene = Scene.load(asked.files[0])
    cameras = scene.rig.orbit(181, asked.size)
    views = iter(cameras[20:])
    free = [k for k, r in enumerate(scene.regions) if r.style is None]

    def edited(number: int, colour: bool) -> object:
        if colour:
            return scene.edited(free[0], colour=(0.1 * number, 0.5, 0.3)).render(cameras[30])
        return scene.edited(0, lighting=0.5 + 0.1 * number).render(cameras[30])

    kinds: dict[str, Callable[[int], object]] = {
        "new view": lambda _: scene.render(next(views)),
        "lighting edited": lambda k: edited(k, False),
    }
    if free:
        kinds["colour edited"] = lambda k: edited(k, True)
    if len(asked.files) > 1:
        caster = by_vtk(*asked.files[1:])
        kinds["VTK"] = lambda k: caster(cameras[30 + k])
    taken: dict[str, list[float]] = {name: [] for name in kinds}
    for number in range(-2, ROUNDS):
        for name, once in kinds.items():
            begun = cpu_seconds()
            once(number + 2)
            if number >= 0:
                taken[name].append(cpu_seconds() - begun)
    print(asked.files[0], asked.size, {name: f"{min(s):.3f} to {max(s):.3f}" for name, s in taken.items()})


if __name__ == "__main__":
    main()
