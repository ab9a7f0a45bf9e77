"""Pytest plugin: imitate a CPU that multiplies bfloat16 matrices in hardware, as one with AMX does.

With ``python -m pytest -p tests.amx``, networks that allow it use half precision, also in the processes that tests
start, pvpython among them; those read ``imitated/sitecustomize.py``. The results of the hardware are computed in
float32. This is slow, and exact up to rounding: products of two bfloat16 numbers are exact in float32.
"""

from __future__ import annotations

import os
from pathlib import Path

import torch
from torch import Tensor

IMITATED = str(Path(__file__).resolve().parent / "imitated")
"""Folder on PYTHONPATH that makes a Python load this module after torch."""


def linear(x: Tensor, weight: Tensor, bias: None, activation: str, *_: object) -> Tensor:
    """As ``torch.ops.mkldnn._linear_pointwise`` without a bias: (S, I) and (O, I) -> (S, O)."""
    out = x.float() @ weight.float().T
    return (out.relu() if activation == "relu" else out).bfloat16()


torch.ops.mkldnn._linear_pointwise = linear  # type: ignore[attr-defined]
torch.cpu.get_capabilities = lambda: {"amx_bf16": True}  # type: ignore[assignment]
for name in ("ONEDNN_MAX_CPU_ISA", "DNNL_MAX_CPU_ISA"):  # which may hold back the real one
    os.environ.pop(name, None)
paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
if IMITATED not in paths:
    os.environ["PYTHONPATH"] = os.pathsep.join([IMITATED, *filter(None, paths)])
