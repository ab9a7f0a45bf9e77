"""Scenes as Cinema databases: read again, resumed, whole or not there, and in the form that pycinema reads."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from svv.cli.app import app
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.io.cinema.views import read_database
from svv.io.pictures.output import to_bytes
from svv.options.cinema import DatabaseOptions, ExportOptions
from svv.render.cinema import write_database
from tests.cube import cube_scene

FEW = ExportOptions(phi=4, theta=3, size=24)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return cube_scene()


@pytest.fixture(scope="module")
def written(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "cube.cdb"
    assert write_database(path, scene, FEW) == 12
    return path


def rows(path: Path) -> list[dict[str, str]]:
    with (path / "data.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_reading_it_gives_the_cameras_and_images_of_the_scene(scene: Scene, written: Path) -> None:
    imported = read_database(written, DatabaseOptions(test=0))
    assert len(imported.train) == 12
    for camera, image in zip(imported.train.cameras[:3], imported.train.images):
        assert np.array_equal(image, to_bytes(scene.render(camera).rgba))
    rig = imported.train.meta.rig
    assert rig is not None and rig.centre == pytest.approx(scene.rig.centre, abs=1e-6)
    assert (rig.radius, rig.fov_x) == pytest.approx((scene.rig.radius, scene.rig.fov_x))


def test_layers_add_up_to_the_picture(scene: Scene, written: Path) -> None:
    for row in rows(written):
        image = np.asarray(Image.open(written / row["FILE"]))
        layers = [np.asarray(Image.open(written / row[name])) for name in row if name.startswith("FILE_region")]
        assert len(layers) == len(scene.regions)
        assert np.array_equal(sum(layer.astype(int) for layer in layers), np.where(image[..., 3:] > 0, image, 0))
        with Image.open(written / row["FILE_depth"]) as depth:
            assert (np.asarray(depth)[image[..., 3] > 0] > 0).all()  # 0 is empty


def test_pycinema_shows_the_picture(written: Path) -> None:
    """It shows the last column whose name contains FILE, and asks for a plain table (CinemaDatabaseReader)."""
    with (written / "data.csv").open(newline="") as file:
        table = list(csv.reader(file))
    shown = [k for k, name in enumerate(table[0]) if re.search("FILE", name, re.IGNORECASE)][-1]
    assert table[0][shown] == "FILE" and table[0][:2] == ["phi", "theta"]
    for row in table[1:]:
        with Image.open(written / row[shown]) as image:
            assert image.mode == "RGBA"
    assert not [path.name for path in written.iterdir() if path.name.startswith(".")]


def test_only_pictures(scene: Scene, tmp_path: Path) -> None:
    write_database(tmp_path / "a.cdb", scene, ExportOptions(phi=3, theta=1, size=16, layers=False, network="base"))
    assert list(rows(tmp_path / "a.cdb")[0]) == ["phi", "theta", "FILE"]
    assert len(list((tmp_path / "a.cdb").glob("*.png"))) == 3


def test_stopped_work_is_continued_and_shows_nothing_before_it_is_whole(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, drawn = tmp_path / "a.cdb", []
    render = Scene.render

    def counted(self: Scene, *given: object) -> object:
        drawn.append(1)
        return render(self, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(Scene, "render", counted)

    def stop(fraction: float, label: str) -> None:
        if label.startswith("view 7 "):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_database(path, scene, FEW, stop)
    assert not path.exists() and len(drawn) == 7
    write_database(path, scene, FEW)
    assert len(drawn) == 12 and len(rows(path)) == 12
    with pytest.raises(KeyboardInterrupt):
        write_database(path, scene, FEW, stop)
    assert len(rows(path)) == 12  # the old one stays until the new one is complete
    write_database(path, scene, ExportOptions(phi=3, theta=1, size=16))  # another one: nothing is taken over
    assert len(rows(path)) == 3 and [p.name for p in tmp_path.iterdir()] == ["a.cdb"]


def test_other_folders_are_left_alone(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "mine.cdb").mkdir()
    (tmp_path / "mine.cdb" / "work.txt").touch()
    with pytest.raises(BadInput, match="not a Cinema database"):
        write_database(tmp_path / "mine.cdb", scene, FEW)
    with pytest.raises(BadInput, match="no network 'styled'"):
        write_database(tmp_path / "a.cdb", scene, ExportOptions(network="styled"))


def test_commands(scene: Scene, tmp_path: Path) -> None:
    scene.save(tmp_path / "a.svv")
    run = CliRunner().invoke
    made = run(app, ["export", str(tmp_path / "a.svv"), "--out", str(tmp_path / "a.cdb"), "--phi", "5", "--theta", "4",
                     "--size", "24", "--no-layers"])  # fmt: skip
    assert made.exit_code == 0 and "a.cdb: 20 views" in made.output
    read = run(app, ["import", str(tmp_path / "a.cdb"), "--out", str(tmp_path / "views"), "--focal-point=0,0,-1"])
    assert read.exit_code == 0 and "views: 18 + 2 views" in read.output
    wrong = run(app, ["export", str(tmp_path / "a.svv"), "--out", str(tmp_path / "a.txt")])
    assert isinstance(wrong.exception, BadInput)
    wrong = run(app, ["import", str(tmp_path / "a.cdb"), "--out", str(tmp_path / "v"), "--focal-point", "0,1"])
    assert isinstance(wrong.exception, BadInput) and "--focal-point needs three numbers" in str(wrong.exception)
    assert not (tmp_path / "v").exists()
