"""The light of pages: least squares as numpy's, and coefficients described by few numbers."""

import numpy as np
import torch

from svv.core.geometry.cameras import sphere_cameras
from svv.core.rays.encodings import spherical_harmonics
from svv.render.web.fitting_kernels import fit
from svv.render.web.harmonics import AROUND, BANDS, VERTICES_AT_A_TIME, principal

RNG = np.random.default_rng(5)


def test_each_vertex_is_fitted_by_its_own_directions() -> None:
    counts, ridge = np.array([30, 1, 12, 0, 57]), 1e-2
    end, total = counts.cumsum(), int(counts.sum())
    basis, values = RNG.normal(size=(total, 16)).astype(np.float32), RNG.normal(size=(2, total)).astype(np.float32)
    weight, out = RNG.uniform(0.1, 1.0, total).astype(np.float32), np.full((len(counts), 18), np.nan, np.float32)
    fit(end, weight, basis, values[0], values[1], np.float32(ridge), out)
    for vertex, (first, last) in enumerate(zip(end - counts, end, strict=True)):
        # The ridge is one more equation for each coefficient: it should be 0.
        root = np.sqrt(weight[first:last].astype(np.float64))[:, None]
        rows = np.concatenate([root * basis[first:last, :9], np.sqrt(ridge) * np.eye(9)])
        wanted = np.concatenate([root * values[:, first:last].T, np.zeros((9, 2))])
        np.testing.assert_allclose(out[vertex].reshape(2, 9).T, np.linalg.lstsq(rows, wanted)[0], atol=2e-4)


def test_harmonics_are_orthogonal_in_the_directions_around() -> None:
    cameras = sphere_cameras(AROUND, (0.0, 0.0, 0.0), 1.0, 0.5, 8)
    directions = torch.tensor(np.stack([camera.position for camera in cameras]), dtype=torch.float32)
    basis = spherical_harmonics(directions)[:, : BANDS**2]
    products = 4.0 * np.pi / AROUND * basis.T @ basis
    torch.testing.assert_close(products, torch.eye(BANDS**2), atol=1e-5, rtol=0.0)


def test_few_numbers_describe_light_that_has_few_degrees_of_freedom() -> None:
    count = VERTICES_AT_A_TIME + 77  # more than one piece
    light = (RNG.normal(size=18) + RNG.normal(size=(count, 3)) @ RNG.normal(size=(3, 18))).astype(np.float32)
    mean, axes, amounts = principal(light, RNG.uniform(size=count).astype(np.float32))
    assert axes.shape == (3, 18) and amounts.shape == (count, 3)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-5)
    np.testing.assert_allclose(mean + amounts @ axes, light, atol=1e-4)
