"""Cells, directions and representatives: the Triton kernels compared with their references.

They run on a GPU if there is one, otherwise in Triton's interpreter. See ``tests/test_triton_kernels.py``.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation

from svv.core.geometry.box import Box
from svv.core.rays.cells import leaps, widened
from svv.fields.devices import kernel_checks
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.kernels import reference
from svv.kernels.numba import kernels as numba_kernels
from tests.interpreted import GPU, triton_kernels

CPU = torch.device("cpu")
DEVICE = torch.device("cuda") if GPU else CPU
SHAPES = st.tuples(*[st.integers(1, 7)] * 3)


def cells_of(shape: tuple[int, int, int], share: float, seed: int) -> torch.Tensor:
    return torch.from_numpy((np.random.default_rng(seed).random(shape) < share).astype(np.uint8))


def nearest(occupied: np.ndarray) -> np.ndarray:
    """Chessboard distance to the nearest occupied cell of each octant, by looking at all of them."""
    there, all_cells = np.argwhere(occupied), np.argwhere(np.ones_like(occupied))
    apart = there[None] - all_cells[:, None]
    octants = []
    for sides in itertools.product((1, -1), repeat=3):
        ahead = (apart * sides >= 0).all(axis=2)
        distance = np.where(ahead, np.abs(apart).max(axis=2), 255).min(axis=1, initial=255)
        octants.append(distance.reshape(occupied.shape))
    return np.stack(octants)


@settings(deadline=None, max_examples=25)
@given(SHAPES, st.sampled_from([0.0, 0.02, 0.2, 1.0]), st.integers(0, 10**6))
def test_leaps_end_at_the_nearest_occupied_cell(shape: tuple[int, int, int], share: float, seed: int) -> None:
    occupied = cells_of(shape, share, seed)
    expected = nearest(occupied.numpy())
    assert leaps(occupied).dtype == numba_kernels.leaps(occupied).dtype == torch.uint8
    np.testing.assert_array_equal(numba_kernels.leaps(occupied), expected)
    np.testing.assert_array_equal(leaps(occupied), expected)
    np.testing.assert_array_equal(reference.leaps(occupied), expected)
    np.testing.assert_array_equal(triton_kernels.leaps(occupied.to(DEVICE)).cpu(), expected)


@settings(deadline=None, max_examples=25)
@given(st.permutations([1, 2, 600]), st.sampled_from([0.0, 0.001, 0.01, 0.2]), st.integers(0, 10**6))
def test_leaps_along_many_cells_are_those_of_the_reference(shape: list[int], share: float, seed: int) -> None:
    occupied = cells_of((shape[0], shape[1], shape[2]), share, seed)
    np.testing.assert_array_equal(numba_kernels.leaps(occupied), leaps(occupied))


@pytest.mark.slow
def test_no_leap_is_longer_than_a_byte() -> None:
    occupied = torch.zeros(1, 1, 300, dtype=torch.uint8)
    occupied[0, 0, 0] = 1
    for found in (leaps(occupied), numba_kernels.leaps(occupied), triton_kernels.leaps(occupied.to(DEVICE)).cpu()):
        assert found[1].flatten().tolist() == [min(k, 255) for k in range(300)]
        assert found[0].flatten().tolist() == [0] + [255] * 299


@given(SHAPES, st.integers(0, 10**6))
def test_widened_cells_are_those_of_scipy(shape: tuple[int, int, int], seed: int) -> None:
    chosen = cells_of(shape, 0.1, seed) > 0
    before = chosen.clone()
    expected = binary_dilation(chosen.numpy(), np.ones((3, 3, 3), bool))
    np.testing.assert_array_equal(widened(chosen), expected)
    assert torch.equal(chosen, before)


@pytest.mark.parametrize("grow", [False, True])
def test_pruning_keeps_what_is_visible(grow: bool) -> None:
    occupied = cells_of((6, 5, 7), 0.6, 1).numpy()
    extinction = np.random.default_rng(2).random(int(occupied.sum())).astype(np.float32)
    visible = np.zeros(occupied.shape, bool)
    visible[occupied > 0] = extinction >= 0.8
    if grow:
        visible = binary_dilation(visible, np.ones((3, 3, 3), bool))
    pruned = Occupancy(Box((0.0,) * 3, 1.0, (0.8, 0.7, 1.0)), 7, occupied, 24).pruned(
        torch.from_numpy(extinction).to(DEVICE), 0.8, grow
    )
    np.testing.assert_array_equal(pruned.occupied, occupied * visible)
    assert pruned.occupied.dtype == np.uint8
    assert pruned.samples_a_ray == 24
    np.testing.assert_array_equal(pruned.distance_on(DEVICE)[0].cpu() == 0, pruned.occupied > 0)
    assert SparseLattice(pruned.occupied, 7, (7,), 1).table.numel() > 0


@pytest.mark.parametrize(("kernels", "device"), [(triton_kernels, DEVICE), (numba_kernels, CPU)], ids=["gpu", "cpu"])
@settings(deadline=None, max_examples=5)
@given(st.integers(1, 40), st.integers(0, 200), st.integers(0, 10**6))
def test_directions_are_the_reference(kernels: Any, device: torch.device, rays: int, count: int, seed: int) -> None:
    kernel_checks.check_directions(kernels, device, seed, rays, count)


@settings(deadline=None, max_examples=20)
@given(st.lists(st.integers(0, 9), min_size=1, max_size=40), st.integers(0, 10**6), st.sampled_from([1 / 16, 0.3, 1.0]))
def test_representatives_are_the_reference(counts: list[int], seed: int, every: float) -> None:
    kernel_checks.check_representatives(triton_kernels, DEVICE, seed, counts, every)
