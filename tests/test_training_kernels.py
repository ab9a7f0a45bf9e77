"""Whole training steps on the CPU, compared with plain torch in value and gradient."""

from __future__ import annotations

import numba
import pytest
import torch
from torch import Tensor

from svv.fields.devices.kernel_checks import weights_of
from svv.fields.devices.training_checks import (
    ALPHA,
    FEATURES,
    LEVELS,
    PENALTIES,
    WIDTH,
    Inputs,
    cleared,
    training_checks,
)
from svv.fields.radiance.networks import learning
from svv.kernels.dispatch import CPU
from svv.kernels.numba import kernels
from svv.kernels.numba import learning as steps
from svv.kernels.types import HARMONICS

pytestmark = pytest.mark.usefixtures("all_threads")

CHECKS = training_checks(150)


@pytest.mark.parametrize("name", CHECKS)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_step_gives_what_plain_torch_gives(name: str, seed: int) -> None:
    CHECKS[name](kernels, CPU, seed)


def test_no_bit_of_a_step_depends_on_the_threads() -> None:
    at, generator = Inputs(3, tuple(k % 9 for k in range(300))), torch.Generator().manual_seed(3)
    samples, target = at.on(CPU, spare=False)
    lighting = weights_of((LEVELS * FEATURES + HARMONICS, WIDTH, 2, 3), 3)
    mixing = weights_of((LEVELS * FEATURES, WIDTH, 1, 13), 4)
    shift, palette = torch.rand(300, generator=generator), torch.rand(3, 3, generator=generator)
    found: list[list[Tensor]] = []
    for threads in (1, numba.config.NUMBA_NUM_THREADS):
        numba.set_num_threads(threads)
        density, features = (cleared(lattice, CPU) for lattice in at.lattices)
        tables = learning(density), learning(features)
        error, gradients, _ = steps.base(samples, target, tables, lighting, 1.0 / 16.0, shift, ALPHA, True)
        one = [error, *gradients, *(table.gradient.clone() for table in tables)]
        where = features.layout, features.table.detach()
        networks = [*lighting[:-1], lighting[-1][:2]], mixing
        error, gradients = steps.palette(samples, target, where, tables[1], networks, palette, PENALTIES, None)
        found.append([*one, error, *gradients, tables[1].gradient])
    assert all(torch.equal(a, b) for a, b in zip(*found, strict=True))
