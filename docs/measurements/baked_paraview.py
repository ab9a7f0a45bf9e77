"""Accuracy and time of StyleRF Volume in ParaView's 3D view, against our images and against the original volume.

``svv pvpython docs/measurements/baked_paraview.py SCENE.svv VOLUME.vti TF.json`` draws three views of 400 x 400 with
the mapper that ParaView picks by itself. A fourth argument is a folder for the pictures, a fifth the resolution.
"""

import statistics
import sys
import time
from pathlib import Path

import numpy as np
from paraview import simple
from PIL import Image

from svv.fields.scene.scene import Scene
from svv.pv.scripts import camera_of_view, open_volume

SIZE, ROUNDS = 400, 5
EYES = ((0.9, 0.7, 1.6), (-1.7, 0.2, 0.9), (0.3, -0.9, -1.7))
"""Directions of the cameras, in sides of the scene's box."""


def place(view, bounds, eye) -> None:
    low, high = np.array(bounds[::2]), np.array(bounds[1::2])
    centre = 0.5 * (low + high)
    view.CameraPosition = list(centre + np.array(eye) * (high - low).max())
    view.CameraFocalPoint, view.CameraViewUp, view.CameraViewAngle = list(centre), [0.0, 1.0, 0.0], 30.0


def drawn(view, path) -> np.ndarray:
    simple.SaveScreenshot(str(path), view, ImageResolution=[SIZE, SIZE])
    return np.asarray(Image.open(path).convert("RGB")) / 255.0


def seconds(shown, view, bounds) -> dict[str, float]:
    """Return the median CPU time of an image, all threads, of each of the named sources; they take turns."""
    found: dict[str, list[float]] = {name: [] for name in shown}
    for _ in range(ROUNDS):
        for name, (source, shade) in shown.items():
            simple.Show(source, view).Shade = shade
            place(view, bounds, EYES[-1])
            simple.Render(view)  # the first image after a change loads the volume
            for eye in EYES:
                place(view, bounds, eye)
                began = time.process_time()
                simple.Render(view)
                found[name].append(time.process_time() - began)
            simple.Hide(source, view)
    return {name: statistics.median(values) for name, values in found.items()}


def main() -> None:
    file, volume, tf = map(Path, sys.argv[1:4])
    folder = Path(sys.argv[4] if len(sys.argv) > 4 else "/tmp")
    folder.mkdir(parents=True, exist_ok=True)
    display, view = open_volume(volume, tf)
    view.ViewSize = [SIZE, SIZE]
    view.UseColorPaletteForBackground, view.Background, view.OrientationAxesVisibility = 0, [1.0, 1.0, 1.0], 0
    edit = simple.StyleRFEdit(Input=simple.OpenDataFile(str(file)))
    baked = simple.StyleRFVolume(Input=edit, Resolution=int(sys.argv[5]) if len(sys.argv) > 5 else 0)
    baked.UpdatePipeline()
    bounds = baked.GetDataInformation().GetBounds()
    simple.Hide(display.Input, view)
    simple.Show(baked, view)
    scene = Scene.load(file)
    for region in range(len(scene.regions)):
        scene = scene.edited(region, lighting=0.0)
    simple.Render(view)
    for number, eye in enumerate(EYES):
        place(view, bounds, eye)
        ours = scene.render(camera_of_view(view, SIZE, SIZE), background=(1.0, 1.0, 1.0)).rgba[..., :3]
        seen = scene.render(camera_of_view(view, SIZE, SIZE)).rgba[..., 3] > 0
        picture = drawn(view, folder / f"{file.stem}-paraview-{number}.png")
        Image.fromarray(np.rint(255 * ours).astype(np.uint8)).save(folder / f"{file.stem}-ours-{number}.png")
        whole, part = (-10 * np.log10(np.mean(error)) for error in ((picture - ours) ** 2, (picture - ours)[seen] ** 2))
        print(f"view {number}: {whole:.1f} dB, foreground {part:.1f} dB", flush=True)
    sources = {"original, unshaded": (display.Input, 0), "original, shaded": (display.Input, 1), "baked": (baked, 0)}
    taken = seconds(sources, view, bounds)
    print(baked.Status, "CPU seconds an image:", ", ".join(f"{name} {value:.2f}" for name, value in taken.items()))
    simple.Show(baked, view)
    for what, change in (
        ("opacity", {"Region0Opacity": 0.5}),
        ("colour", {"Region0Recolour": 1}),
        ("hide", {"Region0Hide": 1}),
    ):
        for name, value in change.items():
            setattr(edit, name, value)
        began = time.monotonic()
        edit.UpdatePipeline()
        middle = time.monotonic()
        baked.UpdatePipeline()
        print(
            f"{what}: StyleRF Edit {middle - began:.2f} s, StyleRF Volume {time.monotonic() - middle:.2f} s", flush=True
        )


if __name__ == "__main__":
    main()
