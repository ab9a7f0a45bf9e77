"""The demo's volume and transfer function as files."""

from __future__ import annotations

import json
from pathlib import Path

from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

from svv.dvr.demo_volume import demo_transfer_function, demo_volume
from svv.dvr.transfer_functions import TransferFunction


def write_volume(path: Path, resolution: int = 24) -> Path:
    writer = vtkXMLImageDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(demo_volume(resolution))
    assert writer.Write()
    return path


def write_function(path: Path, function: TransferFunction | None = None) -> Path:
    path.write_text(json.dumps((function or demo_transfer_function()).to_dict()))
    return path
