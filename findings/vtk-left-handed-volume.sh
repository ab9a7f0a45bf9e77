#!/usr/bin/env bash
# VTK 9.7.2: a volume whose direction matrix is left-handed is all but invisible in the GPU ray caster.
#
# A NIfTI or DICOM volume stored from left to right has such a matrix (determinant -1), and so has what
# vtkImageData.SetDirectionMatrix is given for it. The ray caster then starts at the far faces of the box and ends
# at the near ones: a translucent cube keeps a seventh of its brightness, and no message is printed. A rotation by
# half a turn, which is right-handed, changes nothing. Needs Mesa or a graphics card.
#
# Seen: mean grey value of the picture, in tens.
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


solid = np.ones((20, 20, 20), np.float32)
turns = {"identity": (1, 0, 0, 0, 1, 0, 0, 0, 1), "x and y turned round": (-1, 0, 0, 0, -1, 0, 0, 0, 1), "x turned round": (-1, 0, 0, 0, 1, 0, 0, 0, 1)}
for name, matrix in turns.items():
    print(name, round(float(picture(vtkOpenGLGPUVolumeRayCastMapper, solid, [(0, 0.1)], matrix).mean()) / 10))
PY
diff - seen <<'SEEN'
identity 8
x and y turned round 8
x turned round 1
SEEN
echo "as described"
