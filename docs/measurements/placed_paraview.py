"""StyleRF Place In View against our own images, and its time, in ParaView's 3D view.

``svv pvpython docs/measurements/placed_paraview.py SCENE.svv [FOLDER]`` draws three views of 400 x 400 of the picture
alone, with and without the view's FXAA, and leaves them in the folder.
"""

import statistics
import sys
import time
from pathlib import Path

import numpy as np
from baked_paraview import EYES, SIZE, drawn, place
from paraview import simple
from PIL import Image

from svv.fields.scene.scene import Scene
from svv.pv.scripts import camera_of_view

ROUNDS = 15


def main() -> None:
    file, folder = Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else "/tmp")
    folder.mkdir(parents=True, exist_ok=True)
    scene, view = Scene.load(file), simple.CreateView("RenderView")
    view.ViewSize = [SIZE, SIZE]
    view.UseColorPaletteForBackground, view.Background, view.OrientationAxesVisibility = 0, [1.0, 1.0, 1.0], 0
    image = simple.StyleRFRender(Input=simple.OpenDataFile(str(file)))
    picture = simple.StyleRFPlaceInView(Input=image)
    simple.Show(picture, view)
    box = scene.occupancy.box
    ends = np.array(box.low), np.array(box.low) + box.size * np.array(box.extent)
    bounds = np.stack(ends, axis=1).ravel()
    simple.Render(view)
    for number, eye in enumerate(EYES):
        place(view, bounds, eye)
        ours = scene.render(camera_of_view(view, SIZE, SIZE), background=(1.0, 1.0, 1.0)).rgba[..., :3]
        Image.fromarray(np.rint(255 * ours).astype(np.uint8)).save(folder / f"placed-ours-{number}.png")
        for smoothed in (0, 1):
            view.UseFXAA = smoothed
            error = drawn(view, folder / f"placed-{number}-{smoothed}.png") - ours
            print(f"view {number}, FXAA {smoothed}: {-10 * np.log10(np.mean(error**2)):.1f} dB", flush=True)
    taken: dict[str, list[float]] = {"image alone": [], "sharp": [], "while the mouse moves": []}
    for _ in range(ROUNDS):
        for name in taken:
            view.GetActiveCamera().Azimuth(5.0)
            began = time.process_time()
            if name == "image alone":
                scene.render(camera_of_view(view, SIZE, SIZE))
            elif name == "sharp":
                simple.Render(view)
            else:
                view.SMProxy.InteractiveRender()
            taken[name].append(time.process_time() - began)
    print("CPU seconds:", ", ".join(f"{name} {statistics.median(values):.2f}" for name, values in taken.items()))


if __name__ == "__main__":
    main()
