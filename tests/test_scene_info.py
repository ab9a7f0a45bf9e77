"""What a scene file says of its scene, without the libraries that the scene needs."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from svv.cli.app import app
from svv.errors import BadInput
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import to_json
from svv.io.scene_file import read_scene_file, read_scene_info, write_scene_file
from tests.cube import cube_scene, hash_cube_scene, lit_cube_scene


def both() -> Scene:
    return joined([cube_scene(0), cube_scene(1)]).hidden(2)


def edited() -> Scene:
    return cube_scene().edited(0, colour=(0.1, 0.2, 0.3), name="bone").cut("x>50%").with_section("flat").undone()


@pytest.mark.parametrize("make", [cube_scene, hash_cube_scene, lit_cube_scene, both, edited])
def test_the_file_says_what_the_scene_says(make: Callable[[], Scene], tmp_path: Path) -> None:
    make().save(tmp_path / "a.svv")
    loaded = Scene.load(tmp_path / "a.svv")
    assert read_scene_info(tmp_path / "a.svv") == json.loads(to_json(loaded.info()))
    loaded.save(tmp_path / "b.svv")
    assert (tmp_path / "a.svv").read_bytes() == (tmp_path / "b.svv").read_bytes()


RED = {"regions": [{"colour": "red"}]}


@pytest.mark.parametrize("told", [None, 5, {}, {"svv": "0.0.1", "info": {"regions": []}}, {"svv": None, "info": RED}])
def test_what_another_version_says_is_not_believed(told: Any, tmp_path: Path) -> None:
    path = tmp_path / "a.svv"
    cube_scene().save(path)
    header, arrays = read_scene_file(path)
    write_scene_file(path, {**header, "told": told}, arrays)
    assert read_scene_info(path) is None
    shown = CliRunner().invoke(app, ["info", str(path)])
    assert shown.exit_code == 0 and "networks" in shown.output


def test_a_truncated_file_is_refused_although_its_header_is_there(tmp_path: Path) -> None:
    path = tmp_path / "a.svv"
    cube_scene().save(path)
    path.write_bytes(path.read_bytes()[:-1])
    assert read_scene_info(path) is None
    with pytest.raises(BadInput, match="truncated or damaged"):
        Scene.load(path)
    shown = CliRunner().invoke(app, ["info", str(path)])
    assert isinstance(shown.exception, BadInput) or shown.exit_code == 2


def test_no_heavy_library_is_loaded(tmp_path: Path) -> None:
    cube_scene().save(tmp_path / "a.svv")
    program = (
        "import sys; from svv.cli.app import main; sys.argv = ['svv', 'info', 'a.svv']\n"
        "try: main()\nexcept SystemExit as end: assert not end.code\n"
        "heavy = {'torch', 'numba', 'scipy', 'vtkmodules'} & set(sys.modules); assert not heavy, heavy"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "networks" in done.stdout
