"""Colours in the space Lab/CIEDE2000 are VTK's, without VTK's search for each of them."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from svv.dvr.functions.colour_paths import colours_at
from svv.dvr.functions.transfer_functions import TransferFunction

OPACITIES = ((0.0, 0.0, 0.5, 0.0), (200.0, 0.5, 0.5, 0.0))


@pytest.mark.parametrize("log", [False, True])
def test_many_colours_between_points_are_those_of_vtk(log: bool) -> None:
    colours = ((2, 0.1, 0.2, 0.8), (90, 0.9, 0.3, 0.1), (90, 1, 1, 0), (200, 0.2, 0.9, 0.4))
    function = TransferFunction(colours, OPACITIES, space="Lab/CIEDE2000", log_scale=log)
    values = np.linspace(1.0, 250.0, 100_000).reshape(100, 1000)  # an hour by VTK's function
    some, shown = np.array([0, 3_000, 20_000, 50_000, 79_000, 99_999]), function.colour_at(values)
    vtk = function.to_vtk()[0]
    for value, colour in zip(values.ravel()[some], shown.reshape(-1, 3)[some]):
        np.testing.assert_allclose(colour, vtk.GetColor(float(value)), atol=2 / 255)
    ends = function.colour_at([2.0, 90.0, 200.0])  # a path's own ends are a little off the points
    np.testing.assert_allclose(ends, [vtk.GetColor(value) for value in (2.0, 90.0, 200.0)], atol=7 / 255)


def test_equal_colours_have_nothing_between_them() -> None:
    points = np.array([[0.0, 1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [2.0, 0.999, 0.0, 0.0]])
    shown = colours_at(points, np.array([0.5, 1.5]))
    np.testing.assert_allclose(shown, [[1.0, 0.0, 0.0], [0.9995, 0.0, 0.0]], atol=1e-3)
