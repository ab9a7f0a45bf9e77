"""Scenes' pages in a browser: how close to the renderer, how fast, how large; the figures of web-viewer.md.

usage: python docs/measurements/web_viewer.py SCENE.svv [--size 400] [--shots FOLDER]

Needs Chromium and playwright. WebGL2 runs on the CPU, so frames per second depend on what else the machine does.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from svv.core.colour.colour import over
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import to_bytes
from svv.render.web.page import write_html
from tests.browser import LARGEST, Opened, browser

FRAMES = (30, 90, 150)
"""Cameras of the orbit of 181 views."""

SECONDS = 5.0
"""Time during which a page is turned."""

TURN = """async (seconds) => {
  const svv = await window.svv, start = performance.now(), first = svv.show.frames, parts = [];
  while (performance.now() - start < 1000 * seconds) {
    svv.orbit.turn(0.02, 0.005), svv.changed();
    await new Promise(requestAnimationFrame);
    parts.push(svv.show.part);
  }
  const mean = parts.reduce((a, b) => a + b) / parts.length;
  return [(svv.show.frames - first) / ((performance.now() - start) / 1000), mean];
}"""
"""Turn a scene, and return the frames shown per second and the mean side of the pictures, as a fraction."""

WHOLE = """async (size) => {
  const svv = await window.svv, camera = svv.orbit.camera(size, size), times = [];
  for (let k = 0; k < 5; k++) {
    const start = performance.now();
    svv.picture(camera);
    times.push(performance.now() - start);
  }
  return times.sort((a, b) => a - b)[2];
}"""
"""Median time of a picture in full, in milliseconds."""


def edits(page: Any, scene: Scene) -> list[tuple[str, Any, Scene]]:
    """Name, hand and scene of each edit, one after the other from the reset page."""

    def recolour() -> None:
        if scene.variant is not None:
            page.get_by_label("Painting", exact=True).select_option("")
        page.get_by_label("Colour of Region 0").fill("#20a040")

    # Of a joined scene, this takes the paint of the first function only, and nothing of another may be painted.
    plain = scene.without_variant(scene.variant) if scene.variant is not None else scene
    green = plain.edited(0, (32 / 255, 160 / 255, 64 / 255))
    alone = [
        (
            f"alone-{number}",
            partial(page.get_by_label(f"Show only Function {number}").click),
            scene.isolated(*(k for k, region in enumerate(scene.regions) if region.layer == number)),
        )
        for number in range(len(scene.layers) + 1 if scene.layers else 0)
    ]
    return [
        *alone,
        ("unedited", lambda: None, scene),
        ("recoloured", recolour, green),
        ("opacity 40 %", lambda: page.get_by_label("Opacity of Region 0").fill("0.4"), scene.edited(0, opacity=0.4)),
        ("hidden", lambda: page.get_by_label("Hide Region 0").click(), scene.hidden(0)),
    ]


def main() -> None:
    """Print the figures of one scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--size", type=int, default=400)
    parser.add_argument("--shots", type=Path, help="folder for pictures: browser, renderer, and their difference x 8")
    parser.add_argument("--points", type=int, help="points a side that the graphics are to hold at most")
    given = parser.parse_args()
    scene = Scene.load(given.scene)
    path = Path(tempfile.mkdtemp()) / "scene.html"
    start = time.process_time()
    size = write_html(path, scene, given.scene.stem)
    print(f"{path}: {size / 1e6:.2f} MB, written in {time.process_time() - start:.0f} s of CPU")
    cameras = scene.rig.orbit(181, given.size, frames=FRAMES)
    with browser() as running:
        context = running.new_context(viewport={"width": given.size + 340, "height": given.size})
        opened = Opened.at(path, context, "" if given.points is None else LARGEST % given.points)
        start = time.perf_counter()
        opened.ready()
        print(f"ready after {time.perf_counter() - start:.1f} s. {opened.page.locator('#said').inner_text()}")
        for name, act, edited in edits(opened.page, scene):
            opened.page.get_by_role("button", name="Reset all").click()
            act()
            scores = []
            for frame, camera in zip(FRAMES, cameras, strict=True):
                picture, truth = opened.picture(camera), over(edited.render(camera).rgba)
                scores.append(-10.0 * np.log10(np.square(picture - truth).mean()))
                if given.shots is not None:
                    sheet = np.concatenate([picture, truth, 8.0 * np.abs(picture - truth)], axis=1)
                    given.shots.mkdir(parents=True, exist_ok=True)
                    Image.fromarray(to_bytes(sheet)).save(given.shots / f"{name.split()[0]}-{frame}.png")
            print(f"{name}: {', '.join(f'{score:.1f}' for score in scores)} dB", flush=True)
        opened.page.get_by_role("button", name="Reset all").click()
        print(f"whole picture: {opened.page.evaluate(WHOLE, given.size):.0f} ms")
        rate, part = opened.page.evaluate(TURN, SECONDS)
        print(f"turned: {rate:.1f} frames per second at {part:.0%} of the side")
        assert opened.wrong == [], opened.wrong


if __name__ == "__main__":
    main()
