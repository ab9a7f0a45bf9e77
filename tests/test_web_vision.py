"""The page for browsers shows names of regions, and a scene as people with a colour vision deficiency see it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from svv.core.colour.colour_vision import simulated
from svv.fields.scene.scene import Scene
from svv.render.web.page import write_html

CLOSE = 32.0
"""How close the browser's picture is to the renderer's, in dB."""

EVIL = "<b>bone</b> & 'more'"
"""A name that would be HTML."""


@pytest.mark.slow
def test_colours_edited_in_oklab_are_those_of_the_renderer(open_page: Any, cube: Scene, tmp_path: Path) -> None:
    scene = cube.edited(0, colour=(0.2, 0.9, 0.4), recolour_in="oklab")
    write_html(tmp_path / "page.html", scene, "recoloured")
    opened = open_page(tmp_path / "page.html", size=(400, 300))
    opened.ready()
    camera = scene.rig.orbit(181, 96, frames=[90])[0]
    assert opened.psnr(scene, camera) > opened.psnr(scene.edited(0, recolour_in="hsb"), camera)
    assert opened.psnr(scene, camera) > CLOSE


DRAWN = "window.svv.then(({ show }) => !show.changed && !show.stale && show.fence === null)"


@pytest.mark.parametrize(
    "visions",
    [("deuteranopia", "grey print"), pytest.param(("protanopia", "tritanopia"), marks=pytest.mark.slow)],
    ids=" and ".join,
)
def test_names_are_shown_as_text_and_the_switch_simulates(
    open_page: Any, balls: Scene, tmp_path: Path, visions: tuple[str, ...]
) -> None:
    write_html(tmp_path / "page.html", balls.edited(0, name=EVIL), "named")
    opened = open_page(tmp_path / "page.html", size=(700, 500))
    opened.ready()
    page = opened.page
    assert EVIL in page.get_by_role("list").inner_text() and page.get_by_label(f"Opacity of {EVIL}").count() == 1

    def shot() -> np.ndarray:
        """What the canvas shows once it is drawn in full, however long that takes: until then, it is coarser."""
        opened.until(DRAWN)
        image = Image.open(io.BytesIO(page.locator("#picture").screenshot())).convert("RGB")
        return np.asarray(image, np.float64) / 255.0

    before = shot()
    for vision in visions:
        page.get_by_label("Colour vision").select_option(label=vision.capitalize())
        off = np.abs(shot() - simulated(before, vision)).max(2)  # type: ignore[arg-type]
        assert np.percentile(off, 99) < 3.5 / 255, vision
    page.get_by_label("Colour vision").select_option(label="Normal")
    assert np.abs(shot() - before).max() < 1.5 / 255
