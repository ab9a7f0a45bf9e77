"""Networks in half precision: equal to float32 to three digits in value and gradient, and used only where allowed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor, nn

from svv.core.geometry.box import Box
from svv.core.rays.encodings import lattice_features, spherical_harmonics
from svv.core.rays.networks import relu_layers
from svv.core.rounding import NETWORKS
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, FieldSettings, Layers, mlp
from svv.fields.radiance.occupancy import Occupancy
from svv.kernels.numba import bfloat16, pairs
from svv.kernels.numba import looks as numba_looks
from svv.kernels.numba.bfloat16 import LEAST_SAMPLES, SAMPLES_MULTIPLE, HalfNetwork, cpu_has_bfloat16
from svv.kernels.numba.networks import Network
from svv.kernels.numba.pairs import cpu_multiplies_pairs, paired, rounded
from svv.kernels.types import Samples
from tests.nightly import nightly

HALF = pytest.mark.skipif(not cpu_has_bfloat16(), reason="this CPU multiplies no bfloat16 matrices")
DIGITS = NETWORKS[torch.bfloat16]


def inputs(count: int, width: int = 32, seed: int = 0) -> Tensor:
    return torch.randn(count, width, generator=torch.Generator().manual_seed(seed))


def colour_network(hidden: int = 2, rough: bool = True) -> Layers:
    torch.manual_seed(1)
    return mlp(32, 64, hidden, 3, rough)


def error(got: Tensor, right: Tensor) -> float:
    return float(((got - right).norm() / right.norm()).detach())


@HALF
@pytest.mark.parametrize("hidden", [1, 2])
@pytest.mark.parametrize("count", [LEAST_SAMPLES, LEAST_SAMPLES + 1, 3 * SAMPLES_MULTIPLE + 17])
def test_half_is_float32_to_three_digits_in_value_and_gradient(hidden: int, count: int) -> None:
    network = colour_network(hidden)
    x, twin = inputs(count).requires_grad_(), inputs(count).requires_grad_()
    upstream = inputs(count, 3, 2).abs()  # of one sign: a sum that cancels keeps no digits in any precision
    expected = nn.Sequential.forward(network, twin)
    expected.backward(upstream)
    right = [p.grad.clone() for p in network.parameters() if p.grad is not None]
    network.zero_grad()
    got = HalfNetwork.apply(x, *network.parameters())
    got.backward(upstream)
    assert got.shape == expected.shape and got.dtype == torch.float32
    assert error(got, expected) < DIGITS
    assert x.grad is not None and twin.grad is not None
    # Where a hidden number is nearly 0, rounding turns its ReLU on or off, so some samples' gradients differ by more.
    off = (x.grad - twin.grad).norm(dim=1) / twin.grad.norm(dim=1).clamp(min=1e-6)
    assert float(off.median()) < DIGITS
    for p, expected_gradient in zip(network.parameters(), right, strict=True):
        assert p.grad is not None and p.grad.dtype == torch.float32
        assert error(p.grad, expected_gradient) < 2 * DIGITS


@HALF
def test_a_sample_does_not_depend_on_how_many_there_are() -> None:
    network, x = colour_network(), inputs(2 * LEAST_SAMPLES + 5)
    with torch.no_grad():
        torch.testing.assert_close(network(x)[:LEAST_SAMPLES], network(x[:LEAST_SAMPLES]), atol=1e-6, rtol=0)


@HALF
def test_the_same_numbers_every_time() -> None:
    network, x = colour_network(), inputs(LEAST_SAMPLES + 100)
    results = []
    for _ in range(3):
        network.zero_grad()
        y = network(x)
        y.square().sum().backward()
        results.append([y.detach(), *(p.grad for p in network.parameters())])
    for again in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(again, results[0], strict=True))


@HALF
def test_large_batches_of_rough_networks_are_in_half_and_others_are_not() -> None:
    x = inputs(LEAST_SAMPLES)
    for rough, count in ((True, LEAST_SAMPLES), (True, LEAST_SAMPLES - 1), (False, LEAST_SAMPLES)):
        network = colour_network(rough=rough)
        with torch.no_grad():
            same = torch.equal(network(x[:count]), Network.apply(x[:count], *network.parameters()))
        assert same == (not rough or count < LEAST_SAMPLES)


def test_a_processor_without_it_takes_float32(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bfloat16, "cpu_has_bfloat16", lambda: False)
    network, x = colour_network(), inputs(LEAST_SAMPLES + 7)
    with torch.no_grad():
        assert torch.equal(network(x), Network.apply(x, *network.parameters()))


@pytest.mark.parametrize("name", ["ONEDNN_MAX_CPU_ISA", "DNNL_MAX_CPU_ISA"])
@pytest.mark.parametrize(
    ("most", "allowed"),
    [("SSE41", False), ("AVX2_VNNI_2", False), ("AVX512_CORE", False), ("avx512_core_bf16", False),
     ("AVX512_CORE_FP16", False), ("AVX10_1_512", False), ("AVX512_CORE_AMX", True), ("AVX10_1_512_AMX_FP16", True),
     ("ALL", True), ("default", True), ("", True)],
)  # fmt: skip
def test_a_processor_that_is_held_back_takes_float32(
    name: str, most: str, allowed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The processor has the units; oneDNN is told how new its instructions may be (its documentation, "ISA controls").

    From AVX-512 on, it multiplies bfloat16 matrices without the units, too, with other sums and more slowly.
    """
    for other in ("ONEDNN_MAX_CPU_ISA", "DNNL_MAX_CPU_ISA"):
        monkeypatch.delenv(other, raising=False)
    monkeypatch.setenv(name, most)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": True}, raising=False)
    assert cpu_has_bfloat16.__wrapped__() == allowed


LIMITS = ["SSE41", "AVX512_CORE", "AVX512_CORE_BF16", "AVX512_CORE_AMX", "no such name"]


@pytest.mark.parametrize("most", nightly(LIMITS, "AVX512_CORE", "AVX512_CORE_AMX"))
def test_what_is_said_of_the_processor_is_what_onednn_does(most: str) -> None:
    """oneDNN prints which of its implementations it takes: those of the units have "amx" in their names."""
    multiply = (
        "import torch; x = torch.zeros(1024, 16, dtype=torch.bfloat16);"
        "from svv.kernels.numba.bfloat16 import cpu_has_bfloat16; print('said', cpu_has_bfloat16(), flush=True);"
        "torch.ops.mkldnn._linear_pointwise(x, x[:16], None, 'none', [], '')"  # an error where it has nothing for them
    )
    environment = os.environ | {"ONEDNN_MAX_CPU_ISA": most, "ONEDNN_VERBOSE": "1"}
    alone = [sys.executable, "-I", "-c", multiply]  # -I: nothing is imitated
    found = subprocess.run(alone, env=environment, capture_output=True, text=True)
    used = any("_amx" in line for line in found.stdout.splitlines() if "exec,cpu" in line)
    assert f"said {used}" in found.stdout, found.stderr


def test_what_is_imitated_is_imitated_in_processes_too() -> None:
    """As the tests in ParaView need it, which runs them in programs of its own."""
    ask = "from svv.kernels.numba.bfloat16 import cpu_has_bfloat16; print(cpu_has_bfloat16())"
    paths = os.pathsep.join([str(Path(__file__).parent / "imitated"), os.environ["PYTHONPATH"]])
    environment = os.environ | {"PYTHONPATH": paths, "ONEDNN_MAX_CPU_ISA": "SSE41"}
    found = subprocess.run([sys.executable, "-c", ask], env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "True"


def test_extinctions_are_never_rough() -> None:
    """An error of three digits in an exponent of 9 would be one of several hundredths in the extinction."""
    occupancy = Occupancy(Box((0.0, 0.0, 0.0), 1.0, (1.0, 1.0, 1.0)), 4, torch.ones(4, 4, 4, dtype=torch.uint8).numpy())
    field = BaseField(FieldSettings("hash", (4, 16), features=2, levels=4, log2_entries=8), occupancy)
    assert isinstance(field.density_mlp, Layers) and not field.density_mlp.rough
    assert isinstance(field.colour_mlp, Layers) and field.colour_mlp.rough


PAIRS = pytest.mark.skipif(not cpu_multiplies_pairs(), reason="this CPU multiplies no pairs of bfloat16 numbers")


def looks_of(count: int, same: bool = True) -> tuple[list[Tensor], list[Tensor]]:
    """What the CPU's kernels say of ``count`` samples in a box, and what is right: lighting and palette."""
    random = torch.Generator().manual_seed(3)
    lattice = SparseLattice(np.ones((4, 4, 4), np.uint8), 4, (2, 4), 4).layout
    ray, start = torch.arange(count).int() % 3, torch.zeros(3, dtype=torch.int64)
    position = torch.rand(count, 3, generator=random)
    samples = Samples(position, position[:, 0], position[:, 0], ray, start, start, torch.zeros(3), 0.1)
    along = torch.nn.functional.normalize(torch.randn(3, 3, generator=random), dim=1)
    along = along[:1].repeat(3, 1) if same else along
    tables = torch.randn(125 + 27, 8, generator=random)
    torch.manual_seed(4)
    networks = [mlp(*shape).weights for shape in ((24, 64, 2, 2), (8, 64, 1, 9))]
    both = lattice_features(position, lattice.shapes, lattice.scales, lattice.bases, lattice.index, tables)
    both = both.unflatten(1, (2, 8))
    lit = torch.cat([both[..., :4].flatten(1), spherical_harmonics(along, 4)[ray.long()]], dim=1)
    said = numba_looks.looks(samples, along, lattice, tables, *networks)
    right = [relu_layers(x.double(), [w.detach().double() for w in n])
             for x, n in zip((lit, both[..., 4:].flatten(1)), networks, strict=True)]  # fmt: skip
    return list(said), right


@pytest.mark.parametrize("same", [True, False])
def test_looks_at_many_samples_have_three_digits(same: bool) -> None:
    said, right = looks_of(LEAST_SAMPLES + 1, same)
    assert all(error(got, expected) < DIGITS for got, expected in zip(said, right, strict=True))


def test_looks_at_few_samples_or_on_other_processors_have_all_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    few, right = looks_of(LEAST_SAMPLES - 1)
    assert all(error(got, expected) < NETWORKS[torch.float32] for got, expected in zip(few, right, strict=True))
    monkeypatch.setattr(pairs, "cpu_multiplies_pairs", lambda: False)
    many, right = looks_of(LEAST_SAMPLES + 1)
    assert all(error(got, expected) < NETWORKS[torch.float32] for got, expected in zip(many, right, strict=True))


@PAIRS
def test_looks_at_many_samples_are_in_half_and_the_same_every_time() -> None:
    many, right = looks_of(LEAST_SAMPLES + 77)
    assert all(error(got, expected) > NETWORKS[torch.float32] for got, expected in zip(many, right, strict=True))
    again, _ = looks_of(LEAST_SAMPLES + 77)
    assert all(torch.equal(a, b) for a, b in zip(many, again, strict=True))


FINITE = st.floats(width=32, allow_nan=False, max_value=2.0**126, min_value=-(2.0**126))


@given(st.lists(FINITE, min_size=2, max_size=8))
def test_pairs_are_rounded_as_torch_rounds(numbers: list[float]) -> None:
    values = np.array(numbers[: len(numbers) // 2 * 2], np.float32)
    right = torch.from_numpy(values).bfloat16()
    assert np.array_equal(rounded(values), right.float().numpy())
    assert np.array_equal(paired(values).view(np.int16), right.view(torch.int16).numpy())


@pytest.mark.parametrize("held", ["CPU_NAME", "CPU_FEATURES"])
def test_a_processor_for_which_numba_is_held_back_multiplies_no_pairs(
    held: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, held, "generic")
    assert not cpu_multiplies_pairs.__wrapped__()
