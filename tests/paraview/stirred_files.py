"""The stirred volume and its transfer function as files that ParaView opens."""

from __future__ import annotations

import json
from pathlib import Path

from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

from tests.stirred_volume import stirred_transfer_function, stirred_volume


def write_stirred(folder: Path) -> None:
    """Write ``volume.vti`` and ``tf.json``."""
    writer = vtkXMLImageDataWriter()
    writer.SetDataModeToBinary()
    writer.SetFileName(str(folder / "volume.vti"))
    writer.SetInputData(stirred_volume(32, levels=255))
    assert writer.Write()
    (folder / "tf.json").write_text(json.dumps([stirred_transfer_function().mapped(255.0, 0.0).to_dict()]))
