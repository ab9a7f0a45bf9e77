"""Training in the background: what it gives, and how it ends."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import svv
from svv.errors import BadInput, Cancelled
from svv.fields.scene.scene import Scene
from svv.io.files.worker import PREFIX
from svv.io.scene_file import sketch_of
from svv.io.views.viewset import ViewSet
from svv.job.compile_ahead import ball_views
from svv.options.making import TrainOptions
from svv.render.web.following import Follower
from svv.train.run.config import preset
from svv.train.run.learning import Learning
from svv.train.run.sketches import SKETCHES
from tests.cube import cube_scene
from tests.ending import has_ended

QUICK = ("reconstruct.iterations=60", "recolour.iterations=6", "reconstruct.cells=32")
LONG = ("reconstruct.iterations=1000000",)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files, of this test alone."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture(scope="module")
def views() -> ViewSet:
    return ball_views()


@pytest.fixture
def long(views: ViewSet) -> Iterator[Learning]:
    """A training that does not end by itself."""
    learning = svv.train_scene(views, "draft", change=LONG, background=True)
    yield learning
    learning.stop()


def until(there: Callable[[], bool]) -> None:
    """Wait without taking the time of what is waited for."""
    while not there():
        time.sleep(0.02)


def until_sketched(learning: Learning) -> Scene:
    """The first sketch."""
    while learning.scene is None:
        assert not learning.done
        with pytest.raises(TimeoutError):
            learning.wait(0.1)
    return learning.scene


@pytest.mark.usefixtures("all_threads")
def test_what_is_trained_in_the_background_is_what_is_trained_here(views: ViewSet, tmp_path: Path) -> None:
    learning = svv.train_scene(views, "draft", change=QUICK, background=True, device="cpu", seed=3)
    told: list[float] = []
    heard: list[tuple[int, bool]] = []  # every scene and the end
    watching = learning.watch(lambda now: heard.append((now.number, now.done)))
    scene, report = learning.wait(progress=lambda fraction, label: told.append(fraction))
    watching.join()
    assert heard == sorted(heard) and heard[-1] == (2, True)
    here, expected = svv.train_scene(views, "draft", change=QUICK, device="cpu", seed=3)
    here.save(tmp_path / "here.svv")
    here = Scene.load(tmp_path / "here.svv")
    for (name, one), (other_name, other) in zip(scene.to_arrays()[1].items(), here.to_arrays()[1].items(), strict=True):
        assert name == other_name and np.array_equal(one, other), name
    assert report.keys() == expected.keys() and report["seed"] == 3 and report["notes"]
    assert told == sorted(told) and told[-1] == 1.0 and learning.progress == (1.0, "done")
    assert learning.done and learning.scene is scene and learning.number == 2  # after one sketch
    assert learning.wait()[0] is scene and not list(tmp_path.glob(f"{PREFIX}*"))


def test_it_gives_sketches_pauses_and_stops(long: Learning, folder: Path) -> None:
    sketch = until_sketched(long)
    assert sketch.palette_network is not None and long.number == 1 and not long.done
    until(lambda: long.progress[0] > 0.15)
    long.pause()
    until(lambda: long.progress[1] == "paused")
    fraction = long.progress[0]
    with pytest.raises(TimeoutError, match="goes on"):
        long.wait(1.0)
    assert long.progress == (fraction, "paused")
    long.go_on()
    until(lambda: long.progress[1] != "paused")
    process = long._worker.pid
    long.stop()
    assert has_ended(process) and long.done and long.scene is sketch and not list(folder.glob(f"{PREFIX}*"))
    with pytest.raises(Cancelled):
        long.wait()


def test_errors_are_one_sentence(views: ViewSet, long: Learning) -> None:
    with pytest.raises(BadInput, match="are too few to train on"):
        svv.train_scene(views.take([0, 1]), "draft", background=True)
    with pytest.raises(BadInput, match="name of a preset"):
        svv.train_scene(views, preset("draft"), background=True)  # type: ignore[call-overload]
    with pytest.raises(BadInput, match=r"needs the values of the volume"):
        svv.train_scene(views, "draft", encoding="values", background=True).wait()
    long._worker._process.send_signal(signal.SIGKILL)
    with pytest.raises(BadInput, match=r"has ended \(it was killed\): call train_scene again"):
        long.wait()


@pytest.mark.slow
def test_it_ends_with_the_script(tmp_path: Path) -> None:
    script = f"""
import svv
from svv.job.compile_ahead import ball_views
learning = svv.train_scene(ball_views(), "draft", change={LONG!r}, background=True)
print(learning._worker.pid, learning._worker.folder, flush=True)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    process, folder = done.stdout.split()
    assert has_ended(int(process)) and not Path(folder).exists()


@pytest.mark.slow
def test_a_killed_script_resumes(views: ViewSet, tmp_path: Path) -> None:
    checkpoint = tmp_path / "ball.checkpoint"
    learning = svv.train_scene(
        views, "draft", checkpoint=checkpoint, change=(*QUICK[::2], "recolour.iterations=1000000"), background=True
    )
    until(lambda: learning.done or checkpoint.exists())
    assert not learning.done, learning._error()
    learning.stop()
    with pytest.raises(Cancelled):
        learning.wait()
    assert checkpoint.exists()
    again = svv.train_scene(
        views, TrainOptions("draft", time_limit=1.0), checkpoint=checkpoint, change=QUICK, background=True
    )
    again.wait()
    assert not checkpoint.exists() and again.number == 1  # there was no need for a sketch


def test_few_views_from_all_sides(views: ViewSet) -> None:
    few = replace(SKETCHES[0], views=3, size=16).few(views)
    assert few.names == (views.names[0], views.names[2], views.names[5]) and few.images.shape == (3, 16, 16, 4)
    assert (few.images == views.images[[0, 2, 5], ::2, ::2]).all()
    assert [(c.width, c.height, c.fov_x) for c in few.cameras] == [(16, 16, views.cameras[0].fov_x)] * 3
    assert len(SKETCHES[1].few(views)) == 6 and SKETCHES[1].few(views).images.shape[1] == 32


@pytest.mark.usefixtures("small_stills")
def test_a_page_follows_a_file(tmp_path: Path) -> None:
    file = tmp_path / "cube.svv"
    follower = Follower(file)

    def state() -> dict[str, object]:
        return dict(json.loads(urllib.request.urlopen(f"{follower.address}state").read()))

    try:
        assert not follower.look() and state()["number"] == 0 and "svv train" in str(state()["said"])
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(f"{follower.address}scene")
        cube_scene().save(sketch_of(file))
        assert follower.look() and not follower.look()
        assert state() == {"number": 1, "said": "A sketch of cube.svv, which is being learned."}
        first = urllib.request.urlopen(f"{follower.address}scene?1").read()
        cube_scene().edited(0, colour=(0.0, 1.0, 0.0)).save(file)
        sketch_of(file).unlink()
        assert follower.look() and state() == {"number": 2, "said": "cube.svv"}
        assert b"<iframe" in urllib.request.urlopen(follower.address).read()
        assert urllib.request.urlopen(f"{follower.address}scene?2").read() != first
        with pytest.raises(BadInput, match="give another one"):
            Follower(file, int(follower.address.rsplit(":", 1)[1].strip("/")))
        file.write_bytes(b"nonsense")
        assert not follower.look() and "not a scene file" in str(state()["said"]) and state()["number"] == 2
    finally:
        follower.close()
