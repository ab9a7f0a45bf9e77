"""openPMD 1 and 2: meshes in HDF5 and ADIOS. Lengths and values become SI units.

Source: https://github.com/openPMD/openPMD-standard.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from svv.bricks.formats.places import Axis, text_of
from svv.errors import BadInput


def axes_of_mesh(
    mesh: Mapping[str, Any], component: Mapping[str, Any], name: str
) -> tuple[list[Axis], dict[str, float]]:
    """Return the axes of a mesh and how its values are packed, by its attributes and those of a component.

    Raises BadInput if its coordinates are not Cartesian.
    """
    geometry = text_of(mesh.get("geometry", "cartesian"))
    if geometry != "cartesian":
        raise BadInput(f"{name} has its values in {geometry} coordinates: resample them to a cartesian grid first.")
    unit = np.ravel(mesh.get("gridUnitSI", 1.0))  # a number, or in version 2 one for each axis
    step, first = np.ravel(mesh["gridSpacing"]) * unit, np.ravel(mesh.get("gridGlobalOffset", 0.0)) * unit
    first = first + np.ravel(component.get("position", 0.0)) * step
    names = [text_of(label) for label in np.ravel(mesh["axisLabels"])]
    axes = [Axis(label, float(a), float(b), "m") for label, a, b in zip(names, step, first)]
    order = -1 if text_of(mesh.get("dataOrder", "C")) == "F" else 1
    return axes[::order], {"scale_factor": float(component.get("unitSI", 1.0))}
