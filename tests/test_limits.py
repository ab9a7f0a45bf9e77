"""Little memory, strange surroundings and strange names."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from svv.ending import NO_ADDRESSES, NO_MEMORY
from svv.errors import BadInput
from svv.io.files import memory
from svv.io.files.declared_sizes import arrays_of_npz, check_fits
from svv.io.files.memory import LEAST, memory_there
from tests.cube import cube_scene

GB = 1_000_000_000


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("limits") / "cube.svv"
    cube_scene().save(path)
    return path


def svv(
    *arguments: object, limit: int | None = None, before: Callable[[], object] | None = None, **environ: str | None
) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own, with an address space of ``limit`` bytes; None removes a variable."""

    def begin() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        if before is not None:
            before()

    environment = {name: value for name, value in {**os.environ, **environ}.items() if value is not None}
    command = [sys.executable, "-m", "svv", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=environment, preexec_fn=begin)


def sentence(done: subprocess.CompletedProcess[str]) -> str:
    """The last line of a command that ended with a sentence."""
    assert done.returncode == 2, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr.splitlines()[-1]


def test_an_address_space_too_small_for_the_libraries_is_one_sentence(scene: Path, tmp_path: Path) -> None:
    done = svv("render", scene, "--size", 16, "--out", tmp_path / "a.png", limit=GB)
    assert sentence(done).startswith("svv: The address space is limited to 1.0 GB, and svv needs 2 GB")


def test_a_picture_too_large_for_the_memory_is_one_sentence(scene: Path, tmp_path: Path) -> None:
    done = svv("render", scene, "--size", 16384, "--out", tmp_path / "a.png", limit=LEAST)
    assert sentence(done) in {f"svv: {said}" for said in (NO_MEMORY, NO_ADDRESSES)}  # the second with CUDA's libraries
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("files", "least"),
    [
        ({"proc/self/cgroup": "0::/job/step\n", "sys/fs/cgroup/job/memory.max": "1000\n"}, 1000),
        ({"proc/self/cgroup": "0::/job/step\n", "sys/fs/cgroup/job/step/memory.max": "max\n"}, None),
        ({"proc/self/cgroup": "0::/outside/name\n", "sys/fs/cgroup/memory.max": "2000\n"}, 2000),  # in a container
        ({"proc/self/cgroup": "5:cpu:/x\n4:memory:/x\n", "sys/fs/cgroup/memory/x/memory.limit_in_bytes": "3000"}, 3000),
        ({}, None),
    ],
)
def test_the_memory_of_control_groups_counts(files: dict[str, str], least: int | None, tmp_path: Path) -> None:
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    assert memory_there(tmp_path) == (least or memory_there(tmp_path / "nothing"))


@pytest.fixture
def container(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A control group that limits the memory to 1000 bytes."""
    (tmp_path / "proc/self").mkdir(parents=True)
    (tmp_path / "proc/self/cgroup").write_text("0::/\n")
    (tmp_path / "sys/fs/cgroup").mkdir(parents=True)
    (tmp_path / "sys/fs/cgroup/memory.max").write_text("1000\n")
    of_groups = memory._of_groups
    monkeypatch.setattr(memory, "_of_groups", lambda _: of_groups(tmp_path))


@pytest.mark.usefixtures("container")
def test_what_files_declare_is_compared_with_the_container_not_the_host(tmp_path: Path) -> None:
    check_fits(1000, "It")
    with pytest.raises(BadInput, match=r"It declares .* more than this computer's \(or this container's\) memory"):
        check_fits(1001, "It")
    for name, array in (("small", np.zeros((8, 8, 8), np.uint8)), ("large", np.zeros((11, 11, 11), np.uint8))):
        np.savez(tmp_path / f"{name}.npz", a=array)
        with (tmp_path / f"{name}.npz").open("rb") as file:
            if name == "small":
                assert set(arrays_of_npz(file, ["a"], [], ["a"], "It")) == {"a"}
            else:
                with pytest.raises(BadInput, match="It declares"):
                    arrays_of_npz(file, ["a"], [], ["a"], "It")


@pytest.mark.usefixtures("container")
def test_headers_for_vtk_are_compared_with_the_container_not_the_host(tmp_path: Path) -> None:
    pytest.importorskip("vtkmodules")
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLImageDataWriter

    from svv.dvr.read.grids import from_array
    from svv.dvr.read.vtk_readers import run

    for size in (8, 11):
        writer = vtkXMLImageDataWriter()
        writer.SetFileName(str(tmp_path / f"{size}.vti"))
        writer.SetInputData(from_array(np.arange(size**3).astype(np.uint8).reshape(size, size, size)))
        writer.Write()
    assert run(vtkXMLImageDataReader(), tmp_path / "8.vti").GetNumberOfPoints() == 512
    with pytest.raises(BadInput, match="gives 11 x 11 x 11 voxels, more than this computer's"):
        run(vtkXMLImageDataReader(), tmp_path / "11.vti")


@pytest.mark.parametrize(
    "environ",
    [
        pytest.param(
            {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0"},
            marks=pytest.mark.slow,
        ),
        {"OMP_NUM_THREADS": "64", "HOME": None, "XDG_CACHE_HOME": None, "SVV_CACHE": None},
        {"HOME": "/proc/none", "XDG_CACHE_HOME": None, "LC_ALL": "POSIX", "PYTHONCOERCECLOCALE": "0"},
    ],
    ids=["one thread and a plain locale", "64 threads and no home", "a home that cannot be written"],
)
def test_strange_surroundings(environ: dict[str, str | None], scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "größer als 'sonst' \"heute\".png"
    done = svv("render", scene, "--size", 16, "--out", out, **environ)
    assert done.returncode == 0, done.stderr
    assert out.stat().st_size


def test_one_core(scene: Path, tmp_path: Path) -> None:
    core = min(os.sched_getaffinity(0))
    done = svv(
        "render", scene, "--size", 16, "--out", tmp_path / "a.png", before=lambda: os.sched_setaffinity(0, [core])
    )
    assert done.returncode == 0, done.stderr


def test_a_folder_that_is_gone(scene: Path, tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()

    def leave() -> None:
        os.chdir(gone)
        gone.rmdir()

    done = svv("render", scene, "--size", 16, "--out", tmp_path / "a.png", before=leave)
    assert sentence(done) == "svv: The current folder no longer exists: change to another one."


@pytest.mark.parametrize(
    "name", ["with space", 'it\'s "quoted" $HOME;#', "größe-漢字-🐘", "two\nlines", "-o", "--help"]
)
def test_strange_names(name: str, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from svv.cli.app import app

    folder = tmp_path / name
    folder.mkdir()
    own = folder / f"{name}.svv"
    own.write_bytes(scene.read_bytes())
    app(["edit", str(own), "--region", "0", "--opacity", "0.5", "--out", str(folder / f"{name}2.svv")],
        standalone_mode=False)  # fmt: skip
    app(["render", str(own), "--orbit", "2", "--size", "16", "--out", str(folder / name)], standalone_mode=False)
    app(["render", str(own), "--orbit", "2", "--size", "16", "--out", str(folder / f"{name}.mp4")],
        standalone_mode=False)  # fmt: skip
    app(["export", str(own), "--phi", "1", "--theta", "1", "--size", "16", "--out", str(folder / f"{name}.cdb")],
        standalone_mode=False)  # fmt: skip
    assert {p.name for p in folder.iterdir()} == {name, *(f"{name}{end}" for end in (".svv", "2.svv", ".mp4", ".cdb"))}


@pytest.mark.slow
def test_a_path_of_four_thousand_characters(scene: Path, tmp_path: Path) -> None:
    name = "/".join(["a" * 199] * 20)
    done = svv("render", scene, "--size", 16, "--out", f"{tmp_path}/{name}.png")
    assert sentence(done).endswith(": its folder does not exist; create it or choose another place.")
    done = svv("render", scene, "--orbit", 2, "--size", 16, "--out", f"{tmp_path}/{name * 2}")
    assert sentence(done).endswith(": its name is too long for the disk; choose a shorter one.")
