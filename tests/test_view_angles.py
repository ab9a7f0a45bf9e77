"""The view angle of 20 databases is found to a degree, and the true one is never refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from svv.core.geometry.cameras import Camera
from svv.core.geometry.phi_theta import paraview_rotations
from svv.core.view_checks.silhouettes import Silhouettes, best_fov, disagreement_of
from svv.io.cinema.placing import FINEST, MUCH_WORSE, cameras_about, first_of_each
from svv.io.cinema.shot import Shot, fov_x, view_angle
from tests.nightly import nightly

Angles = list[tuple[float, float]]
CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FEW: Angles = [(p, t) for p in (180, 108, 36, -36, -108) for t in (-90, -30, 30)]
USUAL: Angles = [(p, t) for p in range(0, 360, 60) for t in range(0, 360, 60)]


def mask(camera: Camera, corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The silhouette of a convex body: pixels whose middle lies inside."""
    matrix = camera.camera_to_world
    seen = (corners - matrix[:3, 3]) @ matrix[:3, :3]
    column = camera.width / 2 - camera.focal * seen[:, 0] / seen[:, 2]
    row = camera.height / 2 + camera.focal * seen[:, 1] / seen[:, 2]
    lines = ConvexHull(np.stack([column, row], 1)).equations
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.all([a * x + b * y + c <= 0 for a, b, c in lines], axis=0)


def database(seed: int) -> tuple[float, list[Camera], list[Camera], list[NDArray[np.bool_]]]:
    """A view angle, the true cameras and those of unit distance, and silhouettes, at random."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(int(rng.integers(8, 30)), 3)) * rng.uniform(0.4, 1.0, 3)
    corners = CUBE * rng.uniform(0.5, 1.0, 3) if seed % 4 == 0 else corners
    angle, aspect = 10.0 + 80.0 * seed / 19, (1.0, 4 / 3, 16 / 9)[seed % 3]
    height = 200
    width = round(height * aspect)
    count, steps = int(rng.integers(5, 20)), int(rng.choice([3, 5]))
    grid = [(360 * p / count, -60 + 120 * t / (steps - 1)) for p in range(count) for t in range(steps)]
    rotations = paraview_rotations(*np.array((FEW, USUAL, grid)[seed % 3 if seed % 2 else 2], float).T)
    rotations = rotations[first_of_each(rotations[:, :, 2])]
    radius = np.linalg.norm(corners, axis=1).max()
    distance = rng.uniform(1.05, 1.4) * radius / np.sin(np.radians(0.5 * angle))
    true, unit = [], []
    for rotation in rotations:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, distance * rotation[:, 2]
        true.append(Camera(matrix, fov_x(angle, width, height), width, height))
        matrix = matrix.copy()
        matrix[:3, 3] = rotation[:, 2]
        unit.append(Camera(matrix, 1.0, width, height))
    return angle, true, unit, [mask(camera, corners) for camera in true]


@pytest.mark.parametrize("seed", nightly(range(20), *range(6)))
def test_the_view_angle_is_found_to_a_degree_and_the_true_one_accepted(seed: int) -> None:
    angle, true, unit, masks = database(seed)
    silhouettes = Silhouettes.of(masks)
    fit = best_fov(unit, silhouettes)
    assert fit is not None
    assert view_angle(fit.fov_x, true[0].width, true[0].height) == pytest.approx(angle, abs=1.0)
    differ, least = disagreement_of(unit, silhouettes, (true[0].fov_x, fit.fov_x))
    assert differ < 0.75 * MUCH_WORSE * max(least, FINEST)


def test_few_pairs_at_a_wide_angle_do_not_win() -> None:
    """A cube drawn at 30 degrees: at 120 degrees, 8 of 110 differences are left, and they are small."""
    distance = 3.0**0.5 / np.sin(np.radians(15.0))
    cameras = []
    for rotation in paraview_rotations(*np.array(FEW, float).T):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, distance * rotation[:, 2]
        cameras.append(Camera(matrix, fov_x(30.0, 667, 545), 667, 545))
    masks = [mask(camera, CUBE) for camera in cameras]
    images = np.repeat((255 * np.stack(masks)).astype(np.uint8)[..., None], 4, 3)
    rotations = np.stack([camera.camera_to_world[:3, :3] for camera in cameras])
    kept = first_of_each(rotations[:, :, 2])
    found, _ = cameras_about(rotations[kept], Shot(), images[kept], False)
    assert np.degrees(found[0].fov_x - cameras[0].fov_x) == pytest.approx(0.0, abs=1.0)
    cameras_about(rotations[kept], Shot(view_angle=30.0), images[kept], False)
