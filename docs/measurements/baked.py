"""Accuracy and time of baked volumes, drawn by VTK's ray caster on the CPU.

``python docs/measurements/baked.py SCENE.svv VOLUME.vti TF.json`` prints, for each resolution, the PSNR of three views
of the baked scene against our own images of it, both without light, and the time of each relative to drawing the
original volume without shading. ``stirred`` instead of VOLUME.vti is the stirred volume; it needs no TF.json.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from svv.core.colour.colour import over
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.casters import CpuMapper
from svv.dvr.draw.frame import set_stage
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import as_volume, to_array
from svv.dvr.read.volumes import read_volume
from svv.fields.scene.scene import Scene
from svv.options.baking import BakeOptions
from svv.render.baking.baked import Baker
from svv.render.frames import orbit
from tests.baked_views import BakedCaster
from tests.stirred_volume import stirred_transfer_function, stirred_volume

FRAMES = (20, 76, 130)
"""Views of the orbit of 181 that are compared."""
ROUNDS = 5
STEP = 0.5
"""Sample distance of both ray castings, in voxels of what they draw."""


def seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the CPU time of all threads, and the result."""
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def unlit(scene: Scene) -> Scene:
    """Return the scene as flat material."""
    for region in range(len(scene.regions)):
        scene = scene.edited(region, lighting=0.0)
    return scene


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.mean((one - other) ** 2)))


def original(volume: str, tf: Path | None) -> CpuMapper:
    """Return the ray caster of the volume that the scene was learned from, without shading."""
    if volume == "stirred":
        image, function = stirred_volume(), stirred_transfer_function()
    else:
        image = as_volume(read_volume(volume))
        function = TransferFunction.read(tf)
    values = to_array(image)
    stage = set_stage(image, function.fitted(float(values.min()), float(values.max())))
    return CpuMapper(stage, Shading(on=False), STEP * stage.voxel)


def times(casters: dict[str, Callable[[Camera], Any]], cameras: list[Camera]) -> dict[str, float]:
    """Return the median CPU time of an image, the casters taking turns."""
    found: dict[str, list[float]] = {name: [] for name in casters}
    for number in range(ROUNDS + 1):
        for camera in cameras:
            for name, cast in casters.items():
                spent, _ = seconds(lambda cast=cast, camera=camera: cast(camera))
                if number:  # the first round warms up
                    found[name].append(spent)
    return {name: statistics.median(values) for name, values in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("volume")
    parser.add_argument("tf", type=Path, nargs="?")
    parser.add_argument("--resolutions", default="64,128,256")
    parser.add_argument("--size", type=int, default=400)
    parser.add_argument("--hide", default="", help="regions to hide, such as 0,2")
    parser.add_argument("--pictures", type=Path, help="folder for baked | ours | four times the difference")
    asked = parser.parse_args()
    scene = unlit(Scene.load(asked.scene))
    if asked.hide:
        scene = scene.hidden(*map(int, asked.hide.split(",")))
    every = orbit(scene, 181, asked.size, asked.size)
    cameras = [every[k] for k in FRAMES]
    truth = [scene.render(camera).rgba for camera in cameras]
    casters: dict[str, Callable[[Camera], Any]] = {
        "original": original(asked.volume, asked.tf).render, "ours": scene.render,
    }  # fmt: skip
    print("cells  points            MB  bake s  edit s   PSNR of three views (of their foregrounds), dB")
    for resolution in map(int, asked.resolutions.split(",")):
        options, baker = BakeOptions(resolution=resolution, memory=1.0), Baker()
        first, volume = seconds(lambda o=options, b=baker: b.bake(scene, o))
        region = next(k for k, r in enumerate(scene.regions) if not r.hidden)
        edited = scene.edited(region, opacity=0.5)
        if scene.regions[region].style is None:
            edited = edited.edited(region, colour=(0.2, 0.8, 0.3))
        again, _ = seconds(lambda e=edited, o=options, b=baker: b.bake(e, o))
        caster = BakedCaster(volume, STEP)
        casters[f"{resolution}"] = caster.render
        scores = []
        for number, (camera, ours) in enumerate(zip(cameras, truth)):
            drawn, meant = over(caster.render(camera).astype(np.float32) / 255.0), over(ours)
            seen = ours[..., 3] > 0
            scores.append(f"{psnr(drawn, meant):.1f} ({psnr(drawn[seen], meant[seen]):.1f})")
            if asked.pictures:
                asked.pictures.mkdir(parents=True, exist_ok=True)
                row = np.concatenate([drawn, meant, np.clip(4 * np.abs(drawn - meant), 0, 1)], axis=1)
                name = f"{asked.scene.stem}-{resolution}-{number}.png"
                Image.fromarray(np.rint(255 * row).astype(np.uint8)).save(asked.pictures / name)
        size = " x ".join(map(str, volume.grid.shape))
        mb = volume.rgba.nbytes / 1e6
        print(
            f"{volume.grid.resolution:5}  {size:15} {mb:5.1f}  {first:6.2f}  {again:6.2f}   {', '.join(scores)}",
            flush=True,
        )
    taken = times(casters, cameras)
    base = taken["original"]
    print("CPU seconds an image (relative to the original): ", end="")
    print(", ".join(f"{name} {value:.2f} ({value / base:.2f})" for name, value in taken.items()))


if __name__ == "__main__":
    main()
