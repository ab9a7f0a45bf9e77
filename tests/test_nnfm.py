"""NNFM compared with brute force; colour statistics with their definition; luminance with published values."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.images.nnfm import (
    cell_weights,
    colour_statistics,
    colour_transfer,
    luminance,
    nearest,
    nnfm_loss,
    statistics_loss,
    total_variation,
)

EXACT = {"rtol": 1e-10, "atol": 1e-12}


def vectors(rows: int, channels: int, seed: int) -> torch.Tensor:
    return torch.randn(rows, channels, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def brute_force(features: torch.Tensor, style: torch.Tensor, weights: torch.Tensor) -> float:
    total = 0.0
    for feature, weight in zip(features, weights, strict=True):
        total += weight * min(1 - feature @ s / (feature.norm() * s.norm()) for s in style)
    return float(total / weights.sum())


@settings(deadline=None, max_examples=25)
@given(st.integers(1, 40), st.integers(1, 30), st.integers(1, 8), st.integers(1, 50), st.integers(0, 999))
def test_loss_is_the_brute_force_mean_of_minima_for_any_chunk(n: int, m: int, c: int, chunk: int, seed: int) -> None:
    features, style = vectors(n, c, seed), vectors(m, c, seed + 1)
    weights = vectors(n, 1, seed + 2)[:, 0].square() + 1e-3
    expected = brute_force(features, style, weights)
    torch.testing.assert_close(nnfm_loss(features, style, weights, chunk=chunk).item(), expected, **EXACT)
    assert -1e-12 <= expected <= 2 + 1e-12


def test_equal_weights_are_no_weights_and_zero_weights_drop_rows() -> None:
    features, style = vectors(20, 5, 0), vectors(9, 5, 1)
    ones = torch.ones(20, dtype=torch.float64)
    torch.testing.assert_close(nnfm_loss(features, style, ones), nnfm_loss(features, style), **EXACT)
    ones[7:] = 0
    torch.testing.assert_close(nnfm_loss(features, style, ones), nnfm_loss(features[:7], style), **EXACT)


def test_gradient_is_that_of_the_minimum() -> None:
    features, style = vectors(6, 4, 3).requires_grad_(), vectors(5, 4, 4).requires_grad_()
    assert torch.autograd.gradcheck(nnfm_loss, (features, style))


def test_the_loss_sees_directions_only_and_vanishes_on_the_style_itself() -> None:
    style = vectors(12, 6, 5)
    picked = style[[3, 3, 8, 0]]
    scale = torch.tensor([[0.1], [1.0], [7.0], [100.0]], dtype=torch.float64)
    assert nearest(picked * scale, style).tolist() == [3, 3, 8, 0]
    torch.testing.assert_close(nnfm_loss(picked * scale, style).item(), 0.0, **EXACT)


def test_nothing_in_the_foreground_is_a_loss_of_zero_that_can_be_differentiated() -> None:
    features = vectors(4, 3, 6).requires_grad_()
    style, none = vectors(5, 3, 7), torch.zeros(4, dtype=torch.float64)
    for loss in (nnfm_loss(features, style, none), nnfm_loss(features[:0], style)):
        assert loss.item() == 0
        loss.backward()


def test_cells_weigh_their_share_of_foreground() -> None:
    mask = torch.zeros(10, 12)
    mask[0:4, 0:2] = 1
    mask[4:8, 8:12] = 0.5
    assert cell_weights(mask).tolist() == [0.5, 0, 0, 0, 0, 0.5]


def test_total_variation_counts_foreground_only() -> None:
    image = torch.zeros(3, 8, 8)
    image[:, :, 4:] = 1
    assert total_variation(image).item() == pytest.approx(1 / 7)  # one step in seven differences along each row
    mask = torch.ones(8, 8)
    mask[:, 4:] = 0
    assert total_variation(image, mask).item() == 0
    assert total_variation(image, torch.zeros(8, 8)).item() == 0


@pytest.mark.parametrize(
    ("colour", "expected"),
    [
        ((1, 1, 1), 1.0),
        ((0, 0, 0), 0.0),
        ((1, 0, 0), 0.2126),
        ((0.5, 0.5, 0.5), 0.5**2.2),
        ((0.11, 0.11, 0.11), 0.11**2.2),
    ],
)
def test_luminance_is_the_paper_s_applied_once(colour: tuple[float, ...], expected: float) -> None:
    assert luminance(torch.tensor(colour, dtype=torch.float64)).item() == pytest.approx(expected)


@settings(deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3))
def test_luminance_lies_between_black_and_white(colour: tuple[float, float, float]) -> None:
    assert 0 <= luminance(torch.tensor(colour)).item() <= 1


def test_statistics_are_the_weighted_mean_and_covariance() -> None:
    colours = vectors(50, 3, 8)
    mean, covariance = colour_statistics(colours)
    torch.testing.assert_close(mean, colours.mean(0), **EXACT)
    torch.testing.assert_close(covariance, colours.T.cov(correction=0), **EXACT)
    counts = torch.randint(0, 4, (50,), generator=torch.Generator().manual_seed(0))
    repeated, weighted = (
        colour_statistics(colours.repeat_interleave(counts, 0)),
        colour_statistics(colours, counts.double()),
    )
    torch.testing.assert_close(weighted, repeated, **EXACT)


def test_transferred_colours_have_the_target_s_statistics() -> None:
    source, target = vectors(400, 3, 9) * 0.2 + 0.4, vectors(300, 3, 10) @ vectors(3, 3, 11) * 0.1 + 0.6
    matrix, offset = colour_transfer(colour_statistics(source), colour_statistics(target), floor=0)
    mapped = source @ matrix.T + offset
    torch.testing.assert_close(colour_statistics(mapped), colour_statistics(target), rtol=1e-7, atol=1e-9)
    assert statistics_loss(mapped, colour_statistics(target)).item() == pytest.approx(0, abs=1e-12)
    assert statistics_loss(source, colour_statistics(target)).item() > 1e-3


def test_a_flat_source_or_target_stays_finite() -> None:
    flat, lively = torch.full((30, 3), 0.3), torch.rand(30, 3, generator=torch.Generator().manual_seed(1))
    for source, target in ((flat, lively), (lively, flat), (flat, flat)):
        matrix, offset = colour_transfer(colour_statistics(source), colour_statistics(target))
        mapped = source @ matrix.T + offset
        assert torch.isfinite(mapped).all()
        torch.testing.assert_close(mapped.mean(0), target.mean(0), rtol=1e-4, atol=1e-4)
