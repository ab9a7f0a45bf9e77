"""Pytest plugin: simulate a CPU that multiplies bfloat16 matrices in hardware, as one with AMX does.

With ``python -m pytest -p tests.amx``, networks that allow it use half precision, and the results of the hardware are
computed in float32. This is slow, and exact up to rounding: products of two bfloat16 numbers are exact in float32.
"""

from __future__ import annotations

from functools import cache

import torch
from torch import Tensor

from svv.kernels.numba import bfloat16


def linear(x: Tensor, weight: Tensor, bias: None, activation: str, *_: object) -> Tensor:
    """As ``torch.ops.mkldnn._linear_pointwise`` without a bias: (S, I) and (O, I) -> (S, O)."""
    out = x.float() @ weight.float().T
    return (out.relu() if activation == "relu" else out).bfloat16()


torch.ops.mkldnn._linear_pointwise = linear  # type: ignore[attr-defined]
bfloat16.cpu_has_bfloat16 = cache(lambda: True)
