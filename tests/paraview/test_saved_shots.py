"""Key frames of the animation's camera, saved as a shot by the macro, in the real ParaView."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]

import svv
from svv.core.geometry.cameras import look_at
from svv.fields.scene.scene import Scene
from svv.render.shots.film import Film

MACRO = Path(__file__).resolve().parents[2] / "plugin" / "macros" / "StyleRF save shot.py"

ANIMATED = (
    VOLUME
    + f"""
import runpy
from svv.errors import BadInput
from svv.pv.client.shot import save_shot
macro = lambda: runpy.run_path({str(MACRO)!r})
view = CreateView("RenderView")
view.ViewSize = [160, 90]
animation = GetAnimationScene()
macro()
Sphere()
Show()
try:
    save_shot()
except BadInput as error:
    assert "no key frames of this view's camera" in str(error), error
else:
    raise AssertionError("a shot of nothing")
animation.PlayMode, animation.NumberOfFrames = "Sequence", 61
cue = GetCameraTrack(view)
def key(time, position, up=(0, 1, 0), angle=30.0):
    return CameraKeyFrame(KeyTime=time, Position=position, FocalPoint=[0.1, 0, 0], ViewUp=up, ViewAngle=angle)
cue.KeyFrames = [key(0.0, [0, 0, 3]), key(0.25, [3, 0, 0.5]), key(1.0, [0, 2, -2], (0, 0, 1), 20.0)]
"""
)


def test_key_frames_of_the_camera_become_those_of_a_shot(pvpython: Callable, cube: Scene, tmp_path: Path) -> None:
    done = pvpython(
        ANIMATED
        + """
import os
os.chdir(sys.argv[1])
macro()
track = GetAnimationTrack("Radius", proxy=FindSource("Sphere1"))
track.KeyFrames = [CompositeKeyFrame(KeyTime=time, KeyValues=[1.0 + time]) for time in (0.0, 1.0)]
print("from here on")
macro()
cue.Mode = "Follow-data"
try:
    save_shot("never.json")
except BadInput as error:
    assert "follows data" in str(error), error
else:
    raise AssertionError("it follows data")
cue.Mode = "Interpolate Camera"
try:
    animation.PlayMode, animation.Duration = "Real Time", 8
except ValueError:  # ParaView 6 knows frames alone
    animation.NumberOfFrames = 241
view.CameraParallelProjection = 1
assert str(save_shot("parallel.json")) == "parallel.json"
cue.Enabled = 0
try:
    save_shot()
except BadInput as error:
    assert "no key frames" in str(error), error
else:
    raise AssertionError("the track is off")
""",
        tmp_path,
    )
    first, then = done.stdout.split("from here on")
    assert "no key frames" in first and "camera alone" not in first
    assert "not what else the animation changes: Radius." in then
    assert sorted(path.name for path in tmp_path.glob("*.json")) == [
        "animation-2.shot.json", "animation.shot.json", "parallel.json"
    ]  # fmt: skip
    shot = svv.read_shot(tmp_path / "animation.shot.json")
    assert shot == svv.read_shot(tmp_path / "animation-2.shot.json")
    film = Film(cube, shot)
    assert len(film.cameras) == 61 and [key.time for key in shot.keys] == [0.0, 0.5, 2.0]
    keys = ((0, (0, 0, 3), (0, 1, 0), 30), (15, (3, 0, 0.5), (0, 1, 0), 30), (60, (0, 2, -2), (0, 0, 1), 20))
    for number, position, up, angle in keys:
        camera = film.cameras[number]
        np.testing.assert_allclose(camera.camera_to_world, look_at(position, (0.1, 0, 0), up), atol=1e-6)
        assert (camera.width, camera.height) == (160, 90)
        assert 2 * np.degrees(np.arctan(45 / camera.focal)) == pytest.approx(angle)  # ParaView's is the vertical one
    parallel = svv.read_shot(tmp_path / "parallel.json")
    assert parallel.seconds == 8.0 and all(key.camera.span is not None for key in parallel.keys if key.camera)


@pytest.mark.slow
def test_a_path_of_the_camera_is_followed(pvpython: Callable, cube: Scene, tmp_path: Path) -> None:
    """As ParaView itself moves the camera, at any of its frames."""
    pvpython(
        ANIMATED
        + """
import json, math
ring = [[3 * math.cos(a), 0.5, 3 * math.sin(a)] for a in (2 * math.pi * k / 7 for k in range(7))]
first = CameraKeyFrame(KeyTime=0.0, PositionPathPoints=sum(ring, []), FocalPathPoints=[0, 0, 0], ClosedPositionPath=1)
first.ViewUp = [0, 1, 0]
cue.Mode = "Path-based"
cue.KeyFrames = [first, CameraKeyFrame(KeyTime=1.0)]
save_shot(sys.argv[1] + "/path.json")
seen = []
animation.GoToFirst()
for _ in range(60):
    camera = view.GetActiveCamera()
    seen.append([*camera.GetPosition(), *camera.GetFocalPoint()])
    animation.GoToNext()
with open(sys.argv[1] + "/seen.json", "w") as file:
    json.dump(seen, file)
""",
        tmp_path,
    )
    film = Film(cube, svv.read_shot(tmp_path / "path.json"))
    seen = np.array(json.loads((tmp_path / "seen.json").read_text()))
    assert np.ptp(seen[:, 0]) > 5.0
    for number, (*position, x, y, z) in enumerate(seen):
        camera = film.cameras[number]
        np.testing.assert_allclose(camera.position, position, atol=0.01)
        column, row, _ = camera.project((x, y, z))
        assert (column, row) == pytest.approx((80, 45), abs=0.5)
