"""The stirred volume and its transfer function as files."""

from __future__ import annotations

import json
from pathlib import Path

from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

from svv.dvr.functions.transfer_functions import TransferFunction
from tests.stirred_volume import stirred_transfer_function, stirred_volume


def write_volume(path: Path, resolution: int = 24) -> Path:
    return write_image(path, stirred_volume(resolution))


def write_image(path: Path, image: vtkImageData) -> Path:
    writer = vtkXMLImageDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    assert writer.Write()
    return path


def write_function(path: Path, function: TransferFunction | None = None) -> Path:
    path.write_text(json.dumps((function or stirred_transfer_function()).to_dict()))
    return path
