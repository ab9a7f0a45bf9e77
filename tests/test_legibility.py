"""``svv bench legibility``, ``volumes`` and ``tasks``: what lowers the figure, true answers, Latin squares, scores."""

from __future__ import annotations

import json
import struct
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import label

from svv.cli import app as cli
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import to_array
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput
from svv.fields.scene.scene import Rendering, Scene
from svv_bench.legibility import tasks
from svv_bench.legibility.figure import Legibility, Yardstick, enclosures
from svv_bench.legibility.scenes import KINDS, TaskScene, task_scene, write_scene
from svv_bench.legibility.tasks import (
    agreement,
    assignment,
    check_volume,
    corrected,
    read_answers,
    report,
    score,
    write_sheets,
)
from tests.nightly import nightly

NAMES = ("nuts-0", "tissue-0", "shells-0")
WAYS = ("rendered", "alike", "lost")

# --- the figure --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def yardstick(balls: Scene) -> Yardstick:
    return Yardstick(balls, balls.rig.orbit(181, 120, frames=(60, 120)))


def test_the_volume_rendering_is_as_legible_as_itself(balls: Scene, yardstick: Yardstick) -> None:
    found = yardstick.measure_scene(balls, "pcn")
    assert (found.apart, found.contrast, found.order, found.legibility) == (1, 1, 1, 1)
    # Edits are part of a picture, not of the volume rendering with which it is compared.
    assert Yardstick(balls.hidden(0), yardstick.cameras).measure_scene(balls).legibility == 1


def test_regions_of_one_colour_or_hidden_are_not_legible(balls: Scene, yardstick: Yardstick) -> None:
    colour = balls.regions[0].colour
    nearer = balls.edited(1, colour=(0.7, 0.45, 0.3))
    alike = balls.edited(1, colour=colour)
    figures = [yardstick.measure_scene(scene, "pcn") for scene in (balls, nearer, alike)]
    assert figures[0].legibility == 1 > figures[1].legibility > figures[2].legibility
    assert figures[2].apart < 0.3 and figures[2].smallest["normal"] < 7
    aside = Yardstick(balls, balls.rig.orbit(181, 120, frames=(10, 170)))  # where neither stands before the other
    hidden = aside.measure_scene(balls.hidden(1), "pcn")
    assert hidden.contrast == pytest.approx(0.5, abs=0.05)  # of two regions, one has nothing to stand out with
    assert hidden.apart < 0.05 and hidden.legibility < 0.2


def with_colours(pictures: list[Rendering], colours: np.ndarray) -> list[Rendering]:
    return [replace(p, rgba=np.dstack([colours, np.ones_like(p.depth)]).astype(np.float32)) for p in pictures]


def test_strokes_alone_are_not_contrast(yardstick: Yardstick) -> None:
    """A picture of strong blotches that follow no region stands out nowhere, although each edge crosses some."""
    random = np.random.default_rng(0)
    blotches = np.kron(random.random((24, 24, 3)) < 0.5, np.ones((5, 5, 1)))
    found = yardstick.measure(with_colours(yardstick.pictures, blotches))
    assert found.contrast < 0.15 and found.apart < 0.5
    flat = yardstick.measure(with_colours(yardstick.pictures, np.full((120, 120, 3), 0.5)))
    assert flat.apart == flat.contrast == flat.legibility == 0


def disc(radius: float) -> np.ndarray:
    return np.hypot(*(np.mgrid[:64, :64] - 31.5))[None] < radius


def test_what_lies_within_another_silhouette_is_enclosed() -> None:
    aside = np.roll(disc(8), 26, axis=2)
    assert enclosures([disc(30), disc(12), aside]) == [(0, 1)]
    assert enclosures([disc(12), disc(12)]) == []  # equal silhouettes say nothing
    assert enclosures([disc(30), disc(0)]) == []


def test_reversed_lightness_is_half_an_order(balls: Scene, yardstick: Yardstick) -> None:
    nested = Yardstick(balls, yardstick.cameras)
    nested.enclosing = [(0, 1)]
    assert nested.measure_scene(balls, "pcn").order == 1
    swapped = balls.edited(0, colour=balls.regions[1].colour).edited(1, colour=balls.regions[0].colour)
    assert nested.measure_scene(swapped, "pcn").order == 0.5


def test_parts_are_combined_by_their_geometric_mean() -> None:
    assert Legibility(0.5, 0.4, 0.625, {}).legibility == pytest.approx(0.5)
    assert Legibility(0.0, 1.0, 1.0, {}).legibility == 0


def test_what_has_no_two_regions_cannot_be_measured(balls: Scene, cube: Scene, yardstick: Yardstick) -> None:
    with pytest.raises(BadInput, match="between regions"):
        Yardstick(replace(balls, palette_network=None, regions=()))
    with pytest.raises(BadInput, match="different numbers of regions"):
        yardstick.measure_scene(cube)


# --- scenes ------------------------------------------------------------------------------------------------------


def bodies(values: np.ndarray, low: float, high: float) -> int:
    return int(label((values > low) & (values < high), np.ones((3, 3, 3)))[1])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", nightly(range(3), 0))
def test_answers_are_those_of_the_volume(kind: str, seed: int) -> None:
    """Counted in the voxels, without knowing how they were made."""
    scene = KINDS[kind](np.random.default_rng(seed))
    values = to_array(scene.known.volume(80))
    ranges = scene.known.ranges
    questions = {question.what: question for question in scene.questions}
    for question in scene.questions:
        assert question.answer in question.choices
    assert int(questions["parts"].answer) == len(ranges)
    assert all(((values > r.low) & (values < r.high)).any() for r in ranges)
    opaque = [r for r in ranges if r.opacity > 0.5]
    if "count" in questions:
        counted = opaque if kind == "tangle" else opaque[-1:]
        assert int(questions["count"].answer) == sum(bodies(values, r.low, r.high) for r in counted)
    if "layers" in questions:
        assert int(questions["layers"].answer) == len(ranges) - len(opaque)
    if "end" in questions:
        ends_where_it_should(scene, values, questions["end"].answer, questions["end"].choices)
    if "joined" in questions:
        joined_as_it_should(scene, values)
    if "depth" in questions:
        nested_as_it_should(scene)
    if "inside" in questions:
        within = label(values > ranges[2].low)[0]  # the inner skin and what is in it, and the other balls
        at = {name: within[voxel(scene, name)] for name in "123"}
        sizes = {name: int((within == at[name]).sum()) for name in "123"}
        assert max(sizes, key=lambda name: sizes[name]) == questions["inside"].answer


def voxel(scene: TaskScene, name: str) -> tuple[int, int, int]:
    x, y, z = (round((value + 1) / 2 * 79) for value in scene.marks[name].at)
    return z, y, x


def ends_where_it_should(scene: TaskScene, values: np.ndarray, right: str, choices: tuple[str, ...]) -> None:
    part = scene.known.ranges[scene.marks["S"].part]
    tubes = label((values > part.low) & (values < part.high), np.ones((3, 3, 3)))[0]

    def near(name: str) -> set[int]:
        z, y, x = voxel(scene, name)
        return set(np.unique(tubes[z - 1 : z + 2, y - 1 : y + 2, x - 1 : x + 2])) - {0}

    assert len(near("S")) == 1
    assert [name for name in choices if near(name) == near("S")] == [right]


def joined_as_it_should(scene: TaskScene, values: np.ndarray) -> None:
    """Numbers and letters are in one piece of opaque voxels as is said, and the thickest piece has most of them."""
    part = scene.known.ranges[0]
    tubes = label((values > part.low) & (values < part.high), np.ones((3, 3, 3)))[0]
    piece = {name: int(tubes[voxel(scene, name)]) for name in scene.marks}
    assert 0 not in piece.values() and len({piece[number] for number in "1234"}) == 4
    asked = [question for question in scene.questions if question.what == "joined"]
    assert len(asked) == 3
    for question in asked:
        (letter,) = [name for name in "ABCD" if f"ring {name}:" in question.text]
        assert piece[letter] == piece[question.answer]
    (widest,) = [question.answer for question in scene.questions if question.what == "widest"]
    size = {number: (tubes == piece[number]).sum() for number in "1234"}
    assert max(size, key=lambda number: size[number]) == widest


def nested_as_it_should(scene: TaskScene) -> None:
    """On a straight way out from a ball, values pass the middle of every skin that is around it, and of no other."""
    asked = [question for question in scene.questions if question.what == "depth"]
    assert len(asked) == 3
    for question in asked:
        (name,) = [name for name in "123" if f"ring {name} " in question.text]
        ball = np.array(scene.marks[name].at)
        way = ball / np.linalg.norm(ball)
        line = ball + np.linspace(0.12, 1.0, 300)[:, None] * way
        values = scene.known.field(line[np.abs(line).max(axis=1) <= 1].T)
        skins = scene.known.ranges[:-1]
        crossed = sum(int(values[0] > (skin.low + skin.high) / 2 > values[-1]) for skin in skins)
        assert str(crossed) == question.answer


@pytest.mark.parametrize("name", nightly(["wrapped-0", "vessels-0"], "wrapped-0"))
def test_a_second_view_is_the_scene_turned_and_shows_every_mark(name: str) -> None:
    scene, camera = task_scene(name)
    views = scene.views(camera)
    assert len(views) == 2 and views[0] is camera and scene.turn is not None
    towards = [view.position / np.linalg.norm(view.position) for view in views]
    assert np.degrees(np.arccos(towards[0] @ towards[1])) == pytest.approx(scene.turn)
    np.testing.assert_allclose(views[0].camera_to_world[:3, 1], views[1].camera_to_world[:3, 1], atol=1e-12)
    for view, seen in zip(views, scene.known.class_maps(scene.known.volume(64), views), strict=True):
        for mark in scene.marks.values():
            column, row, _ = (int(value) for value in view.project(mark.at))
            assert seen[row, column] == mark.part
    for other in NAMES:
        assert len(task_scene(other)[0].views(task_scene(other)[1])) == 1


@pytest.mark.parametrize("name", [*NAMES, "wrapped-0", "vessels-0"])
def test_the_camera_shows_every_mark_and_every_body(name: str) -> None:
    scene, camera = task_scene(name)
    camera = camera.resized(160, 160)
    (seen,) = scene.known.class_maps(scene.known.volume(64), [camera])
    for mark in scene.marks.values():
        column, row, _ = (int(value) for value in camera.project(mark.at))
        assert mark.part in seen[row - 2 : row + 3, column - 2 : column + 3]
    if scene.bodies is not None:
        part, count = scene.bodies
        assert (np.bincount(label(seen == part)[0].ravel())[1:] >= 9).sum() == count


def test_a_name_always_gives_the_same_scene(tmp_path: Path) -> None:
    volume, function = write_scene("nuts-0", tmp_path, 24)
    scene, _ = task_scene("nuts-0")
    np.testing.assert_array_equal(to_array(read_volume(volume)), to_array(scene.known.volume(24)))
    task_scene.cache_clear()
    again, _ = task_scene("nuts-0")
    assert again.questions == scene.questions and again.marks == scene.marks
    assert len(TransferFunction.read(function).opacities) == 4 * len(scene.known.ranges)
    for wrong in ("nuts", "nuts-", "nuts--1", "onions-0", "nuts-1e3", "nuts-\u0663"):
        with pytest.raises(BadInput, match="no generated scene"):
            task_scene(wrong)


# --- sheets ------------------------------------------------------------------------------------------------------


@given(st.integers(1, 20), st.integers(2, 5))
def test_of_as_many_judges_as_ways_each_sees_a_scene_in_another(scenes: int, ways: int) -> None:
    square = np.array([assignment(scenes, ways, judge) for judge in range(ways)])  # (judge, scene)
    assert (np.sort(square, axis=0) == np.arange(ways)[:, None]).all()
    for row in square:  # and each way about as often
        counts = Counter(row.tolist())
        assert max(counts.values()) - min(counts[way] for way in range(ways)) <= 1


@pytest.fixture(scope="module")
def folders(balls: Scene, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Scenes by these names; what is in them does not matter here."""
    root = tmp_path_factory.mktemp("ways")
    scenes = (balls, balls.edited(1, colour=balls.regions[0].colour), balls.hidden(1))
    for way, scene in zip(WAYS, scenes, strict=True):
        (root / way).mkdir()
        for name in NAMES:
            scene.save(root / way / f"{name}.svv")
    return [root / way for way in WAYS]


@pytest.fixture(scope="module")
def any_volume() -> Iterator[None]:
    """Scenes of any volume are taken for those of the name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tasks, "LEAST_OVERLAP", 0.0)
        yield


def test_a_scene_of_another_volume_than_its_name_is_refused(yardstick: Yardstick) -> None:
    nut, camera = task_scene("nuts-0")
    seen = np.maximum(nut.known.class_maps(nut.known.volume(48), [camera]), -1)  # regions have no doubt
    shown = SimpleNamespace(cameras=[camera], pictures=[SimpleNamespace(region=seen[0])])
    check_volume("nuts-0", cast("Yardstick", shown))  # as a scene that was learned well shows it
    shown.pictures = [SimpleNamespace(region=np.roll(seen[0], 12, axis=0))]
    for other in (yardstick, cast("Yardstick", shown)):
        with pytest.raises(BadInput, match="shows another volume than nuts-0: train it on"):
            check_volume("nuts-0", other)


@pytest.fixture(scope="module")
def trial(folders: list[Path], any_volume: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("trial")
    assert write_sheets(folders, root / "sheets", root / "key.json", size=200) == (3, 3)
    return root


def test_sheets_tell_nothing_but_pixels(trial: Path) -> None:
    key = json.loads((trial / "key.json").read_text())
    assert sorted(p.name for p in (trial / "sheets").iterdir()) == ["judge-1", "judge-2", "judge-3"]
    seen = set()
    for judge, folder in enumerate(sorted((trial / "sheets").iterdir())):
        names = sorted(path.name for path in folder.iterdir())
        assert names == ["001.png", "002.png", "003.png", "README.txt", "answers.json"]
        told = (folder / "README.txt").read_text() + (folder / "answers.json").read_text()
        assert not any(word in told for word in (*WAYS, *KINDS))
        for path in folder.glob("*.png"):
            assert chunks(path) == {b"IHDR", b"IDAT", b"IEND"}
        seen |= {(s["scene"], s["way"]) for s in key["judges"][judge]}
        assert len({s["scene"] for s in key["judges"][judge]}) == 3
    assert len(seen) == 9
    for scene in key["scenes"]:
        figures = [scene["figures"][way]["legibility"] for way in WAYS]
        assert figures[0] == 1 > max(figures[1:])


def chunks(path: Path) -> set[bytes]:
    data, at, found = path.read_bytes(), 8, set()
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        found.add(data[at + 4 : at + 8])
        at += length + 12
    return found


def answered(trial: Path, judge: int, wrong_ways: tuple[int, ...] = ()) -> Path:
    """As a judge would who answers everything right, but nothing in some ways."""
    key = json.loads((trial / "key.json").read_text())
    answers: dict[str, dict[str, str]] = {}
    for number, shown in enumerate(key["judges"][judge]):
        questions = key["scenes"][shown["scene"]]["questions"]
        wrong = shown["way"] in wrong_ways
        answers[f"{number + 1:03d}"] = {
            str(n + 1): next(c for c in q["choices"] if (c == q["answer"]) != wrong) for n, q in enumerate(questions)
        }
    path = trial / "sheets" / f"judge-{judge + 1}" / "answers.json"
    path.write_text(json.dumps(answers))
    return path


def test_answers_are_counted_for_each_way_and_the_figure_is_compared(trial: Path) -> None:
    found = score([answered(trial, judge, (1, 2)) for judge in range(3)], trial / "key.json")
    asked = sum(len(task_scene(name)[0].questions) for name in NAMES)
    assert [found["ways"][way]["right"] for way in WAYS] == [asked, 0, 0]
    assert all(r["of"] == asked for r in found["ways"].values())
    assert 0.2 < found["ways"]["rendered"]["guessed"] < 0.3
    assert found["ways"]["rendered"]["corrected"] == 1 and -0.6 < found["ways"]["lost"]["corrected"] < -0.2
    assert found["ways"]["rendered"]["legibility"] == 1
    assert sum(found["questions"][what]["rendered"]["of"] for what in found["questions"]) == asked
    assert found["figures"]["legibility"] | {"low": 0, "high": 0} == {
        "agreed": 6, "of": 6, "share": 1, "low": 0, "high": 0,
    }  # fmt: skip
    other = score([answered(trial, judge, (0,)) for judge in range(3)], trial / "key.json")
    assert other["figures"]["legibility"]["agreed"] == 0 and other["figures"]["legibility"]["of"] == 6
    text = report(found)
    assert f"| rendered | {asked} of {asked} | 100 % |" in text and "| legibility | 6 of 6 | 100 % |" in text


def test_a_judge_alone_is_counted_but_compares_nothing(trial: Path) -> None:
    found = score([answered(trial, 1)], trial / "key.json")
    assert sum(r["right"] for r in found["ways"].values()) == sum(r["of"] for r in found["ways"].values()) > 0
    assert found["figures"]["legibility"]["of"] == 0 and "| legibility | 0 of 0 | - | 0 % to 100 % |" in report(found)


def test_agreement_pools_answers_and_leaves_ties_out() -> None:
    def rows(case: int, way: str, *right: bool) -> list[dict[str, Any]]:
        return [{"case": case, "way": way, "right": one} for one in right]

    given = [*rows(0, "a", True, True), *rows(0, "b", True, False), *rows(0, "c", False, True), *rows(1, "a", False)]
    figures = {(0, "a"): 1.0, (0, "b"): 0.3, (0, "c"): 1.0, (1, "a"): 0.2}
    parts = {pair: dict.fromkeys(("legibility", "apart", "contrast", "order"), f) for pair, f in figures.items()}
    found = agreement(given, parts)["legibility"]
    assert (found["agreed"], found["of"]) == (1, 1)  # a and b; b and c have as many right, a and c the same figure


def test_answers_that_are_missing_or_unknown_are_refused(trial: Path, tmp_path: Path) -> None:
    path = answered(trial, 0)
    right = json.loads(path.read_text())
    first = {**right["001"], "1": None}
    for wrong, said in (
        ({**right, "001": None}, "sheet 001 an object"),
        ({**right, "001": first}, "Question 1 of sheet 001 needs one of 1, 2, 3, 4, 5, 6 or"),
        ({**right, "001": {**first, "1": "seven"}}, "not 'seven'"),
        ({**right, "001": {**first, "9": "1"}}, "sheet 001 an object"),
        ({**right, "007": {}}, "names a sheet '007' that does not exist"),
        ([], "JSON object"),
    ):
        path.write_text(json.dumps(wrong))
        with pytest.raises(BadInput, match=said):
            score([path], trial / "key.json")
    path = answered(trial, 0)
    with pytest.raises(BadInput, match="given twice"):
        score([path, path], trial / "key.json")
    (tmp_path / "answers.json").write_text(path.read_text())
    with pytest.raises(BadInput, match="from no judge"):
        score([tmp_path / "answers.json"], trial / "key.json")
    (tmp_path / "key.json").write_text("{}")
    with pytest.raises(BadInput, match="not a key"):
        score([path], tmp_path / "key.json")


@given(st.lists(st.integers(2, 8), min_size=1, max_size=5))
def test_guesses_are_corrected_to_nothing_and_right_answers_to_one(choices: list[int]) -> None:
    """The mean over all ways to answer is what guesses have: 0, however many choices there are."""

    def row(count: int, answer: str) -> dict[str, Any]:
        return {"answer": answer, "right": answer == "1", "guess": 1 / count}

    assert corrected([row(count, "1") for count in choices]) == 1
    assert corrected([row(count, "?") for count in choices]) == 0
    every = [corrected([row(count, str(k + 1))]) for count in choices for k in range(count)]
    means = [np.mean([corrected([row(count, str(k + 1))]) for k in range(count)]) for count in choices]
    assert np.allclose(means, 0) and min(every) >= -1
    assert np.isnan(corrected([]))


def test_views_lie_side_by_side_above_the_questions() -> None:
    scene, camera = task_scene("wrapped-0")
    views = [view.resized(200, 200) for view in scene.views(camera)]
    shots = [np.full((200, 200, 3), level, np.uint8) for level in (60, 120)]
    sheet = tasks._sheet(shots, scene, views)
    assert sheet.shape[1] == 400 and sheet.shape[0] > 200
    for number, view in enumerate(views):
        own = sheet[:200, 200 * number : 200 * (number + 1)]
        assert np.median(own) == shots[number][0, 0, 0]
        for mark in scene.marks.values():  # a ring of black on white
            column, row, _ = (int(value) for value in view.project(mark.at))
            ring = own[row - 6 : row + 7, column - 6 : column + 7]
            assert ring.min() < 30 and ring.max() > 240


def test_letters_may_be_small_and_numbers_plain(tmp_path: Path) -> None:
    asked = [[{"choices": ["A", "B"]}, {"choices": ["1", "2"]}, {"choices": ["1", "2"]}]]
    (tmp_path / "answers.json").write_text(json.dumps({"001": {"1": " b", "2": 2, "3": "?"}}))
    assert read_answers(tmp_path / "answers.json", asked) == [["B", "2", "?"]]


# --- the commands ------------------------------------------------------------------------------------------------


def test_the_commands_go_from_scenes_to_scores(
    folders: list[Path],
    any_volume: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def call(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["svv", "bench", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return int(ended.value.code or 0), *capsys.readouterr()

    out = tmp_path / "sheets"
    for arguments, said in (
        ((*folders,), "Give --out"),
        ((folders[0], "--out", out), "at least two folders"),
        ((folders[0], tmp_path, "--out", out), "not in every folder"),
        ((folders[0], tmp_path / "none", "--out", out), "no folder of scenes"),
        ((*folders, "--answers", out / "answers.json"), "not both"),
        ((*folders, "--out", out, "--json", tmp_path / "x.json"), "no scores before"),
    ):
        code, _, told = call("tasks", *arguments)
        assert code == 2 and said in told.splitlines()[-1] and "Traceback" not in told
    code, told, _ = call("tasks", *folders, "--judges", "4", "--size", "200", "--out", out)
    assert code == 0 and "3 sheets for each of 4 judges" in told
    assert call("tasks", *folders, "--out", out)[0] == 2  # nothing is overwritten
    code, _, told = call("tasks", "--answers", out / "judge-1" / "answers.json")
    assert code == 2 and "Question 1 of sheet 001 needs one of" in told
    key = json.loads((tmp_path / "sheets-key.json").read_text())
    assert [s["way"] for s in sorted(key["judges"][0], key=lambda s: s["scene"])] == [
        s["way"] for s in sorted(key["judges"][3], key=lambda s: s["scene"])
    ]

    code, told, _ = call("legibility", folders[0] / "nuts-0.svv", "--size", "64", "--json", tmp_path / "figures.json")
    assert code == 0 and "nuts-0 | volume rendering | 1.00 | 1.00 | 1.00 | 1.00 |" in told
    assert json.loads((tmp_path / "figures.json").read_text())["paintings"][0]["legibility"] == 1
    code, _, told = call("volumes", "onions-0", "--out", tmp_path)
    assert code == 2 and "no generated scene" in told
