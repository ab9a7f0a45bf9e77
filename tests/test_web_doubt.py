"""Expected errors on a scene's page: the picture of `svv render --what doubt`, and what a click says."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.core.colour.colour import over
from svv.core.geometry.cameras import Camera
from svv.fields.scene.doubt import darkest_error
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import doubt_picture
from svv.render.web.page import html_of, write_html
from tests.browser import Opened
from tests.cube import cube_scene
from tests.test_web import front, lit, paint

pytestmark = pytest.mark.usefixtures("small_stills")

CLOSE = 30.0
"""Least PSNR of pictures of errors, in dB: colours of neighbours, whose difference counts, are bytes on the page."""


def psnr(opened: Opened, scene: Scene, camera: Camera, darkest: float) -> float:
    truth = over(doubt_picture(scene.doubt(camera), darkest))
    return float(-10.0 * np.log10(np.square(opened.picture(camera) - truth).mean()))


def test_a_page_shows_the_errors_that_are_rendered(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    assert balls.expected is not None
    scene = lit(balls).painted(paint(balls, 1), {0: "ink"}, {}, "one").with_light(60.0, 20.0)
    scene = scene.cut("x<30%").with_section("hatched")
    write_html(tmp_path / "balls.html", scene, "balls")
    opened = open_page(tmp_path / "balls.html")
    opened.ready()
    darkest, button = darkest_error(scene, scene.rig.orbit(5, 96)), opened.page.get_by_text("Doubt", exact=True)
    camera, plain = front(scene), opened.picture(front(scene))
    button.click()
    assert f"{100 * darkest:.2g} % or more" in opened.page.locator(".heat").inner_text()
    assert min(psnr(opened, scene, front(scene, frame=frame), darkest) for frame in (30, 90)) > CLOSE
    assert psnr(opened, replace(scene, expected=replace(balls.expected, edge=0.0)), camera, darkest) < CLOSE - 3.0
    opened.page.get_by_label("Opacity of Region 1").fill("0.3")
    assert psnr(opened, scene.edited(1, opacity=0.3), camera, darkest) > CLOSE
    opened.page.get_by_label("Opacity of Region 1").fill("1")
    button.click()
    assert np.array_equal(opened.picture(camera), plain)


def test_a_click_says_how_far_the_pixel_is_expected_to_be_off(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    write_html(tmp_path / "balls.html", balls, "balls")
    opened = open_page(tmp_path / "balls.html")
    opened.ready()
    camera, seen, found = front(balls), [], []
    errors = balls.doubt(camera)
    told: dict[str, Any] = {name: getattr(camera, name) for name in ("fov_x", "span_x", "width", "height")}
    told["camera_to_world"] = camera.camera_to_world.ravel().tolist()
    for column, row in [(x, y) for x in range(3, 96, 6) for y in (40, 48, 56, 95)]:
        error = opened.page.evaluate("async (at) => (await window.svv).doubt(...at)", [told, column, row])
        assert (error is None) == bool(np.isnan(errors[row, column]))
        if error is not None:
            seen.append(error)
            found.append(errors[row, column])
    assert len(seen) > 10 and np.abs(np.subtract(seen, found)).mean() < 0.1 * np.mean(found) + 0.002
    box = opened.page.locator("#picture").bounding_box()
    opened.page.locator("#picture").click(position={"x": 0.35 * box["width"], "y": 0.5 * box["height"]})
    said = opened.page.get_by_role("status").inner_text()
    assert re.search(r"; expected error \d+(\.\d+)? %$", said), said


def test_scenes_that_do_not_know_their_errors_have_no_switch() -> None:
    page = html_of(cube_scene(), "cube", "cube").decode()
    assert '"doubt": null' in page or '"doubt":null' in page
