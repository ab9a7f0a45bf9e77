"""`svv bench chart`: the runs that it makes, none of them twice, the results it shows, and a small run end to end."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from svv.cli import app as cli
from svv.cli.options import parse_choices, parse_limits, parse_whole
from svv.core.geometry.cameras import sphere_cameras
from svv.errors import BadInput, Cancelled, Progress, silent
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.options.making import LIGHTINGS, PRESET_NAMES
from svv.train.run.config import PRESETS, preset
from svv_bench.chart import job, process, result
from svv_bench.chart.job import Chart
from svv_bench.chart.plan import Grid, Measure, Training, trainings
from svv_bench.chart.result import make_chart
from svv_bench.chart.scenes import read_scenes, shrunk, spread_over
from svv_bench.chart.table import COLUMNS
from svv_bench.chart.tasks import RenderTask, TrainTask

# --- runs and their keys -------------------------------------------------------------------------------------------

RUN = Training("head", "abcd", "fast", "lattice", 400, 30.0, "cpu", 0)


def test_each_setting_makes_another_run_and_the_same_settings_the_same() -> None:
    changes: list[dict[str, Any]] = [
        {"scene": "foot"}, {"source": "other"}, {"preset": "draft"}, {"encoding": "hash"}, {"size": 200},
        {"limit": 60.0}, {"limit": None}, {"device": "other"}, {"seed": 1},
        {"kernels": "reference"}, {"lighting": "phong"},
    ]  # fmt: skip
    names = {replace(RUN, **change).name for change in changes}
    assert len(names | {RUN.name}) == len(changes) + 1
    assert replace(RUN).name == RUN.name
    assert all(part in RUN.name for part in ("head", "fast", "lattice", "400px", "30s", "cpu", "seed0"))


def test_a_preset_that_changed_makes_another_run(monkeypatch: pytest.MonkeyPatch) -> None:
    before = RUN.name
    changed = replace(PRESETS["fast"], reconstruct=replace(PRESETS["fast"].reconstruct, iterations=1001))
    monkeypatch.setitem(PRESETS, "fast", changed)
    assert RUN.name != before


def test_the_runs_are_every_combination_once() -> None:
    lights = ("network", "auto")
    grid = Grid(("draft", "fast"), ("lattice", "hash"), (5.0, None, 5.0), seeds=(0, 1, 2), lightings=lights)
    runs = trainings(grid, "head", {64: "a", 128: "b"}, (64, 128))
    assert len(runs) == len(set(runs)) == 2 * 2 * 2 * 3 * 2 * 2
    assert [run.expected for run in runs if run.seed == 0] == sorted(run.expected for run in runs if run.seed == 0)


@pytest.mark.parametrize("name", PRESETS)
def test_another_encoding_keeps_schedule_and_widths(name: str) -> None:
    own, found = preset(name), {encoding: preset(name, encoding) for encoding in ("lattice", "hash")}
    assert own in found.values()
    for encoding, chosen in found.items():
        assert chosen.field.encoding == encoding
        assert chosen.fitted == (encoding == "lattice")
        assert (chosen.field.width, chosen.field.shading) == (own.field.width, own.field.shading)
        assert chosen.reconstruct.iterations == own.reconstruct.iterations
        assert chosen.recolour.iterations == own.recolour.iterations
    with pytest.raises(BadInput, match="no encoding 'octree'"):
        preset(name, "octree")


# --- scenes --------------------------------------------------------------------------------------------------------


def write_views(folder: Path, size: int = 32, test: int = 5) -> Path:
    """Views of a ball of two colours, with a soft rim of alpha."""
    y, x = np.mgrid[:size, :size] - 0.5 * (size - 1)
    for split, n in (("train", 12), ("test", test)):
        cameras = sphere_cameras(n, (0.0, 0.0, 0.0), 4.0, float(np.radians(30.0)), size)
        images = np.zeros((n, size, size, 4), np.uint8)
        images[..., :3] = np.where((x < 0)[..., None], (200, 60, 40), (40, 80, 200))
        images[..., 3] = np.clip(255 * (0.3 * size - np.hypot(x, y)), 0, 255)
        ViewSet(tuple(cameras), images, tuple(f"r_{k:04d}" for k in range(n))).write(folder, split)
    return folder


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 4]))
def test_shrunk_views_show_the_same_light(seed: int, factor: int) -> None:
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 256, (3, 16, 16, 4)).astype(np.uint8)
    cameras = sphere_cameras(3, (0.0, 0.0, 0.0), 4.0, 0.5, 16)
    small = shrunk(ViewSet(tuple(cameras), images, ("a", "b", "c")), 16 // factor)
    assert small.images.shape == (3, 16 // factor, 16 // factor, 4)
    assert {camera.width for camera in small.cameras} == {16 // factor}

    def light(of: np.ndarray) -> np.ndarray:
        straight = of.astype(float) / 255
        return np.concatenate([straight[..., :3] * straight[..., 3:], straight[..., 3:]], axis=-1).mean(axis=(1, 2))

    np.testing.assert_allclose(light(small.images), light(images), atol=1.5 / 255)  # two roundings to 8 bits


@given(st.integers(5, 200), st.data())
def test_views_are_spread_evenly(count: int, data: st.DataObject) -> None:
    test = data.draw(st.integers(5, count))
    chosen = spread_over(count, test)
    assert (chosen[0], chosen[-1], len(set(chosen))) == (0, count - 1, test)
    assert np.ptp(np.diff(chosen)) <= 1


def test_scenes_of_one_name_are_told_apart(tmp_path: Path) -> None:
    folders = [write_views(tmp_path / part / "views") for part in ("a", "b")]
    scenes = read_scenes(folders, [], Measure(test=5))
    assert [scene.name for scene in scenes] == ["views", "views-2"]
    one, other = (scene.views_key(32, Measure()) for scene in scenes)
    assert one == other  # the same views, at two places
    picture = next((folders[1] / "train").glob("*.png"), None) or next(folders[1].rglob("*.png"))
    Image.new("RGBA", (32, 32), (255, 0, 0, 255)).save(picture)
    assert scenes[1].views_key(32, Measure()) != one


# --- a chart whose runs are made up ---------------------------------------------------------------------------------


def made_up(task: dict[str, Any], progress: Progress) -> None:
    """What a process would leave behind, without its work."""
    progress(0.5, "half")
    folder = Path(task["folder"])
    if task["work"] == "train":
        run = task["run"]
        seconds = {
            "hull": 1.0,
            "base": 0.6 * (run["limit"] or 99.0),
            "palette": 1.0,
            "pcn": 0.3,
            "sampling": 0.1,
            "doubt": 0.1,
        }
        seconds["total"] = 9.0
        (folder / "scene.svv").write_bytes(b"x" * 5000)
        report = {"seconds": seconds, "peak_rss_bytes": 1, "parameters": 2, "device": run["device"], "kernels": "numba",
                  "lighting": run["lighting"], "run": run, "scene_bytes": 5000, "cpu_seconds": 12.0, "resumed": False,
                  "threads": 2, "load_average": 0.5}  # fmt: skip
        (folder / "train.json").write_text(json.dumps(report))
        return
    view = {"median": 0.2, "least": 0.1, "most": 0.4, "all": [0.1, 0.2, 0.4], "cpu_median": 0.3}
    shown = {"psnr": 30.0 + len(folder.name) % 5, "psnr_foreground": None, "ssim": 0.9, "seconds_per_view": view,
             "size": [task["size"]] * 2, "network": task["network"], "test_views": task["test"],
             "render_peak_rss_bytes": 3}  # fmt: skip
    (folder / task["file"]).write_text(json.dumps(shown))


class Runner:
    """Stands in for the processes; notes what they were asked to do, and stops before the one with that number."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[str] = []
        self.stop_at: int | None = None
        monkeypatch.setattr(job, "run_apart", self.run)

    def run(self, task: dict[str, Any], progress: Progress, variables: Mapping[str, str]) -> None:
        if len(self.asked) == self.stop_at:
            raise Cancelled
        self.asked.append(task["work"])
        made_up(task, progress)


@pytest.fixture
def runner(monkeypatch: pytest.MonkeyPatch) -> Runner:
    return Runner(monkeypatch)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing is most of the time of a chart whose runs are made up."""
    monkeypatch.setattr(result, "write_result", lambda chart, rows: None)


GRID = Grid(("draft",), ("lattice", "hash"), (2.0, None), render_sizes=(32, 16))
SMALL = Measure(test=5)


@pytest.mark.slow
def test_a_stopped_chart_goes_on_and_a_finished_one_does_nothing(tmp_path: Path, runner: Runner) -> None:
    views, out = write_views(tmp_path / "views"), tmp_path / "out"
    runner.stop_at = 4
    with pytest.raises(Cancelled):
        make_chart(Chart([views], [], out, GRID, SMALL))
    assert runner.asked == ["train", "render", "render", "train"]
    assert "not finished" in (out / "chart.html").read_text()  # what there is, is shown
    runner.stop_at, runner.asked = None, []
    make_chart(Chart([views], [], out, GRID, SMALL))
    assert runner.asked == ["render", "render"] + ["train", "render", "render"] * 2
    assert "not finished" not in (out / "chart.html").read_text()
    runner.asked = []
    make_chart(Chart([views], [], out, GRID, SMALL))
    assert runner.asked == []


@pytest.mark.usefixtures("undrawn")
def test_only_what_a_change_touches_is_done_again(tmp_path: Path, runner: Runner) -> None:
    views, out = write_views(tmp_path / "views", test=6), tmp_path / "out"
    grid = replace(GRID, limits=(2.0,), render_sizes=(None,))
    asked: list[list[str]] = []
    for change, measure in (
        (grid, SMALL),
        (grid, replace(SMALL, test=6)),
        (grid, replace(SMALL, network="base")),
        (replace(grid, render_sizes=(16,)), SMALL),
        (replace(grid, encodings=("hash",), seeds=(0, 1)), SMALL),
    ):
        runner.asked = []
        make_chart(Chart([views], [], out, change, measure))
        asked.append(runner.asked)
    assert asked == [["train", "render"] * 2, ["render"] * 2, ["render"] * 2, ["render"] * 2, ["train", "render"]]
    write_views(views, test=5)  # other views: nothing that was measured holds
    runner.asked = []
    make_chart(Chart([views], [], out, grid, SMALL))
    assert runner.asked == ["train", "render"] * 2


@pytest.mark.usefixtures("undrawn")
def test_a_lost_scene_is_trained_and_measured_again(tmp_path: Path, runner: Runner) -> None:
    views, out = write_views(tmp_path / "views"), tmp_path / "out"
    grid = Grid(("draft",), ("lattice",), (2.0,))
    make_chart(Chart([views], [], out, grid, SMALL))
    next(out.rglob("scene.svv")).unlink()
    runner.asked, runner.stop_at = [], 1
    with pytest.raises(Cancelled):
        make_chart(Chart([views], [], out, grid, SMALL))
    runner.stop_at = None
    make_chart(Chart([views], [], out, grid, SMALL))
    assert runner.asked == ["train", "render"]


def test_the_tables_hold_every_run_with_its_settings(tmp_path: Path, runner: Runner) -> None:
    out = tmp_path / "out"
    make_chart(Chart([write_views(tmp_path / "views")], [], out, GRID, SMALL))
    with (out / "runs.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert tuple(table[0]) == COLUMNS
    runs = json.loads((out / "runs.json").read_text())["runs"]
    assert len(table) == len(runs) == 2 * 2 * 2
    settings = {(r["preset"], r["encoding"], r["time_limit"], r["render_size"], r["seed"]) for r in runs}
    expected = [("draft", e, limit, size, 0) for e in ("lattice", "hash") for limit in (2.0, None) for size in (16, 32)]
    assert settings == set(expected)
    for text, run in zip(table, runs, strict=True):
        assert float(text["psnr"]) == run["psnr"]
        assert text["dvr_seconds"] == "" and run["dvr_seconds"] is None  # no volume at hand
        assert (out / "runs" / run["run"] / "scene.svv").exists()


# --- bad input -----------------------------------------------------------------------------------------------------


def test_lists_on_the_command_line() -> None:
    assert parse_choices("fast, draft,fast", "--presets", PRESET_NAMES) == ("fast", "draft")
    assert parse_whole("3,1,3", "--seeds") == (3, 1)
    assert parse_choices("phong,network", "--lighting", LIGHTINGS) == ("phong", "network")
    assert parse_limits("15,full,2.5", "--time-limits") == (15.0, None, 2.5)
    for text in ("", "fast,", "wild"):
        with pytest.raises(BadInput, match="--presets has no"):
            parse_choices(text, "--presets", PRESET_NAMES)
    with pytest.raises(BadInput, match="lattice, hash"):
        parse_choices("grid", "--encodings", ("lattice", "hash"))
    for text in ("", "-1", "1.5", "a", "8"):
        with pytest.raises(BadInput, match="--sizes"):
            parse_whole(text, "--sizes", 16)
    for text in ("", "0", "inf", "nan", "-3", "soon", "5,,6"):
        with pytest.raises(BadInput, match="--time-limits"):
            parse_limits(text, "--time-limits")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none"], "no volume none"),
        (["empty"], "holds no views"),
        (["views", "--tf", "a.json"], "0 volumes and 1 transfer functions"),
        (["views", "--test", "6"], "has 5 test views"),
        (["views", "--test", "2"], "greater than or equal to 5"),
        (["views", "--sizes", "20"], "shrunk by whole factors"),
        (["views", "--sizes", "64"], "not to 64"),
        (["views", "--presets", "wild"], "--presets has no 'wild'"),
        (["views", "--encodings", "octree"], "--encodings has no 'octree'"),
        (["views", "--lighting", "sun"], "--lighting has no 'sun'"),
        (["views", "--lighting", "network,phong"], "needs the lattice"),
        (["views", "--devices", "abacus"], "--devices has no 'abacus'"),
        (["views", "--time-limits", "0"], "--time-limits needs seconds"),
        (["views", "--network", "styled"], "base or pcn"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_views(tmp_path / "views")
    (tmp_path / "empty").mkdir()
    before = sorted(tmp_path.iterdir())
    test = [] if "--test" in arguments else ["--test", "5"]
    monkeypatch.setattr(sys, "argv", ["svv", "bench", "chart", *arguments, *test, "--out", "out"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    error = capsys.readouterr().err
    assert ended.value.code == 2
    assert said in error
    assert error.startswith("svv: ") and error.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("volume", [None, Path("/data/head.mha")])
def test_tasks_are_the_same_in_the_process_that_does_them(volume: Path | None) -> None:
    rendering = RenderTask(Path("/out/run"), Path("/views"), "render-32.json", 32, 5, "pcn", "cpu", volume)
    assert RenderTask.from_json(json.loads(json.dumps(rendering.to_json()))) == rendering
    training = TrainTask(Path("/out/run"), Path("/views"), RUN)
    assert TrainTask.from_json(json.loads(json.dumps(training.to_json()))) == training


@pytest.mark.parametrize(
    ("task", "kind", "said"),
    [
        ({"work": "sing", "run": asdict(RUN), "folder": ".", "views": "none"}, BadInput, "There is no work 'sing'"),
        pytest.param({"work": "train"}, RuntimeError, "KeyError", marks=pytest.mark.slow),
    ],
)
def test_a_run_that_fails_says_why(task: dict[str, Any], kind: type[Exception], said: str) -> None:
    with pytest.raises(kind, match=said):
        process.run_apart(task, silent)


def test_a_run_that_is_no_longer_wanted_is_stopped(tmp_path: Path) -> None:
    told: list[str] = []

    def stop(fraction: float, label: str) -> None:
        told.append(label)
        raise Cancelled

    task = {"work": "train", "run": asdict(RUN), "folder": str(tmp_path), "views": str(tmp_path / "none")}
    with pytest.raises(Cancelled):
        process.run_apart(task, stop)
    assert told == ["starting"]
    assert not list(tmp_path.iterdir())


# --- end to end ----------------------------------------------------------------------------------------------------


class Sources(HTMLParser):
    """What a page shows from elsewhere than itself."""

    def __init__(self) -> None:
        super().__init__()
        self.kinds: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.kinds += [str(value).split(";")[0] for name, value in attrs if name in ("src", "href")]


@pytest.mark.slow
def test_a_small_chart_of_a_volume(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from svv.io.files.atomic import write_json
    from svv.job.demo import write_volume
    from tests.stirred_volume import stirred_transfer_function, stirred_volume

    write_volume(tmp_path / "ball.vti", stirred_volume(24))
    write_json(tmp_path / "tf.json", [stirred_transfer_function().to_dict()])
    out = tmp_path / "out"
    arguments = [str(tmp_path / "ball.vti"), "--tf", str(tmp_path / "tf.json"), "--presets", "draft", "--encodings",
                 "lattice", "--kernels", "auto,reference", "--lighting", "auto", "--time-limits", "1", "--sizes", "32",
                 "--render-sizes", "48", "--n", "12", "--test", "5", "--out", str(out)]  # fmt: skip
    cli.app(["bench", "chart", *arguments], prog_name="svv", standalone_mode=False)
    said = capsys.readouterr()
    assert said.out == f"{out / 'chart.html'}\n"
    assert said.err.startswith("2 runs to train")
    run, plain = json.loads((out / "runs.json").read_text())["runs"]
    assert [run["kernels"], plain["kernels"]] == ["numba", "reference"]
    assert (run["scene"], run["preset"], run["encoding"], run["device"], run["seed"]) == (
        "ball", "draft", "lattice", "cpu", 0,
    )  # fmt: skip
    assert (run["train_size"], run["render_size"], run["test_views"]) == (32, 48, 5)
    lit = Scene.load(out / "runs" / run["run"] / "scene.svv").settings.lighting
    assert run["lighting"] == "auto" and run["light"] == lit and "-lattice-auto-" in run["run"]
    assert run["lighting_seconds"] > 0
    assert run["psnr"] > 12  # an empty picture of this volume has about 10 dB
    assert run["psnr"] > run["psnr_foreground"] > 5
    assert run["dvr_seconds_least"] <= run["dvr_seconds"] <= run["dvr_seconds_most"]
    assert run["view_seconds_least"] <= run["view_seconds"] <= run["view_seconds_most"]
    assert min(run["train_cpu_seconds"], run["view_cpu_seconds"], run["dvr_cpu_seconds"]) > 0
    assert min(run["train_peak_bytes"], run["render_peak_bytes"]) > 50e6
    assert run["train_seconds"] == pytest.approx(
        sum(
            run[f"{stage}_seconds"]
            for stage in ("check", "hull", "base", "palette", "lighting", "pcn", "sampling", "doubt")
        )
    )
    sources = Sources()
    sources.feed((out / "chart.html").read_text())
    assert sources.kinds == ["data:image/png"] * 3
    assert not list(out.rglob("*checkpoint")) and not list(out.rglob(".*"))
    before = {path: path.stat().st_mtime_ns for path in (out / "runs").rglob("*")}
    cli.app(["bench", "chart", *arguments], prog_name="svv", standalone_mode=False)
    assert capsys.readouterr().err.startswith("0 runs to train")
    assert before == {path: path.stat().st_mtime_ns for path in (out / "runs").rglob("*")}
