"""Pages of joined scenes: each function alone and all together, as the renderer shows them."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.fields.scene.stroke_opacity import strokes_of
from svv.render.web.fields import EXTINCTION_STEP
from svv.render.web.notebook import _edited
from svv.render.web.page import html_of, numbers_of, paintings_of, write_html
from tests.browser import LARGEST, Opened
from tests.cube import faint
from tests.loose_balls import RIGHT, TOP, in_world, loose_balls
from tests.test_web import CLOSE, COARSE, EVIL, front, lit, paint

FRAMES = (30, 90, 150)

SHADED = "async () => { const { show } = await svv; return show.painter.rows(show.state, show.camera(), 1).at(-3) }"
"""JavaScript that gives the rows ``uStrokes`` of the shader."""


def beside(scene: Scene) -> Scene:
    """The scene smaller and elsewhere: its box overlaps the other's, and is of another size and shape."""
    box = scene.occupancy.box
    low = tuple(np.add(box.low, (0.1 * box.size, 0.12 * box.size, -0.05 * box.size)).tolist())
    return replace(scene, occupancy=replace(scene.occupancy, box=Box(low, 0.8 * box.size, box.extent)))


@pytest.fixture(scope="module")
def parts(balls: Scene) -> tuple[Scene, Scene]:
    """Two scenes in boxes of their own, one lit by its network and one by a lamp, through which one sees."""
    return faint(balls, 0.1), faint(beside(lit(balls)), 0.15).edited(0, (0.1, 0.7, 0.2))


@pytest.fixture(scope="module")
def both(parts: tuple[Scene, Scene]) -> Scene:
    return joined(parts)


@pytest.fixture(scope="module")
def brushed(parts: tuple[Scene, Scene], balls: Scene) -> Scene:
    """Of the two, only the second is painted; its opacity follows the strokes."""
    second = parts[1].painted(paint(balls, 1), {0: EVIL, 1: "ink"}, {}, EVIL)
    return joined([parts[0], second.with_stroke_opacity(0.8, 0)])


@pytest.fixture(scope="module", autouse=True)
def _few_frames() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("svv.render.web.page.MOVIE_FRAMES", 2)
        yield


@pytest.fixture(scope="module")
def page_of_both(both: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("joined") / "both.html"
    write_html(path, both, "both")
    return path


def shown(open_page: Any, path: Path, script: str = "") -> Opened:
    opened: Opened = open_page(path, script)
    opened.ready()
    return opened


def least(opened: Opened, scene: Scene, network: str | None = None) -> float:
    return min(opened.psnr(scene, front(scene, frame=frame), network) for frame in FRAMES)


@pytest.mark.slow
def test_functions_are_shown_together_and_alone(open_page: Any, both: Scene, page_of_both: Path) -> None:
    opened = shown(open_page, page_of_both)
    page = opened.page
    assert "4 regions of 2 transfer functions" in page.locator("header").inner_text()
    assert least(opened, both) > CLOSE
    page.get_by_label("Show only Function 1").click()
    assert least(opened, both.isolated(2, 3)) > CLOSE
    assert page.get_by_label("Hide Function 0").get_attribute("aria-pressed") == "true"
    page.get_by_label("Show only Function 1").click()
    page.get_by_label("Hide Function 1").click()
    assert least(opened, both.isolated(0, 1)) > CLOSE
    page.get_by_label("Show only Region 2").click()
    assert least(opened, both.isolated(2)) > CLOSE
    page.get_by_role("button", name="Show all").click()
    page.get_by_label("Colour of Region 3").fill("#d03090")
    page.get_by_label("Colour of Region 0").fill("#20a040")
    edited = both.edited(3, (208 / 255, 48 / 255, 144 / 255)).edited(0, (32 / 255, 160 / 255, 64 / 255))
    assert least(opened, edited) > CLOSE
    page.get_by_label("Opacity of Region 3").fill("1.5")
    assert least(opened, edited.edited(3, opacity=1.5)) > CLOSE


@pytest.mark.slow
def test_a_lamp_lights_the_functions_that_it_can(open_page: Any, both: Scene, page_of_both: Path) -> None:
    opened = shown(open_page, page_of_both)
    opened.page.get_by_label("Light from the right of the camera, in degrees").fill("70")
    assert least(opened, replace(both, lamp=replace(both.lamp, azimuth=70.0))) > CLOSE
    opened.page.get_by_label("Light", exact=True).fill("0")
    dark = both
    for region in range(len(both.regions)):
        dark = dark.edited(region, lighting=0.0)
    assert least(opened, dark) > CLOSE


def test_parallel_rays_meet_boxes_of_all_sizes(open_page: Any, both: Scene, page_of_both: Path) -> None:
    opened = shown(open_page, page_of_both)
    camera = front(both)
    flat = Camera(camera.camera_to_world, camera.fov_x, camera.width, camera.height, span_x=2.2)
    assert opened.psnr(both, flat) > CLOSE


@pytest.mark.slow
def test_the_nearer_function_hides_the_other(open_page: Any, parts: tuple[Scene, Scene], tmp_path: Path) -> None:
    """Opaque, from both sides: layers are composited by distance, not one after the other."""
    first, second = (faint(scene, 3.0) for scene in parts)
    pictures = []
    for number, scenes in enumerate(([first, second], [second, first])):
        scene = joined(scenes)
        write_html(tmp_path / f"{number}.html", scene, "title")
        opened = shown(open_page, tmp_path / f"{number}.html")
        assert least(opened, scene) > CLOSE
        pictures.append(opened.picture(front(first)))
    assert np.abs(pictures[0] - pictures[1]).max() < 0.02, "their order in the list does not matter"


@pytest.mark.slow
def test_a_painted_function_beside_one_that_is_not(open_page: Any, brushed: Scene, tmp_path: Path) -> None:
    write_html(tmp_path / "painted.html", brushed, "painted")
    opened = shown(open_page, tmp_path / "painted.html")
    page = opened.page
    names = page.get_by_label("Painting", exact=True).locator("option").all_inner_texts()
    assert names == ["None: the palette's colours", EVIL]
    assert least(opened, brushed) > CLOSE
    page.get_by_label("Strength of the painting").fill("0.4")
    assert least(opened, brushed.with_strength(0.4)) > CLOSE
    page.get_by_label("Painting", exact=True).select_option("")
    assert least(opened, brushed, "pcn") > CLOSE


def test_opacity_follows_strokes_as_strongly_as_they_are_painted(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    """At each strength, on the page's slider and on the region's own, by as much as the renderer's does."""
    scene = faint(balls, 0.15).painted(paint(balls, 1), {0: EVIL, 1: "ink"}, {}, EVIL).with_stroke_opacity(-0.8, 0)
    scene = scene.with_strength(0.8, 0)
    write_html(tmp_path / "strokes.html", scene, "strokes")
    page = shown(open_page, tmp_path / "strokes.html").page
    for strength in (1.0, 0.8, 0.5, 0.3, 0.1):
        page.get_by_label("Strength of the painting").fill(str(strength))
        told = page.evaluate(SHADED)
        truth = strokes_of(scene.with_strength(0.8 * strength, 0).with_strength(strength, 1))
        assert truth is not None and truth[0, 1] < 0.0, "light strokes are the opaque ones"
        np.testing.assert_allclose(np.array(told)[:, 1:], truth[:, 1:], rtol=2e-3)
        np.testing.assert_allclose(np.array(told)[:, 0], truth[:, 0], atol=EXTINCTION_STEP / 4, err_msg=f"{strength}")


def test_names_are_text_and_paintings_one(brushed: Scene, balls: Scene) -> None:
    other = faint(balls, 0.2).painted(paint(balls, 2), {1: "b"}, {}, 'it\'s "2"')
    three = joined([brushed, other])
    assert paintings_of(three) == [f'{EVIL} + it\'s "2"']
    assert paintings_of(joined([other, other])) == ['it\'s "2"'], "the same name is said once"
    text = html_of(three, f"title {EVIL}", "name").decode()
    assert text.count("<script") == 3 and EVIL not in text
    header = json.loads(re.findall(r'id="scene">([^<]*)<', text)[0])
    assert header["paintings"][0]["styles"] == [None, None, EVIL, "ink", None, "b"]
    strokes = np.array(header["paintings"][0]["strokes"])
    assert strokes.shape == (6, 4) and strokes[2].any() and not strokes[[0, 1, 3, 4, 5]].any()
    assert [(layer["first"], layer["count"]) for layer in header["layers"]] == [(0, 2), (2, 2), (4, 2)]


@pytest.mark.slow
def test_graphics_that_hold_less_than_all_layers(open_page: Any, both: Scene, page_of_both: Path) -> None:
    """The layers lie one behind the other in a texture: it is that which has to fit."""
    opened = shown(open_page, page_of_both)
    longest = opened.page.evaluate(
        "async () => Math.max(...Object.values((await svv).show.painter.textures.all)\
        .flatMap(({ size }) => size))"
    )
    small = shown(open_page, page_of_both, LARGEST % (longest - 1))
    assert f"hold {longest - 1} points a side" in small.page.get_by_role("status").inner_text()
    close = [one.psnr(both, front(both)) for one in (opened, small)]
    assert COARSE < close[1] < close[0]


@pytest.mark.usefixtures("small_stills")
def test_a_part_that_was_split_off_is_listed_with_its_function() -> None:
    """It has the scene's last number, though the page lists it before the other function's regions."""
    split = joined([loose_balls(), loose_balls((TOP,))]).split_at(in_world(RIGHT))
    page = html_of(split, "title", "name").decode()
    header = json.loads(re.search(r'<script[^>]*id="scene"[^>]*>(.*?)</script>', page, re.S).group(1))  # type: ignore[union-attr]
    assert [region["number"] for region in header["regions"]] == [0, 1, 4, 2, 3] == numbers_of(split)
    told = {
        "painting": None, "strength": 1.0, "light": 1.0, "lamp": vars(split.lamp),
        "regions": [{"edited": None, "opacity": 1.0, "hidden": number == 4} for number in numbers_of(split)],
    }  # fmt: skip
    assert [r.hidden for r in _edited(split, told).regions] == [False] * 4 + [True]
