"""The orbit as an animation: Play and Save Animation circle a scene, while the data's time stands still."""

from __future__ import annotations

from svv.errors import BadInput
from svv.pv.display.linked_camera import newest
from svv.pv.paraview_types import Proxy

SHOWN = {"StyleRFRender": "Frame", "StyleRFStylizedView": "Frame", "StyleRFViews": "ShownView",
         "StyleRFViewsReader": "ShownView"}  # fmt: skip
"""Filter -> the property that selects which of several images it shows."""

NONE = "There is nothing to orbit: add StyleRF Render or StyleRF Stylized View first."


def play_orbit(filter: Proxy | None = None, frames: int | None = None) -> Proxy:
    """Animate the frames of the orbit, or the views of a set, at the data's time that is shown now; return the track.

    The filter is StyleRF Render, Stylized View, Views or a folder of views, by default the active one or the newest;
    the orbit's camera replaces its own. There are at least 2 frames, by default as many as images. Raises BadInput if
    there is no such filter, or there are too few frames.
    """
    from paraview import simple

    filter = filter or newest(SHOWN, NONE)
    name = SHOWN[filter.SMProxy.GetXMLName()]
    if name == "Frame":
        filter.Camera = [0.0] * 9 + [30.0]
    filter.UpdatePropertyInformation()
    last = filter.SMProxy.GetProperty(name).FindDomain("vtkSMIntRangeDomain").GetMaximum(0)
    frames = last + 1 if frames is None else frames
    if frames < 2:
        raise BadInput(f"An animation needs at least 2 frames, not {frames}.")
    track = simple.GetAnimationTrack(name, proxy=filter)
    # ParaView rounds interpolated values down, so a value slightly below 16 would become 15.
    ends = [(0.0, 0.25), (1.0, last + 0.25)]
    track.KeyFrames = [simple.CompositeKeyFrame(KeyTime=time, KeyValues=[value]) for time, value in ends]
    simple.GetTimeTrack().Enabled = 0
    scene = simple.GetAnimationScene()
    scene.PlayMode, scene.NumberOfFrames = "Sequence", frames
    return track


def stop_orbit() -> None:
    """Let the animation follow the data's time again; every filter keeps the image that it shows."""
    from paraview import simple

    scene = simple.GetAnimationScene()
    for track in list(scene.Cues):
        animated = getattr(track, "AnimatedProxy", None)
        if animated is not None and SHOWN.get(animated.SMProxy.GetXMLName()) == track.AnimatedPropertyName:
            simple.Delete(track)
    simple.GetTimeTrack().Enabled = 1
    scene.UpdateAnimationUsingDataTimeSteps()
