"""Time scenes' images beside VTK's ray caster, alternating in one process, 800 x 800 pixels.

python docs/measurements/view_dvr.py TF01.svv stirred.svv

The volume is the stirred one, 128^3 voxels, with an opaque transfer function of one range and its own translucent one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from statistics import median

import numpy as np

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera, sphere_cameras
from svv.dvr.draw.frame import set_stage
from svv.dvr.draw.views import open_caster
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.fields.scene.scene import Scene
from svv.fields.scene.view_cache import disable_view_cache
from svv.render.frames import orbit
from tests.stirred_volume import stirred_transfer_function, stirred_volume

SIZE, ROUNDS = 800, 10

OPAQUE = TransferFunction(
    colours=((0.0, 0.9, 0.6, 0.2), (1.0, 0.9, 0.6, 0.2)),
    opacities=((0.0, 0.0, 0.5, 0.0), (0.45, 0.0, 0.5, 0.0), (0.5, 1.0, 0.5, 0.0), (1.0, 1.0, 0.5, 0.0)),
    name="opaque",
)


def by_vtk(function: TransferFunction) -> Callable[[], object]:
    """Return what draws the stirred volume once."""
    stage = set_stage(stirred_volume(128), function)
    caster, _ = open_caster(stage, "cpu", Shading())
    camera = sphere_cameras(3, stage.centre, 4.2, np.radians(30.0), SIZE)[0]
    return lambda: caster.render(camera)


def by_us(path: str) -> Callable[[], object]:
    """Return what draws a scene once, from the front."""
    scene = Scene.load(path)
    camera: Camera = orbit(scene, 181, SIZE, SIZE)[90]
    return disable_view_cache()(lambda: scene.render(camera, "pcn"))


def main() -> None:
    """Draw all in turn, and print medians and ranges."""
    draw = {"VTK, opaque": by_vtk(OPAQUE), "VTK, translucent": by_vtk(stirred_transfer_function())}
    draw |= {path: by_us(path) for path in sys.argv[1:]}
    taken: dict[str, list[float]] = {name: [] for name in draw}
    for number in range(ROUNDS + 1):
        for name, once in draw.items():
            begun = time.perf_counter()
            once()
            if number:  # the first of each is a warm-up
                taken[name].append(time.perf_counter() - begun)
    for name, seconds in taken.items():
        ratios = [median(seconds) / median(taken[other]) for other in ("VTK, opaque", "VTK, translucent")]
        print(f"{name}: {median(seconds):.3f} s ({min(seconds):.3f} to {max(seconds):.3f}), "
              f"{ratios[0]:.2f} of VTK opaque, {ratios[1]:.2f} of VTK translucent")  # fmt: skip


if __name__ == "__main__":
    main()
