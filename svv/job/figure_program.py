"""A figure that another program asks for: ``python -m svv.job.figure_program REQUEST.json``.

ParaView's own Python must not load matplotlib, which brings another VTK, or NumPy of another version. The request is
``{"scene": file, "camera": matrix and lens or null, "options": settings, "out": file}``, as :func:`request` writes it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from svv.core.geometry.cameras import Camera
from svv.ending import end_with
from svv.options.described import chosen
from svv.options.figures import FigureOptions


def request(scene: Path, camera: Camera | None, options: FigureOptions, out: Path) -> dict[str, object]:
    """Return a request as plain values."""
    told = None
    if camera is not None:
        told = {"matrix": camera.camera_to_world.tolist(), "fov": camera.fov_x, "span": camera.span_x}
        told |= {"width": camera.width, "height": camera.height}
    return {"scene": str(scene), "camera": told, "options": chosen(options), "out": str(out)}


def drawn(content: dict[str, Any]) -> None:
    """Draw what a request asks for.

    Raises:
        BadInput: As for :func:`svv.render.figures.figure.figure`.
    """
    import numpy as np

    from svv.fields.scene.scene import Scene
    from svv.render.figures.figure import Panel, figure
    from svv.render.looks.file import figure_in

    told = content["camera"]
    camera = None
    if told is not None:
        matrix = np.asarray(told["matrix"], np.float64)
        camera = Camera(matrix, told["fov"], told["width"], told["height"], told["span"])
    options = FigureOptions(**figure_in(content["options"], "the figure's settings"))
    figure(Panel(Scene.load(content["scene"]), camera), content["out"], options)


def main() -> None:
    """Draw the request in the file that the command line names."""
    end_with(lambda: drawn(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))), "svv")


if __name__ == "__main__":
    main()
