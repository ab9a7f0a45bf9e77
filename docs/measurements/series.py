"""One scene of 20 time steps and two transfer functions: accuracy alone and together, bytes, and flicker of paint.

python docs/measurements/series.py STYLE.jpg
python docs/measurements/series.py gallery:impasto --picture      # writes docs/images/series.jpg instead
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from skimage.registration import optical_flow_tvl1
from skimage.transform import warp
from values import balls, flow

from svv.core.colour.colour import WHITE, over
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.fields.following.followed_scene import at_step
from svv.fields.radiance.time_steps import TimeSteps
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.job.series import Step, with_time_steps
from svv.render.supersampled import supersampled
from svv.styles.gallery import open_style
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


def exactly(steps: TimeSteps, step: int) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return where the matter at places of a step was in the trained one, from the balls' own motion."""
    then, now = balls(APART * TRAINED), balls(APART * step)

    def place(position: NDArray[np.float64]) -> NDArray[np.float64]:
        world = steps.box.to_world(position)
        away = np.square(world[:, None] - now[None, :, :3]).sum(axis=2) / np.square(now[:, 3])
        own = away.argmin(axis=1)
        larger = (then[own, 3] / now[own, 3])[:, None]
        return steps.box.to_box(then[own, :3] + (world - now[own, :3]) * larger)

    return place


def flicker(series: Scene) -> None:
    """Print how much neighbouring frames differ after the earlier one is warped by the optical flow of the DVR's.

    Fine paint differs from itself when it is warped, so paint that is carried exactly is measured beside ours, and
    paint at rest before a camera that moves.
    """
    assert series.steps is not None and series.styled is not None and series.styled.brushed is not None
    camera = series.rig.orbit(181, 320)[90].resized(320, 320)
    frames: dict[str, list[NDArray[np.float32]]] = {}

    def add(name: str, picture: NDArray[np.floating]) -> None:
        frames.setdefault(name, []).append(over(picture, WHITE))

    for step in range(TRAINED - 4, TRAINED + 5):
        add("volume rendering", render_views(flow(APART * step), FUNCTIONS[0], [camera], "cpu")[0] / np.float32(255.0))
        moved = at_step(series, step)
        add("palette network", moved.render(camera, "pcn").rgba)
        add("paint that moves with the matter", moved.render(camera, "styled").rgba)
        add("its lattice, as while the camera moves", replace(moved, still=False).render(camera, "styled").rgba)
    found, lives = TimeSteps.place, series.styled.brushed.lives
    series.styled.brushed.lives = {}
    for name, way in (("paint carried exactly", exactly), ("paint that stays in space", lambda *_: lambda at: at)):
        TimeSteps.place = way  # type: ignore[method-assign]
        for step in range(TRAINED - 4, TRAINED + 5):
            moved = at_step(series, step)
            add(name, moved.render(camera, "styled").rgba)
            if way is exactly:
                add("its lattice, carried exactly", replace(moved, still=False).render(camera, "styled").rgba)
    TimeSteps.place, series.styled.brushed.lives = found, lives  # type: ignore[method-assign]
    told("steps 6 to 14", frames)
    frames.clear()
    own, right = at_step(series, TRAINED), camera.camera_to_world[:3, 0]
    pixel = camera.pixel_at(float(np.linalg.norm(camera.position)))
    for number in range(5):
        pose = camera.camera_to_world.copy()
        pose[:3, 3] += 2.3 * number * pixel * right
        there = replace(camera, camera_to_world=pose)
        drawn = render_views(flow(APART * TRAINED), FUNCTIONS[0], [there], "cpu")[0] / np.float32(255.0)
        add("volume rendering", drawn)
        add("palette network", own.render(there, "pcn").rgba)
        add("paint", own.render(there, "styled").rgba)
        add("its lattice", replace(own, still=False).render(there, "styled").rgba)
    told("one step, from a camera that moves by 2.3 pixels", frames)


def told(title: str, frames: dict[str, list[NDArray[np.float32]]]) -> None:
    """Print the warped differences of frames, relative to the volume rendering's own."""
    found = dict.fromkeys(frames, 0.0)
    for k in range(len(frames["volume rendering"]) - 1):
        before, after = (frames["volume rendering"][k + i].mean(axis=2) for i in (0, 1))
        down, right = optical_flow_tvl1(after, before, attachment=30)
        rows, columns = np.indices(after.shape)
        for name, pictures in frames.items():
            place = np.array([rows + down, columns + right])
            warped = np.stack([warp(pictures[k][..., c], place, mode="edge") for c in range(3)], axis=2)
            found[name] += float(np.abs(warped - pictures[k + 1])[after < 0.995].mean())
    print(f"| {title} | warped difference, relative to the volume rendering's |")
    for name, total in found.items():
        print(f"| {name} | {total / found['volume rendering']:.2f} |", flush=True)


def picture(style: str) -> None:
    """Draw steps of a painted scene: volume rendering, palette network, and paint that moves with the matter."""
    train, _ = make_views(flow(APART * TRAINED), FUNCTIONS[0], n=40, test=1, size=240, mapper="cpu")
    scene, _ = train_scene(train, "balanced", encoding="values")
    scene, _ = stylize_scene(scene, [open_style(style)[1]], "fast")
    steps = [Step(str(k), float(k), partial(flow, APART * k)) for k in range(COUNT)]
    series, _ = with_time_steps(scene, steps)
    seen = series.rig.orbit(181, 300)[90]
    camera = replace(seen, fov_x=0.62 * seen.fov_x).resized(300, 300)
    columns = []
    for step in range(TRAINED - 6, TRAINED + 7, 4):
        there = at_step(series, step)
        drawn = render_views(flow(APART * step), FUNCTIONS[0], [camera], "cpu")[0] / np.float32(255.0)
        pictures = [drawn, there.render(camera, "pcn").rgba, supersampled(there, camera, "styled").rgba]
        columns.append(np.concatenate([over(each, WHITE) for each in pictures]))
    sheet = np.rint(255 * np.clip(np.concatenate(columns, axis=1), 0.0, 1.0)).astype(np.uint8)
    target = Path(__file__).resolve().parents[1] / "images" / "series.jpg"
    Image.fromarray(sheet).save(target, quality=88, optimize=True, progressive=True)


def main(style: str) -> None:
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
        painted, _ = stylize_scene(scenes[0], [open_style(style)[1]], "fast")
        size("function 1, painted", painted)
        series, _ = with_time_steps(painted, steps)
        size(f"{COUNT} steps, painted", series)
        flicker(series)


if __name__ == "__main__":
    (picture if "--picture" in sys.argv else main)(sys.argv[1])
