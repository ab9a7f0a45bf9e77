"""Samples that represent the colour of their neighbours: where they lie, and that pictures do not change."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from svv.fields.radiance.rendering import composite, representatives
from svv.kernels import reference
from svv.kernels.numba import kernels as numba_kernels
from svv.kernels.types import Samples

STEP = 0.1


def samples_of(counts: list[int], seed: int, thick: float) -> Samples:
    """Samples of rays with so many each, optical depths around ``thick``."""
    draw = np.random.default_rng(seed)
    count = torch.tensor(counts)
    number = int(count.sum())
    parts = (draw.gamma(0.5, thick / part, number) for part in (STEP, 9.0))
    sigma, skipped = (torch.from_numpy(part.astype(np.float32)) for part in parts)
    ray = torch.repeat_interleave(torch.arange(len(counts), dtype=torch.int32), count)
    position = torch.from_numpy(draw.random((number, 3)).astype(np.float32))
    tail = torch.zeros(len(counts))
    return Samples(position, sigma, skipped, ray, count.cumsum(0) - count, count, tail, STEP)


def shift_of(samples: Samples, seed: int) -> torch.Tensor:
    return torch.rand(len(samples.count), generator=torch.Generator().manual_seed(seed))


RAYS = st.lists(st.integers(0, 40), min_size=1, max_size=12).filter(any)


@given(RAYS, st.integers(0, 2**31), st.floats(0.001, 3.0), st.floats(1e-3, 2.0))
@example([7, 40, 40, 33, 32], 26, 0.001, 0.001)
def test_each_sample_is_stood_for_on_its_own_ray(counts: list[int], seed: int, thick: float, every: float) -> None:
    samples = samples_of(counts, seed, thick)
    rows, place = representatives(samples, every, shift_of(samples, seed))
    _, _, weight = composite(samples, samples.sigma, torch.zeros(len(samples), 1))
    assert (rows[1:] > rows[:-1]).all()
    assert (samples.ray[rows[place]] == samples.ray).all()
    assert torch.equal(place[rows], torch.arange(len(rows)))  # each stands for itself
    assert (place[1:] >= place[:-1]).all()
    assert np.isin(torch.nonzero(weight > 1.001 * every)[:, 0], rows).all()
    taken = torch.bincount(samples.ray[rows].long(), minlength=len(counts))
    assert (taken >= (samples.count > 0)).all()
    # Cuts lie in what was left out between samples, too, and short samples may have one each.
    depth = torch.zeros(len(counts)).index_add_(0, samples.ray.long(), samples.skipped + samples.sigma * STEP)
    assert (taken <= 2 + (1.0 - torch.exp(-depth)) / every).all()


@given(RAYS, st.integers(0, 2**31), st.floats(0.001, 3.0), st.floats(1e-3, 2.0))
def test_the_kernel_chooses_as_the_reference(counts: list[int], seed: int, thick: float, every: float) -> None:
    samples = samples_of(counts, seed, thick)
    shift = shift_of(samples, seed)
    expected = reference.representatives(samples, every, shift)
    for got, right in zip(numba_kernels.representatives(samples, every, shift), expected, strict=True):
        assert torch.equal(got, right)


def test_every_sample_stands_for_itself_where_each_weighs_enough() -> None:
    samples = samples_of([5, 0, 7], 1, 0.05)
    rows, place = representatives(samples, 1e-9, shift_of(samples, 0))
    assert torch.equal(rows, torch.arange(12)) and torch.equal(place, rows)


def test_pictures_stay_what_they_are() -> None:
    """Colours that run along the rays: the mean over many draws is the picture, and each draw close to it."""
    samples = samples_of([30] * 40, 3, 0.05)
    along = (torch.arange(1200) % 30 / 29)[:, None]
    picture, _, _ = composite(samples, samples.sigma, along)
    drawn = []
    for seed in range(300):
        rows, place = representatives(samples, 1 / 16, shift_of(samples, seed))
        drawn.append(composite(samples, samples.sigma, along[rows][place])[0])
    assert len(rows) < 0.6 * len(samples)
    error = torch.stack(drawn) - picture
    assert error.mean().abs() < 0.005
    assert error.square().mean().sqrt() < 0.03
