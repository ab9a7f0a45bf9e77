"""Disks that fail; the long form is ``python -m campaign.failing_io``."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from campaign.calls import watched
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import atomic_path, make_folder
from svv.io.files.cache import Cache
from svv.io.views.viewset import ViewSet
from svv.job.demo import generate
from svv.options.cinema import ExportOptions
from svv.render.cinema import write_database
from svv.render.frames import orbit, write_movie
from svv.render.web.page import write_html
from tests.ranked import fog_views
from tests.test_kills import campaign

NAME = "scene-" + "0" * 20 + "-" + "0" * 20 + "-1.svv"


@pytest.mark.slow
def test_every_call_of_a_command_may_fail(tmp_path: Path) -> None:
    said = campaign("failing_io", "--command", "edit", "--one-error", "--out", tmp_path / "failing.json")
    assert ", 0 with something wrong" in said


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # the pipe to the encoder
def test_writers_say_so_and_leave_nothing(
    small_files: None, tmp_path: Path, cube: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    cameras = orbit(cube, 20, 64, 64)
    writers = {
        "a.mp4": lambda path: write_movie(path, cube, cameras),
        "a.html": lambda path: write_html(path, cube, "cube"),
        "a.svv": cube.save,
        "volume.vti": lambda path: generate(Path(path).parent, 32),
    }
    for name, write in writers.items():
        with pytest.raises(BadInput, match="Cannot write"):
            write(tmp_path / name)
        assert list(tmp_path.iterdir()) == [], name
    with pytest.raises(BadInput, match="Cannot write"):
        fog_views().write(tmp_path / "views")
    assert [path.name for path in (tmp_path / "views").rglob("*")] == []


def test_a_cache_that_fails_at_any_call_is_only_a_remark(tmp_path: Path, cube: Scene) -> None:
    views = fog_views()
    kept = {NAME: cube.save, NAME.replace("scene", "views").removesuffix(".svv"): views.write}
    for name, write in kept.items():
        for number in itertools.count():
            cache, count = Cache(tmp_path / f"{name[:5]}{number}", 10**9), itertools.count()

            def seen(kind: str, path: str, number: int = number, count: Iterator[int] = count) -> None:
                if next(count) == number:
                    raise OSError(5, "Input/output error", path)

            with watched(str(tmp_path), seen):
                said = cache.write(name, write)
            if next(count) <= number:  # the run has fewer calls than that: all have failed once
                assert said == ""
                break
            found = cache.read(name, Scene.load if name == NAME else ViewSet.read)
            assert found is not None or said.startswith("It could not be kept for saved states: "), (number, said)
            assert said.count(".") < 40 and "\n" not in said
        assert number > 8


def test_an_output_whose_folder_vanishes_is_one_sentence(tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "network")
    with pytest.raises(BadInput, match="its folder does not exist"):
        with atomic_path(folder / "a.json") as temporary:
            temporary.unlink()
            folder.rmdir()


def test_a_full_disk_in_a_database_is_one_sentence_and_it_goes_on(tmp_path: Path, cube: Scene) -> None:
    path, options = tmp_path / "a.cdb", ExportOptions(phi=3, theta=1, size=16)
    count = itertools.count()

    def seen(kind: str, place: str) -> None:
        if kind == "write" and next(count) >= 12:
            raise OSError(28, os.strerror(28))

    with watched(str(tmp_path), seen), pytest.raises(BadInput, match="disk is full"):
        write_database(path, cube, options)
    assert not path.exists()
    write_database(path, cube, options)
    assert [p.name for p in tmp_path.iterdir()] == ["a.cdb"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # the pipe to the encoder
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="mounting a small disk needs root")
def test_a_disk_that_is_really_full(tmp_path: Path, cube: Scene) -> None:
    place = make_folder(tmp_path / "disk")
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "svv", place], capture_output=True).returncode:
        pytest.skip("nothing can be mounted in this container")
    try:
        cube.save(place / "a.svv")
        (place / "rest").write_bytes(bytes(os.statvfs(place).f_bavail * os.statvfs(place).f_bsize))
        before = (place / "a.svv").read_bytes()
        for write in (cube.save, lambda path: write_movie(path.with_suffix(".mp4"), cube, orbit(cube, 20, 64, 64))):
            with pytest.raises(BadInput, match=r"disk (is )?full"):
                write(place / "a.svv")
        assert (place / "a.svv").read_bytes() == before
        assert sorted(path.name for path in place.iterdir()) == ["a.svv", "rest"]
    finally:
        subprocess.run(["umount", place], check=True)


def test_an_array_for_which_the_disk_has_no_room_is_a_sentence(tmp_path: Path) -> None:
    """NumPy gives no reason of the system's if only the beginning of an array could be written."""
    program = (
        "import resource, sys, numpy as np; from svv.io.files.atomic import cannot_write\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))\n"
        "try: np.save(sys.argv[1], np.zeros(5000))\n"
        "except OSError as error: print(cannot_write(sys.argv[1], error))\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path / "a.npy")], capture_output=True, text=True)
    said = "only a part of it could be written; free some space or choose another place."
    assert done.stdout == f"Cannot write {tmp_path / 'a.npy'}: {said}\n", done.stderr
