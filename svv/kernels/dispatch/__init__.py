"""Choice of the kernels for a device, among the sets in the folders beside this one.

Which device it is says :mod:`svv.fields.devices.gpu`.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from importlib import import_module
from typing import Any, TypedDict, cast

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
    """Return the kernels for a kind of device, ``cpu`` or ``cuda``; BadInput if ``SVV_KERNELS`` is not valid."""
    wanted = os.environ.get(KERNELS_VARIABLE, "")
    if wanted not in ("", "reference", "torch"):
        raise BadInput(f"{KERNELS_VARIABLE} can be 'reference', for plain torch, or unset, not '{wanted}'.")
    name = "reference" if wanted else "numba.kernels" if kind == "cpu" else "triton.kernels"
    try:
        kernels: Any = import_module(f"svv.kernels.{name}")
        if name == "triton.kernels":
            kernels.try_to_compile()
    except ImportError as error:
        kernels = _plain_torch(f"Triton is missing ({error})")
    except Exception as error:  # Triton raises whatever its compiler, linker or disk raises
        if name != "triton.kernels":
            raise
        kernels = _plain_torch(f"Triton cannot compile here ({type(error).__name__}: {_first_line(error)})")
    return cast(Kernels, kernels)


def _plain_torch(reason: str) -> Any:
    print(f"The GPU runs plain torch, which is slower, because {reason}.", file=sys.stderr)
    return import_module("svv.kernels.reference")


def _first_line(error: BaseException) -> str:
    return next((line for line in str(error).splitlines() if line.strip()), "no message")[:200]


def kernels_for(tensor: Tensor) -> Kernels:
    """Return the kernels for the device of a tensor."""
    return kernels_of(tensor.device.type)


def forget_gpu_peak(device: torch.device) -> None:
    """Reset the peak GPU memory that :func:`device_report` returns."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)


class DeviceReport(TypedDict):
    """The device of a run, for its report."""

    device: str
    gpu: str | None
    kernels: str
    peak_gpu_bytes: int | None


def device_report(device: torch.device) -> DeviceReport:
    """Describe the device: ``device``, ``kernels``, and ``gpu`` (name) and ``peak_gpu_bytes``, None on the CPU."""
    on_gpu = device.type == "cuda"
    return {
        "device": device.type,
        "gpu": torch.cuda.get_device_name(device) if on_gpu else None,
        "kernels": kernels_of(device.type).NAME,
        "peak_gpu_bytes": torch.cuda.max_memory_allocated(device) if on_gpu else None,
    }
