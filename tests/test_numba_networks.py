"""The CPU's networks: those of plain torch in value and gradient, whatever their widths and the number of threads."""

from __future__ import annotations

from itertools import pairwise

import numba
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from svv.core.rays.networks import relu_layers
from svv.core.rounding import sums_apart
from svv.kernels.numba.networks import BLOCK, SUMS, Network

WIDTHS = st.lists(st.integers(1, 40), min_size=2, max_size=4)
"""Inputs, hidden layers and outputs of networks of one to three layers."""

EXACT = 2.0**24
"""Integers up to here are exact in single precision, and so are their sums, in any order."""


def graph(values: tuple[Tensor, list[Tensor]], network: object, upstream: Tensor) -> list[Tensor]:
    """Return a network's outputs, and the gradients of its inputs and weights."""
    x, weights = values[0].clone().requires_grad_(), [w.clone().requires_grad_() for w in values[1]]
    out = relu_layers(x, weights) if network is relu_layers else Network.apply(x, *weights)
    return [out.detach(), *torch.autograd.grad(out, [x, *weights], upstream)]


def magnitudes(x: Tensor, weights: list[Tensor], upstream: Tensor) -> float:
    """Return more than any sum in a network or in its gradients can be."""
    layers, back = [x.abs()], [upstream.abs()]
    for weight in weights:
        layers.append(layers[-1] @ weight.abs().T)
    for weight in reversed(weights):
        back.append(back[-1] @ weight.abs())
    of_weights = [g.T @ h for g, h in zip(reversed(back[:-1]), layers[:-1], strict=True)]
    return max(float(t.max()) for t in (*layers, *back, *of_weights))


@given(WIDTHS, st.integers(1, 3 * BLOCK), st.integers(0, 2**32 - 1))
def test_integers_give_exactly_what_plain_torch_gives(widths: list[int], samples: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    x = torch.from_numpy(random.integers(-2, 3, (samples, widths[0])).astype(np.float64))
    upstream = torch.from_numpy(random.integers(-2, 3, (samples, widths[-1])).astype(np.float64))
    weights = [
        torch.from_numpy(random.choice([-1.0, 0.0, 1.0], (to, own), p=[0.15, 0.7, 0.15]))
        for own, to in pairwise(widths)
    ]
    assert magnitudes(x, weights, upstream) < EXACT
    right = graph((x, weights), relu_layers, upstream)
    found = graph((x.float(), [w.float() for w in weights]), Network, upstream.float())
    for got, expected in zip(found, right, strict=True):
        assert torch.equal(got.double(), expected)


@given(WIDTHS, st.integers(0, 2 * BLOCK), st.integers(0, 2**32 - 1))
def test_values_are_right_to_rounding(widths: list[int], samples: int, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(samples, widths[0], generator=generator)
    weights = [torch.randn(to, own, generator=generator) for own, to in pairwise(widths)]
    right, bound = relu_layers(x.double(), [w.double() for w in weights]), x.double().abs()
    for weight in weights:
        bound = bound @ weight.double().abs().T
    assert ((Network.apply(x, *weights) - right).abs() <= sums_apart(sum(widths)) * bound).all()


def test_sums_do_not_depend_on_the_number_of_threads() -> None:
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread only")
    generator, found = torch.Generator().manual_seed(0), []
    x, upstream = torch.randn(SUMS * BLOCK + 17, 32, generator=generator), torch.ones(SUMS * BLOCK + 17, 3)
    weights = [torch.randn(64, 32, generator=generator), torch.randn(3, 64, generator=generator)]
    usual = numba.get_num_threads()
    for threads in (1, 2):
        numba.set_num_threads(threads)
        found.append(graph((x, weights), Network, upstream))
    numba.set_num_threads(usual)
    assert all(torch.equal(one, two) for one, two in zip(*found, strict=True))


def test_a_number_that_is_none_stays_none() -> None:
    """Otherwise a training that diverged would go on unseen."""
    x, weights = torch.ones(3, 4), [torch.ones(5, 4), torch.ones(2, 5)]
    x[1, 2] = torch.nan
    out, of_x, *_ = graph((x, weights), Network, torch.ones(3, 2))
    assert out.isnan().any(1).tolist() == [False, True, False]
    broken = [weights[0], weights[1] * torch.nan]
    assert graph((torch.ones(3, 4), broken), Network, torch.ones(3, 2))[1].isnan().all()
    assert of_x[0].isfinite().all()


def test_gradients_of_inputs_are_computed_only_for_those_who_ask() -> None:
    x, weights = torch.ones(3, 4), [torch.ones(2, 4, requires_grad=True)]
    Network.apply(x, *weights).sum().backward()
    assert weights[0].grad is not None and torch.equal(weights[0].grad, torch.full((2, 4), 3.0))
