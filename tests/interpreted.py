"""Triton's kernels for tests: compiled if there is a GPU, otherwise interpreted.

Triton chooses between the two when it is first imported. Tests therefore import its kernels from here and never from
:mod:`svv.kernels` directly.
"""

from __future__ import annotations

import os
import sys

import torch

GPU = torch.cuda.is_available()
if not GPU:
    assert "triton" not in sys.modules, "triton was imported before it was told to interpret"
    os.environ["TRITON_INTERPRET"] = "1"
from svv.kernels.triton import cells as triton_cells  # noqa: E402
from svv.kernels.triton import kernels as triton_kernels  # noqa: E402
from svv.kernels.triton import networks as triton_networks  # noqa: E402
from svv.kernels.triton import rays as triton_rays  # noqa: E402
from svv.kernels.triton import tables as triton_tables  # noqa: E402
from svv.kernels.triton import tomography as triton_tomography  # noqa: E402

__all__ = [
    "GPU",
    "triton_cells",
    "triton_kernels",
    "triton_networks",
    "triton_rays",
    "triton_tables",
    "triton_tomography",
]
