"""A volume as a display shows it: the array chosen, moved, scaled, cropped and interpolated as the panel says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkVersion
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkRenderingCore import vtkVolume

from svv.dvr.draw.plotted import matrix_of, moved, with_outer_halves
from svv.dvr.read.appearance import Appearance, put, without_duplicates
from svv.dvr.read.grids import as_volume, index_to_world, pick_scalars
from svv.errors import BadInput
from svv.pv.panel_values import DisplayValues, Values, by_name, with_names

Array = NDArray[np.float64]

PLAIN: DisplayValues = {
    "InterpolationType": "Linear",
    "UseCropping": False,
    "CroppingOrigin": (0.0, 0.0, 0.0),
    "CroppingScale": (1.0, 1.0, 1.0),
    "Position": (0.0, 0.0, 0.0),
    "Scale": (1.0, 1.0, 1.0),
    "Orientation": (0.0, 0.0, 0.0),
    "Origin": (0.0, 0.0, 0.0),
}
"""Properties of a display, which the panels have under the same names, with values at which they change nothing."""

INSTEAD = "give Scale three equal numbers, or insert the filter Resample To Image before"
"""What to do where a display shears its volume."""

CROPS_INDICES = (vtkVersion.GetVTKMajorVersion(), vtkVersion.GetVTKMinorVersion()) >= (9, 3)
"""Whether ParaView scales the extent of a volume, in indices, where it crops it; until 5.11, it scaled its bounds."""

TURNED = (
    "The display crops a volume whose axes are turned, where ParaView itself crops in wrong places: turn Use Cropping "
    "off and insert the filter Extract Subset."
)
DIVIDED = (
    "With several ranks, a display can neither crop, move nor scale a volume, nor show it without interpolation: use "
    "one process, or filters such as Extract Subset."
)


def chosen_of(values: Values) -> DisplayValues:
    """Return those of a panel's values with which a display changes a volume."""
    given = {name: by_name(values).get(name, plain) for name, plain in PLAIN.items()}
    given = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items()}
    if not given["UseCropping"]:
        given |= {name: PLAIN[name] for name in ("CroppingOrigin", "CroppingScale")}
    plain = {*PLAIN.items(), CUBIC}
    return with_names({name: value for name, value in given.items() if (name, value) not in plain})


CUBIC = ("InterpolationType", "Cubic")
"""ParaView's default, at which VTK's ray casters interpolate linearly."""


def volume_shown(data: vtkImageData, values: Values, name: str = "The input") -> vtkImageData:
    """Return the volume that a display shows of its input, in its place in the world; or raise BadInput."""
    data, chosen = without_duplicates(data), (values["Scalars"] or None, name, values.get("ScalarsOnCells", False))
    image, (_, on_cells) = as_volume(data, *chosen), pick_scalars(data, *chosen)
    given: DisplayValues = {**PLAIN, **chosen_of(values)}
    crop = _crop(data, image, given, on_cells) if given["UseCropping"] else None
    if on_cells:
        image, crop = with_outer_halves(image, crop)
    image = moved(image, matrix_in(given), "The display", INSTEAD)
    put(image, replace(Appearance.of(image), crop=crop, nearest=given["InterpolationType"] == "Nearest"))
    return image


def scale_of(values: Values) -> float:
    """Return how much longer the volume is in the world than in its data, the mean of its axes."""
    return float(np.cbrt(np.abs(np.prod(values.get("Scale", PLAIN["Scale"])))))


def matrix_in(given: DisplayValues) -> Array:
    """Return the matrix from the data to the world of a display with these properties. (4, 4)"""
    prop = vtkVolume()
    prop.SetPosition(*given["Position"])
    prop.SetScale(*given["Scale"])
    prop.SetOrientation(*given["Orientation"])
    prop.SetOrigin(*given["Origin"])
    return matrix_of(prop)


def _crop(data: vtkImageData, image: vtkImageData, given: DisplayValues, on_cells: bool) -> Array:
    """Return the corners of the part of its data that a display shows, as indices of the image's voxels. (2, 3)"""
    place = index_to_world(image)
    if np.abs(place[:3, :3] - np.diag(np.diag(place[:3, :3]))).max() > 1e-6 * np.abs(place[:3, :3]).max():
        raise BadInput(TURNED)
    bounds = np.array(data.GetExtent() if CROPS_INDICES else data.GetBounds(), dtype=float).reshape(3, 2).T
    corners = np.array(given["CroppingOrigin"]) + bounds * np.array(given["CroppingScale"])
    index = (corners - place[:3, 3]) / np.diag(place[:3, :3])
    if not on_cells:
        # As ParaView draws it: VTK's ray caster mistakes the outermost points for the edges of their texels.
        index = index / (1.0 - 1.0 / np.array(image.GetDimensions())) - 0.5
    return np.sort(index, axis=0)
