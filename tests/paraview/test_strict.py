"""Errors of filters in scripts: exceptions that end the script with a sentence, unless it catches them."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.nightly import nightly

SHOWN = """
import sys, os
from paraview.simple import *
import svv, svv.pv
wavelet = Wavelet(WholeExtent=[-8, 8] * 3)
view = CreateView("RenderView")
view.ViewSize = [100, 100]
display = Show(wavelet, view)
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "RTData"))
few = "reconstruct.iterations=20; recolour.iterations=20"
options = dict(Preset="draft", Views=12, ViewSize=32, ImageSize=[48, 48], Settings=few)
bad = StyleRFStylizedView(Input=wavelet, StyleFiles=["/nowhere/style.png"], **options)
"""

SENTENCE = "StyleRF Stylized View: There is no style picture /nowhere/style.png: choose another under Style Files."

STRICT = SHOWN + "svv.pv.strict()\n"

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.mark.parametrize(
    "line",
    nightly(
        [
            "bad.UpdatePipeline()",
            "Hide(wavelet); Show(bad); Render()",
            "SaveData('x.png', proxy=bad)",
            "SaveData('x.vti', proxy=Threshold(Input=bad))",
            "Show(bad); SaveScreenshot('x.png')",
            "print(bad.PointData.keys())",
        ],
        "bad.UpdatePipeline()",
        "SaveData('x.vti', proxy=Threshold(Input=bad))",
    ),
)
def test_a_failure_ends_the_script_with_one_sentence(pvpython: Run, tmp_path: Path, line: str) -> None:
    done = pvpython(f"{STRICT}{line}\nprint('GONE ON')\n", cwd=tmp_path, check=False)
    assert done.returncode == 1
    ours = [said for said in done.stderr.splitlines() if "style.png" in said]
    assert len(ours) == 1 and ours[0].endswith(SENTENCE) and ", line 15: " in ours[0], done.stderr
    assert "GONE ON" not in done.stdout and "Traceback" not in done.stderr
    assert not list(tmp_path.glob("x.*"))


def test_what_no_function_could_tell_is_told_at_the_end(pvpython: Run) -> None:
    done = pvpython(STRICT + "bad.SMProxy.UpdatePipeline()\nprint('STATUS', bad.Status)\n", check=False)
    assert done.returncode == 1 and f"svv: {SENTENCE}" in done.stderr
    assert "STATUS There is no style picture" in done.stdout


def test_failures_are_exceptions_that_scripts_catch(pvpython: Run, tmp_path: Path) -> None:
    script = """
def caught(name, do):
    try:
        do()
    except svv.BadInput as error:
        print("CAUGHT", name, "|", error)
    else:
        print("CAUGHT", name, "| nothing")

caught("update", bad.UpdatePipeline)
caught("again", bad.UpdatePipeline)  # it does not work again, and has been told
bad.Preset = "fast"
caught("another", bad.UpdatePipeline)
caught("data", lambda: SaveData("x.png", proxy=bad))
behind = StyleRFPlaceInView(Input=bad)
caught("behind", behind.UpdatePipeline)
Hide(wavelet)
caught("screenshot", lambda: (Show(behind), SaveScreenshot("x.png")))
Hide(behind); Hide(bad)
caught("blank", lambda: SaveScreenshot("x.png"))
bad.StyleFiles, bad.Preset = [], "draft"
caught("right", bad.UpdatePipeline)
print("STATUS", bad.Status)
caught("right data", lambda: SaveData("right.png", proxy=bad))
bad.StyleFiles = ["/nowhere/style.png"]
caught("earlier", lambda: SaveData("x.png", proxy=bad))
svv.pv.strict(False)
bad.Preset = "fast"
caught("not strict", bad.UpdatePipeline)
print("STATUS", bad.Status)
svv.pv.strict()  # what went before counts as told: the script ends as if nothing had been wrong
"""
    done = pvpython(STRICT + script, cwd=tmp_path)
    said = dict(line[7:].split(" | ", 1) for line in done.stdout.splitlines() if line.startswith("CAUGHT"))
    plain = SENTENCE.split(": ", 1)[1]
    assert said == {
        "update": SENTENCE,
        "again": "nothing",
        "another": SENTENCE,
        "data": f"x.png is not saved, because StyleRF Stylized View has failed: {plain}",
        "behind": f"StyleRF Place In View: StyleRF Stylized View before this filter failed: {plain}",
        "screenshot": "x.png is not saved, because StyleRF Place In View has failed: StyleRF Stylized View before "
        f"this filter failed: {plain}",
        "blank": "x.png is not saved, because the view shows nothing: Show(filter, view) shows a filter in it.",
        "right": "nothing",
        "right data": "nothing",
        "earlier": SENTENCE,
        "not strict": "nothing",
    }
    status = [line for line in done.stdout.splitlines() if line.startswith("STATUS")]
    assert "regions, learned from" in status[0] and status[1] == f"STATUS {plain}"
    assert [path.name for path in tmp_path.glob("*.png")] == ["right.png"]
    # While it learned, the terminal showed how far it was, and no more than a line for each tenth.
    progress = [line for line in done.stderr.splitlines() if line.startswith("StyleRF Stylized View: ") and "%" in line]
    assert progress and "100%" in progress[-1] and len(progress) < 40, done.stderr


def test_a_save_button_that_fails_is_an_exception(pvpython: Run) -> None:
    done = pvpython(STRICT + "StyleRFLook(Input=bad, LookFile='x.look').SaveLook()\nprint('GONE ON')", check=False)
    assert done.returncode == 1 and "GONE ON" not in done.stdout, done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("program", ["pvpython", pytest.param("pvbatch", marks=pytest.mark.slow)])
def test_the_commands_start_strict(environ: dict[str, str], tmp_path: Path, program: str) -> None:
    (tmp_path / "script.py").write_text(SHOWN + "Show(bad)\nprint('GONE ON')\n")
    command = [sys.executable, "-m", "svv", program, "script.py"]
    paths = {"PYTHONPATH": str(Path(__file__).parents[2]), "PV_PLUGIN_PATH": ""}

    def run(**more: str) -> subprocess.CompletedProcess[str]:
        own = {**environ, **paths, **more}
        return subprocess.run(command, env=own, cwd=tmp_path, capture_output=True, text=True, timeout=600)

    done = run()
    assert done.returncode == 1 and done.stderr.endswith(f"script.py, line 14: {SENTENCE}\n"), done.stderr
    assert "GONE ON" not in done.stdout
    done = run(SVV_STRICT="0")
    assert done.returncode == 0 and "GONE ON" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("more", [[], pytest.param(["--sym"], marks=pytest.mark.slow)])
def test_all_ranks_end(mpiexec: Run, environ: dict[str, str], paraview, more: list[str]) -> None:
    done = mpiexec(STRICT + "Show(bad)\nprint('GONE ON')\n", program=[paraview.program("pvbatch"), *more], check=False)
    assert done.returncode == 1 and SENTENCE in done.stderr, done.stderr
    if not more:
        assert "GONE ON" not in done.stdout


def test_failures_on_a_server_are_exceptions_of_the_client(pvpython: Run, start_pvserver: Callable[..., int]) -> None:
    script = STRICT.replace("import svv,", "Connect('127.0.0.1', int(sys.argv[1]))\nimport svv,")
    script += """
for preset in ("draft", "draft", "fast"):
    bad.Preset = preset
    try:
        bad.UpdatePipeline()
        print("SAID nothing")
    except svv.BadInput as error:
        print("SAID", error)
try:
    SaveData("x.png", proxy=bad)
except svv.BadInput as error:
    print("SAID", error)
"""
    done = pvpython(script, start_pvserver())
    said = [line for line in done.stdout.splitlines() if line.startswith("SAID")]
    assert said[:3] == [f"SAID {SENTENCE}", "SAID nothing", f"SAID {SENTENCE}"]
    assert said[3].startswith("SAID x.png is not saved, because StyleRF Stylized View has failed: There is no style")
