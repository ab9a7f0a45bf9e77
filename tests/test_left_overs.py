"""What other runs left in a folder: removed if svv wrote it, refused in a sentence if somebody else did."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from svv.cli.app import app
from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Cancelled
from svv.fields.scene.scene import Scene
from svv.io.files.keyed_results import make_keyed_folder
from svv.io.pictures.output import write_png
from svv.io.views.viewset import ViewSet, write_splits
from svv.job.stages import Stages
from svv.options.cinema import ExportOptions
from svv.render.cinema import write_database
from svv.render.frames import orbit, write_frames, write_frames_of
from tests.cube import cube_scene
from tests.ranked import fog_views


@pytest.fixture
def scene() -> Scene:
    return cube_scene()


def cameras(scene: Scene, count: int) -> list[Camera]:
    return orbit(scene, count, 16, 16)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_folder_holds_the_frames_of_one_orbit(scene: Scene, tmp_path: Path) -> None:
    write_frames(tmp_path / "six", scene, cameras(scene, 6))
    write_frames(tmp_path / "both", scene, cameras(scene, 12))
    (tmp_path / "both" / "notes.txt").write_text("mine")
    (tmp_path / "both" / "cover.png").write_bytes(b"mine, too")
    write_frames(tmp_path / "both", scene, cameras(scene, 6))
    found = contents(tmp_path / "both")
    assert found.pop("notes.txt") == b"mine" and found.pop("cover.png") == b"mine, too"
    assert found == contents(tmp_path / "six")


def test_the_command_does(scene: Scene, tmp_path: Path) -> None:
    scene.save(tmp_path / "cube.svv")
    for count in (5, 3):
        words = [
            "render",
            str(tmp_path / "cube.svv"),
            "--orbit",
            str(count),
            "--size",
            "16",
            "--out",
            str(tmp_path / "o"),
        ]
        assert CliRunner().invoke(app, words).exit_code == 0
        assert names(tmp_path / "o") == [f"{number:04d}.png" for number in range(count)]


def test_a_stopped_run_does_not_mix_two_scenes(scene: Scene, tmp_path: Path) -> None:
    write_frames(tmp_path, scene, cameras(scene, 6))
    before = contents(tmp_path)

    def stop(fraction: float, label: str) -> None:
        if label.startswith("view 2 "):
            raise Cancelled

    other = scene.edited(0, (0.0, 0.0, 0.0), None, None)
    with pytest.raises(Cancelled):
        write_frames(tmp_path, other, cameras(scene, 6), progress=stop)
    assert names(tmp_path) == ["0000.png", "0001.png"]
    assert all(before[name] != content for name, content in contents(tmp_path).items())
    there = contents(tmp_path)
    write_frames(tmp_path, other, cameras(scene, 6))  # goes on
    assert len(names(tmp_path)) == 6 and there.items() <= contents(tmp_path).items()


@pytest.mark.parametrize("ours", [False, True])
def test_pictures_of_others_are_refused_and_stay(scene: Scene, tmp_path: Path, ours: bool) -> None:
    if ours:
        write_frames(tmp_path, scene, cameras(scene, 4))
    for theirs in ("0007.png", "0009.png"):
        write_png(tmp_path / theirs, np.zeros((8, 8, 3), np.uint8))
    before = contents(tmp_path)
    for write in (
        lambda: write_frames(tmp_path, scene, cameras(scene, 3)),
        lambda: write_frames_of({tmp_path: scene}, cameras(scene, 3)),
        *([] if ours else [lambda: write_frames(tmp_path, scene, cameras(scene, 12))]),
    ):
        with pytest.raises(BadInput, match=r"did not write as frames \(0007\.png, 0009\.png\): choose another folder"):
            write()
    assert contents(tmp_path) == before


def test_processes_that_share_an_orbit_leave_each_others_frames(scene: Scene, tmp_path: Path) -> None:
    write_frames(tmp_path / "alone", scene, cameras(scene, 4))
    write_frames(tmp_path / "both", scene, cameras(scene, 9))
    for number in (1, 0):
        write_frames(tmp_path / "both", scene, cameras(scene, 4), those=slice(number, None, 2))
    assert contents(tmp_path / "both") == contents(tmp_path / "alone")


def test_views_without_tests_leave_no_test_views_of_another_volume(tmp_path: Path) -> None:
    views = fog_views()
    write_splits(tmp_path, views, views)
    assert len(ViewSet.read(tmp_path, "test")) == len(views)
    write_splits(tmp_path, views, None)
    assert names(tmp_path) == ["train", "transforms_train.json"]


@pytest.mark.parametrize("split", ["train", "test"])
def test_views_of_others_are_not_overwritten(tmp_path: Path, split: str) -> None:
    theirs = tmp_path / f"transforms_{split}.json"
    theirs.write_text(json.dumps({"camera_angle_x": 0.7, "frames": []}))
    for test in (None, fog_views()):
        with pytest.raises(BadInput, match=rf"transforms_{split}\.json lists views that svv did not write: choose"):
            write_splits(tmp_path, fog_views(), test)
    assert names(tmp_path) == [theirs.name]


def test_a_database_with_files_of_others_is_not_replaced(scene: Scene, tmp_path: Path) -> None:
    few = ExportOptions(phi=2, theta=1, size=16, layers=False)
    path = tmp_path / "a.cdb"
    write_database(path, scene, few)
    write_database(path, scene, few)
    (path / "notes.txt").write_text("mine")
    with pytest.raises(BadInput, match="is not a Cinema database that svv wrote, or has other files"):
        write_database(path, scene, few)
    theirs = tmp_path / "theirs.cdb"
    theirs.mkdir()
    (theirs / "data.csv").write_text("phi,theta,FILE\n0,0,a.png\n")
    with pytest.raises(BadInput, match="is not a Cinema database that svv wrote, or has other files"):
        write_database(theirs, scene, few)
    assert names(path)[-1] == "notes.txt" and names(theirs) == ["data.csv"]


def test_a_folder_with_a_key_of_another_program_is_not_emptied(tmp_path: Path) -> None:
    (tmp_path / "key.json").write_text(json.dumps({"type": "service_account", "key": "x"}))
    with pytest.raises(BadInput, match="contains other files"):
        make_keyed_folder(tmp_path, "one")
    assert names(tmp_path) == ["key.json"]


class Job:
    """A job in a folder whose stages write their own names and settings; the third one uses the second."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def run(self, scene: int, paint: int | None = None, look: int | None = None, frames: int = 2) -> list[str]:
        """Do a scene, its painting or its look in the same file, and frames of it; returns what was done."""
        stages, done = Stages(self.folder), list[str]()
        stages.page = self.folder / "report.html"

        def do(name: str, value: int, files: list[str], after: list[str]) -> None:
            def work(progress: object) -> None:
                done.append(name)
                for file in files:
                    (self.folder / file).write_text(f"{name} {value} of scene {scene}")

            stages.do(name, name, {"value": value}, [self.folder / file for file in files], work, after)

        do("scene", scene, ["scene.svv"], [])
        last = "scene"
        for name, value in (("paint", paint), ("look", look)):
            if value is not None:
                do(name, value, ["styled.svv", f"{name}.json"], ["scene"])
                last = name
        do("frames", frames, [f"{number}.png" for number in range(frames)], [last])
        assert stages.page.exists() != bool(done), "a page of results that are no longer there"
        stages.page.write_text("x")
        return done

    def there(self) -> set[str]:
        return set(names(self.folder)) - {"stages.json"}


def test_the_results_of_a_job_belong_together(tmp_path: Path) -> None:
    job, page = Job(tmp_path), ["frames"]
    assert job.run(1, paint=1, frames=4) == ["scene", "paint", *page]
    assert job.run(1, paint=1, frames=2) == page
    assert job.there() == {"scene.svv", "styled.svv", "paint.json", "0.png", "1.png", "report.html"}
    assert job.run(1) == page, "the painting of the same scene is kept"
    assert job.run(2) == ["scene", *page]
    assert job.there() == {"scene.svv", "0.png", "1.png", "report.html"}, "a painting of another scene is not"


def test_a_painting_and_a_look_in_the_same_file_do_not_pass_for_each_other(tmp_path: Path) -> None:
    job = Job(tmp_path)
    job.run(1, paint=1)
    assert job.run(1, look=1)[0] == "look"
    assert not (tmp_path / "paint.json").exists()
    assert job.run(1, paint=1)[0] == "paint"
    assert (tmp_path / "styled.svv").read_text().startswith("paint")


def test_what_a_changed_stage_made_stale_goes_even_if_the_job_stops(tmp_path: Path) -> None:
    job = Job(tmp_path)
    job.run(1, paint=1)

    def stop(progress: object) -> None:
        raise Cancelled

    stages = Stages(tmp_path)
    stages.page = tmp_path / "report.html"
    with pytest.raises(Cancelled):
        stages.do("scene", "scene", {"value": 2}, [tmp_path / "scene.svv"], stop)
    assert len(job.there()) == 6, "nothing is lost as long as the new scene is not there"
    stages.do("scene", "scene", {"value": 2}, [tmp_path / "scene.svv"], lambda progress: None)
    assert job.there() == {"scene.svv"}


def test_a_record_of_stages_names_no_file_outside(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    folder = tmp_path / "job"
    folder.mkdir()
    told = {"key": "k", "title": "A", "seconds": 0.0, "peak_rss_bytes": 0, "after": ["a"]}
    files = ["../mine.txt", str(tmp_path / "mine.txt"), ".", 5]
    (folder / "stages.json").write_text(json.dumps({"a": {**told, "files": files}, "b": {**told, "files": []}}))
    Stages(folder).do("a", "A", {}, [], lambda progress: None)
    assert (tmp_path / "mine.txt").exists()
