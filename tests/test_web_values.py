"""The volume's values on a scene's page: clicks read off what `svv probe` does, with unit and uncertainty."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from svv.cli.app import app
from svv.core.volumes.classified import LARGEST
from svv.errors import BadInput
from svv.fields.radiance.kept_values import KeptValues, read_at
from svv.fields.radiance.time_steps import TimeSteps
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.options.pages import PageOptions
from svv.render.web.page import html_of, write_html
from tests.browser import Opened
from tests.solid_ball import solid_ball
from tests.test_probing import front, grid_over, keeping, linear, quadratic
from tests.test_web_places import place

pytestmark = pytest.mark.usefixtures("small_stills")


def noisy(points: np.ndarray) -> np.ndarray:
    """Values that no neighbour predicts, which go beyond their interval."""
    return np.asarray(300.0 + 900.0 * np.sin(1e3 * points @ (1.0, 0.7, 0.3)))


def uniform(points: np.ndarray) -> np.ndarray:
    """The same value everywhere, which takes next to no bytes."""
    return np.full(len(points), 100.0)


def read(opened: Opened, points: list[Any], region: int) -> list[dict[str, Any]]:
    """What the page reads off at points in the world."""
    script = "async ([p, r]) => { const svv = await window.svv; return Promise.all(p.map((at) => svv.read(at, r))); }"
    found: list[dict[str, Any]] = opened.page.evaluate(script, [points, region])
    return found


def labelled(scene: Scene) -> Scene:
    """The scene with whole numbers that belong to the nearest voxel."""
    grid = grid_over(scene, quadratic)
    codes = (1 + 3 * (LARGEST // 12) * np.random.default_rng(0).integers(0, 5, grid.codes.shape)).astype(np.uint16)
    grid = replace(grid, codes=codes, interval=(0.0, float(LARGEST)), nearest=True)
    regions = (replace(scene.regions[0], values=(30000.0, 40000.0)), *scene.regions[1:])
    return replace(scene, kept=KeptValues.of(grid, scene.occupancy.box, scene.occupancy, whole=True), regions=regions)


def stepped(scene: Scene) -> Scene:
    """The scene with its values as time steps."""
    steps = TimeSteps.of(grid_over(scene, linear), scene.occupancy.box, 2.5)
    return replace(scene, kept=None, steps=steps)


@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_pages_read_off_what_python_does(open_page: Any, tmp_path: Path, count: int) -> None:
    ball = keeping(solid_ball(2.5), noisy)
    parts = (labelled(ball), ball)[:count]
    write_html(
        tmp_path / "a.html",
        joined(parts) if count > 1 else parts[0],
        "a",
        options=PageOptions(values=True, value_unit="HU"),
    )
    opened, box = open_page(tmp_path / "a.html"), ball.occupancy.box
    opened.ready()
    points, known = box.to_world(np.random.default_rng(1).uniform(-0.02, 1.02, (60, 3)) * box.extent), 0
    for region, part in enumerate(parts):
        assert part.kept is not None
        truth = read_at(part.kept, points, part.regions[0].values)
        for number, found in enumerate(read(opened, points.tolist(), region)):
            assert ("value" in found) == bool(np.isfinite(truth.value[number]))
            if "value" in found:
                known += 1
                told = found["value"], found["uncertainty"], found["beyond"]
                assert told == pytest.approx((truth.value[number], truth.uncertainty[number], truth.beyond[number]))
                assert "HU of ball.vti" in found["words"]
    assert known > 20 * count


@pytest.mark.slow
def test_a_click_says_what_probe_does(open_page: Any, tmp_path: Path) -> None:
    scene = stepped(keeping(solid_ball(2.5), linear))
    write_html(tmp_path / "a.html", scene, "a", options=PageOptions(values=True, value_unit="HU"))
    opened, camera, told = open_page(tmp_path / "a.html"), front(scene), 0
    opened.ready()
    for pixel in [(x, y) for x in range(14, 36, 7) for y in range(14, 36, 7)]:
        found, truth = place(opened, camera, pixel), scene.probe(camera, pixel)
        if found is None or truth is None or truth.value is None or truth.uncertainty is None:
            continue
        told += 1
        value = read(opened, [found[0]], found[1])[0]["value"]
        apart = np.linalg.norm(np.subtract(found[0], truth.point))
        assert abs(value - truth.value) <= 616.5 * apart + 2.0 * (
            truth.uncertainty or 0.0
        )  # the gradient is (500, -300, 200)
    assert told > 8
    box = opened.page.locator("#picture").bounding_box()
    opened.page.locator("#picture").click(position={"x": 0.5 * box["width"], "y": 0.5 * box["height"]})
    opened.until("document.getElementById('said').textContent.includes(' HU of ball.vti')")
    said = opened.page.get_by_role("status").inner_text()
    assert " ± " in said and said.endswith(" at time 2.5")


def test_large_values_are_left_out_unless_they_are_asked_for(tmp_path: Path) -> None:
    scene = keeping(solid_ball(2.5), noisy)
    scene.save(tmp_path / "a.svv")
    out, run = str(tmp_path / "a.html"), CliRunner().invoke
    said = run(app, ["export", str(tmp_path / "a.svv"), "--out", out]).output
    assert "the volume's values would add" in said and "(--values)" in said
    assert 'id="values"' not in Path(out).read_text()
    said = run(app, ["export", str(tmp_path / "a.svv"), "--values", "--out", out]).output
    assert "the volume's values are" in said and 'id="values"' in Path(out).read_text()
    assert 'id="values"' in html_of(keeping(scene, uniform), "a", "a").decode(), "few bytes are no question"
    found = run(app, ["export", str(tmp_path / "a.svv"), "--value-unit", "HU", "--out", str(tmp_path / "a.vti")])
    assert isinstance(found.exception, BadInput) and not (tmp_path / "a.vti").exists()
