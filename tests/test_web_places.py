"""Clicks into a scene's page: they say what is where, as the renderer does."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.core.geometry.cameras import Camera
from svv.errors import BadInput
from svv.fields.scene.joined import joined
from svv.fields.scene.probing import measure
from svv.fields.scene.scene import Scene
from svv.render.web.page import write_html
from tests.browser import Opened
from tests.cube import faint
from tests.test_web import front
from tests.test_web_joined import beside

USUAL, FAR = 0.02, 0.1
"""Median and greatest distance of places, in sizes of the box: at silhouettes and in fog, far samples weigh alike."""


def place(opened: Opened, camera: Camera, pixel: tuple[int, int]) -> tuple[list[float], int] | None:
    """The point and the region that the page says of a pixel."""
    told: dict[str, Any] = {name: getattr(camera, name) for name in ("fov_x", "span_x", "width", "height")}
    told["camera_to_world"] = camera.camera_to_world.ravel().tolist()
    found = opened.page.evaluate(
        "async ([camera, column, row]) => (await window.svv).place(camera, column, row)", [told, *pixel]
    )
    return None if found is None else (found["point"], found["region"])


def agreed(opened: Opened, scene: Scene, camera: Camera) -> int:
    """Compare pixels all over a picture; return how many show something."""
    regions, apart = scene.render(camera).region, []
    for column, row in [(x, y) for x in range(4, camera.width, 8) for y in range(4, camera.height, 8)]:
        found = place(opened, camera, (column, row))
        try:
            expected = scene.point_at(camera, (column, row))
        except BadInput:
            assert found is None
            continue
        assert found is not None
        if found[1] == regions[row, column]:  # a pixel may show as much of one as of another
            apart.append(np.linalg.norm(np.subtract(found[0], expected)) / scene.occupancy.box.size)
    assert np.median(apart) < USUAL and max(apart) < FAR
    return len(apart)


def check_measures(opened: Opened, said: str) -> None:
    """Click twice more after the click on a place that was told: distances and the angle are those of the places."""
    told, box = [said], opened.page.locator("#picture").bounding_box()
    assert box is not None
    for aside in (0.09, -0.09):
        position = {"x": (0.5 + aside) * box["width"], "y": (0.5 + 0.4 * abs(aside)) * box["height"]}
        opened.page.locator("#picture").click(position=position)
        told.append((opened.page.locator("#said").text_content() or "").partition(";")[0])
        assert "at" in told[-1], told
    places = [[float(v) for v in one.partition(" at ")[2].split(", ")[0].split(",")] for one in told]
    lengths, angle = measure(places)
    assert float(told[1].partition(", ")[2].split()[0]) == pytest.approx(lengths[0], rel=1e-3)
    far, angled = told[2].partition(", ")[2].split(" from the last place, angle there ")
    assert float(far) == pytest.approx(lengths[1], rel=1e-3) and angle is not None
    assert float(angled.removesuffix("°")) == pytest.approx(angle, abs=0.1)


@pytest.mark.slow
def test_a_place_is_the_renderers_for_both_kinds_of_rays(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    write_html(tmp_path / "balls.html", balls, "balls")
    opened: Opened = open_page(tmp_path / "balls.html")
    opened.ready()
    camera = front(balls)
    assert agreed(opened, balls, camera) >= 5
    away = float(np.linalg.norm(camera.position - np.array(balls.rig.centre)))
    parallel = Camera.orthographic(camera.camera_to_world, 2.0 * away * np.tan(camera.fov_x / 2), 96, 96)
    assert agreed(opened, balls, parallel) >= 5
    # The picture that is shown is drawn again afterwards, and a click says the same in words.
    assert opened.psnr(balls, camera) > 38.0
    opened.page.locator("#picture").click()
    said = opened.page.locator("#said").text_content()
    assert re.fullmatch(r"Region [01] at -?[\d.e-]+,-?[\d.e-]+,-?[\d.e-]+", said), said
    check_measures(opened, said)
    opened.page.locator("#picture").click(position={"x": 2, "y": 2})
    assert opened.page.locator("#said").text_content() == "Nothing is visible there."
    opened.page.get_by_label("Hide Region 0").click()
    opened.page.get_by_label("Hide Region 1").click()
    assert place(opened, camera, (48, 48)) is None
    assert opened.wrong == []


@pytest.mark.slow
def test_a_place_of_layers_is_where_the_renderer_joins_them(open_page: Any, balls: Scene, tmp_path: Path) -> None:
    both = joined((faint(balls, 0.1), faint(beside(balls), 0.15)))
    write_html(tmp_path / "both.html", both, "both")
    opened: Opened = open_page(tmp_path / "both.html")
    opened.ready()
    assert agreed(opened, both, front(both)) >= 5
