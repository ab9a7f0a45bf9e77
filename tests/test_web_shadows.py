"""Cast shadows on a scene's page: computed there, they follow the light, opacities and cuts as the renderer's do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.fields.scene.shadows import _grid
from svv.render.web.page import write_html
from tests.cube import faint
from tests.test_web import CLOSE, front, lit, paint
from tests.test_web_joined import beside

pytestmark = pytest.mark.usefixtures("small_stills")

DEPTHS = "async () => Array.from((await window.svv).show.painter.shadows.grid.depth)"
"""Optical depths, from which a page computes shadows."""

RIGHT, ABOVE = (f"Shadows from {where} the camera, in degrees" for where in ("the right of", "above"))


def test_shadows_follow_the_light_that_is_moved(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    scene = balls.with_shadow(1.0)  # from the camera's upper left
    write_html(tmp_path / "balls.html", scene, "balls")
    opened = open_page(tmp_path / "balls.html", size=(400, 300))
    opened.ready()
    page, camera, turned = opened.page, front(scene, frame=60), front(scene, frame=20)
    assert min(opened.psnr(scene, one) for one in (camera, turned)) > CLOSE, "they turn with the camera"
    page.get_by_label(RIGHT).fill("70")
    page.get_by_label(ABOVE).fill("30")
    moved = balls.with_shadow(1.0, (70.0, 30.0))
    assert opened.psnr(moved, camera) > CLOSE > opened.psnr(scene, camera) + 5.0
    page.get_by_label("Hide Region 0").click()
    assert opened.psnr(moved.hidden(0), camera) > CLOSE, "what is hidden casts none"
    page.get_by_label("Hide Region 0").click()
    page.get_by_label("Cut", exact=True).select_option("1")
    assert opened.psnr(moved.cut("y>50%"), camera) > CLOSE - 10.0  # as without shadows: tests/test_web_cuts.py
    page.get_by_label("Cut", exact=True).select_option("")
    for name in ("Add key frame", "Add key frame", "Save shot"):
        page.get_by_role("button", name=name).click()
    assert page.get_by_role("status").inner_text().startswith("A shot has the shadows of its scene")
    page.get_by_label("Shadows", exact=True).fill("0")
    assert opened.psnr(balls, camera) > CLOSE


@pytest.mark.slow
def test_what_is_shown_becomes_what_the_renderer_shows(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    scene = lit(balls).with_light(60.0, 20.0).with_shadow(1.0).edited(0, matcap="jade")
    write_html(tmp_path / "lit.html", scene, "lit")
    opened = open_page(tmp_path / "lit.html", size=(400, 300))
    opened.ready()
    camera = front(scene, frame=60)
    assert opened.psnr(scene, camera) > 30.0, "shadows come from the light that was moved, and fall on MatCaps"
    opened.page.get_by_label("Light from the right of the camera, in degrees").fill("-50")
    # On the screen they are coarse at first, and then refined without anything else being done.
    opened.until(
        "window.svv.then((svv) => (window.shadows = svv.show.painter.shadows)) && window.shadows?.work === null"
    )
    assert opened.psnr(scene.with_light(-50.0, 20.0), camera) > 30.0


def test_what_is_clearer_between_its_strokes_casts_less(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    plain = faint(balls, 0.5).painted(paint(balls, 1), {0: "oil"}, {}, "one").with_shadow(1.0, (80.0, 0.0))
    scene = plain.with_stroke_opacity(1.0, 0)
    write_html(tmp_path / "strokes.html", scene, "strokes")
    opened = open_page(tmp_path / "strokes.html", size=(400, 300))
    opened.ready()
    depths = []
    for strength in (0.0, 1.0, 0.4):
        opened.page.get_by_label("Strength of the painting").fill(str(strength))
        assert opened.psnr(scene.with_strength(strength), front(scene)) > CLOSE
        depths.append(np.array(opened.page.evaluate(DEPTHS)))
        own, whole = (_grid(one.with_strength(strength), "styled").depth.ravel() for one in (scene, plain))
        there = (whole > 0.0) & (depths[0] > 0.0)
        found, truth = depths[-1][there] / depths[0][there], own[there] / whole[there]
        assert np.abs(found - truth).mean() < 0.01 and truth.mean() <= 1.0 - 0.1 * strength


@pytest.mark.slow
def test_layers_shade_each_other(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    both = joined((faint(balls, 0.5), beside(balls))).with_shadow(1.0, (1.0, 0.7, 0.5))
    write_html(tmp_path / "both.html", both, "both")
    opened = open_page(tmp_path / "both.html", size=(400, 300))
    opened.ready()
    camera = front(both)
    found, plain = opened.psnr(both, camera), opened.psnr(both.with_shadow(0.0), camera)
    assert found > max(28.0, plain + 5.0) and np.isfinite(found)
