"""Samples behind an opaque surface are left out where no march could know the extinction; pictures do not change."""

from __future__ import annotations

import math

import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.geometry.box import Box
from svv.fields.radiance.networks import BaseField, FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, composite, not_hidden
from tests.test_representatives import RAYS, STEP, samples_of

STOP = 7.0


@given(RAYS, st.integers(0, 2**31), st.floats(0.001, 3.0), st.floats(0.1, 1.0))
def test_a_ray_ends_where_a_march_would_end_it(counts: list[int], seed: int, thick: float, fade: float) -> None:
    samples = samples_of(counts, seed, thick)
    left, rows = not_hidden(samples, samples.sigma, Marching(STEP, stop=STOP, fade=fade))
    expected: list[int] = []
    kept: list[int] = []
    for start, count in zip(samples.start.tolist(), samples.count.tolist(), strict=True):
        tau, number = 0.0, len(expected)
        for row in range(start, start + count):
            if fade * tau > STOP:
                break
            expected.append(row)
            tau += float(samples.skipped[row]) + float(samples.sigma[row]) * STEP
        kept.append(len(expected) - number)
    assert rows.tolist() == expected and left.count.tolist() == kept
    for part in ("position", "sigma", "skipped", "ray"):
        assert torch.equal(getattr(left, part), getattr(samples, part)[rows])


@given(RAYS, st.integers(0, 2**31), st.floats(0.001, 3.0))
def test_what_is_left_composites_as_all_samples_do(counts: list[int], seed: int, thick: float) -> None:
    samples = samples_of(counts, seed, thick)
    colour = torch.rand(len(samples), 3, generator=torch.Generator().manual_seed(seed))
    left, rows = not_hidden(samples, samples.sigma, Marching(STEP, stop=STOP))
    whole, part = composite(samples, samples.sigma, colour), composite(left, left.sigma, colour[rows])
    torch.testing.assert_close(part[0], whole[0], atol=math.exp(-STOP), rtol=0.0)
    torch.testing.assert_close(part[1], whole[1], atol=1e-5, rtol=1e-3)  # the depth of the others is in the tail


def test_the_gradient_of_a_hash_grid_is_that_of_its_visible_samples() -> None:
    """Rows without a gradient cost nothing and are not stepped."""
    occupancy = Occupancy(Box((0.0, 0.0, 0.0), 1.0, (1.0, 1.0, 1.0)), 4, torch.ones(4, 4, 4, dtype=torch.uint8).numpy())
    draw = torch.Generator().manual_seed(0)
    x, upstream = torch.rand(50, 3, generator=draw), torch.randn(50, 8, generator=draw)
    upstream[20:] = 0.0
    grids = [BaseField(FieldSettings("hash", (4, 64), features=2, levels=4, log2_entries=8), occupancy).encoding
             for _ in range(2)]  # fmt: skip
    grids[0].add_gradient(x, upstream)
    grids[1].add_gradient(x[:20], upstream[:20])
    for ours, expected in zip(*(grid.buffers_for_gradient() for grid in grids), strict=True):
        assert torch.equal(ours, expected)
    assert grids[0].buffers_for_gradient()[1].any()
