"""Drawing views that is interrupted, or shared: nothing is drawn twice, and the result is that of one drawing."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from svv.dvr.draw.casters import CpuMapper
from svv.errors import BadInput, Cancelled, Progress, silent
from svv.io.files.keyed_results import key_of
from svv.io.views.drawn_views import RECORD
from svv.io.views.viewset import ViewSet
from svv.job.source import VolumeSource
from svv.job.stages import fingerprint
from svv.options.making import ViewOptions
from tests.stirred_volume import stirred_transfer_function
from tests.volume_files import write_function, write_volume

OPTIONS = ViewOptions(n=4, test=2, size=32, mapper="cpu")


@pytest.fixture
def source(tmp_path: Path) -> VolumeSource:
    return VolumeSource(write_volume(tmp_path / "ball.vti"), write_function(tmp_path / "tf.json"))


@pytest.fixture
def cast(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Widths of the views that were drawn."""
    widths: list[int] = []
    render = CpuMapper.render

    def counted(self: CpuMapper, camera: object) -> np.ndarray:
        widths.append(camera.width)  # type: ignore[attr-defined]
        return render(self, camera)  # type: ignore[arg-type]

    monkeypatch.setattr(CpuMapper, "render", counted)
    return widths


def stop_after(views: int) -> Progress:
    """Progress that is cancelled after some of the six views."""

    def progress(fraction: float, label: str) -> None:
        seen.append(label == "Rendering views")
        if sum(seen) == views:
            raise Cancelled

    seen: list[bool] = []
    return progress


def same(one: Path, other: Path) -> None:
    for split in ("train", "test"):
        a, b = ViewSet.read(one, split), ViewSet.read(other, split)
        np.testing.assert_array_equal(a.images, b.images)
        assert a.meta.sample_distance == b.meta.sample_distance


def test_an_interrupted_drawing_goes_on(source: VolumeSource, cast: list[int], tmp_path: Path) -> None:
    source.make_views(tmp_path / "whole", OPTIONS, silent)
    cast.clear()
    with pytest.raises(Cancelled):
        source.make_views(tmp_path / "out", OPTIONS, stop_after(4))
    assert cast.count(32) == 4
    (tmp_path / "out" / ".drawing" / "00001.npy").write_bytes(b"half a vi")  # after a power failure
    cast.clear()
    source.make_views(tmp_path / "out", OPTIONS, silent)
    assert cast == [32, 32, 32], "the damaged view, the last two, and no picture that finds the sample distance"
    same(tmp_path / "out", tmp_path / "whole")
    assert not (tmp_path / "out" / ".drawing").exists()


@pytest.mark.parametrize("what", ["size", "transfer function", "volume"])
def test_views_of_something_else_are_drawn_again(
    what: str, source: VolumeSource, cast: list[int], tmp_path: Path
) -> None:
    with pytest.raises(Cancelled):
        source.make_views(tmp_path / "out", OPTIONS, stop_after(4))
    options = ViewOptions(n=4, test=2, size=33 if what == "size" else 32, mapper="cpu")
    if what == "transfer function":
        write_function(tmp_path / "tf.json", stirred_transfer_function().mapped(0.9, 0.0))
    if what == "volume":
        write_volume(tmp_path / "ball.vti", 25)
    cast.clear()
    source.make_views(tmp_path / "out", options, silent)
    assert cast.count(options.size) == 6


def test_a_full_disk_is_one_sentence_and_what_was_drawn_stays(
    source: VolumeSource, cast: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save: Callable[..., None] = np.save

    def full(file: object, array: np.ndarray) -> None:
        if cast.count(32) > 3:
            raise OSError(28, "No space left on device")
        save(file, array)

    with monkeypatch.context() as patched:
        patched.setattr("svv.io.views.drawn_views.np.save", full)
        with pytest.raises(BadInput, match="disk is full"):
            source.make_views(tmp_path / "out", OPTIONS, silent)
    cast.clear()
    source.make_views(tmp_path / "out", OPTIONS, silent)
    assert cast.count(32) == 3


def test_a_folder_of_chunks_is_identified_by_all_of_them(tmp_path: Path) -> None:
    chunk = tmp_path / "a.zarr" / "0" / "c" / "0"
    chunk.parent.mkdir(parents=True)
    chunk.write_bytes(b"a")
    before = key_of(fingerprint(tmp_path / "a.zarr"))
    assert key_of(fingerprint(tmp_path / "a.zarr")) == before
    chunk.write_bytes(b"ab")
    assert key_of(fingerprint(tmp_path / "a.zarr")) != before


def test_what_could_not_be_removed_at_first_is_removed(
    source: VolumeSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A later run would find the views finished and leave it there for ever."""
    unlink = os.unlink
    failed: list[str] = []

    def failing(path: str, **where: int) -> None:
        if not failed and str(path).endswith(RECORD):
            failed.append(path)
            raise OSError(errno.EINTR, os.strerror(errno.EINTR), path)
        unlink(path, **where)

    monkeypatch.setattr(os, "unlink", failing)
    source.make_views(tmp_path / "views", OPTIONS, silent)
    assert failed and not list((tmp_path / "views").glob(".*"))
