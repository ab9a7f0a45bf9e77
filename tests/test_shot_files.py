"""Files of shots: what the schema refuses, the reader refuses too, and each mistake is one sentence."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import svv
from svv.cli.app import app
from svv.core.json_values import LARGEST
from svv.errors import BadInput
from svv.io.described_json import to_plain
from svv.io.shot_file import shot_schema
from svv.options.shots import MOVES, eased
from tests.any_json import any_json

FULL: dict[str, Any] = {
    "duration": 9,
    "keys": [
        {"time": 0, "camera": {"view": [0, 10], "zoom": 1.5}, "strength": 0.2},
        {"time": 1, "camera": {"position": [1, 2, 3], "centre": [0, 0, 1], "up": [0, 0, 1], "fov": 30},
         "easing": "smooth"},
        {"time": 2.5, "regions": {"0": {"colour": "#ff8800", "opacity": 0},
                                  "bone": {"colour": [0, 0.5, 1], "hidden": True}}},
        {"time": 4, "cuts": ["x>50%", "sphere:0,0,0:1"], "light": {"azimuth": 20, "intensity": 2}, "step": 3},
    ],
    "moves": [
        {"move": "turntable", "turns": -2},
        {"move": "zoom", "region": "bone", "start": 1, "duration": 2, "back": True},
        {"move": "peel", "regions": [0, "bone"], "easing": "ease-in"},
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def validator() -> Any:
    """What checks files by the schema, which is right itself."""
    kind = pytest.importorskip("jsonschema").Draft202012Validator
    kind.check_schema(shot_schema())
    return kind(shot_schema())


def places(content: Any, way: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The ways to everything within a JSON value."""
    inner = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    return [way] * bool(way) + [found for k, v in inner for found in places(v, (*way, k))]


def put(content: Any, way: tuple[Any, ...], value: object) -> Any:
    """The value with another one at a place."""
    content = copy.deepcopy(content)
    inner = content
    for k in way[:-1]:
        inner = inner[k]
    inner[way[-1]] = value
    return content


@given(st.sampled_from(places(FULL)), any_json | st.sampled_from([-1, 0, 0.5, 7, "x", [1, 2, 3], {"time": 9}]))
def test_the_reader_takes_nothing_that_the_schema_refuses(validator: Any, way: tuple[Any, ...], value: object) -> None:
    """And what it takes is the same after it was written."""
    content = put(FULL, way, value)
    shot, refused = None, ""
    try:
        shot = svv.read_shot(content)
    except BadInput as error:
        refused = str(error)
    if shot is None:
        assert refused.endswith(".") and "\n" not in refused
        return
    assert validator.is_valid(content)
    assert svv.read_shot(json.loads(json.dumps(to_plain(shot)))) == shot


def test_the_schema_takes_what_the_reader_takes(validator: Any) -> None:
    assert validator.is_valid(FULL) and svv.read_shot(FULL).seconds == 9.0
    for wrong in ({"keys": [{"time": -1}]}, {"keys": [{"time": 1, "film": 1}]}, {"moves": [{"move": "fly"}]},
                  {"keys": [{"time": 1, "regions": {"0": {"matcap": "jade"}}}]}):  # fmt: skip
        assert not validator.is_valid(wrong)
    told = shot_schema()["$defs"]
    assert {kind.__name__ for kind in MOVES} < set(told)
    assert all(p.get("description", "x") for one in told.values() for p in one["properties"].values())


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({}, "needs keys or moves"),
        ({"keys": [{"time": 1}, {"time": 1}]}, "Two key frames are at 1 s: give each a time of its own"),
        ({"keys": [{"time": 2}, {"time": 1}]}, "The key frame at 1 s stands behind that at 2 s"),
        ({"keys": [{"time": float("nan")}]}, r"keys\[0\]\.time must be a finite number"),
        ({"keys": [{"time": 0}, {"time": 1, "colour": 1}]}, r"keys\[1\] has no colour; it may have time, camera"),
        ({"keys": [{"camera": {"view": [0, 0]}}]}, r"keys\[0\] needs time"),
        ({"keys": [{"time": 3}]}, None),
        ({"keys": [{"time": 0}]}, "needs a duration"),
        ({"moves": [{"move": "turntable"}]}, "needs a duration"),
        ({"duration": 2, "keys": [{"time": 3}]}, "lasts 2 s, but a key frame ends at 3 s"),
        ({"duration": 2, "moves": [{"move": "swing", "start": 2}]}, "begins when the shot ends"),
        ({"duration": 2, "moves": [{"move": "fly"}]}, "one of turntable, swing, zoom, peel, cut, paint"),
        ({"duration": 2, "moves": [{"move": "peel"}]}, "needs regions"),
        ({"keys": [{"time": 1, "regions": {"0": {"strength": 2}}}]}, r"regions\.0\.strength must be at most 1, not 2"),
        ({"keys": [{"time": 1, "regions": {"0": {"colour": "red"}}}]}, "a colour such as '#ff8800', not 'red'"),
        ({"keys": [{"time": 1, "camera": {"view": [0, 0], "position": [0, 0, 1]}}]}, "not view and position"),
        ({"keys": [{"time": 1, "camera": {}}]}, "one of view, position and camera_to_world"),
        ({"keys": [{"time": 1, "camera": {"view": [0, 100]}}]}, "from -90 to 90"),
        ({"keys": [{"time": 1, "camera": {"view": [0, 0], "up": [0, 1, 0]}}]}, "need its position"),
        ({"keys": [{"time": 1, "camera": {"view": [0, 0], "fov": 30, "span": 3}}]}, "not both"),
        ({"keys": [{"time": 1, "light": {"azimuth": 10, "direction": [1, 0, 0]}}]}, "not both"),
        ({"keys": [{"time": 1, "light": {"direction": [0, 0, 0]}}]}, "not 0, 0, 0"),
        ({"keys": [{"time": LARGEST}]}, "at most 86400"),
        ([], "must be an object"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_sentence(content: object, said: str | None, tmp_path: Path) -> None:
    path = tmp_path / "shot.json"
    path.write_text(json.dumps(content))
    if said is None:
        assert svv.read_shot(path).seconds == 3.0
        return
    with pytest.raises(BadInput, match=said) as raised:
        svv.read_shot(path)
    assert str(raised.value).startswith(f"{path}: ") and str(raised.value).count("\n") == 0


def test_files_that_are_no_shots(tmp_path: Path) -> None:
    path = tmp_path / "shot.json"
    for content, said in (
        (b"{", "not a JSON file"),
        (b"\xff\xfe\x00", "not text"),
        (b'{"duration": 1, "duration": 2, "moves": [{"move": "swing"}]}', "has duration twice"),
        (b'{"keys": [{"time": 1, "time": 2}]}', "has time twice"),
        (b'{"keys": [{"time": 1e999}]}', "finite"),
    ):
        path.write_bytes(content)
        with pytest.raises(BadInput, match=said):
            svv.read_shot(path)
    with pytest.raises(BadInput, match="Cannot read"):
        svv.read_shot(tmp_path / "none.json")
    path.write_text("﻿" + json.dumps(FULL), encoding="utf-8")
    assert svv.read_shot(path) == svv.read_shot(FULL)


def test_the_command_shows_what_a_shot_may_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> tuple[int, str]:
        done = CliRunner().invoke(app, ["shot", *words])
        bad = isinstance(done.exception, BadInput)  # which ends the command with one sentence and exit code 2
        return (2, str(done.exception)) if bad else (done.exit_code, done.output)

    assert json.loads(run("--schema")[1]) == json.loads(json.dumps(shot_schema()))
    for kind in MOVES:
        code, text = run("--move", kind.name)
        Path("begun.json").write_text(text)
        assert code == 0 and type(svv.read_shot("begun.json").moves[0]) is kind
        assert run("begun.json") == (0, f"begun.json: 6 s, 0 key frames, move {kind.name}\n")
    assert run()[0] == run("--schema", "begun.json")[0] == run("--schema", "--scene", "a.svv")[0] == 2
    Path("begun.json").write_text('{"keys": [{"time": 1}, {"time": 1}]}')
    code, text = run("begun.json")
    assert code == 2 and "at 1 s" in text


@given(st.sampled_from(["linear", "ease-in", "ease-out", "smooth"]), st.floats(0, 1), st.floats(0, 1))
def test_a_pace_goes_from_start_to_end_and_never_back(easing: str, one: float, other: float) -> None:
    assert (eased(easing, 0.0), eased(easing, 1.0)) == (0.0, 1.0)
    assert eased(easing, min(one, other)) <= eased(easing, max(one, other)) + 1e-12
    if easing == "ease-in":
        assert eased("ease-out", 1.0 - one) == pytest.approx(1.0 - eased(easing, one))
