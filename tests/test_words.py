"""Edits in words: what is understood, what is done, and what is refused with the words that are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import svv
from svv.cli import app as cli
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.job.words.colours import changed, colour_at, names
from svv.job.words.grammar import understood
from svv.job.words.say import _describe_clause, say
from tests.cube import lit_cube_scene


@pytest.fixture(scope="module")
def named(cube: Scene) -> Scene:
    """The cube with names."""
    return cube.edited(0, name="shell").edited(1, name="Ring").edited(2, name="vortex core")


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("make the shell pale jade, thinner, hide the ring",
         ["shell: colour pale jade", "shell: thinner", "Ring: hide"]),
        ("red ring and blue shell", ["Ring: colour red", "shell: colour blue"]),
        ("Shell RED and ring deep blue.", ["shell: colour red", "Ring: colour deep blue"]),
        ("hide the ring and the shell", ["Ring, shell: hide"]),
        ("hide the ring, the shell", ["Ring, shell: hide"]),
        ("show only the vortex core", ["vortex core: show, only"]),
        ("make everything but the ring transparent", ["shell, vortex core: transparent"]),
        ("region 0 and 2 in porcelain", ["shell, vortex core: MatCap porcelain"]),
        ("the shell in jade, the ring jade", ["shell: MatCap jade", "Ring: colour jade"]),
        ("shell; thinner", ["shell: thinner"]),
        ("vortex core very pale blue. Hide the rest", ["vortex core: colour very pale blue", "shell, Ring: hide"]),
        ("opacity of 0.4 for the ring", ["Ring: opacity of 0.4"]),
        ("the ring 40 % opaque and outlined", ["Ring: 40 % opaque", "Ring: outlined"]),
        ("the ring half as opaque then it #102030", ["Ring: half as opaque", "Ring: colour #102030"]),
        ("light from the upper left", ["light from the upper left"]),
        ("all without outlines", ["shell, Ring, vortex core: without outlines"]),
        ("the ring in oil", ["Ring: style oil"]),
        ("shell as cross-hatching", ["shell: style cross-hatching"]),
    ],
)  # fmt: skip
def test_sentences_are_understood(named: Scene, text: str, lines: list[str]) -> None:
    found = [_describe_clause(named, clause) for clause in understood(text, named.regions)]
    assert [one.split(" (")[0] for one in found] == lines


def test_a_sentence_is_one_edit(named: Scene) -> None:
    done = svv.say(named, "make the shell pale jade, thinner, hide the ring, the vortex core in bronze")
    shell, ring, core = done.scene.regions
    assert shell.opacity == 0.5 and shell.edited_colour == changed(names()["jade"], "pale")
    assert ring.hidden and core.matcap == "bronze"
    assert done.scene.undone().regions == named.regions
    assert len(done.scene.history.past) == len(named.history.past) + 1


@pytest.mark.parametrize(
    ("text", "field", "values"),
    [
        ("only the ring", "hidden", [True, False, True]),
        ("the ring opacity 40%", "opacity", [1.0, 0.4, 1.0]),
        ("the ring thinner. thinner", "opacity", [1.0, 0.25, 1.0]),
        ("all flat", "lighting", [0.0, 0.0, 0.0]),
        ("ring outlined", "outline", [0.0, 1.0, 0.0]),
        ("more transparent vortex core", "opacity", [1.0, 1.0, 0.5]),
    ],
)
def test_what_is_said_is_done(named: Scene, text: str, field: str, values: list[object]) -> None:
    assert [getattr(region, field) for region in say(named, text).scene.regions] == values


def test_light_moves_where_it_can(named: Scene) -> None:
    lit = lit_cube_scene()
    assert say(lit, "light from the right above").scene.lamp.azimuth == 60.0
    assert say(lit, "brighter light").scene.lamp.intensity == pytest.approx(1.3)
    with pytest.raises(BadInput, match="light of this scene cannot be moved"):
        say(named, "light from the left")


@pytest.mark.slow
@pytest.mark.usefixtures("broad_strokes")
def test_styles_are_painted_beside_what_is_painted(named: Scene) -> None:
    first = say(named, "the ring in oil", preset="draft").scene
    assert [r.style for r in first.regions] == [None, "oil", None]
    second = say(first, "shell as hatching, hide vortex core", preset="draft").scene
    assert [r.style for r in second.regions] == ["ink:hatching", "oil", None] and second.regions[2].hidden


def test_styles_are_refused_where_nothing_is_painted(named: Scene) -> None:
    with pytest.raises(BadInput, match="The style oil takes painting, which is not done here"):
        say(named, "hide the shell, the ring in oil", paints=False)
    assert say(named, "hide the shell", paints=False).scene.regions[0].hidden


def test_colours_of_css_and_xkcd_with_modifiers() -> None:
    assert colour_at(["rebeccapurple"], 0) == ((0x66 / 255, 0x33 / 255, 0x99 / 255), 1)
    assert colour_at(["dark", "pastel", "green", "ring"], 0) == ((0x56 / 255, 0xAE / 255, 0x57 / 255), 3)
    assert colour_at(["#ff8000"], 0) == ((1.0, 0x80 / 255, 0.0), 1) and colour_at(["ring"], 0) is None
    assert len(names()) > 1000
    grey = np.array(changed((0.2, 0.4, 0.7), "dull"))
    assert np.ptp(grey) < 0.3 < np.ptp(changed((0.2, 0.4, 0.7), "vivid"))
    assert sum(changed((0.2, 0.4, 0.7), "pale")) > 1.3 > 1.0 > sum(changed((0.2, 0.4, 0.7), "dark"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("make it red", "names no region: name shell, Ring, vortex core, or all"),
        ("red", "names no region"),
        ("frobnicate the ring", "'frobnicate' was not understood.*the regions shell, Ring.*pale.*thinner.*porcelain"),
        ("make the sheel red", "did you mean 'shell'"),
        ("the ring red blue", "two things at once \\(colour red"),
        ("the shell", "asks for nothing"),
        ("", "asks for nothing"),
        ("the shell opacity much", "needs a number"),
        ("hide region 7", "no region 7"),
        ("🦴 red", "'🦴' was not understood"),
        ("ring red; rm -rf /", "'rm' was not understood"),
        ("x" * 3000, "at most 2000 characters"),
        ("the ring opacity -1", "was not understood|needs a number"),
    ],
)
def test_what_is_not_understood_is_refused_with_the_words_known(named: Scene, text: str, words: str) -> None:
    with pytest.raises(BadInput, match=words) as raised:
        say(named, text)
    assert str(raised.value).endswith(".") and "\n" not in str(raised.value)


@pytest.mark.parametrize("name", ['the "inner" shell', "עצם", "🦴", "skin, outer and soft", "red", "v1.5", "a" * 100])
def test_any_name_can_be_spoken_of(cube: Scene, name: str) -> None:
    done = say(cube.edited(1, name=name), f"make {name} lime green, thinner; hide region 0")
    assert done.scene.regions[1].opacity == 0.5 and done.scene.regions[0].hidden
    assert done.scene.regions[1].edited_colour == names()["lime green"]


def test_a_scene_of_one_region_needs_no_name(cube: Scene) -> None:
    assert understood("pale blue", cube.regions[:1])[0].regions == (0,)
    with pytest.raises(BadInput, match="no regions"):
        say(replace(cube, regions=()), "red")


def test_a_painted_region_is_not_recoloured_in_silence(named: Scene) -> None:
    painted = replace(named, regions=(replace(named.regions[0], style="oil"), *named.regions[1:]))
    with pytest.raises(BadInput, match="Region 0 is styled"):
        say(painted, "shell red")


def test_a_colour_takes_a_matcap_off(named: Scene) -> None:
    done = say(say(named, "shell in jade").scene, "shell red").scene.regions[0]
    assert done.matcap is None and done.edited_colour == (1.0, 0.0, 0.0)


def test_the_command_prints_what_it_understood(
    named: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    named.save("a.svv")
    text = "make the shell pale jade, thinner, hide the ring"
    cli.app(["edit", "a.svv", "--say", text, "--out", "b.svv"], prog_name="svv", standalone_mode=False)
    said = capsys.readouterr().out.splitlines()
    assert said == ["shell: colour pale jade (#9ad5b6)", "shell: thinner", "Ring: hide", "b.svv"]
    assert Scene.load("b.svv").regions[1].hidden
