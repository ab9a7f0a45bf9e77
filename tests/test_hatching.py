"""Hatching in figures where the expected error exceeds a level: where its lines are, and what figures say of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import svv
from svv.errors import BadInput
from svv.fields.scene.expected import CELLS, ExpectedErrors
from svv.fields.scene.scene import Scene
from svv.render.figures.figure import Panel, drawing_of
from svv.render.figures.hatching import SPACING, lines_over, mean_around
from tests.test_figures import SMALL, small_pictures, texts_of

__all__ = ["small_pictures"]

pytest.importorskip("matplotlib")

pytestmark = pytest.mark.filterwarnings("ignore:Regions look alike")


@pytest.fixture(scope="module")
def known(cube: Scene) -> Scene:
    """The cube, with an error of 20 % in one half as seen from the front and of 1 % in the other."""
    level = np.full((CELLS,) * 3, 57, np.uint8)
    level[..., : CELLS // 2] = 255
    return replace(cube, expected=ExpectedErrors(level, 0.2, 0.0, 0.1, 0.2, (0.0, 0.0, 0.0)))


@given(st.floats(0.2, 0.8), st.floats(0.2, 0.8), st.floats(15.0, 60.0), st.booleans())
def test_lines_fill_what_is_over_the_level_and_nothing_else(x: float, y: float, side: float, holes: bool) -> None:
    size, pixels = (side, 0.7 * side), (int(2.8 * side), int(4 * side))
    rows, columns = ((np.arange(n) + 0.5) / n for n in pixels)
    errors = 0.2 * ((columns[None] < x) & (rows[:, None] < y)).astype(float)
    if holes:
        errors[errors == 0.0] = np.nan
    lines = lines_over(errors, 0.1, size)
    area = x * y * size[0] * size[1]
    length = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum()
    assert abs(length * SPACING / area - 1.0) < 0.35
    assert (lines[..., 0] <= x * size[0] + 0.3).all() and (lines[..., 1] >= (1.0 - y) * size[1] - 0.3).all()
    assert lines_over(errors, 0.3, size).shape == (0, 2, 2)


def test_the_mean_around_a_pixel_is_of_what_is_visible() -> None:
    errors = np.full((9, 9), np.nan)
    errors[:, :4] = 0.3
    mean = mean_around(errors, 4.0)
    np.testing.assert_allclose(mean[:, :4], 0.3)
    assert np.isnan(mean[:, 4:]).all()


def test_figures_hatch_the_half_that_is_doubted_and_say_so(known: Scene, tmp_path: Path) -> None:
    drawing = drawing_of(
        known, None, svv.FigureOptions(hatch_doubt=0.05, axes="none", scale_bar=False, **SMALL), tell=print
    )
    assert "expected error over 5 %" in texts_of(drawing.figure)
    (told,) = drawing.report()["panels"]
    assert 0.3 < told["hatched"] < 0.7
    plain = drawing_of(known, None, svv.FigureOptions(axes="none", scale_bar=False, **SMALL), tell=print)
    assert plain.report()["panels"][0]["hatched"] is None and "hatched" not in texts_of(plain.figure)
    said: list[str] = []
    small = svv.FigureOptions(hatch_doubt=0.9, legend="none", **SMALL)
    drawing_of(
        [known, Panel(known, draw=lambda c: np.ones((c.height, c.width, 4), np.float32))], None, small, tell=said.append
    )
    hatched = [one for one in said if "hatched" in one]
    assert len(hatched) == 1 and hatched[0].startswith(
        "Nothing is hatched in panel a: its expected errors are at most "
    )


@pytest.mark.parametrize("kind", ["svg", "pdf"])
def test_lines_stay_lines_in_vector_files(known: Scene, tmp_path: Path, kind: str) -> None:
    file, sizes = tmp_path / f"a.{kind}", []
    for level in (None, 0.05):
        svv.figure(known, file, hatch_doubt=level, legend="none", axes="none", scale_bar=False, **SMALL)
        content = file.read_text() if kind == "svg" else ""
        sizes.append(content.count("<path") if kind == "svg" else len(file.read_bytes()))
    assert sizes[1] > sizes[0] + 20


def test_what_cannot_be_hatched_is_refused(cube: Scene, known: Scene) -> None:
    with pytest.raises(BadInput, match="train it again"):
        svv.figure(cube, hatch_doubt=0.1, **SMALL)
    with pytest.raises(BadInput, match=r"above 0 and is at most 1, such as 0\.05, not 0\."):
        svv.figure(known, hatch_doubt=0.0, **SMALL)
