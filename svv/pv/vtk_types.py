"""Names for what VTK passes to a filter; ``vtkmodules`` is not checked, so they only say what is what."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from vtkmodules.vtkCommonCore import vtkInformation, vtkInformationVector
from vtkmodules.vtkCommonDataModel import vtkDataObject

Request: TypeAlias = vtkInformation
"""What the pipeline asks for."""
InInfo: TypeAlias = Sequence[vtkInformationVector]
"""What is known of the inputs, one for each port."""
OutInfo: TypeAlias = vtkInformationVector
"""What is known of the outputs."""
Data: TypeAlias = vtkDataObject
"""The data of a port."""
