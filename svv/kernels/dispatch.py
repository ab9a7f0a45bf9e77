"""Choice of the device and of the kernels that run on it."""

from __future__ import annotations

import os
import sys
from functools import cache
from importlib import import_module
from typing import Any, cast

import torch
from torch import Tensor

from svv.errors import BadInput
from svv.kernels.types import Kernels

CPU = torch.device("cpu")

KERNELS_VARIABLE = "SVV_KERNELS"
"""Environment variable that, if set to ``reference``, selects the plain torch reference instead of faster kernels.

``torch``, its former name, means the same."""


@cache
def kernels_of(kind: str) -> Kernels:
    """Return the kernels for a kind of device, ``cpu`` or ``cuda``.

    Raises:
        BadInput: The variable ``SVV_KERNELS`` is neither ``reference`` (or ``torch``, its former name) nor empty.
    """
    wanted = os.environ.get(KERNELS_VARIABLE, "")
    if wanted not in ("", "reference", "torch"):
        raise BadInput(f"{KERNELS_VARIABLE} can be 'reference', for plain torch, or unset, not '{wanted}'.")
    name = "reference" if wanted else "numba_kernels" if kind == "cpu" else "triton_kernels"
    try:
        kernels: Any = import_module(f"svv.kernels.{name}")
    except ImportError as error:
        print(f"The GPU runs plain torch, which is slower, because Triton is missing ({error}).", file=sys.stderr)
        kernels = import_module("svv.kernels.reference")
    return cast(Kernels, kernels)


def kernels_for(tensor: Tensor) -> Kernels:
    """Return the kernels for the device of a tensor."""
    return kernels_of(tensor.device.type)


def device_named(name: str) -> torch.device:
    """Return the device for the option ``auto``, ``cpu`` or ``cuda``; ``auto`` is the GPU if there is one.

    Raises:
        BadInput: The name is unknown, or it is ``cuda`` and torch finds no GPU.
    """
    if name not in ("auto", "cpu", "cuda"):
        raise BadInput(f"There is no device '{name}'; choose auto, cpu or cuda.")
    there = torch.cuda.is_available()
    if name == "cuda" and not there:
        why = "this torch was built without CUDA" if torch.version.cuda is None else "torch finds no GPU"
        raise BadInput(f"CUDA cannot be used here, because {why}; choose the device cpu or auto.")
    return torch.device("cuda" if there and name != "cpu" else "cpu")


def forget_gpu_peak(device: torch.device) -> None:
    """Reset the peak GPU memory that :func:`device_report` returns."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)


def device_report(device: torch.device) -> dict[str, Any]:
    """Describe the device: ``device``, ``kernels``, and ``gpu`` (name) and ``peak_gpu_bytes``, None on the CPU."""
    on_gpu = device.type == "cuda"
    return {
        "device": device.type,
        "gpu": torch.cuda.get_device_name(device) if on_gpu else None,
        "kernels": kernels_of(device.type).NAME,
        "peak_gpu_bytes": torch.cuda.max_memory_allocated(device) if on_gpu else None,
    }
