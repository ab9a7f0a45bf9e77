"""Cuts on a scene's page: those of its file, and the plane that is dragged there, against the renderer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.core.colour.colour import over
from svv.fields.scene.scene import Scene
from svv.render.web.notebook import SceneWidget
from svv.render.web.page import write_html
from tests.cube import cube_scene
from tests.test_web import front, paint

CLOSE = 27.0
"""Least PSNR of the browser's pictures, in dB: what views never saw of the balls has other colours on another grid."""

APART = 5.0
"""How much closer they are to the scene than to one that is cut otherwise, in dB."""


@pytest.fixture(scope="module")
def dense(balls: Scene) -> Scene:
    """The balls, so opaque that faces hide what is behind them."""
    return balls.edited(0, opacity=4.0).edited(1, opacity=4.0)


@pytest.mark.parametrize(
    "cuts",
    [
        pytest.param(("x>55%",), marks=pytest.mark.slow),
        pytest.param(("x>50%&y>50%", "outside sphere:0,0,0:0.8"), marks=pytest.mark.slow),
        pytest.param(("0=z>50%", "1=cylinder:0,0,0:1,0.5,0:0.3"), marks=pytest.mark.slow),
        ("0=x>50%&y>50%", "1=cylinder:0,0,0:1,0.5,0:0.3", "outside sphere:0,0,0:0.8"),
        pytest.param(("x>200%",), marks=pytest.mark.slow),
    ],
)
def test_a_page_shows_the_cuts_of_its_file(open_page: Any, dense: Scene, tmp_path: Path, cuts: tuple[str, ...]) -> None:
    scene = dense.cut(*cuts)
    write_html(tmp_path / "cut.html", scene, "cut")
    opened = open_page(tmp_path / "cut.html")
    opened.ready()
    cameras = [front(scene, frame=frame) for frame in (30, 90)]
    assert min(opened.psnr(scene, camera) for camera in cameras) > CLOSE
    if cuts != ("x>200%",):
        assert all(opened.psnr(dense, camera) < opened.psnr(scene, camera) - APART for camera in cameras)
    opened.page.get_by_label("Show the cuts of the file").click()
    assert min(opened.psnr(dense, camera) for camera in cameras) > CLOSE


@pytest.mark.usefixtures("small_stills")
@pytest.mark.parametrize(
    "cuts",
    [
        ("0,1,2=x<0.01", "0,1,2=x>0.04"),  # a slab in which no sample need lie: half a step thick
        ("x>0.2", "0,1,2=x<0.17"),
        ("0,1,2=outside cylinder:0,0.1,0:1,0,1:0.03", "y>30%&z>110%"),
        ("0,1,2=outside box:0.1,-0.4,-0.4:0.13,0.4,0.4", "outside sphere:0,0,0:0.35"),
    ],
)
def test_what_cuts_leave_is_seen_however_thin_it_is(open_page: Any, tmp_path: Path, cuts: tuple[str, ...]) -> None:
    scene = cube_scene()
    for region in range(3):  # black on white shows nothing but opacity
        scene = scene.edited(region, (0.0, 0.0, 0.0), opacity=20.0)
    scene = scene.with_section("flat").cut(*cuts)
    write_html(tmp_path / "cut.html", scene, "cut")
    opened = open_page(tmp_path / "cut.html")
    opened.ready()
    for frame in (0, 60):
        camera = front(scene, 48, frame)
        seen, truth = opened.picture(camera), over(scene.render(camera).rgba)
        assert np.abs(seen - truth).mean() < 0.08 * (1.0 - truth).mean()  # codes of extinctions are some 5 % off


def test_a_page_shows_sections_of_palettes_and_paintings(open_page: Any, dense: Scene, tmp_path: Path) -> None:
    scene = dense.edited(0, colour=(0.9, 0.7, 0.1)).painted(paint(dense, 1), {1: "ink"}, {}, "one").cut("x>75%")
    scene = scene.with_section("flat", 1).with_section("hatched", 0)
    write_html(tmp_path / "cut.html", scene, "cut")
    opened = open_page(tmp_path / "cut.html")
    opened.ready()
    camera = front(scene)
    assert opened.psnr(scene, camera) > CLOSE - 4.0  # paint that comes as it may at each point
    opened.page.get_by_label("Painting", exact=True).select_option("")
    assert opened.psnr(scene, camera, "pcn") > CLOSE
    plain, hatched = (over(one.render(camera, "pcn").rgba) for one in (scene.with_section("learned"), scene))
    change, seen = hatched - plain, opened.picture(camera) - plain
    assert np.abs(change).max() > 0.2  # what sections change is what the page changes
    assert (change * seen).sum() / np.square(change).sum() == pytest.approx(1.0, abs=0.4)


def test_a_plane_is_dragged_through_the_scene(open_page: Any, dense: Scene, tmp_path: Path) -> None:
    write_html(tmp_path / "balls.html", dense, "balls")
    opened = open_page(tmp_path / "balls.html")
    opened.ready()
    page, camera = opened.page, front(dense, frame=60)
    assert not page.get_by_label("Place of the cut").is_visible()
    page.get_by_label("Cut", exact=True).select_option(label="Across x")
    page.get_by_label("Place of the cut").fill("0.4")
    assert opened.psnr(dense.cut("x>40%"), camera) > CLOSE
    page.get_by_label("Cut off the other side").click()
    assert opened.psnr(dense.cut("x<40%"), camera) > CLOSE > opened.psnr(dense.cut("x>40%"), camera) + APART
    told = page.evaluate("async () => (await window.svv).told().edits")
    widget = SceneWidget(dense, "balls")
    widget.edits = told
    assert widget.scene.cuts == dense.cut("x<40%").cuts and widget.scene.undone().cuts == ()
    page.get_by_role("button", name="Reset all").click()
    assert opened.psnr(dense, camera) > CLOSE
    assert replace(widget.scene, cuts=()).regions == dense.regions
