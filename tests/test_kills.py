"""Commands that are killed, and what is left of their work; the long form is ``python -m campaign.kills``."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svv.errors import Cancelled
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.job.stages import Stages
from svv.options.cinema import ExportOptions
from svv.render import cinema
from svv.render.cinema import write_database
from tests.ranked import fog_views


def campaign(module: str, *arguments: object) -> str:
    """Run a campaign; it fails if anything is wrong."""
    command = [sys.executable, "-m", f"campaign.{module}", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.splitlines()[-1]


@pytest.mark.slow
def test_killed_commands_go_on(tmp_path: Path) -> None:
    said = campaign("kills", "--command", "train,cinema", "--times", 4, "--out", tmp_path / "kills.json")
    assert said.startswith("8 kills of 2 commands, 0 with something wrong")


def test_a_killed_stage_does_not_pass_for_one_with_the_settings_of_before(tmp_path: Path) -> None:
    out = tmp_path / "result.txt"

    def job(size: int, dies: bool = False) -> bool:
        def work(progress: object) -> None:
            out.write_text(f"{size}")
            if dies:
                raise Cancelled

        return Stages(tmp_path).do("draw", "Drawing", {"size": size}, [out], work)

    assert job(1) and not job(1)
    with pytest.raises(Cancelled):
        job(2, dies=True)
    assert job(1), "the result of size 2 passed for that of size 1"
    assert out.read_text() == "1"


def test_new_images_never_stand_beside_old_cameras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = fog_views()
    old.write(tmp_path)
    real, moved = os.replace, list[object]()

    def dies(source: object, target: object) -> None:
        if len(moved) == 3:
            raise KeyboardInterrupt
        moved.append(target)
        real(source, target)  # type: ignore[call-overload]

    new = replace(old, images=255 - old.images)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("os.replace", dies)
        new.write(tmp_path)
    assert moved and not (tmp_path / "transforms_train.json").exists()
    new.write(tmp_path)
    assert np.array_equal(ViewSet.read(tmp_path).images, new.images)
    assert {path.name for path in tmp_path.iterdir()} == {"train", "transforms_train.json"}


def test_views_that_cannot_be_written_leave_the_old_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = fog_views()
    old.write(tmp_path)

    def full(path: Path) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(ValueError, match="disk is full"):
        patch.setattr("svv.io.views.viewset.sync", full)
        replace(old, images=255 - old.images).write(tmp_path)
    assert np.array_equal(ViewSet.read(tmp_path).images, old.images)


def test_a_database_that_is_killed_at_its_end_is_not_rendered_again(
    tmp_path: Path, cube: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, options = tmp_path / "cube.cdb", ExportOptions(phi=2, theta=1, size=16)
    real = Path.rename

    def dies(self: Path, target: Path) -> Path:
        if Path(target) == path:
            raise KeyboardInterrupt
        return real(self, target)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Path, "rename", dies)
        write_database(path, cube, options)
    with monkeypatch.context() as patch:
        patch.setattr(Scene, "render", lambda *_, **__: pytest.fail("rendered again"))
        assert write_database(path, cube, options) == 2
    assert sorted(file.name for file in tmp_path.iterdir()) == ["cube.cdb"]
    assert not (path / cinema.KEY).exists()


def test_a_database_stays_if_the_new_one_cannot_take_its_place(
    tmp_path: Path, cube: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "cube.cdb"
    write_database(path, cube, ExportOptions(phi=2, theta=1, size=16))
    real = Path.rename

    def fails(self: Path, target: Path) -> Path:
        if self.name.endswith(".partial"):
            raise OSError(5, "Input/output error", str(self))
        return real(self, target)

    with monkeypatch.context() as patch, pytest.raises(ValueError, match="Cannot write"):
        patch.setattr(Path, "rename", fails)
        write_database(path, cube, ExportOptions(phi=3, theta=1, size=16))
    assert len((path / "data.csv").read_text().splitlines()) == 3


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGINT])
def test_asked_to_end_a_program_says_how_to_go_on(sent: signal.Signals) -> None:
    program = (
        "import os, signal, sys\n"
        "from svv.ending import end_with\n"
        "from svv.progress import shown\n"
        "def work():\n"
        "    with shown('Work') as progress:\n"
        f"        os.kill(os.getpid(), {int(sent)})\n"
        "        print('a consistent state')\n"
        "        progress(0.5, 'half')\n"
        "        print('not reached')\n"
        "end_with(work, 'svv')\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (130, "a consistent state\n")
    assert done.stderr.splitlines()[-1] == "svv: stopped; run the same command again to resume."
    assert "Traceback" not in done.stderr


def test_a_damaged_record_of_stages_is_no_record(tmp_path: Path) -> None:
    (tmp_path / "stages.json").write_text('{"draw": {"key": "')
    assert Stages(tmp_path).do("draw", "Drawing", {}, [], lambda progress: None)
    assert set(json.loads((tmp_path / "stages.json").read_text())) == {"draw"}
