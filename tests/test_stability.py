"""``svv bench stability``: the measures on constructed cases, the scenes' ground truth, resuming, and the results."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from svv.cli import app as cli
from svv.core.colour.colour import colour_differences
from svv.core.geometry.cameras import orbit_cameras
from svv.dvr.read.grids import index_to_world, to_array
from svv.errors import BadInput, Cancelled
from svv.train.run.config import Preset, preset
from svv_bench.stability.cases import CASES, EASIEST, Bench, BenchSettings, Case, Measures
from svv_bench.stability.measures import (
    FOREGROUND_DROP,
    failures,
    matched,
    overlaps,
    palette_error,
)
from svv_bench.stability.pictures import barely_masked, tiny
from svv_bench.stability.runs import Matrix, run_stability
from svv_bench.stability.scenes import NESTED, SCENES, TRANSPARENT, Range
from svv_bench.stability.table import FILES, summary, write_summary

# --- measures ----------------------------------------------------------------------------------------------------


def test_a_palette_is_compared_in_the_best_assignment() -> None:
    truth = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert palette_error(truth[[2, 0, 1]], truth) == pytest.approx(0.0, abs=1e-6)
    # one to one: two true colours may not both take the same one as long as another is left
    near = np.array([[0.9, 0.0, 0.0], [0.0, 0.0, 0.0]])
    pair = np.array([[0.9, 0.0, 0.0], [0.95, 0.0, 0.0]])
    assert palette_error(near, pair) > palette_error(near[:1], pair)


def test_a_missing_palette_colour_costs_the_way_to_the_nearest() -> None:
    truth = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    lost = colour_differences(truth[1:], truth[:1])[0, 0]
    assert palette_error(truth[:1], truth) == pytest.approx(lost / 2)
    more = np.concatenate([truth, [[0.5, 0.5, 0.5]]])
    assert palette_error(more, truth) == pytest.approx(0.0, abs=1e-6)


@given(st.permutations(range(3)))
def test_overlap_does_not_know_the_regions_numbers(order: list[int]) -> None:
    truth = np.array([[-1, 0, 0, 1], [1, 2, 2, 2]])
    shown = np.where(truth < 0, -1, np.array(order)[truth])
    assert matched(overlaps(truth, shown, 3, 3)) == [1.0, 1.0, 1.0]


def test_overlap_of_a_constructed_case() -> None:
    truth = np.array([0, 0, 0, 0, 1, 1, -1, -2])
    shown = np.array([1, 1, 1, 0, 0, 0, 0, 1])  # the last pixel is unknown and does not count
    table = overlaps(truth, shown, 2, 2)
    np.testing.assert_allclose(table, [[1 / 7, 3 / 4], [2 / 4, 0.0]])
    assert matched(table) == pytest.approx([0.75, 0.5])


def test_a_class_without_a_region_overlaps_with_nothing() -> None:
    truth, shown = np.array([0, 0, 1, 1]), np.array([0, 0, 0, 0])
    assert matched(overlaps(truth, shown, 2, 1)) == [0.5, 0.0]


def test_failures_have_names() -> None:
    fine = {"psnr_foreground": 30.0, "finite": True, "overlap": 0.9, "colour_error": 3.0, "regions": 2, "ranges": 2}
    assert failures(fine, 32.0) == []
    assert failures({**fine, "psnr_foreground": 32.0 - FOREGROUND_DROP - 0.1}, 32.0) == ["blurred"]
    limited = {**fine, "psnr_foreground": 26.0, "dvr_foreground": 28.0}  # jagged edges allow no more than 28
    assert failures(limited, 32.0) == []
    assert failures({**limited, "psnr_foreground": 28.0 - FOREGROUND_DROP - 0.1}, 32.0) == ["blurred"]
    assert failures({**fine, "regions": 1, "overlap": 0.4}, 32.0) == ["1 regions for 2", "wrong regions"]
    assert failures({**fine, "colour_error": 25.0}, None) == ["wrong colours"]
    assert failures({**fine, "finite": False}, 32.0) == ["not finite"]
    assert failures({"crash": "ValueError: x"}, 32.0) == ["crash"]
    assert failures({"refused": False}, 32.0) == ["not refused"]
    assert failures({"refused": True}, 32.0) == []
    assert failures({"style_error": 40.0, "finite": True, "in_gamut": False}, 32.0) == ["off its style", "out of gamut"]


# --- scenes ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_shows_every_class(name: str) -> None:
    known = SCENES[name]
    volume = known.volume(32)
    values = to_array(volume)
    found = known.classes(values)
    counts = [int((found == k).sum()) for k in range(len(known.ranges))]
    assert min(counts) > 20
    empty = float((found == -1).mean())
    # Bodies lie in empty space; layers fill theirs, but not to the faces.
    assert 0.2 < empty < 0.5 if name.startswith("regions") else empty > 0.5
    opacity = known.transfer_function().opacity_at(values.ravel()[::97])
    np.testing.assert_array_equal(opacity > 0, found.ravel()[::97] >= 0)
    colours = known.transfer_function().colour_at(values.ravel()[::97])
    for k, r in enumerate(known.ranges):
        seen = found.ravel()[::97] == k
        np.testing.assert_allclose(colours[seen], np.broadcast_to(r.colour, colours[seen].shape), atol=1e-6)


def test_spacing_stretch_and_shift_leave_the_shape_as_it_is() -> None:
    easy, thick = SCENES["easy"].volume(31), SCENES["anisotropic"].volume(31)
    assert thick.GetDimensions() == (31, 31, 11)
    np.testing.assert_allclose(thick.GetBounds(), easy.GetBounds())
    np.testing.assert_allclose(to_array(thick), to_array(easy)[::3], atol=1e-6)
    for name, spacing in (("tiny-spacing", 1e-9), ("huge-spacing", 1e6)):
        volume = SCENES[name].volume(31)
        np.testing.assert_allclose(volume.GetSpacing(), spacing)
        np.testing.assert_array_equal(to_array(volume), to_array(easy))
    centre = index_to_world(SCENES["off-centre"].volume(31)) @ [15.0, 15.0, 15.0, 1.0]
    np.testing.assert_allclose(centre[:3], [2000.0, -1000.0, 400.0])


def test_class_maps_agree_with_the_volume() -> None:
    """Nested shells from outside: the middle of the picture is the core's, around it the shells', then nothing."""
    volume = NESTED.volume(40)
    front = orbit_cameras(3, (0.0, 0.0, 0.0), 8.0, np.pi / 8, 64)[1]
    solid = replace(NESTED, ranges=tuple(replace(r, opacity=0.9) for r in NESTED.ranges))
    assert set(np.unique(solid.class_maps(volume, [front]))) <= {-2, -1, 0}  # opaque: only the outermost is seen
    (seen,) = NESTED.class_maps(volume, [front])
    row = seen[32]
    assert row[32] == 2
    order = [int(v) for v in row[32:] if v != -2]
    assert order == sorted(order, reverse=True)
    assert set(order) == {2, 1, 0, -1}


def test_more_than_three_classes_are_told_apart() -> None:
    opacities = (0.02, 0.04, 0.06, 0.9)
    ranges = tuple(Range(0.1 + 0.2 * k, 0.28 + 0.2 * k, a, (0.5, 0.5, 0.5)) for k, a in enumerate(opacities))
    known = replace(NESTED, ranges=ranges)
    front = orbit_cameras(3, (0.0, 0.0, 0.0), 8.0, np.pi / 8, 64)[1]
    assert known.class_maps(known.volume(40), [front])[0][32, 32] == 3


# --- cases -------------------------------------------------------------------------------------------------------

SMALL = BenchSettings(n=12, test=2, size=64, resolution=24, time_limit=1.0)
QUICK = replace(SMALL, steps=(("draft", 12, 6),), samples=1024)


def test_a_transparent_function_is_refused_in_a_sentence() -> None:
    assert TRANSPARENT.ranges
    found = CASES["transparent"].measure(Bench(SMALL), CASES["transparent"], preset("draft"), 0, lambda f, t: None)
    assert found["refused"] is True


def test_what_a_case_changes() -> None:
    draft, paper = preset("draft"), preset("paper")
    assert CASES["lambda-0"].change(draft).recolour.offset_weight == 0.0
    assert CASES["lambda-0"].change(draft).reconstruct == draft.reconstruct
    assert CASES["small-tables"].change(paper).field.log2_entries == 10
    assert not CASES["small-tables"].concerns(draft)
    assert CASES["small-tables"].concerns(paper)
    assert CASES[EASIEST].change(draft) == draft


def test_steps_stand_in_for_the_time_limit() -> None:
    settings = replace(SMALL, steps=(("draft", 30, 20),), samples=1024)
    draft, limit = settings.applied(CASES["lambda-1"].change(preset("draft")))
    assert limit is None
    assert (draft.reconstruct.iterations, draft.recolour.iterations) == (30, 20)
    assert (draft.reconstruct.samples, draft.recolour.rays) == (1024, 128)
    assert draft.recolour.offset_weight == 1.0  # the case's own change stays
    paper, limit = settings.applied(preset("paper"))
    assert limit == SMALL.time_limit
    assert paper.reconstruct.iterations == preset("paper").reconstruct.iterations
    assert SMALL.applied(preset("paper")) == (preset("paper"), SMALL.time_limit)


def test_style_pictures_are_what_they_say() -> None:
    assert tiny().shape == (16, 16, 3)
    assert 0.98 < (barely_masked() == 1.0).all(axis=2).mean() < 1.0


@pytest.mark.slow
def test_a_run_measures_what_it_promises(tmp_path: Path) -> None:
    matrix = Matrix(("easy", "saved", "camera-far", "camera-inside"), ("draft",), 1)
    records = run_stability(tmp_path, matrix, QUICK)
    assert [r["case"] for r in records] == ["easy", "saved", "camera-inside", "camera-far"]
    for r in records:
        measures = r["measures"]
        assert "crash" not in measures
        assert measures["finite"] is True
        assert measures["psnr_foreground"] < measures["psnr"] or r["case"] == "camera-inside"
        assert 0.0 <= measures["overlap"] <= 1.0
        assert measures["ranges"] == 2
        assert len(measures["colours"]) == measures["regions"]
    assert abs(records[1]["measures"]["lost"]) < 0.5
    again = run_stability(tmp_path / "again", Matrix(("easy",), ("draft",), 1), QUICK)
    assert again[0]["measures"] == records[0]["measures"]  # the same seed and steps, the same figures


# --- running -----------------------------------------------------------------------------------------------------


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, str]]:
    """Two cases that only note that they ran; the second breaks down from seed 1."""
    calls: list[tuple[int, str]] = []

    def measure(bench: Bench, case: Case, chosen: Preset, seed: int, progress: object) -> Measures:
        calls.append((seed, case.title))
        if case.title == "second" and seed == 1:
            raise ZeroDivisionError("the end")
        return {"psnr_foreground": 30.0 + seed, "finite": True, "overlap": 0.5, "colour_error": 1.0, "regions": 2,
                "ranges": 2}  # fmt: skip

    cases = {"easy": Case("first", measure), "wires": Case("second", measure)}
    for name in tuple(CASES):
        monkeypatch.delitem(CASES, name)
    for name, case in cases.items():
        monkeypatch.setitem(CASES, name, case)
    return calls


def test_a_run_that_is_there_is_not_repeated(counted: list[tuple[int, str]], tmp_path: Path) -> None:
    matrix = Matrix(("easy", "wires"), ("draft",), 2)
    first = run_stability(tmp_path, matrix, SMALL)
    assert counted == [(0, "first"), (0, "second"), (1, "first"), (1, "second")]
    assert run_stability(tmp_path, matrix, SMALL) == first
    assert len(counted) == 4
    run_stability(tmp_path, replace(matrix, seeds=3), SMALL)
    assert counted[4:] == [(2, "first"), (2, "second")]
    run_stability(tmp_path, matrix, replace(SMALL, size=65))  # other settings, other runs
    assert len(counted) == 10


def test_a_stopped_series_goes_on(counted: list[tuple[int, str]], tmp_path: Path) -> None:
    matrix = Matrix(("easy", "wires"), ("draft",), 2)

    def stop(fraction: float, label: str) -> None:
        if fraction >= 0.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        run_stability(tmp_path, matrix, SMALL, stop)
    assert len(counted) == 2
    (tmp_path / "runs" / "wires-draft-0.json").write_text("half a fi")
    assert len(run_stability(tmp_path, matrix, SMALL)) == 4
    assert counted[2:] == [(0, "second"), (1, "first"), (1, "second")]


def test_what_is_written(counted: list[tuple[int, str]], tmp_path: Path) -> None:
    records = run_stability(tmp_path, Matrix(("easy", "wires"), ("draft", "paper"), 2), SMALL)
    rows = write_summary(tmp_path, records)
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["runs", *sorted(FILES)]
    easy, broken = (next(r for r in rows if (r.case, r.preset) == (case, "draft")) for case in ("easy", "wires"))
    assert easy.foreground == pytest.approx(30.5)
    assert easy.spread == pytest.approx(np.std([30, 31], ddof=1))
    assert easy.failed == {"wrong regions": 2}
    assert (broken.foreground, broken.failed) == (30.0, {"wrong regions": 1, "crash": 1})
    content = json.loads((tmp_path / "stability.json").read_text())
    assert len(content["runs"]) == 8
    assert content["runs"][0]["settings"]["size"] == 64
    table = list(csv.DictReader((tmp_path / "stability.csv").read_text().splitlines()))
    assert {row["seed"] for row in table} == {"0", "1"}
    assert [row["crash"] for row in table if row["failures"] == "crash"] == ["ZeroDivisionError: the end"] * 2
    text = (tmp_path / "stability.md").read_text()
    assert "| first | 2 | 30.5 ± 0.7 | 0.0 | 0.50 | 1.0 | wrong regions (2/2) |" in text
    with Image.open(tmp_path / "stability.png") as picture:
        assert picture.size[0] > 300


def test_unsteady_seeds_are_a_failure(counted: list[tuple[int, str]], tmp_path: Path) -> None:
    records = run_stability(tmp_path, Matrix(("easy",), ("draft",), 2), SMALL)
    records[1]["measures"]["psnr_foreground"] = 36.0
    assert summary(records)[0].failed["unsteady"] == 2


# --- the command -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--case", "nothing"], "There is no case 'nothing'"),
        (["--preset", "finest"], "finest"),
        (["--seeds", "0"], "seeds"),
        (["--time-limit", "0"], "time-limit"),
        (["--n", "2"], "--n"),
        (["--steps", "draft=300"], "does not give steps"),
        (["--steps", "finest=300+20"], "does not give steps"),
        (["--steps", "draft=0+20"], "does not give steps"),
        (["--case", "transparent", "--seeds", "1", "--out", "/dev/null/x"], "/dev/null/x"),
    ],
)
def test_bad_use(
    arguments: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["svv", "bench", "stability", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    error = capsys.readouterr().err
    assert ended.value.code == 2
    assert said in error
    assert "Traceback" not in error
    assert len(error.strip().splitlines()) == 1


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["bench", "stability", "--case", "transparent", "--seeds", "2", "--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", ["svv", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    assert "4 runs" in capsys.readouterr().out
    assert "| transparent everywhere | 2 | - | - | - | - | none |" in (tmp_path / "out" / "stability.md").read_text()


def test_without_vtk_a_sentence_says_how_to_get_it(tmp_path: Path) -> None:
    code = (
        "import importlib.util as util; find = util.find_spec\n"
        "util.find_spec = lambda name, *rest: None if name == 'vtkmodules' else find(name, *rest)\n"
        "from svv.cli.app import main; main()"
    )
    command = [sys.executable, "-c", code, "bench", "stability", "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and "svv[standalone]" in done.stderr and len(done.stderr.splitlines()) == 1


def test_a_matrix_without_runs() -> None:
    with pytest.raises(BadInput, match="At least one seed"):
        Matrix(seeds=0)
    with pytest.raises(BadInput, match="applies to any"):
        Matrix(("small-tables",), ("draft",), 3)
    assert len(Matrix(("small-tables", "wires"), ("draft",), 3).runs) == 3
