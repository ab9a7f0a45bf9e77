"""Cinema databases that ``extract_views.py`` and Catalyst scripts write with the real ParaView's image extractor."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.views import render_views
from svv.render.pictures import read_png
from tests.paraview.stirred_files import write_stirred
from tests.stirred_volume import stirred_transfer_function, stirred_volume

SCRIPT = Path(__file__).resolve().parents[2] / "paraview_scripts" / "extract_views.py"
SIZE, LONG = 96, 300.0


@pytest.fixture(scope="module")
def made(pvpython, tmp_path_factory) -> Path:
    """A folder with a volume, its transfer function, and ``small.cdb``, drawn on black and on white too."""
    folder = tmp_path_factory.mktemp("extracts")
    write_stirred(folder)
    done = pvpython(
        SCRIPT, folder / "volume.vti", "--tf", folder / "tf.json", "--phi", 6, "--theta", 5, "--size", SIZE,
        "--black-and-white", "--out", folder / "small.cdb",
    )  # fmt: skip
    (folder / "said.txt").write_text(done.stdout)
    return folder


def rows_of(database: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((database / "data.csv").read_text().splitlines()))


def camera_at(database: Path, phi: float, theta: float) -> Camera:
    """ParaView's camera, from its angles in degrees and what ``camera.json`` says."""
    known = json.loads((database / "camera.json").read_text())
    (sp, cp), (st, ct) = ((np.sin(np.radians(angle)), np.cos(np.radians(angle))) for angle in (phi, theta))
    back, up = np.array([sp * ct, st, cp * ct]), np.array([-sp * st, ct, -cp * st])
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([np.cross(up, back), up, back], axis=1)
    matrix[:3, 3] = np.array(known["focal_point"]) + known["distance"] * back
    return Camera(matrix, np.radians(known["view_angle"]), SIZE, SIZE)


def test_a_database_has_a_row_for_each_image_and_says_where_its_camera_is(made: Path) -> None:
    database = made / "small.cdb"
    rows = rows_of(database)
    assert len(rows) == 30 and len({(row["phi"], row["theta"]) for row in rows}) == 30
    assert {path.name for path in database.iterdir()} == {"data.csv", "camera.json"} | {r["FILE_png"] for r in rows}
    assert {row["producer"] for row in rows} == {"views"} and list(rows[0])[-1] == "FILE_png"
    camera = json.loads((database / "camera.json").read_text())
    assert set(camera) == {"focal_point", "distance", "view_angle", "parallel_projection", "parallel_scale"}
    assert camera["view_angle"] == 30.0 and camera["parallel_projection"] is False
    assert not list(made.glob(".*"))


def test_images_show_what_the_angles_say_with_the_alpha_of_the_volume(made: Path) -> None:
    """Against the CPU ray caster, whose alpha comes from memory: no window and no background is involved."""
    rows = rows_of(made / "small.cdb")
    cameras = [camera_at(made / "small.cdb", float(row["phi"]), float(row["theta"])) for row in rows]
    function = stirred_transfer_function().mapped(255.0, 0.0)
    truth = render_views(stirred_volume(32, levels=255), function, cameras, "cpu", Shading(on=False)).astype(float)
    images = np.stack([read_png(made / "small.cdb" / row["FILE_png"]) for row in rows]).astype(float)
    off = np.abs(images[..., 3] - truth[..., 3]).mean(axis=(1, 2))
    others = np.abs(images[:, None, ..., 3] - truth[None, ..., 3]).mean(axis=(2, 3))
    assert (others.argmin(axis=1) == np.arange(len(rows))).all() and off.max() < 1.0, off
    seen = truth[..., 3] > 128
    assert np.abs(images[..., :3] - truth[..., :3])[seen].mean() < 6.0


def test_the_alpha_of_paraviews_writer_is_exact(made: Path) -> None:
    """It draws on white and on black itself; what it reads back from VTK would not be."""
    said = (made / "said.txt").read_text()
    off = int(said.split("differed by up to ")[1].split("/")[0])
    assert off <= 1, said


def test_a_catalyst_script_needs_only_paraview(made: Path, pvpython, tmp_path: Path) -> None:
    pvpython(
        """
import sys
sys.path.insert(0, sys.argv[1])
from extract_views import set_up, write_camera
from paraview import simple
assert not any(name.split(".")[0] == "svv" for name in sys.modules)
volume = simple.OpenDataFile(sys.argv[2])
view = simple.CreateView("RenderView")
display = simple.Show(volume, view)
display.SetRepresentationType("Volume")
simple.ColorBy(display, ("POINTS", volume.PointData.keys()[0]))
simple.ResetCamera(view)
view.CameraParallelProjection = 1
set_up(view, 2, 5, 32)
write_camera(view, sys.argv[3])
simple.SaveExtracts(ExtractsOutputDirectory=sys.argv[3], FrameWindow=[0, 0])
""",
        SCRIPT.parent, made / "volume.vti", tmp_path / "a.cdb", environ={"PV_PLUGIN_PATH": ""},
    )  # fmt: skip
    images = sorted((tmp_path / "a.cdb").glob("views_*.png"))
    assert len(images) == 10 and all(read_png(path).shape == (32, 32, 4) for path in images)
    assert json.loads((tmp_path / "a.cdb" / "camera.json").read_text())["parallel_projection"] is True


@pytest.mark.slow
def test_directions_that_are_drawn_twice_are_counted(made: Path, pvpython) -> None:
    pvpython(
        """
import sys
sys.path.insert(0, sys.argv[1])
from extract_views import repeated
assert repeated(6, 6) == (18, 36)      # ParaView's default: (phi, theta) and (phi + 180, 180 - theta)
assert repeated(12, 12) == (82, 144)   # and the poles, 12 times each
assert repeated(14, 7) == repeated(7, 14) == (0, 98)
assert repeated(18, 9) == (0, 162)
assert repeated(13, 7) == (7, 98)      # ParaView's sum of 13 steps stays below 360, so it draws a 14th
""",
        SCRIPT.parent,
    )
    for arguments, said in (
        (("--phi", 6, "--theta", 4), "5 to 360 for theta"),
        (("--out", made / "small.cdb"), "exists already"),
    ):
        done = pvpython(SCRIPT, made / "volume.vti", "--out", made / "other.cdb", *arguments, check=False)
        assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr
    assert not (made / "other.cdb").exists()


@pytest.mark.slow
def test_a_database_becomes_a_painting_with_one_command(made: Path, tmp_path: Path) -> None:
    """As in the tutorial, at a small size. Scores tell whether the cameras that were read are those of ParaView."""
    words = ["run", made / "small.cdb", "--style", "gallery:woodcut", "--preset", "draft"]
    words += ["--orbit", 2, "--orbit-size", 32, "--out", tmp_path / "out"]
    subprocess.run([sys.executable, "-m", "svv", *map(str, words)], check=True, timeout=LONG)
    out = tmp_path / "out"
    assert json.loads((out / "train.json").read_text())["learned_from"] == "views only"
    assert (out / "styled.svv").exists() and "views only" in (out / "report.html").read_text()
    scores = json.loads((out / "scores.json").read_text())["base"]
    assert scores["views"] >= 3 and scores["psnr"] > 22.7  # blank images would have 21.7


@pytest.mark.slow
def test_ctrl_c_ends_the_sweep_and_leaves_nothing(made: Path, pvpython, tmp_path: Path) -> None:
    done = pvpython(
        """
import os, signal, sys
sys.path.insert(0, sys.argv[1])
import extract_views
from svv.pv import scripts
opened = scripts.open_volume
def open_volume(*arguments):
    display, view = opened(*arguments)
    def interrupt(*_):
        view.SMProxy.RemoveObserver(watch)
        os.kill(os.getpid(), signal.SIGINT)
    watch = view.SMProxy.AddObserver("EndEvent", interrupt)
    return display, view
scripts.open_volume = open_volume
sys.argv = ["extract_views.py", *sys.argv[2:]]
extract_views.main()
""",
        SCRIPT.parent, made / "volume.vti", "--size", 32, "--out", tmp_path / "a.cdb", check=False,
    )  # fmt: skip
    assert done.returncode == 130 and "stopped" in done.stderr.splitlines()[-1], done.stderr
    assert "Traceback" not in done.stderr and not list(tmp_path.iterdir())
