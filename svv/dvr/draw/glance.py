"""A volume seen at once, from any camera: drawn roughly, while something better is being made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.frame import set_stage
from svv.dvr.draw.large import Opened
from svv.dvr.draw.rig import rig_of
from svv.dvr.draw.views import open_caster
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.options.making import ViewOptions

STEP = 0.5
"""Sample distance in voxels."""


class Glance:
    """A volume (``as_volume``), its transfer function and shading, ready to be drawn; raises as ``render_views``."""

    def __init__(self, volume: vtkImageData, tf: TransferFunction, shading: Shading) -> None:
        opened = Opened.of(volume, "auto", None)
        stage = set_stage(opened.image, tf.fitted(*opened.range, rescale=False))
        self.rig = rig_of(ViewOptions(), stage, opened.whole)
        """The cameras around what is visible, as those of the views and of the scene that is learned from them."""
        self._caster, _ = open_caster(stage, "auto", shading, STEP, opened.caster(tf))

    def draw(self, camera: Camera) -> NDArray[np.uint8]:
        """Return the image from a camera, with straight alpha. (height, width, 4)"""
        return self._caster.render(camera)

    def close(self) -> None:
        """Release what drawing takes."""
        self._caster.close()
