"""Inputs that are no images: the filters resample them, each only once."""

from __future__ import annotations

from vtkmodules.vtkCommonDataModel import vtkCompositeDataSet, vtkDataObject, vtkImageData

from svv.dvr.read.meshes import describe_resampling, is_mesh, resampled
from svv.pv.panel_values import Values

_last: dict[tuple[object, ...], vtkImageData] = {}
"""What an image was resampled from -> the last such image, which the filters on one input share."""


def image_of(data: vtkDataObject, values: Values) -> vtkImageData:
    """Return a mesh as an image, as a panel's values say (:func:`svv.dvr.read.meshes.resampled`); or raise BadInput."""
    array, cells, along = values.get("Scalars") or None, values.get("ScalarsOnCells", False), values.get("ResampleTo")
    key = (data.__this__, _changed(data), array, cells, along)
    if key not in _last:
        _last.clear()
        _last[key] = resampled(data, array, cells, along or None)
    return _last[key]


def describe_resampled_input(data: vtkDataObject | None, values: Values) -> str:
    """Return a sentence about the image that a mesh was resampled to; nothing for other data."""
    if data is None or not is_mesh(data) or data.IsA("vtkPolyData"):
        return ""
    return f" {describe_resampling(data, image_of(data, values))}"


def _changed(data: vtkDataObject) -> int:
    """Return when a data object or one of its blocks was changed last (VTK's modification time)."""
    changed = int(data.GetMTime())
    if isinstance(data, vtkCompositeDataSet):
        iterator = data.NewIterator()
        iterator.InitTraversal()
        while not iterator.IsDoneWithTraversal():
            changed = max(changed, _changed(iterator.GetCurrentDataObject()))
            iterator.GoToNextItem()
    return changed
