"""The launcher: the ParaView that it chooses, the environment that it sets, and arguments, exit codes and signals."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from svv.errors import BadInput
from svv.pv.launch import prepare, programs
from tests.paraview.forked import LONG

ROOT = Path(__file__).resolve().parents[2]
SVV = [sys.executable, "-m", "svv"]


def make_paraview(folder: Path, answer: str = "svv: 5.11.0 3 11") -> Path:
    """A pvpython that says which version it is, and otherwise shows how it was started and exits with 7."""
    program = folder / "bin" / "pvpython"
    program.parent.mkdir(parents=True)
    program.write_text(
        f'#!/bin/sh\necho asked >> {folder}/log\ncase "$2" in *svv:*) echo "{answer}"; exit 0;; esac\n'
        'printf "<%s>" "$@"; echo; echo "$PYTHONPATH"; echo "$PV_PLUGIN_PATH"; exit 7\n'
    )
    program.chmod(0o755)
    return folder


@pytest.fixture(autouse=True)
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was found out about ParaViews is forgotten, and nobody names one."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def prepared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ParaView that only answers, with an environment that is empty."""
    environment = tmp_path / "environment" / "python3.11"
    environment.mkdir(parents=True)
    (environment / programs.STAMP).touch()
    monkeypatch.setenv("SVV_ENVIRONMENT", str(environment.parent))
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv("SVV_PARAVIEW", str(make_paraview(tmp_path / "ParaView")))
    return tmp_path / "ParaView"


def run(*arguments: object, **environ: str) -> subprocess.CompletedProcess[str]:
    command = [*SVV, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, env={**os.environ, **environ}, capture_output=True, text=True)


@pytest.mark.parametrize("sub", ["", "bin"])
def test_a_paraview_is_found_where_it_is_unpacked(tmp_path: Path, sub: str) -> None:
    found = programs.find(make_paraview(tmp_path / "here", "svv: 6.0.1 3 12") / sub)
    assert (found.bin, found.version, found.python) == (tmp_path / "here" / "bin", (6, 0), (3, 12))


def test_the_option_goes_before_the_variable_and_that_before_the_path(tmp_path: Path) -> None:
    one, two, three = (make_paraview(tmp_path / name) for name in ("one", "two", "three"))
    environ = {"SVV_PARAVIEW": str(two), "PATH": str(three / "bin")}
    assert programs.find(one, environ).bin == one / "bin"
    assert programs.find(None, environ).bin == two / "bin"
    assert programs.find(None, {**environ, "SVV_PARAVIEW": ""}).bin == three / "bin"


def test_a_version_is_asked_for_once_until_the_program_changes(tmp_path: Path) -> None:
    folder = make_paraview(tmp_path / "here")
    programs.find(folder)
    programs.find(folder)
    assert (folder / "log").read_text().split() == ["asked"]
    os.utime(folder / "bin" / "pvpython", (1, 1))
    programs.find(folder)
    assert (folder / "log").read_text().split() == ["asked"] * 2


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [("svv: 5.10.1 3 9", "ParaView 5.10, which is too old"), ("no idea", "does not run as ParaView's Python")],
)
def test_a_paraview_of_no_use_is_refused(tmp_path: Path, answer: str, sentence: str) -> None:
    with pytest.raises(BadInput, match=sentence):
        programs.find(make_paraview(tmp_path / "here", answer))


def test_where_there_is_none_the_sentence_says_what_to_install(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="apt-get install paraview"):
        programs.find(None, {"PATH": str(tmp_path)})
    with pytest.raises(BadInput, match="name the folder that contains bin/pvpython"):
        programs.find(tmp_path)
    for word in ("Fedora: sudo dnf", "without root: conda", "paraview.org/download"):
        assert word in programs.INSTALL_HINT
    done = run("pvpython", "--paraview", tmp_path, "script.py")
    assert done.returncode == 2
    assert done.stderr.startswith("svv: There is no ParaView in")
    assert len(done.stderr.splitlines()) == 1


def test_a_program_that_this_paraview_lacks_is_named(prepared: Path) -> None:
    done = run("pvserver")
    assert done.returncode == 2
    assert "has no pvserver" in done.stderr


def test_an_environment_that_is_not_prepared_is_named(prepared: Path, tmp_path: Path) -> None:
    done = run("pvpython", SVV_ENVIRONMENT=str(tmp_path / "none"))
    assert done.returncode == 2
    assert "make paraview" in done.stderr
    assert "svv paraview --prepare" in done.stderr


def test_a_shared_package_that_was_removed_is_noticed(prepared: Path, tmp_path: Path) -> None:
    environment = tmp_path / "environment" / "python3.11"
    (environment / "numpy-2.3.5.dist-info").symlink_to(tmp_path)
    assert run("pvpython").returncode == 7
    (environment / "numpy-2.3.5.dist-info").unlink()
    (environment / "numpy-2.3.5.dist-info").symlink_to(tmp_path / "upgraded")
    done = run("pvpython")
    assert done.returncode == 2
    assert "changed or removed" in done.stderr
    assert "svv paraview --prepare" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_build_of_torch_goes_with_the_preparation_alone(prepared: Path) -> None:
    done = run("paraview", "--torch", "cpu")
    assert (done.returncode, done.stderr) == (2, "svv: --torch has no effect without --prepare: give both.\n")
    done = run("paraview", "--prepare", "--torch", "rocm")
    assert (done.returncode, "choose one of auto, cpu, cuda, keep" in done.stderr) == (2, True)
    assert run("paraview", "--prepare", TORCH="gpu").returncode == 2


@pytest.mark.parametrize(
    ("given", "passed"),
    [
        (["script.py", "--help", "--paraview", "x", "-n", "2"], "<script.py><--help><--paraview><x><-n><2>"),
        (["-c", "print(1)", "a b"], "<-c><print(1)><a b>"),
        (["--dr", "--script=x.py", "-display", ":1"], "<--dr><--script=x.py><-display><:1>"),
        (["--", "--help"], "<--help>"),
        ([], "<>"),
    ],
)
def test_arguments_and_exit_code_are_handed_on(prepared: Path, given: list[str], passed: str) -> None:
    done = run("pvpython", *given)
    assert done.stdout.splitlines()[0] == passed
    assert done.returncode == 7


def test_our_help_is_shown_for_the_command_itself() -> None:
    done = run("pvpython", "--help")
    assert done.returncode == 0
    assert "svv pvpython script.py --help" in done.stdout


def test_what_the_user_has_set_is_kept_behind_ours(prepared: Path, tmp_path: Path) -> None:
    good, bad = tmp_path / "good", tmp_path / "bad"
    good.mkdir()
    (bad / "vtkmodules").mkdir(parents=True)
    done = run("pvpython", PYTHONPATH=f"{bad}:{good}", PV_PLUGIN_PATH="/theirs")
    environment = tmp_path / "environment" / "python3.11"
    assert done.stdout.splitlines()[1:] == [
        f"{ROOT}/plugin/compat:{ROOT}:{environment}:{good}",
        f"{ROOT}/plugin:/theirs",
    ]


@pytest.mark.parametrize(
    ("version", "python", "needed"),
    [((5, 11), (3, 11), True), ((5, 11), (3, 9), False), ((5, 12), (3, 11), False), ((6, 0), (3, 12), False)],
)
def test_the_shim_goes_only_where_it_is_needed(version, python, needed: bool, tmp_path: Path) -> None:
    folders = programs.python_path(programs.ParaView(tmp_path, version, python), tmp_path, {})
    assert (str(ROOT / "plugin" / "compat") in folders) == needed


@pytest.mark.parametrize("ours", [["svv"], ["svv", "svv_bench"]])
def test_of_a_folder_with_another_vtk_only_svv_is_shown(
    ours: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packages, environment = tmp_path / "site-packages", tmp_path / "environment"
    for name in (*ours, "vtkmodules"):
        (packages / name).mkdir(parents=True)
    environment.mkdir()
    monkeypatch.setattr(programs, "_home", lambda: packages)
    for _ in range(2):
        linked, *others = programs.python_path(programs.ParaView(tmp_path, (6, 0), (3, 12)), environment, {})
        assert others == [str(environment)]
        assert sorted(os.listdir(linked)) == ours
        assert all((Path(linked) / name).resolve() == packages / name for name in ours)


@pytest.mark.parametrize(
    ("folder", "version", "program", "needed"),
    [
        ("usr", (5, 11), "pvpython", True),
        ("usr", (5, 11), "pvserver", True),
        ("ParaView-5.13.0-osmesa-MPI-Linux", (5, 13), "pvbatch", False),
        ("ParaView-5.13.0-MPI-Linux", (5, 13), "pvbatch", True),
        ("ParaView-6.0.0-MPI-Linux", (6, 0), "pvbatch", False),
        ("ParaView-6.0.0-MPI-Linux", (6, 0), "paraview", True),
    ],
)
def test_a_display_is_made_only_where_it_is_needed(folder: str, version, program: str, needed: bool) -> None:
    assert programs.needs_display(programs.ParaView(Path("/") / folder / "bin", version, (3, 10)), program) == needed


def test_without_xvfb_one_sentence_says_what_to_do(prepared: Path) -> None:
    done = run("pvpython", DISPLAY="", PATH="/nowhere")
    assert done.returncode == 2
    assert "install Xvfb" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_displays_do_not_collide() -> None:
    displays = [programs.start_display() for _ in range(3)]
    try:
        assert len({name for _, name in displays}) == 3
    finally:
        for server, _ in displays:
            server.terminate()
            server.wait()


def test_the_shim_runs_the_sitecustomize_that_it_hides(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.theirs = True\n")
    script = "import inspect, sys; print(sys.theirs, inspect.getargspec(lambda a, b: 0).args)"
    path = os.pathsep.join([str(ROOT / "plugin" / "compat"), str(tmp_path)])
    done = subprocess.run([sys.executable, "-c", script], env={"PYTHONPATH": path}, capture_output=True, text=True)
    assert done.stdout.strip() == "True ['a', 'b']", done.stderr


def test_a_prepared_environment_is_not_prepared_again(
    paraview: programs.ParaView, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prepare, "_fill", lambda *arguments: pytest.fail("installed again"))
    assert str(programs.environment_folder(paraview)) in prepare.prepare()


def test_a_failed_preparation_leaves_what_was_there(prepared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(paraview: programs.ParaView, folder: Path, *rest: object) -> str:
        (folder / "half").touch()
        raise BadInput("no network")

    monkeypatch.setattr(prepare, "_fill", fail)
    environment = programs.environment_folder(programs.find())
    with pytest.raises(BadInput, match="no network"):
        prepare.prepare()
    assert [path.name for path in environment.parent.iterdir()] == [environment.name]
    assert [path.name for path in environment.iterdir()] == [programs.STAMP]


def test_a_second_vtk_in_the_environment_is_refused(prepared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prepare, "_fill", lambda paraview, folder, *rest: (folder / "matplotlib").mkdir())
    with pytest.raises(BadInput, match=r"second VTK \(matplotlib\)"):
        prepare.prepare()


def test_torch_and_paraviews_own_vtk_are_at_home_in_pvpython(paraview: programs.ParaView, pvpython: Callable) -> None:
    environment = programs.environment_folder(paraview)
    assert not programs.holds_second_vtk(environment)
    done = pvpython(
        "import importlib.util, numba, numpy, skimage, torch, svv, vtkmodules\n"
        "from paraview.simple import *\n"
        "grey = Calculator(Input=Wavelet(), Function='RTData/2')\n"
        "code = ProgrammableFilter(Input=grey)\n"
        "code.Script = \"output.PointData.append(inputs[0].PointData['Result'] * 2, 'x')\"\n"
        "print(code.PointData['x'].GetRange() == Wavelet().PointData['RTData'].GetRange())\n"
        "print(torch.__file__, svv.__file__, sep='\\n')\n"
        "print(vtkmodules.__file__)\n"
        "print(*[name for name in ('vtk', 'pyvista', 'matplotlib') if (importlib.util.find_spec(name) or "
        f"importlib.util.find_spec('os')).origin.startswith({str(environment)!r})])",
        own=True,
    )
    same, torch, svv, vtk, *ours = done.stdout.splitlines()[-5:]
    assert same == "True"
    assert Path(torch).is_relative_to(environment)
    assert Path(svv).resolve() == ROOT / "svv" / "__init__.py"
    assert not Path(vtk).is_relative_to(environment)
    assert ours == [""]


def is_on(display: str) -> bool:
    """Whether an X server answers there."""
    with socket.socket(socket.AF_UNIX) as client:
        return client.connect_ex(f"/tmp/.X11-unix/X{display.removeprefix(':')}") == 0


def ends(display: str) -> bool:
    until = time.monotonic() + LONG
    while is_on(display) and time.monotonic() < until:
        time.sleep(0.05)
    return not is_on(display)


@pytest.mark.slow
def test_without_a_display_pvpython_renders_on_one_that_ends_with_it(
    paraview: programs.ParaView, tmp_path: Path
) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import os, sys\n"
        "from paraview.simple import *\n"
        "Show(Sphere()); Render(); SaveScreenshot(sys.argv[1], ImageResolution=[64, 64])\n"
        "print('display', os.environ['DISPLAY'] or 'none')\n"
    )
    done = run("pvpython", script, tmp_path / "out.png", DISPLAY="")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out.png").stat().st_size > 500
    display = next(line for line in done.stdout.splitlines() if line.startswith("display")).split()[1]
    assert (display != "none") == programs.needs_display(paraview, "pvpython")
    assert ends(display)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=["Ctrl-C", "killed"])
def test_signals_reach_the_program_and_end_its_display(paraview: programs.ParaView, tmp_path: Path, number) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import os, signal, time\n"
        "signal.signal(signal.SIGINT, lambda *_: os._exit(9))\n"  # as a script of the user may
        # pvpython keeps what is printed, whatever is flushed, where Python is not told to be unbuffered.
        "os.write(1, (os.environ['DISPLAY'] or 'none').encode() + b'\\n')\n"
        "while True: time.sleep(0.05)\n"
    )
    command = [*SVV, "pvpython", str(script)]
    environ = {**os.environ, "DISPLAY": ""}
    with subprocess.Popen(command, cwd=ROOT, env=environ, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            display = process.stdout.readline().strip()
            assert is_on(display) == programs.needs_display(paraview, "pvpython")
            process.send_signal(number)
            assert process.wait(LONG) == (9 if number == signal.SIGINT else -signal.SIGKILL)
        finally:
            process.kill()
    assert ends(display)


def test_torch_calculates_with_its_own_linear_algebra(pvpython) -> None:
    # Debian's ParaView brings OpenBLAS into the process, whose sgemm torch would be given by the dynamic linker.
    source = """
import sys
import svv.pv
flags = sys.getdlopenflags()
assert "torch" not in sys.modules
import torch
assert sys.getdlopenflags() == flags
print("product", (torch.ones(64, 64) @ torch.ones(64, 64))[0, 0].item(), "mkl" in torch.__config__.show())
"""
    done = pvpython(source, environ={"MKL_VERBOSE": "1"})
    assert "product 64.0" in done.stdout
    if "product 64.0 True" in done.stdout:  # a torch that was built with MKL says when that calculates
        assert "SGEMM" in done.stdout, "another library's matrix product"


def test_views_are_drawn_on_all_processors_and_paraviews_limit_stays(pvpython) -> None:
    pvpython("""
from vtkmodules.vtkCommonCore import vtkMultiThreader
from paraview import simple
from svv.dvr.draw import casters
before = vtkMultiThreader.GetGlobalMaximumNumberOfThreads()
with casters.all_threads():
    assert vtkMultiThreader.GetGlobalMaximumNumberOfThreads() == 0
assert vtkMultiThreader.GetGlobalMaximumNumberOfThreads() == before
""")
