"""`svv export` to splats, and what files keep of the pictures."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import svv
from svv.cli.app import app
from svv.errors import BadInput
from svv.job.splats import export_splats
from svv.job.workshop import Workshop
from svv.train.splats import fit, starting
from tests.cube import cube_scene
from tests.solid_ball import solid_ball
from tests.test_web_values import stepped

FEW = ("--splats", "600", "--steps", "4", "--degree", "1")


@pytest.fixture(autouse=True)
def few_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (fit, starting):
        monkeypatch.setattr(module, "VIEWS", 4)
        monkeypatch.setattr(module, "PIXELS", 40)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "cube.svv"
    cube_scene().save(path)
    return path


def test_command(scene: Path, tmp_path: Path) -> None:
    """The file has the splats of the scene, as :func:`svv.fit_splats` returns them."""
    out = tmp_path / "cube.ply"
    done = CliRunner().invoke(app, ["export", str(scene), "--out", str(out), *FEW])
    assert done.exit_code == 0 and "splats of degree 1" in done.output
    assert [path.name for path in tmp_path.iterdir()] == [out.name]
    splats = svv.fit_splats(svv.Scene.load(scene), svv.SplatOptions(count=600, steps=4, degree="1"))
    back = svv.read_splats(out)
    side = float(np.ptp(splats.centres, axis=0).max())
    np.testing.assert_allclose(back.centres, splats.centres, atol=1e-6 * side)
    np.testing.assert_array_equal(back.harmonics, splats.harmonics)
    np.testing.assert_array_equal(back.regions, splats.regions)
    assert back.names == splats.names


@pytest.mark.parametrize("suffix", [".spz", ".glb"])
def test_other_files_are_written_from_the_same(
    scene: Path, tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("svv.job.splats.fit_splats", few_splats)
    out = tmp_path / f"cube{suffix}"
    done = CliRunner().invoke(app, ["export", str(scene), "--out", str(out)])
    assert done.exit_code == 0 and "3 splats of degree 0" in done.output
    svv.write_splats(tmp_path / f"other{suffix}", few_splats())
    assert out.read_bytes() == (tmp_path / f"other{suffix}").read_bytes()


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("a.ply", ("--light", "baked"), "Splats have the options --splats"),
        ("a.spz", ("--phi", "3"), "Splats have the options --splats"),
        ("a.html", ("--splats", "1000"), "no options of splats"),
        ("a.cdb", ("--splats", "1000"), "no options of splats"),
        ("a.vti", ("--degree", "2"), "no options of splats"),
        ("a.usda", (), r"splats NAME\.ply, NAME\.spz, NAME\.glb or NAME\.usdz"),
    ],
)
def test_options_of_other_files_are_refused(
    scene: Path, tmp_path: Path, name: str, options: tuple[str, ...], says: str
) -> None:
    done = CliRunner().invoke(app, ["export", str(scene), "--out", str(tmp_path / name), *options])
    assert isinstance(done.exception, BadInput)
    with pytest.raises(BadInput, match=says):
        raise done.exception
    assert list(tmp_path.iterdir()) == []


def few_splats(*_: object) -> svv.Splats:
    return svv.Splats(
        centres=np.eye(3, dtype="f4"), scales=np.ones((3, 3), "f4"), rotations=np.eye(4, dtype="f4")[[0] * 3],
        opacities=np.ones(3, "f4"), harmonics=np.zeros((3, 1, 3), "f4"), regions=np.zeros(3, "i2"), names=("bone",),
        background=(1.0, 1.0, 1.0),
    )  # fmt: skip


def test_a_file_holds_one_time_step_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svv.job.splats.fit_splats", few_splats)
    own = stepped(solid_ball()).steps
    assert own is not None
    steps = replace(own, times=(2.5, 7.0), codes=own.codes * 2, moves=own.moves * 2, own=1)
    said = export_splats(tmp_path / "a.ply", replace(solid_ball(), steps=steps), svv.SplatOptions())
    assert said.startswith("3 splats of degree 0") and "at time 7; svv follow --out FOLDER" in said
    assert "time" not in export_splats(tmp_path / "a.ply", solid_ball(), svv.SplatOptions())


def test_assistants_export(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cube_scene().save(tmp_path / "cube.svv")
    shop, told = Workshop(tmp_path), list[float]()
    said = shop.export("cube.svv", "cube.ply", 300, lambda fraction, _: told.append(fraction))
    assert said.startswith("cube.ply: ") and "splats of degree" in said and told[-1] == 1.0 and told == sorted(told)
    assert 100 < len(svv.read_splats(tmp_path / "cube.ply")) <= 300
    with pytest.raises(BadInput, match=r"NAME\.ply, NAME\.spz"):
        shop.export("cube.svv", "cube.obj")
    with pytest.raises(BadInput, match="below the folder"):
        shop.export("cube.svv", "../cube.ply")
    monkeypatch.setattr("svv.render.web.page.write_html", lambda *_, **__: 2_500_000)
    assert shop.export("cube.svv", "cube.html") == "cube.html: 2.5 MB."


def test_vtk_is_not_needed(scene: Path, tmp_path: Path) -> None:
    script = """
import sys
sys.modules["vtkmodules"] = None
import svv
from svv.job.splats import export_splats
from svv.train.splats import fit, starting
for module in (fit, starting):
    module.VIEWS, module.PIXELS = 3, 24
export_splats(__import__("pathlib").Path(sys.argv[2]), svv.Scene.load(sys.argv[1]), svv.SplatOptions(100, "0", 2))
"""
    subprocess.run([sys.executable, "-c", script, scene, tmp_path / "a.spz"], check=True)
    assert 0 < len(svv.read_splats(tmp_path / "a.spz")) <= 100


def test_nothing_is_left_of_a_stopped_fit(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("svv.render.splats.files.write_ply", interrupted)
    done = CliRunner().invoke(app, ["export", str(scene), "--out", str(tmp_path / "a.ply"), *FEW])
    assert done.exit_code != 0
    assert list(tmp_path.iterdir()) == []
