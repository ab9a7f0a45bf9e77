"""Cameras of the views of a volume."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from svv.bricks.formats.source import Level
from svv.core.geometry.cameras import CameraRig
from svv.dvr.draw.frame import Stage
from svv.options.making import ViewOptions

FRAMING = 4.0311 / (0.516 * np.sqrt(3.0))
"""Camera distance / half the diagonal of the visible box, as in the views published with StyleRF-VolVis."""

FOV = np.pi / 6
"""Horizontal angle of view in radians to which ``FRAMING`` applies."""


def rig_of(asked: ViewOptions, stage: Stage, whole: Level) -> CameraRig:
    """Return the cameras around what is visible, or around the whole volume."""
    fov = float(np.radians(asked.fov))
    centre, half = stage.centre, 0.5 * stage.visible_size
    if asked.frame == "whole":
        last = np.array(whole.shape[::-1]) - 1
        centre, half = whole.origin + 0.5 * whole.axes @ last, 0.5 * last * whole.spacing
    # With a narrower angle of view, cameras are farther away, so the volume fills the same part of the image.
    radius = float(FRAMING * np.linalg.norm(half) * np.tan(0.5 * FOV) / np.tan(0.5 * fov))
    x, y, z = (float(v) for v in centre)
    rig = CameraRig((x, y, z), radius, fov)
    return replace(rig, span_x=rig.view_width) if asked.projection == "orthographic" else rig
