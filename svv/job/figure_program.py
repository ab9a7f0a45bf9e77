"""A figure that another program asks for: ``python -m svv.job.figure_program REQUEST.json`` (:func:`request`).

ParaView's own Python must not load matplotlib, which brings another VTK, or NumPy of another version. What users should
know of the figure is printed, a line each.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from svv.core.geometry.cameras import Camera
from svv.ending import end_with
from svv.options.described import chosen
from svv.options.figures import FigureOptions


def request(
    scene: Path, camera: Camera | None, options: FigureOptions, out: Path, volume: Sequence[str] | None = None
) -> dict[str, object]:
    """Return a request as plain values; with ``volume``, files that may be the scene's, its rendering is shown, too."""
    told = None
    if camera is not None:
        told = {"matrix": camera.camera_to_world.tolist(), "fov": camera.fov_x, "span": camera.span_x}
        told |= {"width": camera.width, "height": camera.height}
    return {"scene": str(scene), "camera": told, "options": chosen(options), "volume": volume, "out": str(out)}


def drawn(content: dict[str, Any]) -> None:
    """Draw what a request asks for; raises BadInput as :func:`svv.render.figures.figure.figure`."""
    import numpy as np

    from svv.fields.scene.scene import Scene
    from svv.job.looks.file import figure_in
    from svv.job.volume_panels import panel_of, remembered
    from svv.render.figures.figure import Panel, figure

    told = content["camera"]
    camera = None
    if told is not None:
        matrix = np.asarray(told["matrix"], np.float64)
        camera = Camera(matrix, told["fov"], told["width"], told["height"], told["span"])
    options = FigureOptions(**figure_in(content["options"], "the figure's settings"))
    scene, volume = Scene.load(content["scene"]), content["volume"]
    panels = [Panel(scene, camera)]
    if volume is not None:
        panels.insert(0, panel_of(scene, remembered(scene, [Path(file) for file in volume], []), camera))
    figure(panels, content["out"], options, tell=print)


def main() -> None:
    """Draw the request in the file that the command line names."""
    end_with(lambda: drawn(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))), "svv")


if __name__ == "__main__":
    main()
