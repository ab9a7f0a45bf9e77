"""Names of regions: given, kept, shown, and refused where nothing could show them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from svv.cli import app as cli
from svv.cli.options import parse_names
from svv.errors import BadInput
from svv.fields.scene.region import LONGEST_NAME, Region, label_of
from svv.fields.scene.scene import Scene
from svv.options.editing import RegionEdit, SceneEdit
from svv.render.web.page import _regions

HARD = ["bone", 'the "inner" shell', "l'os & <b>", "עצם", "عظم", "骨", "🦴", "a" * LONGEST_NAME, "100 % = all"]
"""Names in other scripts, with quotes and signs, and the longest."""


@pytest.mark.parametrize("name", HARD)
def test_a_name_is_kept_in_the_file_and_shown(cube: Scene, tmp_path: Path, name: str) -> None:
    file = tmp_path / "a.svv"
    cube.edited(1, name=f"  {name} ").save(file)
    scene = Scene.load(file)
    assert scene.regions[1].name == name == label_of(scene.regions, 1)
    assert json.loads(json.dumps(scene.info()["regions"]))[1]["name"] == name
    assert _regions(scene)[1]["name"] == name


def test_a_name_is_an_edit_that_can_be_undone_but_no_look_that_is_reset(cube: Scene) -> None:
    named = cube.edited(0, name="bone").edited(0, opacity=0.5)
    assert named.reset().regions[0] == cube.edited(0, name="bone").regions[0]
    assert named.undone().undone().regions == cube.regions
    assert named.edited(0, name="").regions[0].name is None


def test_a_part_has_a_name_of_its_own(cube: Scene) -> None:
    regions = cube.edited(0, name="bone").with_part(0, 0.5).regions
    assert label_of(regions, len(regions) - 1) == f"Region {len(regions) - 1}, part of bone"
    assert label_of([Region((1.0, 0.0, 0.0), 1.0)], 0) == "Region 0"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a" * 300, "at most 100 characters, not 300: shorten it"),
        ("two\nlines", "without the control character U\\+000A"),
        ("bell\x07", "without the control character U\\+0007"),
        ("turned \u202e name", "without the control character U\\+202E"),
        ("\u200b", "has no character that can be seen"),
        ("half \ud83e", "without the control character U\\+D83E"),
    ],
)
def test_a_name_that_nothing_can_show_is_refused(cube: Scene, name: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        cube.edited(0, name=name)


def test_the_command_names_regions_beside_other_edits(
    cube: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    cube.save("cube.svv")

    def run(*arguments: str) -> None:
        cli.app(list(arguments), prog_name="svv", standalone_mode=False)

    run(
        "edit",
        "cube.svv",
        "--name",
        "0=soft tissue",
        "--name",
        "2=a=b",
        "--region",
        "2",
        "--opacity",
        "0.5",
        "-o",
        "a.svv",
    )
    scene = Scene.load("a.svv")
    assert [r.name for r in scene.regions] == ["soft tissue", None, "a=b"] and scene.regions[2].opacity == 0.5
    assert len(scene.history.past) == 1
    run("info", "a.svv")
    assert "name soft tissue" in capsys.readouterr().out
    run("edit", "a.svv", "--name", "0=", "--out", "b.svv")
    assert Scene.load("b.svv").regions[0].name is None
    with pytest.raises(BadInput, match="no region 7"):
        run("edit", "a.svv", "--name", "7=bone", "--out", "c.svv")


@pytest.mark.parametrize("texts", [["bone"], ["x=bone"], ["-1=bone"], ["0=a", "0=b"]])
def test_what_names_no_region_is_one_sentence(texts: list[str]) -> None:
    with pytest.raises(BadInput, match=f"'{texts[-1]}'"):
        parse_names(texts)


def test_a_panel_that_names_nothing_changes_nothing() -> None:
    assert not SceneEdit({0: RegionEdit()}) and SceneEdit({0: RegionEdit(name="bone")})
