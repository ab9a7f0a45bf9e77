"""Sheets of samples: one colour where a viewer sees a region along a ray."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.rays.sheets import sheets
from svv.core.strokes.stroke_reference import paint_at
from svv.core.strokes.strokes import Brush, joined, straight_stroke
from svv.fields.strokes.stored_strokes import Brushed, sheets_of
from svv.kernels.types import Samples

STEP = 0.01


def samples_of(counts: list[int], seed: int = 0, gaps: float = 0.3) -> Samples:
    """Rays along x with so many samples each; every now and then one is far from the one before."""
    rng = np.random.default_rng(seed)
    total = sum(counts)
    away = np.where(rng.random(total) < gaps, 0.1, STEP) * rng.uniform(0.9, 1.1, total)
    ray = np.repeat(np.arange(len(counts)), counts)
    x = np.concatenate([np.cumsum(a) for a in np.split(away, np.cumsum(counts)[:-1])]) if total else away
    position = np.stack([x, 0.1 * ray, np.zeros(total)], 1).astype(np.float32)
    start = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
    sigma, skipped = (rng.uniform(0.0, most, total).astype(np.float32) for most in (60.0, 0.3))
    arrays = position, sigma, skipped, ray.astype(np.int32), start, np.array(counts, np.int64)
    return Samples(*map(torch.from_numpy, arrays), torch.zeros(len(counts)), STEP)  # type: ignore[arg-type, call-arg]


def weights_of(samples: Samples) -> np.ndarray:
    """The weight of each sample in its pixel, ray by ray."""
    sigma, skipped = samples.sigma.double().numpy(), samples.skipped.double().numpy()
    out = np.empty(len(sigma))
    for first, count in zip(samples.start.tolist(), samples.count.tolist(), strict=True):
        left = 1.0
        for j in range(first, first + count):
            left *= np.exp(-skipped[j])
            out[j] = left * -np.expm1(-sigma[j] * samples.step)
            left *= np.exp(-sigma[j] * samples.step)
    return out


@given(st.lists(st.integers(0, 12), min_size=1, max_size=6), st.integers(0, 99), st.integers(1, 4))
def test_the_kernel_equals_the_reference(counts: list[int], seed: int, regions: int) -> None:
    samples = samples_of(counts, seed)
    region = np.random.default_rng(seed).integers(0, regions, len(samples))
    apart = np.where(np.arange(regions) % 3 == 1, 0.0, 0.05)
    own, where = sheets_of(samples, region, apart)
    expected, there = sheets(samples.position.numpy(), weights_of(samples), samples.ray.numpy(), region, apart)
    assert np.array_equal(own, expected)
    np.testing.assert_allclose(where, there, atol=2e-6)


@given(st.lists(st.integers(1, 12), min_size=1, max_size=4), st.integers(0, 99))
def test_sheets_are_where_their_samples_are_and_never_cross_a_ray(counts: list[int], seed: int) -> None:
    samples = samples_of(counts, seed)
    own, where = sheets_of(samples, np.zeros(len(samples), np.int64), np.array([0.05]))
    for number in range(len(where)):
        rows = np.flatnonzero(own == number)
        assert len(set(samples.ray.numpy()[rows])) == 1
        along = samples.position.numpy()[rows, 0]
        assert along.min() - 1e-6 <= where[number, 0] <= along.max() + 1e-6
        assert (np.diff(along) <= 0.05).all()


def test_a_sheet_has_one_colour_however_deep_it_is_sampled() -> None:
    """A red stroke over a green one at another depth: samples of one sheet have the colour of its middle."""
    red = straight_stroke((0.0, 0.1, 0.5), (1.0, 0.1, 0.5), 0.2, (1.0, 0.0, 0.0))
    green = straight_stroke((0.0, 0.1, 0.52), (1.0, 0.1, 0.52), 0.2, (0.0, 1.0, 0.0))
    brushed = Brushed({0: (joined([green, red]), Brush(0, 0, 0))})
    samples = samples_of([9], gaps=0.0)
    position = torch.stack([torch.full((9,), 0.5), torch.full((9,), 0.1), torch.linspace(0.46, 0.56, 9)], 1)
    samples = replace(samples, position=position)
    found = brushed.over(torch.zeros(9, 3), samples, torch.zeros(9, dtype=torch.int64), {0: 0}, [0], 0.01)
    assert found.std(0).max() < 1e-6


def test_both_sides_of_a_thin_body_keep_their_own_strokes() -> None:
    """However the strokes are ordered, a place has mostly the paint of the stroke whose sheet is nearer."""
    reach = np.full(9, 0.1, np.float32)
    for order in (0, 1):
        near, far = (
            straight_stroke((0.0, 0.5, z), (1.0, 0.5, z), 0.2, colour, (0.0, 0.0, side))
            for z, colour, side in ((0.54, (1.0, 0.0, 0.0), 1.0), (0.46, (0.0, 1.0, 0.0), -1.0))
        )
        both = joined([near, far] if order else [far, near])
        both.inner[:], both.outer[:] = reach[0], reach[0]
        out = paint_at(both, Brush(0, 0, 0), [[0.5, 0.5, 0.54], [0.5, 0.5, 0.46], [0.5, 0.5, 0.59]], 0.01)
        assert out[0, 0] > 0.7 > 0.3 > out[0, 1]
        assert out[1, 1] > 0.7 > 0.3 > out[1, 0]
        assert out[2, 0] > 0.95 and (out[:, 3] > 0.95).all()
