"""Cinema databases as views: what is chosen, left out, estimated and refused, and databases written from scenes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from PIL import Image

from svv.core.geometry.cameras import Camera
from svv.core.geometry.phi_theta import ascent_rotations
from svv.errors import BadInput
from svv.io.cinema.views import read_database, read_views
from svv.io.views.viewset import ViewSet
from svv.job.source import imported_views
from svv.options.cinema import DatabaseOptions
from tests.cinema_database import BALLS, DISTANCE, cameras, picture, save_rows, turns, write, write_over

CAMERA = {"focal_point": [1.0, 2.0, 3.0], "distance": DISTANCE, "view_angle": 30.0}


def add_camera(folder: Path, **changes: object) -> None:
    (folder / "camera.json").write_text(json.dumps({**CAMERA, **changes}))


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cinema") / "balls.cdb"
    write(folder)
    add_camera(folder)
    return folder


def by_name(views: ViewSet | None) -> dict[str, tuple[Camera, np.ndarray]]:
    return {} if views is None else dict(zip(views.names, zip(views.cameras, views.images)))


def test_images_and_cameras_are_those_that_were_written(database: Path) -> None:
    imported = read_database(database)
    found = {**by_name(imported.train), **by_name(imported.test)}
    assert len(imported.train) == 49 and len(found) == 56
    for (phi, theta), camera in zip(turns(), cameras(turns())):
        got, image = found[f"RenderView1_000000p={phi:06.2f}t={theta:06.2f}"]
        matrix = camera.camera_to_world.copy()
        matrix[:3, 3] += CAMERA["focal_point"]
        assert got.camera_to_world == pytest.approx(matrix, abs=1e-3)  # two digits of an angle
        assert got.fov_x == pytest.approx(camera.fov_x) and np.array_equal(image, picture(camera))
    assert imported.notes[0].startswith("The silhouettes agree") and len(imported.notes) == 1


def test_the_split_is_the_same_each_time_and_no_view_is_in_both(database: Path) -> None:
    train, test = read_views(database, "train"), read_views(database, "test")
    assert train.names == read_views(database, "train").names
    assert set(train.names).isdisjoint(test.names) and len(test) == 7
    axes = np.stack([camera.camera_to_world[:3, 2] for camera in test.cameras])
    assert np.degrees(np.arccos(np.sort(axes @ axes.T)[:, -2])).min() > 35  # spread out
    with pytest.raises(BadInput, match="no views for the split val"):
        read_views(database, "val")


def test_views_go_through_files(database: Path, tmp_path: Path) -> None:
    imported = read_database(database, DatabaseOptions(test=5))
    imported.write(tmp_path)
    read = ViewSet.read(tmp_path)
    assert np.array_equal(read.images, imported.train.images) and read.names == imported.train.names
    assert read.meta.other["cinema"] == imported.train.meta.other["cinema"] and len(read_views(tmp_path, "test")) == 5


def test_a_job_imports_once(database: Path, tmp_path: Path) -> None:
    def stamp() -> int:
        return (
            (imported_views(database, tmp_path / "views", lambda *_: None) / "transforms_train.json").stat().st_mtime_ns
        )

    first = stamp()
    assert stamp() == first
    image = next(database.glob("*.png"))
    image.write_bytes(image.read_bytes())  # the database was written again
    assert stamp() != first


def test_the_angle_is_estimated_if_nothing_says_it(tmp_path: Path) -> None:
    write(tmp_path, turns(6, 5), fov=np.radians(36.0), size=96)
    imported = read_database(tmp_path)
    assert np.degrees(imported.train.cameras[0].fov_x) == pytest.approx(36.0, abs=0.7)
    said = " ".join(imported.notes)
    assert "View angle estimated from the silhouettes" in said and "pixels" in said and "centred on the origin" in said
    assert imported.train.meta.assumed == said
    with pytest.raises(BadInput, match=r"contradict a view angle of 30 .* differ by 0\.\d pixels: they say 3[56]"):
        read_database(tmp_path, DatabaseOptions(view_angle=30.0))


def test_angles_that_contradict_the_images(tmp_path: Path) -> None:
    rows = write(tmp_path, turns(6, 5))
    save_rows(tmp_path, [{**row, "theta": f"{-float(row['theta'])}"} for row in rows])
    add_camera(tmp_path)
    with pytest.raises(BadInput, match="contradict"):
        read_database(tmp_path)


def test_phi_may_run_the_other_way(tmp_path: Path) -> None:
    """As ParaView wrote it up to 5.8; an angle that is right is not blamed."""
    rows = write(tmp_path, turns(6, 5))
    save_rows(tmp_path, [{**row, "phi": f"{-float(row['phi'])}"} for row in rows])
    for options in (DatabaseOptions(), DatabaseOptions(view_angle=30.0)):
        imported = read_database(tmp_path, options)
        assert "phi runs the other way" in " ".join(imported.notes)
        assert np.degrees(imported.train.cameras[0].fov_x) == pytest.approx(30.0, abs=1.0)


def test_a_colour_bar_is_left_out_on_request(tmp_path: Path) -> None:
    rows = write(tmp_path, turns(6, 5))
    for row in rows:
        image = np.array(Image.open(tmp_path / row["FILE_png"]))
        image[10:40, 61:63] = (200, 30, 30, 255)
        Image.fromarray(image).save(tmp_path / row["FILE_png"])
    noticed = read_database(tmp_path, DatabaseOptions(view_angle=30.0, test=0))
    assert "at the right stands still on the screen" in " ".join(noticed.notes)
    left = read_database(tmp_path, DatabaseOptions(view_angle=30.0, test=0, ignore_fixed=True))
    assert "is left out" in left.notes[-1] and left.train.meta.assumed == " ".join(left.notes)
    assert noticed.train.images[:, 10:40, 61:63, 3].all() and not left.train.images[:, 10:40, 61:63].any()


def test_missing_images_are_left_out_and_counted(tmp_path: Path) -> None:
    rows = write(tmp_path, turns(6, 5))
    (tmp_path / rows[4]["FILE_png"]).unlink()
    imported = read_database(tmp_path, DatabaseOptions(view_angle=30.0, test=0))
    assert len(imported.train) == 29 and "1 row of 30 has no image and is left out" in imported.notes[0]
    assert imported_views(tmp_path, tmp_path / "views", lambda *_: None) == tmp_path / "views"


def test_repeated_directions_are_left_out(tmp_path: Path) -> None:
    write(tmp_path, turns(6, 6))
    imported = read_database(tmp_path, DatabaseOptions(view_angle=30.0, test=0))
    assert len(imported.train) == 18 and imported.test is None
    assert "18 of 36 images repeat a direction and are left out: 18 remain" in imported.notes[0]


def test_a_gap_is_mentioned(tmp_path: Path) -> None:
    write(tmp_path, [(phi, theta) for phi in range(0, 360, 30) for theta in (20, 60)])
    (note,) = (n for n in read_database(tmp_path, DatabaseOptions(view_angle=30.0)).notes if "sphere" in n)
    assert note.startswith("Half of the sphere") and "(0.0, -1.0, 0.0)" in note


def test_many_views_are_thinned_out(database: Path) -> None:
    imported = read_database(database, DatabaseOptions(n=20, test=4))
    assert len(imported.train) == 20 and imported.test is not None and len(imported.test) == 4
    assert "24 of 56 directions are used" in imported.notes[0]
    with pytest.raises(BadInput, match="fewer than 3 remain"):
        read_database(database, DatabaseOptions(test=54))


def test_white_and_black_give_exact_alpha(tmp_path: Path) -> None:
    angles = turns(5, 5)
    rows = write_over(tmp_path / "white.cdb", 255.0, angles)
    write_over(tmp_path / "black.cdb", 0.0, angles)
    options = DatabaseOptions(black=str(tmp_path / "black.cdb"), view_angle=30.0, test=0)
    images = read_database(tmp_path / "white.cdb", options).train.images
    truth = np.stack([picture(camera) for camera in cameras(angles)])
    assert np.abs(images[..., 3].astype(int) - truth[..., 3]).max() <= 1
    assert np.abs(images.astype(int) - truth).max() <= 3  # colours divided by alpha
    with pytest.raises(BadInput, match="too similar"):
        read_database(tmp_path / "white.cdb", DatabaseOptions(black=str(tmp_path / "white.cdb")))
    with pytest.raises(BadInput, match="neither a Cinema database nor a producer"):
        read_database(tmp_path / "white.cdb", DatabaseOptions(black="nothing"))
    save_rows(tmp_path / "black.cdb", rows[1:])
    (tmp_path / "black.cdb" / rows[0]["FILE_png"]).unlink()
    with pytest.raises(BadInput, match="no image over black"):
        read_database(tmp_path / "white.cdb", options)


def test_a_sweep_of_opacity_functions(tmp_path: Path) -> None:
    rows = write(tmp_path, turns(5, 5))
    for row in rows:  # the second function shows less
        name = "otf=1" + row["FILE_png"]
        image = np.asarray(Image.open(tmp_path / row["FILE_png"])) // np.array((1, 1, 1, 2), np.uint8)
        Image.fromarray(image).save(tmp_path / name)
    save_rows(tmp_path, [{**r, "opacity_transfer_function": str(k), "FILE_png": f"otf=1{r['FILE_png']}" if k else
                          r["FILE_png"]} for k in (0, 1) for r in rows])  # fmt: skip
    preset = {"Name": "cinemavolume", "Points": [0, 0, 0.5, 0], "RGBPoints": [0, 1, 1, 1]}
    (tmp_path / "cinemavolume_1.json").write_text(json.dumps([preset]))
    first = read_database(tmp_path, DatabaseOptions(view_angle=30.0))
    assert "opacity_transfer_function is 0, the first of 2" in first.notes[0] and first.train.meta.tf is None
    second = read_database(tmp_path, DatabaseOptions(select=("opacity_transfer_function=1",), view_angle=30.0))
    assert second.train.meta.tf == preset
    assert second.train.images[..., 3].max() == first.train.images[..., 3].max() // 2


def damaged_image(folder: Path) -> None:
    file = sorted(folder.glob("*.png"))[3]
    file.write_bytes(file.read_bytes()[:60])


def another_size(folder: Path) -> None:
    Image.new("RGBA", (8, 8)).save(sorted(folder.glob("*.png"))[3])


def one_without_alpha(folder: Path) -> None:
    Image.new("RGB", (64, 64)).save(sorted(folder.glob("*.png"))[3])


def textured_without_alpha(folder: Path) -> None:
    rng = np.random.default_rng(0)
    for file in folder.glob("*.png"):
        Image.fromarray(rng.integers(0, 255, (64, 64, 3), np.uint8)).save(file)


def words_for_angles(folder: Path) -> None:
    text = (folder / "data.csv").read_text()
    (folder / "data.csv").write_text(text.replace("000.00,RenderView1", "east,RenderView1", 1))


def no_angles(folder: Path) -> None:
    text = (folder / "data.csv").read_text()
    (folder / "data.csv").write_text(text.replace("phi", "a").replace("theta", "b"))


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (damaged_image, "truncated or not an image"),
        (another_size, "same size"),
        (one_without_alpha, "has alpha and"),
        (textured_without_alpha, "no alpha"),
        (words_for_angles, "angle that is not a number"),
        (no_angles, "neither phi and theta nor cameras"),
    ],
)
def test_bad_databases(tmp_path: Path, damage: Callable[[Path], None], says: str) -> None:
    write(tmp_path, turns(5, 5))
    damage(tmp_path)
    options = DatabaseOptions(view_angle=30.0, select=("a=000.00", "b=000.00") if damage is no_angles else ())
    with pytest.raises(BadInput, match=says):
        read_database(tmp_path, options)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"select": ("time",)}, "--select needs COLUMN=VALUE"),
        ({"view_angle": 30.0, "parallel_scale": 1.0}, "not both"),
        ({"distance": -1.0}, "distance must be above 0"),
    ],
)
def test_bad_options(database: Path, options: dict[str, Any], says: str) -> None:
    with pytest.raises(BadInput, match=says):
        read_database(database, DatabaseOptions(**options))


# --- HDF5 -----------------------------------------------------------------------------------------------------------


def write_h5(folder: Path, style: str = "CameraPos") -> list[Camera]:
    """A database as pycinema writes it: the camera is in the images."""
    folder.mkdir(exist_ok=True)
    shots = [Camera.orthographic(c.camera_to_world, 4.0, 64, 48) for c in cameras(turns(5, 5))]
    names = ("CameraPos", "CameraDir", "CameraUp", "CameraHeight", "CameraNearFar")
    if style != "CameraPos":
        names = ("camera_position", "camera_direction", "camera_up", "camera_height", "camera_near_far")
    for k, camera in enumerate(shots):
        matrix = camera.camera_to_world
        values = (matrix[:3, 3], -matrix[:3, 2], matrix[:3, 1], [3.0], [1.0, 9.0])
        with h5py.File(folder / f"{k}.h5", "w") as file:
            file["channels/rgba"] = picture(camera)
            file["channels/depth"] = np.zeros((48, 64), np.float32)
            for name, value in zip(names, values):
                file[f"meta/{name}"] = np.array(value)
            file["meta/object_id"] = np.array(["p+s0"], dtype="S10")
    save_rows(folder, [{"time": "0.0", "FILE": f"{k}.h5"} for k in range(len(shots))])
    return shots


@pytest.mark.parametrize("style", ["CameraPos", "camera_position"])
def test_pycinemas_images_carry_their_cameras(tmp_path: Path, style: str) -> None:
    shots = write_h5(tmp_path, style)
    imported = read_database(tmp_path, DatabaseOptions(test=0))
    for name, camera, image in zip(imported.train.names, imported.train.cameras, imported.train.images):
        true = shots[int(name)]
        assert camera.span_x == pytest.approx(4.0)
        assert camera.camera_to_world == pytest.approx(true.camera_to_world, abs=1e-6)
        assert np.array_equal(image, picture(true))


def test_parallel_rays_go_through_files(tmp_path: Path) -> None:
    write_h5(tmp_path / "a.cdb")
    imported = read_database(tmp_path / "a.cdb")
    imported.write(tmp_path / "views")
    for one, other in zip(imported.train.cameras, ViewSet.read(tmp_path / "views").cameras, strict=True):
        assert one.identity[1:] == other.identity[1:] and np.array_equal(one.camera_to_world, other.camera_to_world)


def test_ascents_cameras(tmp_path: Path) -> None:
    """The silhouettes agree, and the angle of 60 degrees that Ascent takes is found."""
    phis, thetas = [f"{p:.1f}" for p in range(-180, 180, 60)], [f"{t:.1f}" for t in range(0, 180, 30)]
    (tmp_path / "0.0").mkdir()
    balls = [tuple(1.3 * np.array(ball)) for ball in BALLS]
    for phi in phis:
        for theta in thetas:
            matrix = np.eye(4)
            matrix[:3, :3] = ascent_rotations(float(phi), float(theta))
            matrix[:3, 3] = DISTANCE * matrix[:3, 2]
            image = picture(Camera(matrix, np.radians(60.0), 96, 96), balls)
            Image.fromarray(image).save(tmp_path / "0.0" / f"{phi}_{theta}_balls.png")
    values = {"time": "0.0", "phi": phis, "theta": thetas}
    arguments = {name: {"values": v} for name, v in values.items()}
    (tmp_path / "info.json").write_text(
        json.dumps({"name_pattern": "{time}/{phi}_{theta}_balls.png", "arguments": arguments})
    )
    imported = read_database(tmp_path)
    assert len(imported.train) + len(imported.test or ()) == 31  # at theta = 0, phi only turns the image
    assert np.degrees(imported.train.cameras[0].fov_x) == pytest.approx(60.0, abs=0.7)


def test_damaged_hdf5(tmp_path: Path) -> None:
    write_h5(tmp_path)
    whole = (tmp_path / "4.h5").read_bytes()
    (tmp_path / "4.h5").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BadInput, match=r"4.h5 .*; it is truncated or not an HDF5 file"):
        read_database(tmp_path)
    with h5py.File(tmp_path / "4.h5", "w") as file:
        file["channels/depth"] = np.zeros((4, 4))
    with pytest.raises(BadInput, match="no channel rgba: depth"):
        read_database(tmp_path)
    with h5py.File(tmp_path / "4.h5", "w") as file:
        file["channels/rgba"] = np.zeros((48, 64, 4), np.uint8)
    with pytest.raises(BadInput, match=r"for some images, but not for 4.h5"):
        read_database(tmp_path)


def test_without_h5py(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "0.h5").touch()
    save_rows(tmp_path, [{"phi": "0", "theta": "0", "FILE": "0.h5"}])
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(BadInput, match=r"pip install 'svv\[cinema\]'"):
        read_database(tmp_path)
