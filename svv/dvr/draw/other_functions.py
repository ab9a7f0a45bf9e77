"""A volume classified by other transfer functions than the one that its scene was trained with, over the same grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.geometry.box import Box
from svv.dvr.draw.averaging import averaged
from svv.dvr.draw.classify import as_voxels_are, extinction, resampled
from svv.dvr.draw.frame import place_whole
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import to_array


def exponents_over(
    image: vtkImageData, functions: Sequence[TransferFunction], box: Box, cells: int
) -> tuple[NDArray[np.float32], list[NDArray[np.float16]]]:
    """Return a volume's values on a grid, and the logarithm of the extinction that each function gives them there.

    The functions are for the values of a volume (see ``as_volume``), with unit distances; the grid has ``cells`` per
    box unit over a box in world units. Values are NaN outside the volume, exponents as in a ClassifiedVolume, (X + 1, Y
    + 1, Z + 1) each. Raises BadInput if a function lies outside the values, or shows nothing or all of the volume.
    """
    numbers = to_array(image)
    low, high = float(numbers.min()), float(numbers.max())
    values = np.zeros(0, np.float32)
    found: list[NDArray[np.float16]] = []
    for function in functions:
        stage = place_whole(image, function.fitted(low, high, rescale=False))
        if not found:
            values = resampled(stage, box, cells)
        known, sigma = extinction(stage, box, *stage.staged((low, high)).tolist())
        found.append(averaged(values, known, sigma, [0], as_voxels_are(stage, box, known))[0])
    return stage.of_volume(values).astype(np.float32).T, found
