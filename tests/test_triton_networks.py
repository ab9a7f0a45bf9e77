"""Small networks on tensor cores compared with plain torch, in value and gradient.

The kernels run on a GPU if there is one, otherwise in Triton's interpreter. See ``tests/test_triton_kernels.py``.
"""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from svv.core.rays.networks import relu_layers
from svv.core.rounding import NETWORKS, ROUNDOFF
from svv.fields.devices.kernel_checks import NETWORK_SHAPES as SHAPES
from svv.fields.devices.kernel_checks import relative_error as off
from svv.fields.devices.kernel_checks import rounded_layers
from svv.fields.devices.kernel_checks import value_and_gradients as results
from svv.fields.devices.kernel_checks import weights_of as weights_for
from svv.fields.radiance.networks import mlp
from svv.kernels.dispatch import CPU
from tests.interpreted import GPU, triton_kernels, triton_networks

DEVICE = torch.device("cuda" if GPU else "cpu")
FEW = settings(deadline=None, max_examples=12)


def lost_to_half_precision(x: Tensor, weights: list[Tensor]) -> Tensor:
    """Return how far outputs may be from exact ones: each product rounds both operands to float16, in each layer.

    As in :func:`svv.core.rounding.sums_apart`, it is a part of the sum of magnitudes: a sum that cancels keeps fewer
    digits. Numbers below 2^-14 lose more of themselves, but no more than 2^-14 would.
    """
    size = x.double().abs().clamp(min=2.0**-14)
    for weight in weights:
        size = size @ weight.double().abs().clamp(min=2.0**-14).T
    return ((1 + ROUNDOFF[torch.float16]) ** (2 * len(weights)) - 1 + NETWORKS[torch.float32]) * size


@pytest.fixture(params=[None, 2], ids=["a block each", "many blocks each"])
def programs(request, monkeypatch: pytest.MonkeyPatch) -> None:
    """With as many programs as there are blocks, and with two that go over many small ones."""
    if request.param:
        for name in ("FORWARD", "BACKWARD"):
            monkeypatch.setattr(triton_networks, name, triton_networks.Launch(16, request.param))


@pytest.mark.usefixtures("programs")
@FEW
@given(st.sampled_from(SHAPES), st.integers(1, 150), st.integers(0, 10**6), st.integers(-30, 10))
def test_values_and_gradients_are_those_of_plain_torch(
    shape: tuple[int, int, int, int], count: int, seed: int, exponent: int
) -> None:
    generator = torch.Generator().manual_seed(seed)
    x, weights = torch.randn(count, shape[0], generator=generator), weights_for(shape, seed)
    g = 2.0**exponent * torch.randn(count, shape[-1], generator=generator)
    got = results(triton_networks.run, x, weights, g, DEVICE)
    exact = results(relu_layers, x, weights, g, CPU)
    rounded = results(rounded_layers, x, weights, g, CPU)
    assert [t.shape for t in got] == [t.shape for t in exact]
    assert off(got[0], rounded[0]) < NETWORKS[torch.float32]
    assert ((got[0] - exact[0]).abs() <= lost_to_half_precision(x, weights)).all()
    assert max(off(mine, theirs) for mine, theirs in zip(got[1:], rounded[1:], strict=True)) < NETWORKS[torch.float16]


@pytest.mark.parametrize("shape", SHAPES[:4])
def test_gradients_neither_fade_nor_overflow(shape: tuple[int, int, int, int]) -> None:
    """They are as many times larger as the loss is, to the last bit, far beyond what float16 can hold."""
    generator = torch.Generator().manual_seed(1)
    x, weights = torch.randn(70, shape[0], generator=generator), weights_for(shape, 2)
    g = torch.randn(70, shape[-1], generator=generator)
    expected = results(triton_networks.run, x, weights, g, DEVICE)[1:]
    for factor in (2.0**-60, 2.0**40):
        got = results(triton_networks.run, x, weights, factor * g, DEVICE)[1:]
        assert all(torch.equal(mine, factor * theirs) for mine, theirs in zip(got, expected, strict=True))
    assert all(t.abs().max() > 0.1 for t in expected)


def test_gradients_of_faint_samples_beside_strong_ones() -> None:
    """A sample whose gradient is a millionth of its neighbour's still teaches its features."""
    shape = SHAPES[0]
    generator = torch.Generator().manual_seed(1)
    x, weights = torch.randn(64, shape[0], generator=generator), weights_for(shape, 2)
    g = 1e-3 * torch.randn(64, shape[-1], generator=generator)
    g[1::2] *= 1e-6
    got = results(triton_networks.run, x, weights, g, DEVICE)[1]
    expected = results(rounded_layers, x, weights, g, CPU)[1]
    assert off(got[1::2], expected[1::2]) < NETWORKS[torch.float16]


def test_what_is_too_large_for_half_precision_stays_finite() -> None:
    weights = weights_for(SHAPES[0], 0, 30.0)
    x = 1e5 * torch.randn(40, 32, generator=torch.Generator().manual_seed(0))
    for t in results(triton_networks.run, x, weights, torch.ones(40, 3), DEVICE):
        assert t.isfinite().all()


def test_what_is_no_number_shows() -> None:
    """A training that has gone astray must not look like one that has not."""
    x, weights = torch.zeros(40, 32), weights_for(SHAPES[0], 0)
    x[7, 3] = torch.nan
    out, _, *rest = results(triton_networks.run, x, weights, torch.ones(40, 3), DEVICE)
    assert out.isnan().any(dim=1).nonzero().flatten().tolist() == [7]
    assert rest[0].isnan().any()
    g = torch.ones(40, 3)
    g[2, 1] = torch.nan
    assert all(t.isnan().any() for t in results(triton_networks.run, torch.ones(40, 32), weights, g, DEVICE)[1:])


def test_the_same_inputs_give_the_same_bits() -> None:
    """However the GPU's programs race: every part of a sum has its place in it."""
    generator = torch.Generator().manual_seed(1)
    x, g = torch.randn(1500, 32, generator=generator), torch.randn(1500, 3, generator=generator)
    first, second = (results(triton_networks.run, x, weights_for(SHAPES[0], 2), g, DEVICE) for _ in range(2))
    assert all(map(torch.equal, first, second))


def test_no_samples() -> None:
    weights = weights_for(SHAPES[0], 0)
    out, g_x, *rest = results(triton_networks.run, torch.zeros(0, 32), weights, torch.zeros(0, 3), DEVICE)
    assert (out.shape, g_x.shape) == ((0, 3), (0, 32))
    assert all(torch.equal(g, torch.zeros_like(w)) for g, w in zip(rest, weights, strict=True))


def test_inputs_that_learn_nothing() -> None:
    """Geometry features are frozen while the lighting learns from them."""
    weights = [w.to(DEVICE).requires_grad_() for w in weights_for(SHAPES[2], 0)]
    x = torch.randn(50, 36, generator=torch.Generator().manual_seed(0)).to(DEVICE)
    ends = []
    for leaf in (x, x.clone().requires_grad_()):
        ends.append(torch.autograd.grad(triton_kernels.network(leaf, weights, True).square().sum(), weights))
    assert all(map(torch.equal, *ends))
    assert not triton_kernels.network(x, [w.detach() for w in weights], True).requires_grad


@pytest.mark.parametrize("sizes", [(8, 4), (8, 32, 16, 4), (8, 128, 4), (200, 64, 4), (8, 16, 16, 16, 4)])
def test_other_networks_run_in_plain_torch(sizes: tuple[int, ...]) -> None:
    generator = torch.Generator().manual_seed(0)
    weights = [torch.randn(to, source, generator=generator).to(DEVICE) for source, to in pairwise(sizes)]
    x = torch.randn(20, sizes[0], generator=generator).to(DEVICE)
    assert torch.equal(triton_kernels.network(x, weights, True), relu_layers(x, weights))


def test_gpus_without_tensor_cores_for_triton_run_plain_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    x, weights = torch.randn(20, 32, device=DEVICE), [w.to(DEVICE) for w in weights_for(SHAPES[0], 0)]
    monkeypatch.setattr(triton_networks, "_can_run", lambda device: False)
    assert torch.equal(triton_kernels.network(x, weights, True), relu_layers(x, weights))
    monkeypatch.undo()
    assert not torch.equal(triton_kernels.network(x, weights, True), relu_layers(x, weights))
    for capability, runs in (((7, 5), False), ((8, 0), True), ((9, 0), True), ((10, 3), True), ((12, 0), True)):
        monkeypatch.setattr(torch.cuda, "get_device_capability", lambda device, own=capability: own)
        triton_networks._can_run.cache_clear()
        triton_networks._warps.cache_clear()
        assert triton_networks._can_run(torch.device("cuda", 7)) == runs
        # Blackwell's GPUs for data centres use the tensor cores that the backward pass compiles for with more warps.
        assert triton_networks._warps(torch.device("cuda", 7)) == (16 if capability[0] == 10 else 4)
    triton_networks._can_run.cache_clear()
    triton_networks._warps.cache_clear()


def test_layers_are_named_as_in_plain_torch() -> None:
    layers = mlp(32, 64, 2, 3)
    assert layers.state_dict().keys() == nn.Sequential(*layers).state_dict().keys()
    assert layers.state_dict().keys() == {"0.weight", "2.weight", "4.weight"}
