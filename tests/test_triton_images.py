"""The Triton kernels of images and of training steps, compared with those of the CPU and with plain torch.

They run on a GPU if there is one, otherwise in Triton's interpreter. See ``tests/test_triton_kernels.py``.
"""

from __future__ import annotations

import pytest
import torch

from svv.fields.radiance.image_checks import image_checks
from svv.fields.radiance.training_checks import training_checks
from tests.interpreted import GPU, triton_kernels

DEVICE = torch.device("cuda" if GPU else "cpu")


CHECKS = image_checks(150) | training_checks(150)


@pytest.mark.parametrize("name", CHECKS)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_kernel_gives_what_the_cpu_gives(name: str, seed: int) -> None:
    CHECKS[name](triton_kernels, DEVICE, seed)
