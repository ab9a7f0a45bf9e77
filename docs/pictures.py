"""The pictures of "How it works": the result of each stage for the demo's volume, seen from the same camera.

Run ``make demo``, then ``.venv/bin/python -m docs.pictures demo`` in the checkout. This takes a few
seconds and writes ``docs/images/stage-*.jpg`` from the views and scenes in the folder.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.core.cameras import Camera
from svv.fields.scene import Scene
from svv.io.viewset import ViewSet

IMAGES = Path(__file__).resolve().parent / "images"

SIZE = 420
"""Width and height of each picture, in pixels."""

ZOOM = 0.55
"""Fraction of the field of view that the pictures show, because the views leave a margin around the volume."""

WHITE = (1.0, 1.0, 1.0)

Pixels = NDArray[np.float64]


def write(name: str, pictures: list[Pixels]) -> None:
    """Write pictures (height, width, 3), in [0, 1], side by side into one file."""
    row = np.clip(np.concatenate(pictures, axis=1), 0.0, 1.0)
    path = IMAGES / f"stage-{name}.jpg"
    Image.fromarray(np.rint(255 * row).astype(np.uint8)).save(path, quality=88, optimize=True, progressive=True)


def over_white(rgba: NDArray[np.uint8]) -> Pixels:
    """Return an image with straight alpha (height, width, 4; 0 to 255) over white (height, width, 3), in [0, 1]."""
    levels = rgba.astype(np.float64) / 255
    return levels[..., :3] * levels[..., 3:] + (1 - levels[..., 3:])


def main() -> None:
    """Draw the pictures from the output folder of ``svv demo``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="the folder of `svv demo`")
    folder = parser.parse_args().demo
    views = ViewSet.read(folder / "views", "train")
    scene, painted = Scene.load(folder / "scene.svv"), Scene.load(folder / "styled.svv")
    write("views", [_shrunk(views, number) for number in (0, 20, 45, 70)])
    seen = views.cameras[45]
    camera = Camera(seen.camera_to_world, ZOOM * seen.fov_x, SIZE, SIZE)

    def drawn(scene: Scene, network: str | None = None) -> Pixels:
        return np.asarray(scene.render(camera, network, WHITE).rgba[..., :3], np.float64)

    write("base", [_shrunk(views, 45), drawn(scene, network="base")])
    regions = [drawn(scene.isolated(region)) for region in range(len(scene.regions))]
    write("palette", [drawn(scene), *regions])
    lines, shell = 0, 1  # most visible first
    green = scene.edited(lines, colour=(0.1, 0.55, 0.35))
    write("edits", [drawn(green), drawn(green.edited(shell, opacity=4.0)), drawn(green.hidden(shell))])
    write("painting", [drawn(painted.with_paint_light(0.0)), drawn(painted)])


def _shrunk(views: ViewSet, number: int) -> Pixels:
    image = Image.fromarray(np.rint(255 * over_white(views.images[number])).astype(np.uint8))
    margin = round((1 - ZOOM) / 2 * image.width)
    image = image.crop((margin, margin, image.width - margin, image.height - margin))
    return np.asarray(image.resize((SIZE, SIZE), Image.Resampling.LANCZOS), np.float64) / 255


if __name__ == "__main__":
    main()
