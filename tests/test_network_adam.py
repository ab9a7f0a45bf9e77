"""The optimiser of the small networks takes torch's steps, and continues from torch's state."""

from __future__ import annotations

import copy
import subprocess
import sys
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.train.run.network_adam import FusedAdam, NetworkAdam

HOW: dict[str, Any] = {"lr": 0.01, "betas": (0.9, 0.99), "eps": 1e-12}
SHAPES = ((5, 3), (4,), (2, 2))


def parameters(seed: int) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return [torch.randn(shape, generator=generator).requires_grad_() for shape in SHAPES]


def with_gradients(tensors: list[torch.Tensor], seed: int, without: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    for number, tensor in enumerate(tensors):
        gradient = torch.randn(tensor.shape, generator=generator) * 10.0 ** (3 * number - 4)
        tensor.grad = None if number == without else gradient


@pytest.mark.parametrize("kind", [NetworkAdam, FusedAdam])
@given(st.integers(0, 10**6), st.integers(1, 30), st.integers(-1, 2))
def test_its_steps_are_those_of_torch(kind: type[NetworkAdam], seed: int, steps: int, without: int) -> None:
    mine = parameters(seed)
    theirs = copy.deepcopy(mine)
    own = kind([{"params": mine[:2]}, {"params": mine[2:], "lr": 0.1}], **HOW)
    reference = torch.optim.Adam([{"params": theirs[:2]}, {"params": theirs[2:], "lr": 0.1}], **HOW)
    for step in range(steps):
        for tensors, optimiser in ((mine, own), (theirs, reference)):
            with_gradients(tensors, seed + step, without if step % 3 else -1)
            optimiser.param_groups[0]["lr"] = 0.01 / (1 + step)
            optimiser.step()
    for one, other in zip(mine, theirs, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-6)
    own.zero_grad()
    assert all(tensor.grad is None for tensor in mine)


@pytest.mark.parametrize("kind", [NetworkAdam, FusedAdam])
def test_it_continues_from_the_state_of_torch(kind: type[NetworkAdam]) -> None:
    mine, theirs = parameters(1), parameters(1)
    own, reference = kind(mine, **HOW), torch.optim.Adam(theirs, **HOW)
    for step in range(5):
        with_gradients(theirs, step, -1)
        reference.step()
    with torch.no_grad():
        for one, other in zip(mine, theirs, strict=True):
            one.copy_(other)
    own.load_state_dict(copy.deepcopy(reference.state_dict()))
    for tensors, optimiser in ((mine, own), (theirs, reference)):
        with_gradients(tensors, 9, -1)
        optimiser.step()
    for one, other in zip(mine, theirs, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-6)


def test_training_does_not_load_the_compiler_of_torch() -> None:
    """It would take 150 MB and 1.5 s, and it loads triton, beside which some of ParaView's drivers do not run."""
    code = (
        "import sys, svv.job.compile_ahead as ahead; from dataclasses import replace\n"
        "from svv.train.run.config import preset; from svv.train.pipeline import train_scene\n"
        "draft = preset('draft')\n"
        "few = replace(draft, reconstruct=replace(draft.reconstruct, iterations=2, cells=16),\n"
        "    recolour=replace(draft.recolour, iterations=2))\n"
        "train_scene(ahead.ball_views(), few)\n"
        "assert 'torch._dynamo' not in sys.modules, 'the compiler was loaded'\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=600)
