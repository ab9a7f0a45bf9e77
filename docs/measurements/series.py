"""One scene of 20 time steps and two transfer functions: accuracy alone and together, bytes, and flicker of paint.

python docs/measurements/series.py STYLE.jpg
python docs/measurements/series.py STYLE.jpg --picture      # writes docs/images/series.jpg instead
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage.registration import optical_flow_tvl1
from skimage.transform import warp
from values import flow

from svv.core.colour.colour import WHITE, over
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.fields.values.followed_scene import at_step
from svv.io.pictures.style_picture import read_style
from svv.job.series import Step, with_time_steps
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import stylize_scene, train_scene

FUNCTIONS = tuple(
    TransferFunction.from_bumps(bumps)
    for bumps in (
        [
            {"centre": 0.35, "width": 0.16, "opacity": 0.12, "colour": (0.2, 0.5, 0.9)},
            {"centre": 0.8, "width": 0.14, "opacity": 0.6, "colour": (0.9, 0.35, 0.15)},
        ],
        [
            {"centre": 0.55, "width": 0.2, "opacity": 0.25, "colour": (0.3, 0.8, 0.4)},
            {"centre": 0.9, "width": 0.2, "opacity": 0.8, "colour": (0.8, 0.8, 0.2)},
        ],
    )
)
"""Two transfer functions that overlap in their values."""

COUNT, TRAINED, APART = 20, 10, 0.25
"""Time steps, the one that is trained on, and their distance in time."""


def both(first: TransferFunction, second: TransferFunction) -> TransferFunction:
    """Return the function whose extinction is the sum of two, and whose colour is their mean weighted by it."""
    values = np.unique(np.concatenate([f.samples(-1.0, 2.0) for f in (first, second)] + [np.linspace(-0.2, 1.4, 800)]))
    opacity = [f.opacity_at(values) for f in (first, second)]
    sigma = [-np.log1p(-np.minimum(o, 0.999999)) + 1e-9 for o in opacity]
    share = (sigma[0] / (sigma[0] + sigma[1]))[:, None]
    colour = share * first.colour_at(values) + (1.0 - share) * second.colour_at(values)
    opaque = 1.0 - (1.0 - opacity[0]) * (1.0 - opacity[1])
    return replace(
        first,
        opacities=tuple((float(v), float(o), 0.5, 0.0) for v, o in zip(values, opaque, strict=True)),
        colours=tuple((float(v), *map(float, c)) for v, c in zip(values, colour, strict=True)),
    )


def score(scene: Scene, step: int, tf: TransferFunction) -> float:
    """Return the PSNR of the palette network on 8 unseen views of a step."""
    _, test = make_views(flow(APART * step), tf, n=3, test=8, size=240, mapper="cpu")
    assert test is not None
    return evaluate_scene(scene, test, "pcn").psnr


def accuracy(series: Scene) -> None:
    """Print scores of some steps, alone and together."""
    print("| step | first function, dB | trained on its views, dB | second, dB | together, dB | a picture of both |")
    for step in (0, TRAINED, COUNT - 1):
        there = at_step(series, step)
        train, _ = make_views(flow(APART * step), FUNCTIONS[0], n=40, test=1, size=240, mapper="cpu")
        own, _ = train_scene(train, "balanced", encoding="values")
        alone = [there.isolated(*(k for k, r in enumerate(there.regions) if r.layer == layer)) for layer in (0, 1)]
        found = [
            score(alone[0], step, FUNCTIONS[0]),
            score(own, step, FUNCTIONS[0]),
            score(alone[1], step, FUNCTIONS[1]),
        ]
        found.append(score(there, step, both(*FUNCTIONS)))
        begun = time.perf_counter()
        there.render(there.rig.orbit(181, 240)[90].resized(240, 240))
        spent = time.perf_counter() - begun
        print(f"| {step} | {' | '.join(f'{dB:.1f}' for dB in found)} | {spent:.2f} s |", flush=True)


def flicker(series: Scene) -> None:
    """Print how much neighbouring frames differ after the earlier one is warped by the optical flow of the DVR's."""
    assert series.steps is not None
    camera = series.rig.orbit(181, 320)[90].resized(320, 320)
    still = replace(series, steps=replace(series.steps, moves=(None,) * COUNT))
    frames: dict[str, list[NDArray[np.float32]]] = {
        "volume rendering": [],
        "palette": [],
        "paint": [],
        "paint, not moved": [],
    }
    for step in range(TRAINED - 4, TRAINED + 5):
        drawn = render_views(flow(APART * step), FUNCTIONS[0], [camera], "cpu")[0] / np.float32(255.0)
        moved, fixed = at_step(series, step), at_step(still, step)
        pictures = drawn, *(s.render(camera, n).rgba for s, n in ((moved, "pcn"), (moved, "styled"), (fixed, "styled")))
        for name, picture in zip(frames, pictures, strict=True):
            frames[name].append(over(picture, WHITE))
    found = dict.fromkeys(frames, 0.0)
    for k in range(len(frames["palette"]) - 1):
        before, after = (frames["volume rendering"][k + i].mean(axis=2) for i in (0, 1))
        down, right = optical_flow_tvl1(after, before, attachment=30)
        rows, columns = np.indices(after.shape)
        for name, pictures in frames.items():
            place = np.array([rows + down, columns + right])
            warped = np.stack([warp(pictures[k][..., c], place, mode="edge") for c in range(3)], axis=2)
            found[name] += float(np.abs(warped - pictures[k + 1])[after < 0.995].mean())
    print("| picture | warped difference, relative to the volume rendering's |")
    for name, total in found.items():
        print(f"| {name} | {total / found['volume rendering']:.2f} |")


def picture(style: Path) -> None:
    """Draw steps of a painted scene: volume rendering, palette network, and paint that moves with the matter."""
    train, _ = make_views(flow(APART * TRAINED), FUNCTIONS[0], n=40, test=1, size=240, mapper="cpu")
    scene, _ = train_scene(train, "balanced", encoding="values")
    scene, _ = stylize_scene(scene, [read_style(style)], "fast")
    steps = [Step(str(k), float(k), partial(flow, APART * k)) for k in range(COUNT)]
    series, _ = with_time_steps(scene, steps)
    seen = series.rig.orbit(181, 300)[90]
    camera = replace(seen, fov_x=0.62 * seen.fov_x).resized(300, 300)
    columns = []
    for step in range(TRAINED - 6, TRAINED + 7, 4):
        there = at_step(series, step)
        drawn = render_views(flow(APART * step), FUNCTIONS[0], [camera], "cpu")[0] / np.float32(255.0)
        pictures = [drawn, there.render(camera, "pcn").rgba, there.render(camera, "styled").rgba]
        columns.append(np.concatenate([over(each, WHITE) for each in pictures]))
    sheet = np.rint(255 * np.clip(np.concatenate(columns, axis=1), 0.0, 1.0)).astype(np.uint8)
    target = Path(__file__).resolve().parents[1] / "images" / "series.jpg"
    Image.fromarray(sheet).save(target, quality=88, optimize=True, progressive=True)


def main(style: Path) -> None:
    """Print everything."""
    scenes, steps = [], [Step(str(k), float(k), partial(flow, APART * k)) for k in range(COUNT)]
    with tempfile.TemporaryDirectory() as folder:

        def size(name: str, scene: Scene) -> None:
            scene.save(Path(folder) / "scene.svv")
            print(f"| {name} | {(Path(folder) / 'scene.svv').stat().st_size / 1e6:.2f} MB |", flush=True)

        for number, tf in enumerate(FUNCTIONS):
            train, _ = make_views(flow(APART * TRAINED), tf, n=40, test=1, size=240, mapper="cpu")
            scenes.append(train_scene(train, "balanced", encoding="values")[0])
            size(f"function {number + 1}, one step", scenes[-1])
            size("the same, encoding lattice", train_scene(train, "balanced")[0])
        begun = time.perf_counter()
        series, _ = with_time_steps(joined(scenes), steps)
        print(f"| following {COUNT} steps, both functions | {time.perf_counter() - begun:.0f} s |")
        size(f"{COUNT} steps, both functions", series)
        accuracy(series)
        painted, _ = stylize_scene(scenes[0], [read_style(style)], "fast")
        size("function 1, painted", painted)
        series, _ = with_time_steps(painted, steps)
        size(f"{COUNT} steps, painted", series)
        flicker(series)


if __name__ == "__main__":
    (picture if "--picture" in sys.argv else main)(Path(sys.argv[1]))
