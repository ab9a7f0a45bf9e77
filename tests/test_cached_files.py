"""What `svv cache` counts is what is on the disk, and nothing of it is left after `--clear` but what is at work."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from svv.cli.cache import KindName
from svv.io.files.cache import LEFT_BEHIND, Cache
from svv.io.files.keyed_results import digest
from svv.io.files.locks import create_held, is_held
from svv.io.files.temporary import temporary_folders, view_folder, work_folder
from svv.pv.results.keys import name_of
from tests.nightly import nightly

ROOT = Path(__file__).resolve().parents[1]
Run = Callable[..., subprocess.CompletedProcess[str]]

WRITES = """
import os, pathlib, sys, numpy as np, torch
from svv.bricks.opened import open_bricks
from svv.bricks.pyramid import pyramids, with_pyramid
from svv.errors import Cancelled
from svv.io.files.cache import Cache, cache_folder
from svv.io.files.keyed_results import digest
from svv.io.files.temporary import view_folder, work_folder
from svv.job import compile_ahead
from svv.pv.launch.programs import find
from svv.pv.results.keys import name_of
from svv.styles import networks, weights
from svv.styles.gallery import gallery_picture

volume = pathlib.Path("volume.nrrd")
volume.write_bytes(b"NRRD0004\\ntype: uint8\\ndimension: 3\\nsizes: 8 8 80\\nencoding: raw\\n\\n" + bytes(8 * 8 * 80))
with_pyramid(open_bricks(volume), volume, lambda fraction, label: None)
(pyramids().folder / ".pyramid-0123456789abcdef0123-0123456789abcdef0123-1").mkdir()
gallery_picture("stipple", 32)
networks.weights_folder().mkdir()
weights._keep("alexnet", {"a": torch.ones(9)}, "", "")
(networks.weights_folder() / networks.FAILED_FILE).touch()
compile_ahead._marker().parent.mkdir()
compile_ahead._marker().touch()
find("paraview")
(cache_folder() / "gpu").mkdir()
(cache_folder() / "gpu" / "0123.json").write_text("{}")
cache, name = Cache.of_user(), name_of("scene", digest(1), digest(2))
assert cache.write(name, lambda path: path.write_bytes(b"x" * 1000)) == ""
checkpoint, held = cache.hold_checkpoint(name)
checkpoint.write_bytes(b"x" * 5000)
(cache.folder / f".{checkpoint.name}-partial").write_bytes(b"x" * 70)  # a write that was killed
(view_folder() / "scene.html").write_text("page")
with work_folder() as folder:
    (folder / "volume.npy").write_bytes(b"x" * 300)
    os._exit(0)
"""
"""A program that writes files of all kinds, and ends in the midst of its work."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the packages, whose kernels may be removed."""
    folder = tmp_path_factory.mktemp("site")
    for package in (ROOT / "svv", ROOT / "bench" / "svv_bench"):
        shutil.copytree(package, folder / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture
def run(site: Path, tmp_path: Path) -> Run:
    """Runs Python with that package and folders of its own, and returns what it said."""
    program = tmp_path / "paraview" / "bin" / "pvpython"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\necho svv: 5.11.2 3 11\n")
    program.chmod(0o755)
    for name in ("home", "temporary"):
        (tmp_path / name).mkdir()
    places = {"XDG_CACHE_HOME": tmp_path / "home", "TMPDIR": tmp_path / "temporary", "PYTHONPATH": site}
    environ = {name: value for name, value in os.environ.items() if not name.startswith(("SVV_", "NUMBA_"))}

    def run(*words: str, **more: str) -> subprocess.CompletedProcess[str]:
        variables = {**environ, **{name: str(value) for name, value in places.items()}, **more}
        done = subprocess.run(
            [sys.executable, *words], env=variables, cwd=tmp_path, capture_output=True, text=True, timeout=600
        )
        assert done.returncode == 0, done.stderr
        return done

    return run


def on_disk(tmp_path: Path, site: Path) -> int:
    """Return the bytes in all folders to which the program writes, without byte code, which belongs to Python."""
    compiled = list(site.rglob("*.nb*"))
    files = [*(tmp_path / "home").rglob("*"), *(tmp_path / "temporary").rglob("*"), *compiled]
    files += (tmp_path / "numba").rglob("*")
    return sum(file.stat().st_size for file in files if file.is_file())


@pytest.mark.parametrize("elsewhere", nightly([False, True], False))
def test_all_that_is_written_is_counted_and_cleared(run: Run, site: Path, tmp_path: Path, elsewhere: bool) -> None:
    more = {"NUMBA_CACHE_DIR": str(tmp_path / "numba")} if elsewhere else {}
    run("-c", WRITES, **more)
    run("-m", "svv", "cache", "--json", "told.json", **more)
    told = json.loads((tmp_path / "told.json").read_text())
    kinds = {kind["kind"]: kind for kind in told["kinds"]}
    assert list(kinds) == [kind.value for kind in KindName]
    assert all(kind["entries"] for kind in kinds.values()), "a kind of which nothing was written proves nothing"
    assert told["bytes"] == sum(kind["bytes"] for kind in kinds.values()) == on_disk(tmp_path, site) > 10_000
    assert (tmp_path / "numba").exists() == elsewhere
    run("-m", "svv", "cache", "--clear", "--dry-run", **more)
    assert on_disk(tmp_path, site) == told["bytes"]
    said = run("-m", "svv", "cache", "--clear", **more).stdout
    assert on_disk(tmp_path, site) == 0 and "in use" not in said
    left = [path for place in ("home", "temporary") for path in (tmp_path / place).rglob("*") if path.is_file()]
    assert left == []


def test_what_is_printed_is_what_is_there_and_what_limits_it(run: Run, site: Path, tmp_path: Path) -> None:
    run("-c", WRITES)
    lines = run("-m", "svv", "cache", "results", "unfinished", "pictures", SVV_CACHE_SIZE="3G").stdout.splitlines()
    assert lines[0].split()[:4] == ["results", "1", "0.0", "MB"]
    assert f"at most 3000 MB with unfinished (SVV_CACHE_SIZE), in {tmp_path}/home/svv/scenes (SVV_CACHE)" in lines[0]
    assert lines[1].split()[:2] == ["unfinished", "3"] and "at most 3000 MB with results (SVV_CACHE_SIZE)" in lines[1]
    assert "at most 100 MB, in" in lines[2]
    assert lines[3].split()[:2] == ["all", "5"] and len(lines) == 4
    run("-m", "svv", "cache", "--clear", "unfinished")
    assert [path.name[:6] for path in (tmp_path / "home/svv/scenes").iterdir()] == ["scene-"]


def test_what_a_running_training_needs_stays_and_that_is_said(run: Run, tmp_path: Path) -> None:
    cache, name = Cache(tmp_path / "kept", 1000), name_of("scene", digest(1), digest(2))
    path, held = cache.hold_checkpoint(name)
    path.write_bytes(b"x" * 2_500_000)
    assert held is not None and [entry.held for entry in cache.unfinished()] == [True, True]
    said = run("-m", "svv", "cache", "--clear", SVV_CACHE=str(cache.folder)).stdout
    assert "  2 in use by a running process stay, 2.5 MB.\n" in said
    cache.trim()
    assert path.stat().st_size == 2_500_000
    os.close(held)
    run("-m", "svv", "cache", "--clear", SVV_CACHE=str(cache.folder))
    assert not list(cache.folder.iterdir())


def test_checkpoints_count_towards_the_bound(tmp_path: Path) -> None:
    cache = Cache(tmp_path, 1000)
    first, second, third = (name_of("scene", digest(number), digest(2)) for number in range(3))
    path, held = cache.hold_checkpoint(first)
    assert held is not None
    os.close(held)
    path.write_bytes(b"x" * 600)
    os.utime(path, (time.time() - 60,) * 2)
    assert cache.write(second, lambda path: path.write_bytes(b"x" * 300) and None) == "" and path.exists()
    assert cache.write(third, lambda path: path.write_bytes(b"x" * 300) and None) == "" and not path.exists()
    assert len(cache.entries()) == 2


def test_a_write_that_another_process_is_at_is_not_removed_for_room(tmp_path: Path) -> None:
    cache, name = Cache(tmp_path, 1000), name_of("scene", digest(1), digest(2))
    writing, killed = tmp_path / f".{name}-0123456789ab", tmp_path / f"..{name}-partial.svv-checkpoint"
    for path in (writing, killed):
        path.write_bytes(b"x" * 2000)
    cache.trim()
    assert writing.exists() and not killed.exists()
    os.utime(writing, (time.time() - LEFT_BEHIND - 60,) * 2)
    cache.trim()
    assert not writing.exists()


def test_a_finished_training_leaves_no_checkpoint(tmp_path: Path) -> None:
    cache, name = Cache(tmp_path, 1000), name_of("scene", digest(1), digest(2))
    path, held = cache.hold_checkpoint(name)
    path.touch()
    assert held is not None
    cache.remove_checkpoint(name)
    os.close(held)
    assert not list(tmp_path.iterdir())


def test_two_that_ask_at_once_do_not_take_each_other_for_holders(tmp_path: Path) -> None:
    held = create_held(tmp_path / "lock")
    assert held is not None and is_held(tmp_path / "lock")
    os.close(held)
    assert not is_held(tmp_path / "lock") and not is_held(tmp_path / "nowhere")
    ask = f"""import sys
from pathlib import Path
from svv.io.files.locks import is_held
sys.exit(any(is_held(Path({str(tmp_path / "lock")!r})) for _ in range(3000)))"""
    both = [subprocess.Popen([sys.executable, "-c", ask]) for _ in range(2)]
    assert [process.wait(timeout=600) for process in both] == [0, 0]


def test_temporary_folders_of_others_are_not_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for name in ("svv-mine", "svv-work-", "svv-work-short", "svv-data-abcdefgh", "other-work-abcdefgh"):
        (tmp_path / name).mkdir()
    with work_folder() as folder:
        assert temporary_folders() == [folder] and is_held(folder)
    assert temporary_folders() == []
    old = view_folder()
    os.utime(old, (time.time() - LEFT_BEHIND - 60,) * 2)
    new = view_folder()
    assert temporary_folders() == [new] and not old.exists() and len(list(tmp_path.iterdir())) == 6
