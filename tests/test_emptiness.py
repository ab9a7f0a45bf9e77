"""Pictures that show nothing: people are told why, or they are refused if there is nothing else in them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from svv.cli.app import app
from svv.errors import BadInput
from svv.render.emptiness import HIDDEN, PAST, hides_all, why_empty
from svv.render.figures.figure import Panel, figure
from svv.render.frames import orbit
from tests.cube import cube_scene


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a cube, and others of which nothing is visible."""
    cube = cube_scene()
    cube.save(tmp_path / "cube.svv")
    cube.hidden(0, 1, 2).save(tmp_path / "hidden.svv")
    faded = cube
    for region in range(3):
        faded = faded.edited(region, None, 0.0, None)
    faded.save(tmp_path / "faded.svv")
    cube.hidden(0, 1).save(tmp_path / "one.svv")
    return tmp_path


def run(*words: object) -> Result:
    return CliRunner().invoke(app, list(map(str, words)))


def test_why() -> None:
    cube = cube_scene()
    assert not hides_all(cube) and not hides_all(cube.hidden(0, 1)) and hides_all(cube.hidden(0, 1, 2))
    camera = orbit(cube, 8, 16, 16)[0]
    assert why_empty(cube, cube.render(camera).depth) == ""
    assert why_empty(cube.hidden(0, 1, 2), cube.hidden(0, 1, 2).render(camera).depth) == HIDDEN
    assert why_empty(cube, np.full((4, 4), np.nan)) == PAST


@pytest.mark.parametrize("name", ["hidden", "faded"])
@pytest.mark.parametrize("out", ["a.png", "a.vti", "frames"])
def test_an_empty_picture_is_told(folder: Path, name: str, out: str) -> None:
    done = run(
        "render", folder / f"{name}.svv", "--size", 16, "--out", folder / out, *["--orbit", 2] * (out == "frames")
    )
    assert done.exit_code == 0 and (folder / out).exists()
    assert f"svv: {folder / out} is empty, because {HIDDEN}: show regions with `svv edit --show`" in done.stderr
    assert not np.asarray(Image.open(folder / "a.png"))[..., 3].any() if out == "a.png" else True
    assert "empty" not in run("render", folder / "cube.svv", "--size", 16, "--out", folder / "b.png").stderr


def test_a_camera_that_looks_past_it_is_told(folder: Path) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 0.0, 0.0, -9.0  # looks along -z
    (folder / "past.json").write_text(json.dumps({"camera_to_world": pose.tolist(), "fov": 30.0}))
    camera = "--camera", folder / "past.json"
    done = run("render", folder / "cube.svv", *camera, "--size", 16, "--out", folder / "a.png")
    assert done.exit_code == 0 and f"a.png is empty, because {PAST}." in done.stderr


@pytest.mark.filterwarnings("ignore:Regions look alike")  # those of the cube do
def test_a_figure_of_nothing_is_refused_and_an_empty_panel_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, size in {"figure.SWATCH_VIEW": 48, "swatches.LIGHT_VIEW": 24, "framing.PREVIEW": 64}.items():
        monkeypatch.setattr(f"svv.render.figures.{name}", size)
    done = run("figure", folder / "hidden.svv", "--dpi", 50, "--out", folder / "a.png")
    assert isinstance(done.exception, BadInput) and not (folder / "a.png").exists()
    assert str(done.exception).startswith(f"Nothing is visible in the figure, because {HIDDEN}: show regions with")
    done = run("figure", folder / "cube.svv", folder / "faded.svv", "--dpi", 50, "--out", folder / "a.png")
    assert done.exit_code == 0 and f"svv: Panel b is empty, because {HIDDEN}." in done.stderr
    cube = cube_scene()
    with pytest.warns(UserWarning, match="Panel a is empty"):
        figure([Panel(cube.hidden(0, 1, 2)), Panel(cube)], dpi=50)


@pytest.mark.parametrize("name", ["hidden", "faded"])
def test_colours_of_nothing_are_refused(folder: Path, name: str) -> None:
    done = run("check-colours", folder / f"{name}.svv", "--json", folder / "a.json")
    assert isinstance(done.exception, BadInput) and "No region of" in str(done.exception)
    assert not (folder / "a.json").exists()
    assert "Fewer than two regions are visible" in run("check-colours", folder / "one.svv").stdout


def test_exports_of_nothing_are_told_or_refused(folder: Path) -> None:
    few = "--phi", 2, "--theta", 1, "--size", 16
    done = run("export", folder / "hidden.svv", "--out", folder / "a.cdb", *few)
    assert done.exit_code == 0 and f"a.cdb will be empty, because {HIDDEN}" in done.stderr
    done = run("export", folder / "hidden.svv", "--out", folder / "a.vti")
    assert isinstance(done.exception, BadInput) and "Nothing in the scene is visible" in str(done.exception)
