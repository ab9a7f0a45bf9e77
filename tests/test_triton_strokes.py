"""Strokes in images: the Triton kernels compared with those of the CPU.

They run on a GPU if there is one, otherwise in Triton's interpreter. See ``tests/test_triton_kernels.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch

from svv.fields.devices import stroke_checks
from svv.fields.strokes.stroke_paint import StrokePaint
from svv.fields.strokes.stroke_tables import bins_of
from svv.kernels.numba.strokes import sort_into_bins
from tests.interpreted import GPU, triton_kernels
from tests.nightly import nightly

CPU = torch.device("cpu")
DEVICE = torch.device("cuda") if GPU else CPU
COUNTS = np.random.default_rng(1).integers(0, 9, 60).tolist()


BRUSHES = [*((brush, 0) for brush in stroke_checks.BRUSHES), ("wash", 2)]


@pytest.mark.parametrize(("brush", "seed"), nightly(BRUSHES, ("oil", 0)))
def test_strokes_are_those_of_the_cpu(brush: str, seed: int) -> None:
    # With the seed 2, washes end below dry strokes: what is left of their sums counts for nothing.
    stroke_checks.check_strokes(triton_kernels, DEVICE, seed, brush, COUNTS)


@pytest.mark.parametrize("counts", [[0, 0], [0, 1, 0], [40]])
def test_rays_with_no_and_with_many_samples(counts: list[int]) -> None:
    stroke_checks.check_strokes(triton_kernels, DEVICE, 3, "oil", counts)


@pytest.mark.slow
def test_strokes_far_apart_leave_the_ground_of_the_nearest() -> None:
    """Where two strokes are far apart, most of what is near one is bare, and its colour is a question of distance."""
    stroke_checks.check_strokes(triton_kernels, DEVICE, 1, "oil", COUNTS, strokes=2, soft=0.002)


@pytest.mark.parametrize("soft", [0.002, 0.02])
def test_bins_are_those_of_the_cpu(soft: float) -> None:
    strokes = stroke_checks.curved_strokes(9, 2)
    paint = StrokePaint(strokes, stroke_checks.BRUSHES["oil"], soft)
    start, entries = bins_of(paint.around, 0.01, paint.bins.size, DEVICE)
    expected, points = sort_into_bins(paint.around, 0.01, paint.bins.size)
    np.testing.assert_array_equal(start.cpu(), expected)
    np.testing.assert_array_equal(entries.cpu(), points)
