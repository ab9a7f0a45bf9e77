"""Locks on results: released by the system however a process ends, and files that a killed process leaves."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from svv.cli.app import app
from svv.errors import BadInput
from svv.io.files.atomic import atomic_path, partial_folder, write_json
from svv.io.files.locks import alone
from tests.cube import cube_scene

DIES = """
import os, signal, sys
from pathlib import Path
from svv.io.files.atomic import atomic_path, partial_folder
from svv.io.files.locks import alone
target = Path(sys.argv[1])
with alone(target), atomic_path(target) as temporary, partial_folder(target) as folder:
    temporary.write_bytes(b"half")
    (folder / "half").write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_only_one_holds_a_result(tmp_path: Path) -> None:
    out = tmp_path / "out.svv"
    with alone(out):
        with pytest.raises(BadInput, match=r"Another svv command is writing to .*out\.svv: wait"):
            with alone(out):
                pass
        with alone(tmp_path / "other.svv"):  # another result in the same folder is free
            pass
    with alone(out):
        pass
    assert names_in(tmp_path) == []


def test_a_folder_has_one_lock_by_whatever_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    with alone(tmp_path / "out"), pytest.raises(BadInput, match="Another svv command"):
        with alone(Path(".")):
            pass


def test_without_a_folder_there_is_no_lock(tmp_path: Path) -> None:
    with alone(tmp_path / "missing" / "out"):
        pass
    assert names_in(tmp_path) == []


def test_what_a_killed_process_leaves_is_removed_by_the_next(tmp_path: Path) -> None:
    target = tmp_path / "out.json"
    died = subprocess.run([sys.executable, "-c", DIES, str(target)])
    assert died.returncode == -signal.SIGKILL
    assert names_in(tmp_path) == [".out-partial.json", ".out.json-partial", ".out.json.lock"]
    with alone(target):
        with partial_folder(target) as folder:
            assert names_in(folder) == []
        write_json(target, {})
    assert names_in(tmp_path) == ["out.json"]


def test_two_writers_of_one_file_do_not_meet(tmp_path: Path) -> None:
    target = tmp_path / "out.txt"
    with atomic_path(target) as first, atomic_path(target) as second, partial_folder(target) as a:
        with partial_folder(target) as b:
            assert first != second and a != b
        first.write_text("first")
        second.write_text("second")
    assert target.read_text() == "first"  # the last one to end
    assert names_in(tmp_path) == ["out.txt"]


def test_a_link_of_the_temporary_name_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("precious")
    (tmp_path / ".out-partial.json").symlink_to("precious")
    write_json(tmp_path / "out.json", {})
    assert (tmp_path / "precious").read_text() == "precious"
    assert (tmp_path / "out.json").read_text() == "{}\n"


@pytest.mark.parametrize("name", ["ü" * 120 + ".json", "🐘" * 60 + ".json", "a" * 250 + ".json"])
def test_names_as_long_as_the_disk_allows(tmp_path: Path, name: str) -> None:
    with alone(tmp_path / name):
        write_json(tmp_path / name, {})
    assert names_in(tmp_path) == [name]


def test_a_command_refuses_a_result_that_another_one_writes(tmp_path: Path) -> None:
    scene, out = tmp_path / "cube.svv", tmp_path / "red.svv"
    cube_scene().save(scene)
    edit = ["edit", str(scene), "--region", "0", "--opacity", "0.5", "--out", str(out)]
    with alone(out), pytest.raises(BadInput, match="Another svv command is writing"):
        app(edit, standalone_mode=False)
    assert not out.exists()
    app(edit, standalone_mode=False)
    assert names_in(tmp_path) == ["cube.svv", "red.svv"]


def test_processes_without_locks_still_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locks(file: int, how: int) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr("fcntl.flock", no_locks)
    (tmp_path / ".out-partial.json").write_text("of a process that may live")
    with alone(tmp_path / "out.json"):
        write_json(tmp_path / "out.json", {})
    assert names_in(tmp_path) == [".out-partial.json", "out.json"]


def test_a_signal_in_between_leaves_nothing(tmp_path: Path) -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
    try:
        with pytest.raises(KeyboardInterrupt), alone(tmp_path / "x"), partial_folder(tmp_path / "x"):
            with atomic_path(tmp_path / "x.txt"):
                os.kill(os.getpid(), signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert names_in(tmp_path) == []
