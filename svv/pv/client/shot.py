"""The camera's key frames of ParaView's animation as a shot, which ``svv render --shot`` films. Client code."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

from svv.errors import BadInput
from svv.io.files.atomic import is_file
from svv.io.shot_file import write_shot
from svv.options.shots import CameraKey, KeyFrame, Shot
from svv.pv.display.linked_camera import inputs_of
from svv.pv.paraview_types import Proxy, View

FPS = 30.0
"""Frames per second of a film, by which frames of the animation are seconds of the shot."""

SAMPLES = 24
"""Key frames that a path of the camera becomes, which svv's curves follow to a thousandth of its size."""

NONE = "The animation has no key frames of this view's camera: add its camera to the animation, with two key frames."


def save_shot(path: str | Path | None = None, view: View | None = None) -> Path:
    """Write the key frames of a view's camera as a shot; return its file.

    The view is by default the active one; the file, one that does not exist yet, ``NAME.shot.json`` beside the file of
    the active source, or in the current folder. Times are those of the animation at 30 frames per second, or of its
    duration in real time. Raises BadInput if the view's camera has no key frames or follows data, or the file cannot be
    written.
    """
    from paraview import simple

    view = view or simple.GetActiveView()
    if view is None or view.GetXMLName() != "RenderView":
        raise BadInput("There is no 3D view: click the one whose camera is animated.")
    cue = _camera_cue(view)
    seconds, keys = _seconds(), list(cue.KeyFrames)
    if cue.Mode == "Follow-data":
        raise BadInput("The camera follows data, of which a shot knows nothing: give it key frames instead.")
    told = _along_paths(keys) if cue.Mode == "Path-based" else [(key.KeyTime, _placed(key)) for key in keys]
    width, height = view.ViewSize
    frames = [
        KeyFrame(round(seconds * time, 6), CameraKey(**place, **_lens(key, view)))
        for (time, place), key in zip(told, _keys_at([time for time, _ in told], keys), strict=True)
    ]
    out = _free_name() if path is None else Path(path)
    write_shot(out, Shot(seconds, tuple(frames), size=(int(width), int(height))))
    return out


def left_out(view: View | None = None) -> list[str]:
    """Return what the animation changes besides a view's camera and the data's time, which no shot of it has."""
    from paraview import simple

    view = view or simple.GetActiveView()
    cues = [
        cue for cue in simple.GetAnimationScene().Cues if cue.Enabled and len(getattr(cue, "KeyFrames", None) or ()) > 1
    ]
    others = [cue for cue in cues if cue.AnimatedProxy is not None and cue.AnimatedProxy != view]
    return [str(getattr(cue, "AnimatedPropertyName", None) or "camera of another view") for cue in others]


def _camera_cue(view: View) -> Any:
    """Return the track of a view's camera that is on and has key frames."""
    from paraview import simple

    for cue in simple.GetAnimationScene().Cues:
        if cue.GetXMLName() == "CameraAnimationCue" and cue.AnimatedProxy == view and cue.Enabled:
            if len(cue.KeyFrames) > 1:
                return cue
    raise BadInput(NONE)


def _seconds() -> float:
    """Return how long the animation lasts."""
    from paraview import simple

    scene = simple.GetAnimationScene()
    if scene.PlayMode == "Real Time":
        return float(scene.Duration)
    count = scene.NumberOfFrames
    if scene.PlayMode == "Snap To TimeSteps":
        count = len(simple.GetTimeKeeper().TimestepValues or ())
    return round((max(2, int(count)) - 1) / FPS, 6)


def _placed(key: Any) -> dict[str, Any]:
    """Return position, centre and direction up of a key frame."""
    return {
        name: tuple(float(v) for v in numbers)
        for name, numbers in (("position", key.Position), ("centre", key.FocalPoint), ("up", key.ViewUp))
    }


def _along_paths(keys: list[Any]) -> list[tuple[float, dict[str, Any]]]:
    """Return times and places on the camera's paths, ParaView's splines, each of which begins at a key frame."""
    found: list[tuple[float, dict[str, Any]]] = []
    for key, after in pairwise(keys):
        position = _spline(key.PositionPathPoints, bool(key.ClosedPositionPath))
        focus = _spline(key.FocalPathPoints, bool(key.ClosedFocalPath))
        last = after is keys[-1]
        for k in range(SAMPLES + last):
            part = k / SAMPLES
            place = {"position": position(part), "centre": focus(part), "up": tuple(float(v) for v in key.ViewUp)}
            found.append((key.KeyTime + part * (after.KeyTime - key.KeyTime), place))
    return found


def _spline(numbers: Any, closed: bool) -> Any:
    """Return a function that gives the point at a part of a path, as ParaView's camera has it."""
    from vtkmodules.vtkCommonComputationalGeometry import vtkParametricSpline
    from vtkmodules.vtkCommonCore import vtkPoints

    points, spline = vtkPoints(), vtkParametricSpline()
    for k in range(0, len(numbers), 3):
        points.InsertNextPoint(*numbers[k : k + 3])
    spline.SetPoints(points)
    spline.SetClosed(closed)

    def at(part: float) -> tuple[float, ...]:
        if points.GetNumberOfPoints() == 1:
            return tuple(float(v) for v in numbers)
        point = [0.0, 0.0, 0.0]
        spline.Evaluate([part, 0.0, 0.0], point, [0.0] * 9)
        return tuple(point)

    return at


def _keys_at(times: list[float], keys: list[Any]) -> list[Any]:
    """Return the last key frame that is not after each time."""
    return [max((key for key in keys if key.KeyTime <= time + 1e-9), key=lambda key: key.KeyTime) for time in times]


def _lens(key: Any, view: View) -> dict[str, Any]:
    """Return the horizontal angle of view, or the width of what is seen by parallel rays."""
    width, height = view.ViewSize
    if view.CameraParallelProjection:
        return {"span": 2.0 * float(key.ParallelScale) * width / height}
    half = math.tan(0.5 * math.radians(float(key.ViewAngle))) * width / height
    return {"fov": math.degrees(2.0 * math.atan(half))}


def _free_name() -> Path:
    """Return the name of a file that does not exist, beside that of the active source."""
    from paraview import simple

    place = Path.cwd() / "animation"
    source: Proxy | None = simple.GetActiveSource()
    while source is not None:
        given = [getattr(source, field, None) for field in ("FileName", "FileNames", "SceneFile")]
        name = next((str(one if isinstance(one, str) else next(iter(one))) for one in given if one), "")
        if name:
            place = Path(name)
            break
        source = next(iter(inputs_of(source)), None)
    for number in range(1, 10000):
        path = place.with_name(f"{place.stem}{'' if number == 1 else f'-{number}'}.shot.json")
        if not is_file(path):
            return path
    raise BadInput(f"{place.parent} is full of shots: give the file a name.")
