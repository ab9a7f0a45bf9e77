#!/usr/bin/env bash
# VTK 9.7.2: the picture of a mask of 0 and 1 depends on the type of its numbers.
#
# One mask, one opacity function, linear interpolation. The fixed-point ray caster rounds interpolated integers to
# integers, so that a voxel's border lies at 0.5 whatever the function says between 0 and 1; with float32 it
# interpolates. The GPU ray caster interpolates, but draws uint8 unlike int16 and float32. Needs Mesa or a graphics
# card.
#
# Seen: mean grey value of the picture.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check vtk==9.7.2 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkRenderingCore import (
    vtkColorTransferFunction, vtkRenderer, vtkRenderWindow, vtkVolume, vtkVolumeProperty, vtkWindowToImageFilter,
)
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper
from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper


def picture(mapper, values, opacities, direction=(1, 0, 0, 0, 1, 0, 0, 0, 1)):
    """The picture of a white volume on black, 100 x 100."""
    image = vtkImageData()
    image.SetDimensions(*values.shape[::-1])
    image.SetDirectionMatrix(direction)
    image.GetPointData().SetScalars(numpy_to_vtk(values.ravel(), deep=1))
    opacity, colour, look = vtkPiecewiseFunction(), vtkColorTransferFunction(), vtkVolumeProperty()
    for point in opacities:
        opacity.AddPoint(*point)
    colour.AddRGBPoint(0, 1, 1, 1)
    look.SetInterpolationTypeToLinear()
    look.SetScalarOpacity(opacity)
    look.SetColor(colour)
    volume, drawn, renderer, window = vtkVolume(), mapper(), vtkRenderer(), vtkRenderWindow()
    drawn.SetInputData(image)
    volume.SetMapper(drawn)
    volume.SetProperty(look)
    renderer.AddVolume(volume)
    window.SetOffScreenRendering(1)
    window.SetSize(100, 100)
    window.AddRenderer(renderer)
    renderer.ResetCamera()
    window.Render()
    grab = vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.Update()
    return vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars())[:, 0].reshape(100, 100)


z, y, x = np.mgrid[:20, :20, :20] - 9.5
ball = x**2 + y**2 + z**2 < 49
steps = [(0, 0), (0.125, 0), (0.225, 0.35), (1, 0.6)]
for mapper in (vtkFixedPointVolumeRayCastMapper, vtkOpenGLGPUVolumeRayCastMapper):
    for kind in (np.uint8, np.int16, np.float32):
        print(mapper.__name__, kind.__name__, round(float(picture(mapper, ball.astype(kind), steps).mean())))
PY
diff - seen <<'SEEN'
vtkFixedPointVolumeRayCastMapper uint8 44
vtkFixedPointVolumeRayCastMapper int16 44
vtkFixedPointVolumeRayCastMapper float32 39
vtkOpenGLGPUVolumeRayCastMapper uint8 35
vtkOpenGLGPUVolumeRayCastMapper int16 38
vtkOpenGLGPUVolumeRayCastMapper float32 38
SEEN
echo "as described"
