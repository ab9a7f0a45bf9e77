"""Colours in the space ProLab, which VTK knows since 9.5: presets with it are sampled, in any VTK.

ProLab is a projective map of XYZ (Konovalenko, Smagina, Nikolaev, Nikolaev 2021, eq. 8):
lab = Q xyz / (q . xyz + 1), with xyz relative to the white D65.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkMath

from svv.dvr.functions.scales import Points

Array = NDArray[np.float64]

WHITE = np.array([0.9505, 1.0, 1.089])
"""XYZ of D65, as VTK has it."""

Q = np.array([[75.54, 486.66, 167.39], [617.72, -595.45, -22.27], [48.34, 194.94, -243.28]])
PROJECTION = np.array([0.7554, 3.8666, 1.6739])
"""The matrix Q, and the vector q, of the equation."""


def between(colours: Points, count: int, log: bool) -> Points:
    """Return the points of a function in ProLab, and about ``count`` more between them, for the space RGB.

    Args:
        colours: (value, red, green, blue), ascending.
        count: Number of evenly spaced values.
        log: Whether they are evenly spaced in the logarithm.
    """
    given = np.array(colours, np.float64)
    own, (low, high) = given[:, 0], (given[0, 0], given[-1, 0])
    is_log = log and low > 0
    spaced = (np.geomspace if is_log else np.linspace)(low, high, count)
    inner = np.setdiff1d(spaced[(spaced > low) & (spaced < high)], own)
    after = np.searchsorted(own, inner)
    ends = np.log(own) if is_log else own
    share = ((np.log(inner) if is_log else inner) - ends[after - 1]) / (ends[after] - ends[after - 1])
    lab = np.array([_to_prolab(rgb) for rgb in given[:, 1:]])
    mixed = lab[after - 1] + share[:, None] * (lab[after] - lab[after - 1])
    new = [(float(value), *_to_rgb(one)) for value, one in zip(inner, mixed)]
    return tuple(sorted([*colours, *new], key=lambda point: float(point[0])))


def _to_prolab(rgb: Array) -> Array:
    vtkMath.RGBToXYZ(rgb.tolist(), xyz := [0.0] * 3)
    relative = np.array(xyz) / WHITE
    return np.asarray(Q @ relative / (PROJECTION @ relative + 1.0))


def _to_rgb(lab: Array) -> list[float]:
    relative = np.linalg.solve(Q - np.outer(lab, PROJECTION), lab)
    vtkMath.XYZToRGB((relative * WHITE).tolist(), rgb := [0.0] * 3)
    return list(np.clip(rgb, 0.0, 1.0).tolist())
