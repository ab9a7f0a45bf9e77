#!/usr/bin/env bash
# A NIfTI file whose two orientation codes are 0: nibabel 5.4.2 mirrors x and centres it, SimpleITK 2.5.7 and VTK 9.7.2 do not.
#
# The standard gives such a file no orientation. nibabel then takes the default of Analyze files, x to the left, with the
# origin in the middle; the others place the first voxel at 0 and let x rise. The same region of interest, in mm, is
# another part of the volume in either, on the other side of the body.
#
# Seen: the matrix of nibabel, and spacing and origin of the others.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check nibabel==5.4.2 SimpleITK==2.5.7 vtk==9.7.2 numpy==2.3.5
cat >look.py <<'PY'
import nibabel
import numpy as np
import SimpleITK
from vtkmodules.vtkIOImage import vtkNIFTIImageReader

image = nibabel.Nifti1Image(np.zeros((4, 5, 6), np.int16), None)
image.header["pixdim"][1:4] = 3, 2, 1
image.header["qform_code"] = image.header["sform_code"] = 0
nibabel.save(image, "a.nii")
print("nibabel", nibabel.load("a.nii").affine[:3].astype(float).tolist())
itk = SimpleITK.ReadImage("a.nii")
print("SimpleITK", itk.GetSpacing(), itk.GetOrigin(), itk.GetDirection())
reader = vtkNIFTIImageReader()
reader.SetFileName("a.nii")
reader.Update()
vtk = reader.GetOutput()
print("VTK", vtk.GetSpacing(), vtk.GetOrigin(), reader.GetQFormMatrix(), reader.GetSFormMatrix())
PY
venv/bin/python look.py >seen
diff - seen <<'SEEN'
nibabel [[-3.0, 0.0, 0.0, 4.5], [0.0, 2.0, 0.0, -4.0], [0.0, 0.0, 1.0, -2.5]]
SimpleITK (3.0, 2.0, 1.0) (0.0, 0.0, 0.0) (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
VTK (3.0, 2.0, 1.0) (0.0, 0.0, 0.0) None None
SEEN
echo "as described"
