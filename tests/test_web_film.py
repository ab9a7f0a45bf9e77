"""Key frames from a scene's page: the shot that it saves shows what the page showed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import svv
from svv.fields.scene.scene import Scene
from svv.render.shots.film import Film
from svv.render.web.page import write_html
from tests.browser import Opened
from tests.test_web import CLOSE, paint


def save_shot(opened: Opened, path: Path) -> svv.Shot:
    """Press the button, and read what it saves."""
    with opened.page.expect_download() as saved:
        opened.page.get_by_role("button", name="Save shot").click()
    assert saved.value.suggested_filename == "balls.shot.json"
    saved.value.save_as(path)
    return svv.read_shot(path)


def test_key_frames_of_a_page_are_a_shot_of_the_scene(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    scene = balls.painted(paint(balls, 1), {0: "a"}, {}, "first").edited(1, name="blue")
    write_html(tmp_path / "balls.html", scene, "balls")
    opened = open_page(tmp_path / "balls.html", size=(760, 300))
    opened.ready()
    page, said = opened.page, opened.page.get_by_role("status")
    save = page.get_by_role("button", name="Save shot")
    assert save.is_disabled()
    page.get_by_role("button", name="Add key frame").click()
    assert said.inner_text() == "Key frame 1 is at 0 s." and save.is_disabled()
    moved = "async () => { const { orbit, changed } = await window.svv; %s; changed(); }"
    page.evaluate(moved % "orbit.turn(0.7, 0.3); orbit.closer(1.4)")
    page.get_by_label("Opacity of blue").fill("0.3")
    page.get_by_label("Strength of the painting").fill("0.25")
    page.get_by_label("Colour of Region 0").fill("#20a040")
    page.get_by_label("Seconds from the last key frame to the next one").fill("1.5")
    page.get_by_label("Cut", exact=True).select_option(label="Across y")
    page.get_by_label("Place of the cut").fill("0.55")
    page.get_by_role("button", name="Add key frame").click()
    page.get_by_label("Place of the cut").fill("0.45")
    page.evaluate(moved % "orbit.pan(0.1, 0)")
    page.get_by_label("Hide Region 0").click()
    page.get_by_role("button", name="Add key frame").click()
    shot = save_shot(opened, tmp_path / "shot.json")
    assert said.inner_text().endswith("svv render SCENE.svv --shot balls.shot.json --out film.mp4")
    assert [key.time for key in shot.keys] == [0.0, 1.5, 3.0] and shot.painting == "first"
    assert set(json.loads((tmp_path / "shot.json").read_text())["keys"][0]["regions"]) == {"0", "1"}
    assert [key.cuts for key in shot.keys] == [(), ("y>55.00000000000001%",), ("y>45%",)]
    film = Film(scene, shot, fps=2)
    assert len(film.cameras) == 7
    for number, time in ((0, "0"), (3, "1.5"), (6, "3")):
        page.get_by_label(f"Show the key frame at {time} s", exact=True).click()
        camera = film.cameras[number]
        told = page.evaluate("async () => (await window.svv).told().camera")
        assert (camera.width, camera.height) == (told["width"], told["height"])
        assert camera.camera_to_world.ravel().tolist() == pytest.approx(told["camera_to_world"], abs=1e-9)
        assert camera.fov_x == pytest.approx(told["fov_x"])
        assert opened.psnr(film.at(number), camera.resized(120, 120)) > CLOSE - 4.0
    page.get_by_role("button", name="Remove last").click()
    assert len(save_shot(opened, tmp_path / "shot.json").keys) == 2


def test_a_shot_that_would_not_be_what_the_page_shows_is_not_saved(
    open_page: Any, balls: Scene, tmp_path: Path
) -> None:
    scene = balls.painted(paint(balls, 1), {0: "a"}, {}, "first").painted(paint(balls, 2), {1: "b"}, {}, "second")
    write_html(tmp_path / "balls.html", scene, "balls")
    opened = open_page(tmp_path / "balls.html", size=(300, 300))
    opened.ready()
    add = opened.page.get_by_role("button", name="Add key frame")
    add.click()
    opened.page.get_by_label("Seconds from the last key frame to the next one").fill("-1")
    add.click()
    assert opened.page.get_by_role("status").inner_text() == "Seconds from one key frame to the next are 0.1 to 600."
    opened.page.get_by_label("Seconds from the last key frame to the next one").fill("1")
    opened.page.get_by_label("Painting", exact=True).select_option("first")
    add.click()
    opened.page.get_by_role("button", name="Save shot").click()
    assert opened.page.get_by_role("status").inner_text().startswith("A shot shows one painting")
    opened.page.get_by_role("button", name="Remove last").click()
    opened.page.get_by_label("Painting", exact=True).select_option("")
    add.click()  # without paint
    shot = save_shot(opened, tmp_path / "shot.json")
    assert shot.painting == "second" and Film(scene, shot, (8, 8), 2).at(2).paint_shares.tolist() == [0.0, 0.0]
