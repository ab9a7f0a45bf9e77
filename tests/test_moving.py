"""Matter of a volume that is played in any order leads back to where it was painted."""

from __future__ import annotations

import numpy as np
import pytest
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.job.moving import MOST_KNOWN, Moving

SIDE, SPACING, ORIGIN = 40, (0.5, 1.0, 2.0), (3.0, -10.0, 100.0)


def ball(at: float, side: int = SIDE) -> vtkImageData:
    """A soft ball at x = ``at`` (a fraction of the side), in the middle of y and z, on anisotropic voxels."""
    x, y, z = np.meshgrid(*[np.arange(side) / (side - 1)] * 3, indexing="ij")
    values = 200.0 * np.exp(-((x - at) ** 2 + (y - 0.5) ** 2 + (z - 0.5) ** 2) / 0.02)
    image = vtkImageData()
    image.SetDimensions(side, side, side)
    image.SetSpacing(*SPACING)
    image.SetOrigin(*ORIGIN)
    array = numpy_to_vtk(values.transpose(2, 1, 0).ravel().astype(np.float32), deep=1)
    array.SetName("v")
    image.GetPointData().SetScalars(array)
    return image


def centre(at: float) -> np.ndarray:
    return np.array(ORIGIN) + np.array(SPACING) * (SIDE - 1) * np.array([at, 0.5, 0.5])


@pytest.mark.parametrize(
    "order", [pytest.param((0.35, 0.4, 0.45, 0.5), marks=pytest.mark.slow), (0.4, 0.35, 0.5, 0.45, 0.35)]
)
def test_the_ball_comes_from_where_it_was(order: tuple[float, ...]) -> None:
    moving = Moving(ball(0.3), (0.0, 200.0), 0.3)
    for at in order:
        place = moving.matter(ball(at), at)
        (found,) = place(centre(at)[None])
        voxel = np.array(SPACING)
        assert (np.abs(found - centre(0.3)) < 1.2 * voxel * (SIDE - 1) / 48 + voxel).all(), (at, found)
    (home,) = moving.matter(ball(0.3), 0.3)(centre(0.3)[None])
    np.testing.assert_array_equal(home, centre(0.3))


def test_another_grid_is_at_rest_and_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    moving = Moving(ball(0.3), (0.0, 200.0), 0.0)
    where = centre(0.5)[None]
    np.testing.assert_array_equal(moving.matter(ball(0.5, 20), 1.0)(where), where)
    monkeypatch.setattr("svv.job.moving.came_from", lambda before, after, earlier: np.zeros((3, *after.shape)))
    for time in range(1, MOST_KNOWN + 5):
        moving.matter(ball(0.3 + 0.001 * time, SIDE), float(time))
    assert len(moving._known) == MOST_KNOWN and 0.0 in moving._known
