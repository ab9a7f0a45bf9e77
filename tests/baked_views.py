"""Baked volumes drawn by VTK's fixed-point ray caster, the one that ParaView uses without a GPU."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkMultiThreader
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.core.volumes.opacity_code import opacity_points
from svv.dvr.draw import casters
from svv.dvr.draw.frame import Stage
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance
from svv.render.baking.baked_volume import BakedVolume


class BakedCaster(casters.CpuMapper):
    """The ray caster with which views of volumes are drawn, on a baked volume; ``step`` in voxels."""

    def __init__(self, volume: BakedVolume, step: float = 0.5) -> None:
        grid, image = volume.grid, vtkImageData()
        image.SetDimensions(*grid.shape)
        image.SetOrigin(*grid.origin)
        image.SetSpacing(*(grid.spacing,) * 3)
        self._array = volume.rgba.reshape(-1, 4)
        image.GetPointData().SetScalars(numpy_to_vtk(self._array))
        grey = ((0.0, 0.0, 0.0, 0.0), (255.0, 1.0, 1.0, 1.0))
        tf = TransferFunction(grey, tuple((c, o, 0.5, 0.0) for c, o in opacity_points(volume.most)), name="baked")
        size = grid.spacing * (np.array(grid.shape) - 1)
        self._codes = volume.rgba[..., 3]
        stage = Stage(image, tf, grid.unit_distance, np.eye(3), np.zeros(3), 1.0, size, 1.0, 0.0, Appearance(), tf)
        theirs = patch.object(casters, "_visible_blocks", self._visible_blocks)  # and reals are for scalars
        with theirs, patch.object(Stage, "reals", image):
            super().__init__(stage, Shading(on=False), step * grid.spacing)
        self._volume.GetProperty().IndependentComponentsOff()

    def cast(self, camera: Camera) -> np.ndarray:
        """Cast rays with all threads, but look for empty blocks with one, as ParaView does.

        With several, VTK (seen in 9.7) takes the wrong blocks of a volume of colours for empty.
        """
        limit = vtkMultiThreader.GetGlobalMaximumNumberOfThreads()
        vtkMultiThreader.SetGlobalMaximumNumberOfThreads(1)
        try:
            return super().cast(camera)
        finally:
            vtkMultiThreader.SetGlobalMaximumNumberOfThreads(limit)

    def _visible_blocks(self, stage: Stage) -> tuple[np.ndarray, float]:
        side = casters.BLOCK
        padded = np.pad(self._codes > 0, [(0, -size % side) for size in self._codes.shape])
        z, y, x = (size // side for size in padded.shape)
        blocks = np.argwhere(padded.reshape(z, side, y, side, x, side).any(axis=(1, 3, 5)))[:, ::-1]
        spacing = np.array(stage.image.GetSpacing())
        radius = 0.5 * (side + 2) * np.linalg.norm(spacing)  # a point's cells reach to the next in every direction
        return (blocks + 0.5) * side * spacing + stage.image.GetOrigin(), float(radius)
