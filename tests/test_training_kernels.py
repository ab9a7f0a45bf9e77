"""Whole training steps on the CPU, compared with plain torch in value and gradient."""

from __future__ import annotations

import pytest
import torch

from svv.fields.devices.training_checks import training_checks
from svv.kernels.numba import kernels

pytestmark = pytest.mark.usefixtures("all_threads")

CHECKS = training_checks(150)


@pytest.mark.parametrize("name", CHECKS)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_step_gives_what_plain_torch_gives(name: str, seed: int) -> None:
    CHECKS[name](kernels, torch.device("cpu"), seed)
