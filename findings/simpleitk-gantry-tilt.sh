#!/usr/bin/env bash
# SimpleITK 2.5.7: a CT series that was taken with a tilted gantry becomes an upright volume.
#
# The slices of such a series are not stacked along their normal, so the volume is sheared, which an image with
# spacing and a rotation cannot express. ImageSeriesReader stacks them along the normal all the same, with nothing
# said to the program; a warning of ITK is printed to the terminal. The last slice of four, 15 mm above the first,
# is 5 mm beside its place.
#
# Seen: where the corner of the last slice is.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check pydicom==3.0.2 SimpleITK==2.5.7 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import math

import numpy as np
import SimpleITK
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

series, tilt = generate_uid(), math.radians(20)
for k in range(4):
    meta = FileMetaDataset()
    meta.TransferSyntaxUID, meta.MediaStorageSOPClassUID = ExplicitVRLittleEndian, CTImageStorage
    meta.MediaStorageSOPInstanceUID = generate_uid()
    slice_ = FileDataset("", {}, file_meta=meta, preamble=b"\0" * 128)
    slice_.SOPClassUID, slice_.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
    slice_.SeriesInstanceUID = slice_.StudyInstanceUID = series
    slice_.Modality, slice_.InstanceNumber, slice_.GantryDetectorTilt = "CT", k + 1, 20
    slice_.ImageOrientationPatient = [1, 0, 0, 0, round(math.cos(tilt), 6), round(-math.sin(tilt), 6)]
    slice_.ImagePositionPatient, slice_.PixelSpacing, slice_.SliceThickness = [0, 0, 5.0 * k], [1, 1], 5
    slice_.Rows = slice_.Columns = 8
    slice_.SamplesPerPixel, slice_.PhotometricInterpretation, slice_.PixelRepresentation = 1, "MONOCHROME2", 0
    slice_.BitsAllocated = slice_.BitsStored = 16
    slice_.HighBit, slice_.PixelData = 15, np.zeros((8, 8), np.uint16).tobytes()
    slice_.save_as(f"{k}.dcm", enforce_file_format=True)
reader = SimpleITK.ImageSeriesReader()
reader.SetFileNames([f"{k}.dcm" for k in range(4)])
image = reader.Execute()
print("in the files: (0.0, 0.0, 15.0); read:", tuple(round(v, 2) for v in image.TransformIndexToPhysicalPoint((0, 0, 3))))
PY
diff - seen <<'SEEN'
in the files: (0.0, 0.0, 15.0); read: (0.0, 5.13, 14.1)
SEEN
echo "as described"
