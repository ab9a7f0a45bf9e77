"""What a power failure may leave; the long form is ``python -m campaign.power_loss``."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from campaign.calls import watched
from campaign.power_loss import Disk
from svv.bricks.formats.source import ArraySource
from svv.bricks.pyramid import with_pyramid
from svv.errors import BadInput, silent
from svv.io.files.atomic import atomic_path, make_folder
from tests.test_kills import campaign


@pytest.mark.slow
def test_results_open_whenever_power_fails() -> None:
    said = campaign("power_loss", "--command", "views,render")
    assert said == "render again: 1 states, 0 wrong"


def test_the_disk_of_the_campaign_finds_what_is_not_synced(tmp_path: Path) -> None:
    folder = tmp_path / "w"
    folder.mkdir()
    (folder / "old.json").write_text("{}")
    disk = Disk(folder, tmp_path / "crashed")
    with watched(str(folder), disk.seen):
        (folder / "new.tmp").write_text("{}")
        os.replace(folder / "new.tmp", folder / "new.json")  # neither content nor name is synced
    disk.check("the end")
    assert set(disk.least()) == {"old.json"}
    assert len(disk.wrong) == 1 and "without content that is not synced: new.json" in disk.wrong[0]


def test_a_file_and_its_name_and_its_folders_are_on_disk_when_it_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "w"
    folder.mkdir()
    disk = Disk(folder, tmp_path / "crashed")
    with watched(str(folder), disk.seen):
        with atomic_path(make_folder(folder / "a" / "b") / "c.json") as temporary:
            temporary.write_text("[]")
    disk.check("the end")
    assert disk.wrong == []
    assert disk.least() == {"a/b/c.json": b"[]"}


def test_folders_that_cannot_be_synced_are_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.fsync

    def fsync(file: int) -> None:
        if os.path.isdir(f"/proc/self/fd/{file}"):
            raise OSError(22, "Invalid argument")  # as on some network folders
        real(file)

    monkeypatch.setattr("os.fsync", fsync)
    with atomic_path(tmp_path / "a.txt") as temporary:
        temporary.write_text("a")
    assert (tmp_path / "a.txt").read_text() == "a"


def test_voxels_of_a_pyramid_count_only_once_they_are_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SVV_PYRAMIDS", str(tmp_path / "pyramids"))
    values = np.arange(80**3, dtype=np.float32).reshape(80, 80, 80)
    np.save(tmp_path / "v.npy", values)
    real = os.fsync

    def fsync(file: int) -> None:
        if os.readlink(f"/proc/self/fd/{file}").endswith(".raw"):
            raise OSError(5, "Input/output error")
        real(file)

    with monkeypatch.context() as patch, pytest.raises(BadInput, match="Cannot write"):
        patch.setattr("os.fsync", fsync)
        with_pyramid(ArraySource(values), tmp_path / "v.npy", silent)
    (ranges,) = (tmp_path / "pyramids").glob(".*/ranges.npy")
    assert np.isnan(np.load(ranges)).all()
    made = with_pyramid(ArraySource(values), tmp_path / "v.npy", silent)
    assert made.range == (0.0, 80.0**3 - 1)
