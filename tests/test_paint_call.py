"""``svv.paint``: one call from an array, a grid or a plotter to a painted scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

pyvista = pytest.importorskip("pyvista")

import svv  # noqa: E402
from svv.dvr.draw.views import make_views  # noqa: E402
from svv.errors import BadInput, Cancelled  # noqa: E402
from svv.train.run.config import PRESETS  # noqa: E402
from tests.balls import SHORT  # noqa: E402
from tests.nightly import nightly  # noqa: E402
from tests.test_plotted import SIZE, image, sheared, values  # noqa: E402

QUICK: dict[str, Any] = {"preset": "draft", "n": 16, "size": 56, "mapper": "cpu"}


@pytest.fixture(autouse=True)
def quick(broad_strokes: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The preset draft takes seconds."""
    monkeypatch.setitem(PRESETS, "draft", replace(SHORT, stylize=PRESETS["draft"].stylize))


def style(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((64, 64, 3), np.float32)


def test_a_plotter_becomes_a_painting_that_is_seen_where_it_shows_the_volume(tmp_path: Path) -> None:
    plotter = pyvista.Plotter(off_screen=True, window_size=list(SIZE))
    actor = plotter.add_volume(image(), cmap="plasma", opacity="sigmoid_5", show_scalar_bar=False)
    actor.prop.SetInterpolationTypeToLinear()
    plotter.camera_position = "iso"
    plotter.camera.zoom(1.4)
    plotter.set_background("white")
    theirs = plotter.screenshot(return_img=True).min(-1) < 200
    said: list[str] = []
    painted = svv.paint(plotter, style(), tell=said.append, **QUICK)
    assert painted.networks == ("base", "pcn", "styled") and painted.variant is not None
    picture = svv.show(painted, camera=plotter, network="base", off_screen=True, screenshot=tmp_path / "painted.png")
    assert picture is not None and picture.size == SIZE
    with Image.open(tmp_path / "painted.png") as written:
        assert written.size == SIZE
    ours = np.asarray(picture).min(-1) < 200
    assert (theirs & ours).sum() > 0.85 * (theirs | ours).sum() > 500
    plotter.close()


GRIDS = ("image", "sheared", "cells")

WORDS = [(grid, clim) for grid in GRIDS for clim in (None, (0.1, 0.7), 0.8)]


@pytest.mark.parametrize(("grid", "clim"), nightly(WORDS, ("image", None), ("cells", 0.8)))
def test_words_of_pyvista_mean_what_they_do_there(monkeypatch: pytest.MonkeyPatch, grid: str, clim: Any) -> None:
    """For each kind of grid, with and without a range of values: the views are those of a plotter."""
    drawn: list[Any] = []

    def stop(views: Any, *_: Any, **__: Any) -> Any:
        drawn.append(views)
        raise Cancelled

    monkeypatch.setattr("svv.job.request.train_scene", stop)
    shown = {"image": image, "sheared": sheared, "cells": lambda: image().point_data_to_cell_data()}[grid]()
    told = {"cmap": ["red", "lime", "blue"], "opacity": "sigmoid_3", "clim": clim}
    plotter = pyvista.Plotter(off_screen=True)
    actor = plotter.add_volume(shown.cell_data_to_point_data(), show_scalar_bar=False, **told)
    actor.prop.SetInterpolationTypeToLinear()
    with pytest.raises(Cancelled):
        svv.paint(shown.cell_data_to_point_data(), "ink:hatching", **told, **QUICK)
    wanted, _ = make_views(plotter, n=16, size=56, mapper="cpu")
    found = drawn[-1].meta
    assert found.shading == wanted.meta.shading
    for key in ("RGBPoints", "Points", "ScalarOpacityUnitDistance"):
        np.testing.assert_allclose(found.tf[key], wanted.meta.tf[key], atol=1e-9)  # type: ignore[index]
    if isinstance(shown, pyvista.ImageData):  # plotters cut other grids into tetrahedra
        assert np.abs(drawn[-1].images.astype(int) - wanted.images).max() <= 1
    plotter.close()


def test_styles_are_pictures_inks_files_and_names_one_for_each_region(tmp_path: Path) -> None:
    Image.fromarray((255 * style(1)).astype(np.uint8)).save(tmp_path / "brush.png")
    painted = svv.paint(
        values(), tmp_path / "brush.png", "ink:hatching", spacing=(1.0, 0.8, 1.3), tell=lambda _: None, **QUICK
    )
    assert {region.style for region in painted.regions} <= {"brush", "ink:hatching"}
    assert painted.made["source"]["grid"]["spacing"] == [1.0, 0.8, 1.3]


def test_what_was_assumed_is_kept_with_the_views(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[Any] = []

    def stop(views: Any, *_: Any, **__: Any) -> Any:
        drawn.append(views)
        raise Cancelled

    monkeypatch.setattr("svv.job.request.train_scene", stop)
    with pytest.raises(Cancelled):
        svv.paint(values(), svv.Ink("stippling"), tell=lambda _: None, **QUICK)
    assert "taken for [z, y, x]" in str(drawn[-1].meta.assumed)


def test_all_notes_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr("svv.job.painting.run", lambda *_: SimpleNamespace(notes=["one", "two"], scene="painted"))
    assert svv.paint(values(), svv.Ink("stippling"), tell=said.append, **QUICK) == "painted"  # type: ignore[comparison-overlap]
    assert said == ["one", "two"]


@pytest.mark.slow
def test_what_was_assumed_is_told_and_recorded() -> None:
    said: list[str] = []
    painted = svv.paint(values(), svv.Ink("stippling"), tell=said.append, **QUICK)
    assert any("taken for [z, y, x]" in one for one in said)
    assert "taken for [z, y, x]" in painted.made["source"]["assumed"]


def test_progress_runs_from_0_to_1_and_stops_the_work() -> None:
    seen: list[float] = []

    def stop(fraction: float, label: str) -> None:
        seen.append(fraction)
        if fraction > 0.3:
            raise Cancelled

    with pytest.raises(Cancelled):
        svv.paint(values(), "ink:hatching", cmap="viridis", progress=stop, **QUICK)
    assert seen[0] < 0.01 and seen[-1] > 0.3 and max(seen) <= 1.0


BAD: dict[str, tuple[tuple[Any, ...], dict[str, Any], str]] = {
    "no style": ((), {}, "Give at least one style"),
    "no such style": (("gallery:nothing",), {}, "nothing"),
    "a list of styles": ((["ink:hatching", "ink:stippling"],), {}, "A style picture is an array"),
    "two functions": (("ink:hatching",), {"cmap": "viridis", "tf": "f.json"}, "Give either a transfer function"),
    "no such map": (("ink:hatching",), {"cmap": "no such map"}, "no transfer function of cmap='no such map'"),
    "no such opacity": (("ink:hatching",), {"opacity": "dense"}, "opacity='dense'"),
    "no range": (("ink:hatching",), {"clim": (2.0, 1.0)}, "two ascending numbers"),
    "no map": (("ink:hatching",), {"cmap": 3}, "PyVista has no transfer function"),
    "no preset": (("ink:hatching",), {"preset": "quick"}, "quick"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_painted_is_refused_before_the_work(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    styles, changes, words = BAD[case]
    monkeypatch.setattr("svv.job.request.train_scene", lambda *_: pytest.fail("The work has begun."))
    with pytest.raises(BadInput, match=words) as caught:
        svv.paint(values(), *styles, **{**QUICK, **changes})
    assert "\n" not in str(caught.value)


def test_an_unknown_option_is_an_error_of_the_call() -> None:
    for name in ("sizes", "test", "go_on"):
        with pytest.raises(TypeError, match=name):
            svv.paint(values(), "ink:hatching", **{name: 1})
