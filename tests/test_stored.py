"""Scenes of which only the headers are read, and what is said from them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.io.files.keyed_results import digest
from svv.io.scene_file import read_scene_file, read_scene_header
from svv.pv.results import expected
from svv.pv.results.keys import digest_of_scene, name_of
from svv.pv.results.stored import Stored, describe_parts
from svv.pv.work.unfinished import NotYetThere, is_unfinished, mark_unfinished
from svv.pv.work.vtk_data import finished_scene_of, put_scene, put_stored, scene_of
from tests.cube import cube_paint, cube_scene
from tests.nightly import nightly

LIGHT = """
import sys
import svv.dvr.draw.glance, svv.pv.work.vtk_data, svv.pv.results.stored
from pathlib import Path
stored, content = svv.pv.results.stored.Stored.and_content(Path(sys.argv[1]))
from vtkmodules.vtkCommonDataModel import vtkTable
svv.pv.work.vtk_data.put_stored(stored, content, vtkTable())
print([name for name in ("torch", "numba") if name in sys.modules])
"""


@pytest.fixture
def painted(tmp_path: Path) -> Path:
    """A painted scene's file."""
    cube = cube_scene()
    cube.painted(cube_paint(cube, 1), {0: "brush"}, {}, "ink").edited(1, opacity=0.5).save(tmp_path / "cube.svv")
    return tmp_path / "cube.svv"


def test_headers_are_those_of_the_whole_file(painted: Path, tmp_path: Path) -> None:
    assert read_scene_header(painted) == read_scene_file(painted)[0]
    stored, scene = Stored.read(painted), Scene.load(painted)
    assert stored.made == scene.made and [r.opacity for r in stored.regions] == [r.opacity for r in scene.regions]
    assert not stored.follows_time
    stored.save(tmp_path / "copy.svv")
    assert (tmp_path / "copy.svv").read_bytes() == painted.read_bytes()
    for name, content in (("short", painted.read_bytes()[:40]), ("foreign", b"something else")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(BadInput, match=name):
            read_scene_header(tmp_path / name)
    with pytest.raises(BadInput, match="There is no scene file"):
        Stored.read(tmp_path / "none.svv")
    with pytest.raises(BadInput, match="cannot be read"):
        Stored.and_content(tmp_path / "none.svv")


def test_a_table_is_filled_without_what_draws(painted: Path) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkTable

    said = subprocess.run([sys.executable, "-c", LIGHT, painted], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "[]"
    one, other = vtkTable(), vtkTable()
    put_stored(*Stored.and_content(painted), one)
    put_scene(Scene.load(painted), other)
    assert one.GetNumberOfColumns() == other.GetNumberOfColumns() and one.GetNumberOfRows() == 3
    for name in ("Region", "Colour", "Share", "Part Of", "Values", "Opacity", "Lighting"):
        first, second = (vtk_to_numpy(table.GetColumnByName(name)) for table in (one, other))
        assert np.array_equal(first, second, equal_nan=True), name
    assert digest_of_scene(scene_of(one)) == digest_of_scene(scene_of(other))


def test_parts_of_a_picture_are_told_from_the_header(painted: Path, tmp_path: Path) -> None:
    """So they are told while another process draws the scene, too."""
    scene, part = Scene.load(painted), {"style": "a.png", "part": "sky", "colours": ["#102030", "#405060", "#708090"]}
    scene = replace(scene, made={**scene.made, "stylized": {"divided": {"0": part}}})
    scene.save(tmp_path / "divided.svv")
    said = describe_parts(scene)
    assert said == "Region 0: sky of a.png (#102030, #405060, #708090)."
    assert describe_parts(Stored.read(tmp_path / "divided.svv")) == said


def test_what_is_still_being_learned_is_marked(painted: Path) -> None:
    from vtkmodules.vtkCommonDataModel import vtkTable

    table = vtkTable()
    with pytest.raises(BadInput, match="not a scene"):
        scene_of(table)
    mark_unfinished(table)
    with pytest.raises(NotYetThere, match="as soon as there is something"):
        scene_of(table)
    put_scene(Scene.load(painted), table)
    assert not is_unfinished(table) and finished_scene_of(table) is scene_of(table)
    mark_unfinished(table)
    assert is_unfinished(table) and scene_of(table).variant == "ink"
    with pytest.raises(NotYetThere, match="when it is there"):
        finished_scene_of(table)


def test_the_last_paintings_tell_how_long_one_takes(
    painted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SVV_CACHE", str(tmp_path / "kept"))
    monkeypatch.setattr(expected, "usable_cpus", lambda: 4)
    text = "On this machine: draft (a sketch) {}, fast (good) {}, balanced (better) {}."
    unknown = text.format("about 20 s", "about 2 min", "about 2 min")
    assert expected.expected() == unknown
    (tmp_path / "kept").mkdir()
    file = tmp_path / "kept" / name_of("painting", digest("a"), digest("b"))
    keep(painted, file, "draft", 100.0)
    used = file.stat().st_mtime_ns
    assert expected.expected() == text.format("about 2 min", "about 10 min", "about 12 min")
    assert file.stat().st_mtime_ns == used, "looking is no use"
    file.write_bytes(b"damaged")
    assert expected.expected() == unknown
    monkeypatch.setenv("SVV_CACHE_SIZE", "much")
    assert expected.expected() == unknown


def keep(painted: Path, file: Path, preset: str, seconds: float, load: float = 0.6, views: int = 92) -> None:
    """Save a painting that took so many seconds, and in its parts ``load`` times those of the processor."""
    parts = [{"seconds": {"total": part * seconds}, "cpu_seconds": part * seconds / load} for part in (0.7, 0.2)]
    made = {"preset": preset, "views": views, **parts[0], "stylized": parts[1], "source": {"seconds": 0.1 * seconds}}
    replace(Scene.load(painted), made=made).save(file)


def told_of_presets() -> list[float]:
    """Seconds that are told for draft, fast and balanced."""
    units = {"s": 1.0, "min": 60.0}
    return [float(number) * units[unit] for number, unit in re.findall(r"about (\d+) (s|min)", expected.expected())]


@pytest.mark.parametrize("preset", ["draft", "fast", "balanced"])
@pytest.mark.parametrize("seconds", nightly([3.0, 50.0, 300.0, 4000.0], 3.0, 4000.0))
def test_one_measurement_tells_the_times_of_all_presets_in_their_ratio(
    painted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, preset: str, seconds: float
) -> None:
    monkeypatch.setenv("SVV_CACHE", str(tmp_path / "kept"))
    (tmp_path / "kept").mkdir()
    keep(painted, tmp_path / "kept" / name_of("painting", digest("a"), digest("b")), preset, seconds)
    draft, fast, balanced = told_of_presets()
    assert draft <= fast <= balanced
    assert {"draft": draft, "fast": fast, "balanced": balanced}[preset] == pytest.approx(seconds, abs=30.0)
    if seconds >= 300.0:
        assert draft < fast < balanced and fast / draft == pytest.approx(6.0, rel=0.3)


def test_a_busy_machine_and_smaller_work_tell_nothing_of_its_speed(
    painted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SVV_CACHE", str(tmp_path / "kept"))
    (tmp_path / "kept").mkdir()
    unknown = told_of_presets()
    names = [tmp_path / "kept" / name_of("painting", digest("a"), digest(str(k))) for k in range(4)]
    for age, file in enumerate(names):
        keep(painted, file, "draft", 300.0, load=4.0)
        if age == 1:
            keep(painted, file, "draft", 2.0, views=12)
        if age == 2:
            keep(painted, file, "paper", 20000.0)
        os.utime(file, (1e9 + age, 1e9 + age))
    assert told_of_presets() == unknown, "five minutes at load, and a small job, are taken for the machine's speed"
    keep(painted, names[3], "fast", 600.0)  # measured again
    assert told_of_presets() == [120.0, 600.0, 720.0]
    keep(painted, names[0], "draft", 300.0, load=4.0)  # at load again, later
    assert told_of_presets() == [120.0, 600.0, 720.0]


@pytest.mark.parametrize(("seconds", "said"), [(3.0, "about 5 s"), (41.0, "about 40 s"), (100.0, "about 2 min")])
def test_durations_as_people_say_them(seconds: float, said: str) -> None:
    assert expected.duration(seconds) == said
