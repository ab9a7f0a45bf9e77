"""The cache between runs: it is bounded, shared by processes, never an obstacle, and can be listed and cleared."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from svv.errors import BadInput
from svv.io.files.cache import LEFT_BEHIND, Cache, bytes_in, cache_folder
from svv.io.files.keyed_results import digest
from svv.pv.results.keys import name_of


def name(number: int, kind: str = "scene") -> str:
    return name_of(kind, digest(number), digest("settings"))


def write(cache: Cache, number: int, size: int, age: float = 0.0) -> str:
    said = cache.write(name(number), lambda path: _filled(path, size))
    if not said:
        then = time.time() - age
        os.utime(cache.folder / name(number), (then, then))
    return said


def _filled(path: Path, size: int) -> None:
    path.write_bytes(b"x" * size)


def _read(path: Path) -> int:
    content = path.read_bytes()
    if content.strip(b"x"):
        raise BadInput(f"{path} is damaged.")
    return len(content)


def there(cache: Cache) -> set[str]:
    return {entry.path.name for entry in cache.entries()}


def test_the_least_recently_used_gives_way_and_never_the_newest(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "kept", 250)
    for number, age in enumerate((300, 200)):
        assert write(cache, number, 100, age) == ""
    assert cache.read(name(0), _read) == 100  # which makes it the last that was used
    assert write(cache, 2, 100) == ""
    assert there(cache) == {name(0), name(2)}
    assert write(cache, 3, 1000) == ""
    assert there(cache) == {name(3)}
    assert write(cache, 4, 10) == ""
    assert there(cache) == {name(4)}


def test_folders_count_with_all_that_is_in_them(tmp_path: Path) -> None:
    cache = Cache(tmp_path, 10_000)

    def write_folder(path: Path) -> None:
        (path / "train").mkdir(parents=True)
        _filled(path / "train" / "0.png", 70)
        _filled(path / "transforms_train.json", 7)

    for _ in range(2):  # a folder takes the place of one
        assert cache.write(name(0, "views"), write_folder) == ""
    (entry,) = cache.entries()
    assert entry.bytes == 77 and entry.path.is_dir()
    assert cache.clear() == 77 and not list(tmp_path.iterdir())


def test_what_is_damaged_is_removed_and_names_that_are_none_hold_nothing(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "kept", 1000)
    write(cache, 0, 10)
    (cache.folder / name(0)).write_bytes(b"other")
    assert cache.read(name(0), _read) is None and there(cache) == set()
    (tmp_path / "secret").write_bytes(b"xx")
    for foreign in ("../secret", str(tmp_path / "secret"), "", ".", "scene.svv"):
        assert not cache.holds(foreign) and cache.read(foreign, _read) is None


def test_files_of_others_are_left_alone(tmp_path: Path) -> None:
    cache = Cache(tmp_path, 50)
    for foreign in ("notes.txt", "scene.svv", ".hidden"):
        _filled(tmp_path / foreign, 100)
    write(cache, 0, 40)
    assert there(cache) == {name(0)}
    assert cache.clear() == 40
    assert {path.name for path in tmp_path.iterdir()} == {"notes.txt", "scene.svv", ".hidden"}


def test_what_a_killed_run_left_behind_goes_in_time(tmp_path: Path) -> None:
    cache = Cache(tmp_path, 1000)
    old, new = (tmp_path / f".{name(1)}-{word}" for word in ("old", "new"))
    for path in (old, new):
        _filled(path, 10)
    then = time.time() - LEFT_BEHIND - 60
    os.utime(old, (then, then))
    write(cache, 0, 10)
    assert not old.exists() and new.exists()  # another process may be at it
    assert there(cache) == {name(0)}
    cache.clear()
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_said_and_raises_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    said = write(Cache(tmp_path / "file" / "kept", 1000), 0, 10)
    assert said.startswith("It could not be kept for saved states: Cannot write") and said.endswith(".")
    assert "SVV_CACHE_SIZE is 0" in write(Cache(tmp_path / "kept", 0), 0, 10)
    assert Cache(tmp_path / "nowhere", 10).entries() == [] and Cache(tmp_path / "nowhere", 10).clear() == 0

    def fails(path: Path) -> None:
        _filled(path, 3)
        raise OSError(28, "No space left on device", str(path))

    cache = Cache(tmp_path / "full", 1000)
    assert "disk is full" in cache.write(name(0), fails)
    assert not list(cache.folder.iterdir())


def test_several_processes_keep_within_the_bound(tmp_path: Path) -> None:
    script = (
        "import sys\nfrom pathlib import Path\n"
        "from svv.io.files.cache import Cache\nfrom svv.io.files.keyed_results import digest\n"
        "from svv.pv.results.keys import name_of\n"
        "cache = Cache(Path(sys.argv[1]), 500)\n"
        "for number in range(60):\n"
        "    name = name_of('scene', digest(number % 9), digest('settings'))\n"
        "    said = cache.write(name, lambda path: path.write_bytes(b'x' * 100))\n"
        "    assert said == '', said\n"
        "    assert cache.read(name, lambda path: len(path.read_bytes()) == 100 or sys.exit(3)) in (True, None)\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    for process in both:
        _, err = process.communicate(timeout=600)
        assert process.returncode == 0, err
    cache = Cache(tmp_path, 500)
    write(cache, 100, 100)
    assert 0 < sum(entry.bytes for entry in cache.entries()) <= 500
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_place_and_bound_come_from_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SVV_CACHE", raising=False)
    monkeypatch.delenv("SVV_CACHE_SIZE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert Cache.of_user() == Cache(cache_folder() / "scenes", 2_000_000_000)
    monkeypatch.setenv("SVV_CACHE", str(tmp_path / "own"))
    monkeypatch.setenv("SVV_CACHE_SIZE", "1.5G")
    assert Cache.of_user() == Cache(tmp_path / "own", 1_500_000_000)


SIZES = [("0", 0), ("500", 500), ("20 MB", 20_000_000), ("3k", 3000), ("1T", 10**12)]


@pytest.mark.parametrize(("text", "size"), SIZES)
def test_sizes(text: str, size: int) -> None:
    assert bytes_in(text) == size


@pytest.mark.parametrize("text", ["", "much", "-1", "1 G B", "nan"])
def test_what_is_no_size(text: str) -> None:
    with pytest.raises(BadInput, match="SVV_CACHE_SIZE must be a number of bytes such as 500M or 2G"):
        bytes_in(text)


def test_the_command_shows_and_clears(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "kept", 1000)
    write(cache, 0, 1_500_000)

    def svv(*arguments: str, **environ: str) -> subprocess.CompletedProcess[str]:
        variables = {**os.environ, "SVV_CACHE": str(cache.folder), "SVV_PYRAMIDS": str(tmp_path / "coarse"), **environ}
        command = [sys.executable, "-m", "svv", "cache", *arguments]
        return subprocess.run(command, env=variables, capture_output=True, text=True, timeout=600)

    shown = svv("--json", str(tmp_path / "cache.json"), "results", "pyramids")
    assert shown.returncode == 0
    first, second, last = shown.stdout.splitlines()
    assert first.split()[:4] == ["results", "1", "1.5", "MB"] and f"in {cache.folder} (SVV_CACHE)" in first
    assert second.split()[:4] == ["pyramids", "0", "0.0", "MB"] and "at most 50000 MB (SVV_PYRAMIDS_SIZE)" in second
    assert last.split() == ["all", "1", "1.5", "MB"]
    told = json.loads((tmp_path / "cache.json").read_text())
    results, _ = told["kinds"]
    assert results["folder"] == str(cache.folder) and results["bound"] == 2_000_000_000
    assert told["bytes"] == results["bytes"] == 1_500_000
    assert [entry["path"] for entry in results["entries"]] == [str(cache.folder / name(0))]
    cleared = svv("--clear", "results")
    assert cleared.stdout.split() == ["results", "1", "1.5", "MB", "removed"] and there(cache) == set()
    alone = svv("--dry-run")
    assert alone.returncode == 2 and alone.stderr == "svv: --dry-run says what --clear would remove: give both.\n"
    bad = svv(SVV_CACHE_SIZE="much")
    assert bad.returncode == 2 and bad.stderr.count("\n") == 1 and "not 'much'" in bad.stderr
