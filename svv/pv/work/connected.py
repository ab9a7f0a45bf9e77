"""What is connected to a filter, in words: so that a filter that cannot use it says what to connect instead."""

from __future__ import annotations

from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData, vtkPolyData

SCENE = "StyleRF Scene"
VIEWS = "StyleRF Views"
CAMERA = "StyleRF Camera"
"""Field data of an image: its camera's matrix (16, row by row), horizontal angle of view in radians, and width in world
units if it is orthographic, otherwise 0."""
BAKED, OPACITY, UNIT_DISTANCE = "RGBA", "StyleRF Opacity", "StyleRF Unit Distance"
"""Names of a baked volume's array and field data, the same as in files (:mod:`svv.render.baking.baked`)."""

OF_SCENE = ("a scene", "an image of a scene", "the picture of a scene in the 3D view", "a volume baked from a scene")


def what_is(data: vtkDataObject | None) -> str:
    """Return what data are, for sentences.

    >>> what_is(None), what_is(vtkPolyData())
    ('nothing', 'a vtkPolyData')
    """
    if data is None:
        return "nothing"
    fields = data.GetFieldData()
    if data.IsA("vtkTable") and fields.HasArray(SCENE):
        return OF_SCENE[0]
    if fields.HasArray(VIEWS):
        return "a set of views"
    if fields.HasArray(CAMERA) and (is_flat(data) or isinstance(data, vtkPolyData)):
        return OF_SCENE[1 if is_flat(data) else 2]
    if is_baked(data):
        return OF_SCENE[3]
    return "a flat image" if is_flat(data) else f"a {data.GetClassName()}"


def is_baked(data: vtkDataObject) -> bool:
    """Return whether data are a volume of colours that StyleRF Volume made."""
    return isinstance(data, vtkImageData) and bool(
        data.GetFieldData().HasArray(OPACITY) and data.GetPointData().HasArray(BAKED)
    )


def is_flat(data: vtkDataObject) -> bool:
    """Return whether data are an image of one slice, row or point."""
    return isinstance(data, vtkImageData) and min(data.GetDimensions()) == 1
