"""The demo's volume and its transfer function as files that ParaView opens."""

from __future__ import annotations

import json
from pathlib import Path

from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

from svv.dvr.demo_volume import demo_transfer_function, demo_volume


def write_demo(folder: Path) -> None:
    """Write ``volume.vti`` and ``tf.json``."""
    writer = vtkXMLImageDataWriter()
    writer.SetDataModeToBinary()
    writer.SetFileName(str(folder / "volume.vti"))
    writer.SetInputData(demo_volume(32, levels=255))
    assert writer.Write()
    (folder / "tf.json").write_text(json.dumps([demo_transfer_function().mapped(255.0, 0.0).to_dict()]))
