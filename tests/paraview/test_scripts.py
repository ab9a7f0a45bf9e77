"""The scripts of ``paraview_scripts`` in the real ParaView, each doing its whole job at a small size."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from svv.fields.scene.scene import Scene
from svv.io.pictures.output import write_png
from svv.render.pictures import read_png
from svv.styles.gallery.textures import style_picture
from tests.paraview.filter_script import LITTLE
from tests.paraview.stirred_files import write_stirred

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS, COMPARE = ROOT / "paraview_scripts", ROOT / "bench" / "paraview_scripts" / "compare_dvr_pcn.py"
QUICK = ("--preset", "draft", "--views", 12, "--test", 2, "--size", 96)
SMALL = ("--orbit", 3, "--orbit-size", 48)


@pytest.fixture(scope="module")
def made(pvpython, tmp_path_factory) -> Path:
    """A folder with a volume, its function, a style, and what stylize_volume.py makes of them."""
    folder = tmp_path_factory.mktemp("scripts")
    write_stirred(folder)
    write_png(folder / "brush.png", style_picture("brush strokes", 64))
    write_png(folder / "dots.png", style_picture("stippling", 64))
    done = pvpython(
        LITTLE, SCRIPTS / "stylize_volume.py", folder / "volume.vti", "--tf", folder / "tf.json",
        "--style", folder / "brush.png", "--out", folder / "out", *QUICK, *SMALL,
    )  # fmt: skip
    assert done.stdout.splitlines()[-1] == str(folder / "out" / "report.html")
    return folder


def test_a_volume_becomes_a_painted_scene(made: Path) -> None:
    out = made / "out"
    assert {"report.html", "scene.svv", "styled.svv", "image.vti", "image.png", "orbit.mp4"} <= {
        path.name for path in out.iterdir()
    }
    scene = Scene.load(out / "styled.svv")
    assert {region.style for region in scene.regions} == {"brush"}
    assert scene.made["learned_from"] == "volume and views"
    assert scene.made["source"]["tf"]["Name"] and scene.made["source"]["shading"]["on"] is False  # as ParaView shows
    assert read_png(out / "image.png").shape == (96, 96, 4)


def test_what_is_finished_is_not_done_again(made: Path, pvpython) -> None:
    before = (made / "out" / "scene.svv").stat().st_mtime_ns
    pvpython(
        LITTLE, SCRIPTS / "stylize_volume.py", made / "volume.vti", "--tf", made / "tf.json",
        "--style", made / "brush.png", "--out", made / "out", *QUICK, *SMALL,
    )  # fmt: skip
    assert (made / "out" / "scene.svv").stat().st_mtime_ns == before


@pytest.mark.slow
def test_a_state_is_taken_as_it_was_saved(made: Path, pvpython, tmp_path: Path) -> None:
    pvpython(
        """
import sys
from svv.pv import scripts
from pathlib import Path
from paraview import simple
display, view = scripts.open_volume(Path(sys.argv[1]), Path(sys.argv[2]))
display.Shade, display.ScalarOpacityUnitDistance = 1, 0.125
simple.SaveState(sys.argv[3])
""",
        made / "volume.vti", made / "tf.json", tmp_path / "session.pvsm",
    )  # fmt: skip
    arguments = (tmp_path / "session.pvsm", "--views-only", "--out", tmp_path / "out", *QUICK, *SMALL)
    pvpython(LITTLE, SCRIPTS / "stylize_volume.py", *arguments)
    scene = Scene.load(tmp_path / "out" / "scene.svv")
    assert scene.made["learned_from"] == "views only"
    source = scene.made["source"]
    assert source["shading"]["on"] is True and source["tf"]["ScalarOpacityUnitDistance"] == 0.125
    assert (tmp_path / "out" / "recoloured.svv").exists()


def test_an_orbit_beside_the_volume_as_paraview_renders_it(made: Path, pvpython, tmp_path: Path) -> None:
    pvpython(
        SCRIPTS / "render_orbit.py", made / "out" / "styled.svv", "--volume", made / "volume.vti",
        "--tf", made / "tf.json", "--network", "pcn", "styled", "--frames", 3, "--size", 64,
        "--out", tmp_path / "orbit",
    )  # fmt: skip
    frames = [read_png(path) for path in sorted((tmp_path / "orbit").iterdir())]
    assert len(frames) == 3
    volumes, pcns, styled = ([f[-64:, 70 * k : 70 * k + 64].astype(float) for f in frames] for k in range(3))
    for k, volume in enumerate(volumes):  # how well a scene is learned hangs on the machine; whose view it is does not
        likeness = [np.corrcoef(volume.ravel(), pcn.ravel())[0, 1] for pcn in pcns]
        assert np.argmax(likeness) == k and likeness[k] > 0.5, f"ParaView's camera is not the scene's: {likeness}"
    assert np.abs(styled[1] - pcns[1]).mean() > 1.0


def test_edits_go_through_the_filters(made: Path, pvpython, tmp_path: Path) -> None:
    done = pvpython(
        SCRIPTS / "edit_palette.py", made / "out" / "scene.svv", "--colour", "0=#ff00ff", "--opacity", "0=0.5",
        "--isolate", "0", "--show", "regions in their colours",
        "--out", tmp_path / "edited.svv", "--picture", tmp_path / "edited.png", "--size", 64,
        "--state", tmp_path / "session.pvsm",
    )  # fmt: skip
    first = Scene.load(tmp_path / "edited.svv").regions[0]
    assert np.allclose(first.edited_colour, (1, 0, 1)) and first.opacity == 0.5
    assert len([line for line in done.stdout.splitlines() if line.startswith("Region")]) == len(
        Scene.load(made / "out" / "scene.svv").regions
    )
    picture = read_png(tmp_path / "edited.png")
    seen = picture[picture[..., 3] > 0]
    assert len(seen) and (np.median(seen, axis=0)[:3] == (255, 0, 255)).all()
    assert "StyleRFEdit" in (tmp_path / "session.pvsm").read_text()


@pytest.mark.slow
def test_many_styles_over_one_scene(made: Path, pvpython, tmp_path: Path) -> None:
    (tmp_path / "styles").mkdir()
    for name in ("brush", "dots"):
        (tmp_path / "styles" / f"{name}.png").write_bytes((made / f"{name}.png").read_bytes())
    arguments = (made / "out" / "scene.svv", tmp_path / "styles", "--preset", "draft", "--size", 64)
    pvpython(SCRIPTS / "batch_styles.py", *arguments, "--out", tmp_path / "out")
    pictures = [read_png(tmp_path / "out" / f"{name}.png").astype(float) for name in ("unpainted", "brush", "dots")]
    assert np.abs(pictures[1] - pictures[2])[..., :3].mean() > 1.0
    assert np.array_equal(pictures[1][..., 3], pictures[0][..., 3])  # dots are strokes, which opacity follows on glass
    before = (tmp_path / "out" / "dots.svv").stat().st_mtime_ns
    pvpython(SCRIPTS / "batch_styles.py", *arguments, "--out", tmp_path / "out")
    assert (tmp_path / "out" / "dots.svv").stat().st_mtime_ns == before
    assert read_png(tmp_path / "out" / "contact.png").shape[1] > 4 * 64


@pytest.mark.slow
def test_dvr_and_the_palette_network_are_compared(pvpython, tmp_path: Path) -> None:
    """On a volume of one's own, at its own size; the same command measures nothing twice."""
    ball = np.linalg.norm(np.indices((26, 26, 26)) - 12.5, axis=0).astype(np.float32)
    np.save(tmp_path / "ball.npy", ball)
    (tmp_path / "tf.json").write_text('{"bumps": [{"centre": 8, "width": 6, "opacity": 0.5}]}')
    own = ("--volume", tmp_path / "ball.npy", "--tf", tmp_path / "tf.json", "--spacing", "2,2,2", "--views-only")
    quick = ("--images", 48, 64, "--preset", "draft", "--views", 12, "--repeats", 2)
    done = pvpython(LITTLE, COMPARE, *own, *quick, "--out", tmp_path / "own")
    lines = (tmp_path / "own" / "compare.csv").read_text().splitlines()
    told = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# ") and not line.endswith(": "))
    assert told["paraview"].startswith(("5.", "6.")) and told["preset"] == "draft" and told["views"] == "12"
    assert told["repeats"] == "2" and told["processor"] and told["volume"] == "ball.npy"
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert [(r["side"], r["volume"], r["image"]) for r in rows] == [
        (side, "26", image) for side in ("DVR", "bricks", "PCN") for image in ("48", "64")
    ]
    for row in rows:
        assert 0 < float(row["seconds_least"]) <= float(row["seconds_median"]) <= float(row["seconds_most"])
        assert float(row["idle_bytes"]) > 1e7
        assert int(row["own_bytes"]) == int(row["memory_bytes"]) - int(row["idle_bytes"]) > 0
        assert (row["side"] == "PCN") == bool(row["psnr"]) and (row["side"] != "PCN") == bool(row["ray_caster"])
        if row["side"] != "PCN":
            assert ball.nbytes < int(row["data_bytes"]) < ball.nbytes + 4096
    assert float(rows[-1]["psnr"]) > 15.0, "not even alike: the sides do not show the same"
    assert done.stdout.count("|---") == 14 - ("LPIPS was not measured" in done.stdout)
    assert "In memory" in done.stdout and told["paraview"] in done.stdout
    assert (tmp_path / "own" / "compare.pdf").read_bytes().startswith(b"%PDF")
    assert "voxels along a side" in (tmp_path / "own" / "compare.svg").read_text()
    chart = read_png(tmp_path / "own" / "compare.png")[..., :3].reshape(-1, 3).astype(int)
    for one, other in ((0, 2), (2, 0), (1, 0)):  # red, blue and green marks
        assert ((chart[:, one] - chart[:, other]) > 100).sum() > 40
    assert Scene.load(tmp_path / "own" / "26" / "scene.svv").made["learned_from"] == "views only"
    stamp = (tmp_path / "own" / "26" / "pcn.json").stat().st_mtime_ns
    pvpython(LITTLE, COMPARE, *own, *quick, "--out", tmp_path / "own")
    assert (tmp_path / "own" / "26" / "pcn.json").stat().st_mtime_ns == stamp
    scene = (tmp_path / "own" / "26" / "scene.svv").stat().st_mtime_ns
    (tmp_path / "own" / "26" / "pcn.json").write_text("[]")  # as earlier versions wrote it
    done = pvpython(LITTLE, COMPARE, *own, *quick, "--out", tmp_path / "own")
    assert "26: what an earlier version measured (pcn) lacks processor, versions and repeats" in done.stderr
    assert len(json.loads((tmp_path / "own" / "26" / "pcn.json").read_text())["rows"]) == 2
    assert (tmp_path / "own" / "26" / "scene.svv").stat().st_mtime_ns == scene


BAD = {
    ("stylize_volume.py", "none.vti", "--out", "out"): "no file none.vti",
    ("stylize_volume.py", "notes.txt", "--out", "out"): "no array",
    ("stylize_volume.py", "volume.vti", "--array", "heat", "--out", "out"): "'heat'; it has: concentration",
    ("stylize_volume.py", "volume.vti", "--style", "none.png", "--out", "out"): "none.png",
    ("render_orbit.py", "none.svv", "--out", "orbit"): "none.svv",
    ("render_orbit.py", "out/scene.svv", "--frames", "1", "--out", "orbit"): "at least 2 frames",
    ("edit_palette.py", "out/scene.svv", "--colour", "99=#ff0000"): "no region 99",
    ("edit_palette.py", "out/scene.svv", "--opacity", "0=-1"): "at least 0",
    ("batch_styles.py", "out/scene.svv", "out/orbit", "--out", "painted"): "contains no pictures",
    ("batch_styles.py", "out/scene.svv", "brush.png", "out/../brush.png", "--out", "painted"): "rename one",
    (str(COMPARE), "--volumes", "4", "--out", "compared"): "at least 16",
    (str(COMPARE), "--volume", "none.vti", "--out", "compared"): "no volume none.vti",
    ("extract_views.py", "none.vti", "--out", "none.cdb"): "no file none.vti",
    ("extract_views.py", "volume.vti", "--phi", "361", "--out", "none.cdb"): "1 to 360 for phi",
}
"""Arguments, and a part of the sentence that they deserve."""

IN_TURN = """
import contextlib, io, json, runpy, sys
from collections.abc import Callable
from pathlib import Path
folder, commands, answers = Path(sys.argv[1]), json.loads(sys.argv[2]), []
sys.path.insert(0, str(folder))
for script, *arguments in commands:
    sys.argv = [script, *arguments]
    out, err, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            runpy.run_path(str(folder / script), run_name="__main__")
        except SystemExit as ended:
            code = ended.code
    answers.append([code, out.getvalue(), err.getvalue()])
print("ANSWERS", json.dumps(answers))
"""


def in_turn(pvpython, commands, **options) -> list[tuple[int, str, str]]:
    """Run scripts one after the other in one pvpython, whose start takes longer than they: code, output, errors."""
    done = pvpython(IN_TURN, SCRIPTS, json.dumps([list(command) for command in commands]), **options)
    (answers,) = (line for line in done.stdout.splitlines() if line.startswith("ANSWERS"))
    return [tuple(answer) for answer in json.loads(answers.removeprefix("ANSWERS "))]


def test_bad_input_is_a_sentence(made: Path, pvpython) -> None:
    (made / "notes.txt").write_text("no volume")
    for (command, said), (code, _, err) in zip(BAD.items(), in_turn(pvpython, BAD, cwd=made), strict=True):
        last = err.strip().splitlines()[-1]
        assert code == 2 and last.startswith(f"{Path(command[0]).name}: ") and said in last, (command, code, err)
        assert "Traceback" not in err
    assert not any((made / name).exists() for name in ("orbit", "painted", "compared", "none.cdb"))


def test_help_has_examples(pvpython) -> None:
    commands = [(str(path), "--help") for path in (*sorted(SCRIPTS.glob("*.py")), COMPARE)]
    assert len(commands) == 6
    for (script, _), (code, out, _) in zip(commands, in_turn(pvpython, commands), strict=True):
        assert code == 0 and "examples:" in out and f"svv pvpython {Path(script).name}" in out


def test_a_script_knows_the_program_that_runs_it(pvpython: Callable) -> None:
    """Without the plugin, too, which would have imported ParaView's modules by then."""
    pvpython(
        "from pathlib import Path\n"
        "from svv.pv.scripts import interpreter\n"
        "assert Path(interpreter()).is_file() and Path(interpreter()).name.startswith('pvpython'), interpreter()",
        environ={"PV_PLUGIN_PATH": ""},
    )
