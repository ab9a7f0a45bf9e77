"""The demo's volume: a vortex' core that is a trefoil knot, and a sheet of equal phase that the knot bounds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from svv.dvr import demo_volume as module
from svv.dvr.demo_volume import PHASE, SIZE, demo_transfer_function, demo_volume
from svv.dvr.read.grids import to_array
from svv.errors import BadInput

VOXELS = 96


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    """The volume. (z, y, x)"""
    return to_array(demo_volume(VOXELS))


def knot(turns: np.ndarray) -> np.ndarray:
    """Points (3: x, y, z; n) of the trefoil u^3 = v^2 in the cube [-1, 1]^3; once around it is 0 to 2 pi.

    On the knot |u|^3 = |v|^2 and |u|^2 + |v|^2 = 1.
    """
    u, v = _KNOT * np.exp(2j * turns), _KNOT**1.5 * np.exp(3j * turns)
    across, up = u / (1.0 - v.imag), v.real / (1.0 - v.imag)
    return np.stack([across.real, up, across.imag]) / SIZE


_KNOT = float(np.real(next(root for root in np.roots([1.0, 1.0, 0.0, -1.0]) if abs(root.imag) < 1e-9)))


def at(values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values at points (3: x, y, z; n), interpolated."""
    return map_coordinates(values, (points[::-1] + 1.0) / 2.0 * (VOXELS - 1), order=1)


def beside(points: np.ndarray, away: float) -> np.ndarray:
    """Points on circles around those of a closed curve. (3; 24, n)"""
    along = np.roll(points, -1, axis=1) - np.roll(points, 1, axis=1)
    one = np.cross(along, points, axis=0)
    other = np.cross(along, one, axis=0)
    one, other = (axis / np.linalg.norm(axis, axis=0) for axis in (one, other))
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)[:, None]
    return points[:, None] + away * (one[:, None] * np.cos(angle) + other[:, None] * np.sin(angle))


def test_the_core_is_a_tube_around_the_trefoil(values: np.ndarray) -> None:
    points = knot(np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False))
    assert np.abs(points).max() < 0.9
    assert at(values, points).min() > 0.97
    radius = module.CORE / SIZE
    assert at(values, beside(points, 0.7 * radius).reshape(3, -1)).min() > 0.72  # the core's range of values
    assert (at(values, beside(points, 1.5 * radius).reshape(3, -1)) < 0.72).mean() > 0.99


def test_the_phase_turns_once_around_the_core() -> None:
    points = SIZE * beside(knot(np.linspace(0.0, 2.0 * np.pi, 50, endpoint=False)), 0.02)
    real, imaginary, *_ = module._wave(points[0], points[2], points[1])
    phase = np.unwrap(np.arctan2(imaginary, real), axis=0, period=2.0 * np.pi)
    turned = phase[-1] - phase[0]
    np.testing.assert_allclose(np.abs(turned), 2.0 * np.pi * 23 / 24, rtol=0.1)
    assert len(set(np.sign(turned))) == 1


def test_one_sheet_ends_at_every_point_of_the_core(values: np.ndarray) -> None:
    around = at(values, beside(knot(np.linspace(0.0, 2.0 * np.pi, 80, endpoint=False)), 1.9 * module.CORE / SIZE))
    inside = around < 0.4  # the sheet's range of values
    entered = (inside & ~np.roll(inside, 1, axis=0)).sum(axis=0)
    assert (entered == 1).mean() > 0.9, "where the knot passes itself, a circle may meet the sheet again"
    assert entered.min() >= 1


def test_a_third_of_a_turn_about_the_axis_changes_nothing() -> None:
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 400))
    c, s = np.cos(2.0 * np.pi / 3.0), np.sin(2.0 * np.pi / 3.0)
    turned = np.stack([c * points[0] - s * points[2], points[1], s * points[0] + c * points[2]])
    np.testing.assert_allclose(module._values(*points), module._values(*turned), atol=1e-9)
    assert 0.0 < PHASE < np.pi


def test_slopes_are_those_of_the_wave() -> None:
    points, step = np.random.default_rng(1).uniform(-2.0, 2.0, (3, 100)), 1e-5
    shifted = [(points + sign * step * np.eye(3)[axis][:, None]) for axis in range(3) for sign in (1, -1)]
    found = np.stack([module._wave(*p)[0] + 1j * module._wave(*p)[1] for p in shifted]).reshape(3, 2, -1)
    slope = (found[:, 0] - found[:, 1]) / (2 * step)
    _, _, both, imaginary = module._wave(*points)
    np.testing.assert_allclose(both, np.sqrt((np.abs(slope) ** 2).sum(axis=0) / 2), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(imaginary, np.sqrt((slope.imag**2).sum(axis=0)), rtol=1e-4, atol=1e-6)


def test_three_ranges_are_there_and_the_volume_is_the_same_at_every_resolution(values: np.ndarray) -> None:
    assert values.dtype == np.float32 and values.min() >= 0.0 and values.max() <= 1.0
    ranges = demo_transfer_function().visible_ranges(0.0, 1.0)
    assert len(ranges) == 3
    assert all(((values > low) & (values < high)).mean() > 0.01 for low, high in ranges)
    every_second = to_array(demo_volume(2 * VOXELS - 1))[::2, ::2, ::2]
    np.testing.assert_allclose(every_second, values, atol=1e-5)
    levels = to_array(demo_volume(VOXELS, levels=255))
    assert levels.dtype == np.uint8
    np.testing.assert_allclose(levels / 255.0, values, atol=0.51 / 255)
    with pytest.raises(BadInput, match="16 voxels"):
        demo_volume(8)
