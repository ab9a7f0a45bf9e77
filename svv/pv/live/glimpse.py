"""Images of what there is before a scene has been learned: small ones, enlarged, so that they hold nobody up."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.errors import Progress
from svv.pv.panel_values import Values
from svv.pv.vtk_types import Data
from svv.pv.work.base import Filter

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

Arrays = dict[str, NDArray[np.number]]
"""Arrays of an image by name."""

LONGEST = 200
"""Longer side of what is rendered, pixels."""


def drawn_small(scene: Scene, values: Values, progress: Progress) -> tuple[Arrays, Camera]:
    """Return the image of a scene as a panel's values ask, with fewer pixels, and the camera that it is meant for."""
    from svv.pv.work.engine import camera_for, draw

    camera = camera_for(scene.rig, values)
    return draw(scene, small(camera), {**values, "Moving": True}, progress), camera


def glanced(filter: Filter, data: Data | None) -> tuple[Arrays, Camera]:
    """Return an image of a volume that a filter has not learned yet, as ParaView draws it, and its camera."""
    from svv.dvr.draw.glance import Glance
    from svv.pv.display.shown import volume_shown
    from svv.pv.work.engine import camera_for, moment_of, shading_of, transfer_function_of, volume_of

    values = filter.values
    now = moment_of(data, values, None)

    def make() -> Glance:
        image = volume_shown(volume_of(data, values), values)
        return Glance(image, transfer_function_of(values), shading_of(values))

    glance: Glance = filter.get_or_make("glance", (now.look, now.data, now.settings), make)
    camera = camera_for(glance.rig, values)
    rgba = glance.draw(small(camera))
    nothing: Arrays = {
        "Depth": np.full(rgba.shape[:2], np.nan, np.float32),
        "Region": np.full(rgba.shape[:2], -1, np.int16),
    }
    return {"RGBA": rgba, **nothing}, camera


def small(camera: Camera) -> Camera:
    """Return a camera for an image whose longer side is at most :data:`LONGEST`."""
    scale = min(LONGEST / max(camera.width, camera.height), 1.0)
    return camera.resized(max(round(scale * camera.width), 1), max(round(scale * camera.height), 1))


def enlarged(arrays: Arrays, camera: Camera) -> Arrays:
    """Return the arrays of an image at a camera's size: colours smoothly, others by their nearest pixel."""
    if arrays["RGBA"].shape[:2] == (camera.height, camera.width):
        return arrays
    from PIL import Image

    picture = Image.fromarray(arrays["RGBA"]).convert("RGBa")
    rgba = np.asarray(picture.resize((camera.width, camera.height), Image.Resampling.BICUBIC).convert("RGBA"))
    height, width = arrays["RGBA"].shape[:2]
    rows = np.arange(camera.height) * height // camera.height
    columns = np.arange(camera.width) * width // camera.width
    return {name: rgba if name == "RGBA" else values[rows][:, columns] for name, values in arrays.items()}
