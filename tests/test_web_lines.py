"""Ink on a scene's page: outlines and the lines around sections are those of the renderer."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from svv.core.colour.colour import over
from svv.core.images.edges import VIEW
from svv.core.images.outlines import Pen, outlined
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.fields.scene.sections import with_lines
from svv.render.web.html import viewer_file
from svv.render.web.page import LINES, write_html
from tests.test_outlines import camera, images, plane, sphere
from tests.test_web import front

pytestmark = pytest.mark.usefixtures("small_stills")

INK = """(() => {
  const opacitiesOf = () => [1, 1, 1], cutsOf = () => [0];
  %s
  const bytes = Uint8Array.from(atob(%s), (letter) => letter.charCodeAt(0));
  const work = inkLayer(new Uint32Array(bytes.buffer), %s, {}, %s);
  for (;;) {
    const { done, value } = work.next();
    if (done) return Array.from(value);
  }
})()"""
"""The page's computation of ink, alone: its scripts, what the march tells, the camera and the header."""


def test_ink_is_found_and_drawn_as_by_the_renderer(chromium: Any) -> None:
    size, shapes = 160, (sphere(160), sphere(160, (0.35, 0.2, 0.3), 0.25), plane(160, (0.3, 0.2, 1.0), -0.4))
    rgba, depth, region = images(shapes, (1.0, 1.0, 0.4))
    seen, (y, x) = camera(size), np.mgrid[:size, :size]
    share = (0.9 / (1.0 + np.exp(np.hypot(x - 70, y - 90) - 30.0))).astype(np.float32)
    regions = [
        Region((1.0, 1.0, 1.0), 1 / 3, outline=ink, outline_width=width, outline_colour=colour, section_line=line)
        for ink, width, colour, line in (
            (1.0, 9.0, (0.0, 0.0, 0.0), 8.0), (0.6, 14.0, (0.8, 0.0, 0.0), 0.0), (1.0, 6.0, (0.0, 0.0, 0.6), 6.0),
        )
    ]  # fmt: skip
    pens = [Pen(r.outline, r.outline_width, r.outline_colour) for r in regions]
    drawn, _, after = outlined(rgba, depth, region, pens, seen.pixel_at, 1.0)
    truth, plain = over(with_lines(drawn, share, after, regions, VIEW)), over(rgba)
    told = np.zeros((size, size, 4), np.uint32)
    for k, image in ((0, rgba[..., 3]), (1, depth), (3, share)):
        told[..., k] = np.ascontiguousarray(image).view(np.uint32)
    told[..., 2] = region + 1
    header = {
        "lines": {name: getattr(module, name) for module, names in LINES.items() for name in names},
        "layers": [{"box": {"size": 1.0}}],
        "regions": [vars(r) for r in regions],
    }
    told_camera = {"width": size, "height": size, "fov_x": seen.fov_x, "span_x": None}
    given = base64.b64encode(told[::-1].tobytes()).decode(), told_camera, header
    page = chromium.new_page()
    found = page.evaluate(INK % (viewer_file("lines.js"), *(json.dumps(one, default=str) for one in given)))
    page.close()
    ink = np.array(found, np.float64).reshape(size, size, 4)[::-1] / 255.0
    shown = plain * (1.0 - ink[..., 3:]) + ink[..., :3] * ink[..., 3:]
    assert np.abs(truth - plain).max() > 0.9
    # Where two points put as much ink on a pixel, either may be the one that gives it its colour.
    assert (np.abs(shown - truth).max(axis=2) > 0.02).mean() < 0.002


def test_pages_draw_outlines_and_lines_around_sections(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    plain = balls.edited(0, opacity=4.0).edited(1, opacity=4.0).cut("x>70%").with_section("flat")
    scene = plain.with_outline(1.0, width=10.0).with_section(line=8.0)
    write_html(tmp_path / "ink.html", scene, "ink")
    opened = open_page(tmp_path / "ink.html", size=(1000, 500))
    opened.ready()
    seen = front(scene, 128, frame=60)
    found, without = opened.psnr(scene, seen), opened.psnr(plain, seen)
    assert found > max(27.0, without + 6.0)
    change = np.abs(opened.picture(seen) - over(plain.render(seen).rgba)).max(axis=2) > 0.3
    wanted = np.abs(over(scene.render(seen).rgba) - over(plain.render(seen).rgba)).max(axis=2) > 0.3
    assert wanted.sum() > 100 and (change & wanted).sum() > 0.85 * (change | wanted).sum()
    opened.page.evaluate("window.svv.then((svv) => (window.show = svv.show, svv.changed()))")
    opened.until("!window.show.stale && window.show.frames > 1")  # the screen comes to show them as well
    screen = Image.open(io.BytesIO(opened.page.locator("#picture").screenshot())).convert("RGB")
    assert (np.asarray(screen).max(axis=2) < 60).sum() > 200
