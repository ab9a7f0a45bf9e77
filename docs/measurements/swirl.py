"""Strokes in a series in which matter swirls, divides, merges and appears: counts, bytes, flicker, and a picture.

python docs/measurements/swirl.py STYLE.jpg      # writes docs/images/swirl.jpg
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from series import told
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.colour.colour import WHITE, over
from svv.dvr.draw.classify import classified_as
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.fields.following.followed_scene import at_step, at_volume
from svv.fields.scene.scene import Scene
from svv.fields.strokes.flocks import FAR
from svv.fields.strokes.lives import Lives
from svv.io.pictures.style_picture import read_style
from svv.job.moving import Moving
from svv.job.series import Step, with_time_steps
from svv.train.pipeline import stylize_scene, train_scene

FUNCTION = TransferFunction.from_bumps([{"centre": 0.75, "width": 0.5, "opacity": 0.9, "colour": (0.9, 0.35, 0.15)}])

COUNT, PAINTED, SIZE = 13, 6, 400
"""Time steps, the one that is painted, and the side of a picture in pixels."""


def swirl(time: float, voxels: int = 64) -> vtkImageData:
    """Return a bar that a vortex winds up, a drop that divides, two that merge, and one that appears, at 0 to 1."""
    axis = np.linspace(-1.0, 1.0, voxels)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    turn = -2.2 * time * np.exp(-3.0 * (x * x + y * y))
    u, v = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    values = np.exp(-((u / 0.55) ** 4 + (v / 0.17) ** 2 + ((z - 0.35) / 0.16) ** 2))

    def ball(a: float, b: float, c: float, radius: float) -> NDArray[np.float64]:
        return np.exp(-0.5 * ((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) / radius**2)

    apart, left = 0.252 * time, 0.32 * (1.0 - time)
    values = np.maximum(values, np.maximum(ball(-0.45, apart, -0.45, 0.15), ball(-0.45, -apart, -0.45, 0.15)))
    values += ball(0.4 + left, 0.35, -0.4, 0.13) + ball(0.4 - left, 0.35, -0.4, 0.13)
    values += min(max(2.2 * (time - 0.45), 0.0), 1.0) * ball(0.35, -0.5, -0.4, 0.16)
    return from_array(values.astype(np.float32), (2.0 / (voxels - 1),) * 3, (-1.0,) * 3)


def counts(name: str, lives: Iterable[Lives], first: int, last: int) -> None:
    """Print how many strokes of each region are painted, born and removed, from one number of a step to another."""
    for region, own in enumerate(lives):
        born = 0 if own.born is None else len(own.born)
        later, earlier = (own.own[:, 1] < last).sum(), (own.own[:, 0] > first).sum()
        print(f"{name}, region {region}: {len(own.own)} strokes, {born} born, {later} removed, {earlier} begin later")


def sizes(scene: Scene, series: Scene) -> None:
    """Print how many bytes all steps take."""
    with tempfile.TemporaryDirectory() as folder:
        for what, one in (("one step", scene), (f"{COUNT} steps", series)):
            one.save(Path(folder) / "scene.svv")
            print(f"{what}, painted: {(Path(folder) / 'scene.svv').stat().st_size / 1e6:.2f} MB")


def played(scene: Scene) -> tuple[dict[int, Scene], dict[int, Scene]]:
    """Return the scene at all steps as it follows them one by one, with births and without."""
    assert scene.values is not None
    moving = Moving(swirl(PAINTED / (COUNT - 1)), scene.values.interval, PAINTED, range(COUNT))
    alive, kept = {PAINTED: scene}, {PAINTED: scene}
    for step in (*range(PAINTED + 1, COUNT), *range(PAINTED - 1, -1, -1)):
        volume = swirl(step / (COUNT - 1))
        given = scene, classified_as(volume, FUNCTION), step, moving.matter(volume, step)
        alive[step], kept[step] = at_volume(*given, moving.strokes.at(step)), at_volume(*given)
    counts("played", moving.strokes.lives(), FAR - PAINTED, FAR + COUNT - 1 - PAINTED)
    return alive, kept


def main(style: Path) -> None:
    """Train and paint one step, follow the others in a file and one by one, and draw seven of them."""
    train, _ = make_views(swirl(PAINTED / (COUNT - 1)), FUNCTION, n=40, test=1, size=240, mapper="cpu")
    scene, _ = train_scene(train, "balanced", encoding="values")
    scene, _ = stylize_scene(scene, [read_style(style)], "fast")
    steps = [Step(str(k), float(k), partial(swirl, k / (COUNT - 1))) for k in range(COUNT)]
    series, _ = with_time_steps(scene, steps)
    assert series.styled is not None and series.styled.brushed is not None
    counts("in a file", series.styled.brushed.lives.values(), 0, COUNT - 1)
    sizes(scene, series)
    alive, kept = played(scene)
    seen = series.rig.orbit(181, SIZE)[60]
    camera = replace(seen, fov_x=0.9 * seen.fov_x).resized(SIZE, SIZE)
    frames: dict[str, list[NDArray[np.float32]]] = {}

    def add(name: str, picture: NDArray[np.floating]) -> None:
        frames.setdefault(name, []).append(over(picture, WHITE))

    for step in range(COUNT):
        volume = swirl(step / (COUNT - 1))
        add("volume rendering", render_views(volume, FUNCTION, [camera], "cpu")[0] / np.float32(255.0))
        add("in a file", at_step(series, step).render(camera, "styled").rgba)
        add("played", alive[step].render(camera, "styled").rgba)
        add("played, without births", kept[step].render(camera, "styled").rgba)
    told("a vortex, fission, merging and birth", frames)
    shown = [np.concatenate([frame[70:-50, 40:-20] for frame in own[::2]], axis=1) for own in frames.values()]
    sheet = np.rint(255 * np.clip(np.concatenate(shown[:3]), 0.0, 1.0)).astype(np.uint8)
    target = Path(__file__).resolve().parents[1] / "images" / "swirl.jpg"
    Image.fromarray(sheet).save(target, quality=88, optimize=True, progressive=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
