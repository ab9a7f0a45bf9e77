"""Names for what VTK passes to a filter; ``vtkmodules`` is not checked, so they only say what is what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

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
Values: TypeAlias = Mapping[str, Any]
"""What a panel holds, by property; :func:`svv.pv.panel.option_panel.options_in` makes options of known types of it."""
