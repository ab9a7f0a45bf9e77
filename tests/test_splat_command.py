"""`svv export` to splats, and what files keep of the pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import svv
from svv.cli.app import app
from svv.errors import BadInput
from tests.cube import cube_scene

FEW = ("--splats", "600", "--steps", "4", "--degree", "1")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "cube.svv"
    cube_scene().save(path)
    return path


@pytest.mark.parametrize("suffix", [".ply", ".spz", ".glb"])
def test_command(scene: Path, tmp_path: Path, suffix: str) -> None:
    """The same splats whatever the file, of the scene's regions and in its place."""
    out = tmp_path / f"cube{suffix}"
    done = CliRunner().invoke(app, ["export", str(scene), "--out", str(out), *FEW])
    assert done.exit_code == 0 and "splats of degree 1" in done.output
    assert [path.name for path in tmp_path.iterdir()] == [out.name]
    splats = svv.fit_splats(svv.Scene.load(scene), svv.SplatOptions(count=600, steps=4, degree="1"))
    if suffix == ".glb":
        assert out.stat().st_size > len(splats) * 4 * (3 + 2 + 4 + 3 + 1 + 1 + 12)
        return
    back = svv.read_splats(out)
    side = float(np.ptp(splats.centres, axis=0).max())
    np.testing.assert_allclose(back.centres, splats.centres, atol=1e-5 * side)
    if suffix == ".ply":
        assert back.names == splats.names[: len(back.names)]
        np.testing.assert_array_equal(back.harmonics, splats.harmonics)


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("a.ply", ("--light", "baked"), "Splats have the options --splats"),
        ("a.spz", ("--phi", "3"), "Splats have the options --splats"),
        ("a.html", ("--splats", "1000"), "no options of splats"),
        ("a.cdb", ("--splats", "1000"), "no options of splats"),
        ("a.vti", ("--degree", "2"), "no options of splats"),
        ("a.usdz", (), r"splats NAME\.ply, NAME\.spz or NAME\.glb"),
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


def test_nothing_is_left_of_a_stopped_fit(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("svv.render.splats.files.write_ply", interrupted)
    done = CliRunner().invoke(app, ["export", str(scene), "--out", str(tmp_path / "a.ply"), *FEW])
    assert done.exit_code != 0
    assert list(tmp_path.iterdir()) == []
