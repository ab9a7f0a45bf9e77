"""The ``svv`` command: the input that it accepts, its messages, and its exit codes."""

from __future__ import annotations

import inspect
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from svv.cli import added
from svv.cli import app as cli
from svv.cli.options import parse_colour, parse_mapping, parse_numbers, parse_size
from svv.core.geometry.cameras import look_at
from svv.errors import BadInput, Cancelled
from svv.io.views.camera_file import read_camera, read_cameras
from svv_bench import cli as bench
from tests.cube import cube_scene
from tests.nightly import nightly
from tests.wheels import make_installed

COMMANDS = [
    "demo", "run", "views", "train", "edit", "palette", "stylize", "styles", "style-mask", "render", "evaluate", "info",
    "follow", "opacities", "features", "cache", "bench", *(f"bench {name}" for name in bench.COMMANDS),
]  # fmt: skip


def run(*arguments: str | Path, **options: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "svv", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=600, check=False, **options)


def call(
    *arguments: str | Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str]:
    """The command in this process: its exit code and what it wrote on standard error."""
    monkeypatch.setattr(sys, "argv", ["svv", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0), capsys.readouterr().err


@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
def test_a_colour_is_its_levels(red: int, green: int, blue: int) -> None:
    expected = np.array([red, green, blue]) / 255
    for text in (f"#{red:02x}{green:02x}{blue:02x}", f"{red:02X}{green:02X}{blue:02X}"):
        np.testing.assert_allclose(parse_colour(text), expected)


@pytest.mark.parametrize(
    "text", ["", "#12345", "#1234567", "reddish", "#-12345", "#+12345", "#12 456", "#1_2345", "0x12ab"]
)
def test_no_colour(text: str) -> None:
    with pytest.raises(BadInput, match="is not a colour"):
        parse_colour(text)


@pytest.mark.parametrize("name", nightly(["chart", "stability"], "chart"))
def test_without_matplotlib_a_command_that_draws_says_so_before_it_begins(name: str, tmp_path: Path) -> None:
    without = "import sys; sys.modules['matplotlib'] = None; from svv.cli.app import main; main()"
    what = {"chart": str(tmp_path / "views"), "stability": "--case=easy"}[name]
    command = [sys.executable, "-c", without, "bench", name, what, "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 2
    assert done.stderr.strip().endswith("pip install matplotlib.") and "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_sizes() -> None:
    assert parse_size("800") == (800, 800)
    assert parse_size("1280x720") == (1280, 720)
    for text in ("", "0", "-5", "x", "3x", "1x2x3", "99999", "4.5"):
        with pytest.raises(BadInput, match="is not a size"):
            parse_size(text)


def test_mappings() -> None:
    assert parse_mapping("0=0,2=1") == {0: 0, 2: 1}
    for text in ("", "0", "a=1", "0=1=2", "-1=0"):
        with pytest.raises(BadInput, match="is not a mapping"):
            parse_mapping(text)
    with pytest.raises(BadInput, match="twice"):
        parse_mapping("0=1,0=2")


def test_numbers() -> None:
    assert parse_numbers("1,2.5,3e2", "--spacing") == (1.0, 2.5, 300.0)
    for text in ("1,2", "1,2,x", "1,2,0", "1,2,nan", "1,2,-3", "1,2,inf"):
        with pytest.raises(BadInput, match="--spacing"):
            parse_numbers(text, "--spacing")


def imported_for(*arguments: str) -> set[str]:
    """Names of the modules that a process has imported when a command has ended well."""
    code = (
        f"import sys; sys.argv = ['svv', *{arguments}]\n"
        "from svv.cli import app as cli\n"
        "try: cli.main()\n"
        "except SystemExit as end: assert not end.code\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stderr.split())


def test_help_comes_without_the_heavy_libraries() -> None:
    assert not {"torch", "vtkmodules", "numba", "scipy", "skimage", "numpy"} & imported_for("train", "--help")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_shows_examples(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(sys, "argv", ["svv", *command.split(), "--help"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert not ended.value.code
    said = capsys.readouterr().out
    assert f"svv {command}" in said.split("Examples")[1]
    assert "repeated. May be repeated" not in " ".join(said.replace("│", "").split())


@pytest.mark.parametrize("command", COMMANDS)
def test_an_option_whose_value_is_called_as_itself_is_named(command: str) -> None:
    """Otherwise typer 0.27 names it after the value: ``--VIEWS``."""
    group, _, name = command.rpartition(" ")
    function = bench.COMMANDS[name][0] if group else bench.bench if name == "bench" else cli.command_of(name)[0]
    for parameter in inspect.signature(function, eval_str=True).parameters.values():
        for note in get_args(parameter.annotation):
            if getattr(note, "metavar", None) and "prompt" in vars(note):
                names = [n for n in (note.default, *(note.param_decls or ())) if str(n).startswith("-")]
                assert names or note.metavar.lower() != parameter.name, parameter.name


def test_the_command_alone_shows_its_help_and_its_version() -> None:
    told = run().stdout
    assert all(command in told for command in COMMANDS if " " not in command)
    assert run("--version").stdout.startswith("svv 0.")


def test_the_help_says_of_each_command_what_the_command_says_of_itself() -> None:
    functions = {name: cli.command_of(name)[0] for name in cli.COMMANDS} | {"bench": bench.bench}
    for name, (_, said) in (cli.COMMANDS | added.added()).items():
        told = functions[name].__doc__ or ""
        assert " ".join(told.split("\n\n")[0].split()) == said, name


def test_without_what_measures_a_sentence_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(added, "find_spec", lambda name: None)
    monkeypatch.setattr(added, "entry_points", lambda group: ())
    for arguments in (["bench"], ["bench", "--help"], ["bench", "gpu", "--short"]):
        code, said = call(*arguments, monkeypatch=monkeypatch, capsys=capsys)
        assert code == 2 and is_one_sentence(said) and "pip install ./bench" in said
    monkeypatch.setattr(sys, "argv", ["svv", "--help"])
    with pytest.raises(SystemExit):
        cli.main()
    told = capsys.readouterr().out
    assert "demo" in told and "bench" not in told


def test_other_distributions_add_commands_which_never_hide_ours(tmp_path: Path) -> None:
    points = "[svv.commands]\nweigh = weigh:app\nbroken = weigh.none:app\ntrain = weigh:app\n"
    module = "import typer\napp = typer.Typer()\n@app.command()\ndef weigh():\n    'Weigh.'\n    print('heavy')\n"
    more = {"weigh.py": module, "weigh-1.0.dist-info/entry_points.txt": points}
    make_installed(tmp_path, "weigh", "1.0", more=more)
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]])}
    assert run("weigh", env=environ).stdout == "heavy\n"
    assert run("train", "--help", env=environ).stdout.count("VIEWS")
    broken = run("broken", env=environ)
    assert broken.returncode == 2 and is_one_sentence(broken.stderr) and "install both in the same" in broken.stderr
    told = run("--help", env=environ).stdout
    assert "weigh" in told and told.count("Train a scene on views") == 1


def test_a_command_is_imported_when_it_is_called() -> None:
    commands = {f"svv.cli.{module}" for module, _ in cli.COMMANDS.values()}
    assert not commands & imported_for("--help")
    assert commands & imported_for("train", "--help") == {"svv.cli.scene"}


def is_one_sentence(text: str) -> bool:
    return text.startswith("svv: ") and text.count("\n") == 1 and "Traceback" not in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["frobnicate"], "No such command"),
        (["train"], "Missing argument"),
        (["train", "views", "--out", "a.svv", "--preset", "wild"], "not one of"),
        (["train", "missing", "--out", "a.svv"], "missing"),
        (["train", "missing", "--out", "none/a.svv"], "folder does not exist"),
        (["train", "missing", "--out", "a.svv", "--encoding", "hash", "--lighting", "auto"], "needs the lattice"),
        (["info", "missing.svv"], "no scene file"),
        (["info", "foreign.svv"], "not a scene file"),
        (["info", "future.svv"], "format 99"),
        (["edit", "missing.svv", "--region", "0", "--out", "b.svv"], "Nothing to change"),
        (["edit", "missing.svv", "--region", "0", "--colour", "red", "--out", "b.svv"], "is not a colour"),
        (["stylize", "missing.svv", "--style", "none.png", "--out", "b.svv"], "none.png"),
        (["stylize", "missing.svv", "--style", "a.png", "--map", "x", "--out", "b.svv"], "is not a mapping"),
        (["stylize", "missing.svv", "--style", "a.png", "--preview", "now.gif", "--out", "b.svv"], "name it .png"),
        (["stylize", "missing.svv", "--style", "gallery:fresco", "--out", "b.svv"], "no 'fresco' in the gallery"),
        (["stylize", "missing.svv", "--style", "a.png", "--style-mask", "1=m.png", "--out", "b.svv"], "no style 1"),
        (["stylize", "missing.svv", "--style", "a.png", "--style-mask", "m", "--out", "b.svv"], "a style's mask"),
        (["styles", "fresco", "--out", "g"], "no 'fresco' in the gallery"),
        (["style-mask", "missing.png", "--regions", "3", "--out", "parts"], "missing.png"),
        (["run", "missing.vti", "--style", "gallery:mosaic", "--out", "v"], "missing.vti"),
        (["run", "a.vti", "--preset", "paper", "--lighting", "phong", "--out", "v"], "needs the lattice"),
        (["run", "a.vti", "--lighting", "sun", "--out", "v"], "'--lighting': 'sun' is not one of"),
        (["edit", "missing.svv", "--shadow", "2", "--out", "b.svv"], "less than or equal to 1. Try: svv edit --help"),
        (["render", "missing.svv", "--orbit", "4", "--out", "a.png"], "many views"),
        (["render", "missing.svv", "--orbit", "4", "--camera", "c.json", "--out", "a"], "not both"),
        (["render", "missing.svv", "--size", "big", "--out", "a"], "is not a size"),
        (["evaluate", "missing.svv", "--views", "none"], "no scene file"),
        (["views", "missing.vti", "--tf", "tf.json", "--out", "v"], "missing.vti"),
        (["run", "missing.vti", "--tf", "tf.json", "--out", "v"], "missing.vti"),
    ],
)
def test_bad_use_and_bad_input_are_one_sentence_and_leave_nothing(
    arguments: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from svv.io import scene_file

    monkeypatch.chdir(tmp_path)
    Path("foreign.svv").write_text("hello")
    Path("a.vti").write_text("no volume, but a file")
    with monkeypatch.context() as patch:
        patch.setattr(scene_file, "FORMAT_VERSION", 99)
        scene_file.write_scene_file("future.svv", {}, {})
    before = sorted(tmp_path.iterdir())
    code, error = call(*arguments, monkeypatch=monkeypatch, capsys=capsys)
    assert code == 2
    assert is_one_sentence(error), error
    assert said in error
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("raised", "code", "said"),
    [
        (BadInput("The volume has\none slice."), 2, "svv: The volume has one slice.\n"),
        (Cancelled(), 130, "svv: stopped; run the same command again to resume.\n"),
        (KeyboardInterrupt(), 130, None),
        (OSError(28, "No space left on device", "/data/x"), 2, "svv: /data/x: No space left on device.\n"),
        (MemoryError(), 2, "svv: There is not enough memory; choose a smaller size or the preset draft.\n"),
    ],
)
def test_what_goes_wrong_inside_a_command_ends_as_promised(
    raised: BaseException,
    code: int,
    said: str | None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(path: Path) -> None:
        raise raised

    monkeypatch.setattr("svv.io.scene_file.read_scene_info", fail)
    ended, error = call("info", "x.svv", monkeypatch=monkeypatch, capsys=capsys)
    assert ended == code
    assert said is None or error == said


def test_a_defect_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(path: Path) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("svv.io.scene_file.read_scene_info", fail)
    monkeypatch.setattr(sys, "argv", ["svv", "info", "x.svv"])
    with pytest.raises(ZeroDivisionError):
        cli.main()


MATRIX = look_at((3.0, 1.0, 2.0), (0.0, 0.0, 0.0))


def test_a_camera_file_of_ours_and_of_a_view_set(tmp_path: Path) -> None:
    degrees, radians = tmp_path / "a.json", tmp_path / "b.json"
    degrees.write_text(json.dumps({"camera_to_world": MATRIX.tolist(), "fov": 30, "width": 640, "height": 360}))
    frames = [{"file_path": "x", "transform_matrix": np.eye(4).tolist()}, {"transform_matrix": MATRIX.tolist()}]
    radians.write_text(json.dumps({"camera_angle_x": np.pi / 6, "frames": frames}))
    ours, theirs = read_camera(degrees), read_camera(radians, (320, 200), frame=1)
    for camera in (ours, theirs):
        np.testing.assert_allclose(camera.camera_to_world, MATRIX)
        np.testing.assert_allclose(camera.fov_x, np.pi / 6)
    assert (ours.width, ours.height) == (640, 360)
    assert (theirs.width, theirs.height) == (320, 200)
    assert read_camera(radians, frame=0).width == 800
    assert [camera.width for camera in read_cameras(radians)] == [800, 800]
    with pytest.raises(BadInput, match="2 views: choose one"):  # never silently the first
        read_camera(radians)


@pytest.mark.parametrize(
    "content",
    [
        "{",
        "[]",
        "{}",
        json.dumps({"camera_to_world": MATRIX.tolist()}),
        json.dumps({"camera_to_world": MATRIX.tolist(), "fov": "wide"}),
        json.dumps({"camera_to_world": [[1, 2], [3]], "fov": 30}),
        json.dumps({"camera_to_world": (2 * MATRIX).tolist(), "fov": 30}),
        json.dumps({"camera_to_world": MATRIX.tolist(), "fov": 0}),
        json.dumps({"camera_angle_x": 1, "frames": []}),
        json.dumps({"camera_angle_x": 1, "frames": [3]}),
    ],
)
def test_a_bad_camera_file_is_one_sentence(content: str, tmp_path: Path) -> None:
    (tmp_path / "c.json").write_text(content)
    with pytest.raises(BadInput):
        read_camera(tmp_path / "c.json")


def test_the_bounds_of_a_scene_are_told_axis_by_axis(tmp_path: Path) -> None:
    scene = cube_scene()
    scene.save(tmp_path / "cube.svv")
    told = CliRunner().invoke(cli.app, ["info", str(tmp_path / "cube.svv"), "--json", str(tmp_path / "info.json")])
    assert told.exit_code == 0
    (line,) = (line for line in told.stdout.splitlines() if line.startswith("bounds"))
    low, high = json.loads((tmp_path / "info.json").read_text())["bounds"]
    pairs = [f"{name} {a:.4g} to {b:.4g}" for name, a, b in zip("xyz", low, high, strict=True)]
    assert line.removeprefix("bounds").strip() == ", ".join(pairs)


def test_info_prints_of_regions_what_is_edited(tmp_path: Path) -> None:
    cube_scene().edited(1, name="core", opacity=0.0).save(tmp_path / "cube.svv")
    told = CliRunner().invoke(cli.app, ["info", str(tmp_path / "cube.svv"), "--json", str(tmp_path / "info.json")])
    zero, one = (line for line in told.stdout.splitlines() if line.startswith(("  0: colour", "  1: name")))
    assert "opacity" not in zero and one.startswith("  1: name core, ") and "opacity 0" in one
    assert json.loads((tmp_path / "info.json").read_text())["regions"][0]["opacity"] == 1.0
