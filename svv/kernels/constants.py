"""Copies between CPU and GPU that wait for as little as they can: constants, small arrays, and images.

A tensor made of Python's numbers is copied to a GPU, and torch waits for that copy and everything started before. Here
such tensors are remembered by their values, so that most images copy none.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from functools import lru_cache
from numbers import Integral

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

REMEMBERED = 512
"""Number of tensors that are remembered, of a few numbers each."""


def on_device(array: NDArray[np.generic], device: torch.device) -> Tensor:
    """Return an array as a tensor on a device; it may be shared, so it must not be written to.

    >>> on_device(np.array([0.5, 1.0], np.float32), torch.device("cpu")).tolist()
    [0.5, 1.0]
    """
    if device.type == "cpu":
        return torch.from_numpy(np.array(array))
    return _known(array.tobytes(), array.shape, array.dtype.str, device)


def numbers_on(values: ArrayLike, device: torch.device) -> Tensor:
    """Return numbers as float32 on a device, of the shape of nested sequences; not to be written to.

    >>> numbers_on([(0.5, 1.0)], torch.device("cpu")).shape
    torch.Size([1, 2])
    """
    return on_device(np.array(values, np.float32), device)


def number_on(number: float | Tensor, device: torch.device) -> Tensor:
    """Return a number on a device, int32 or float32, (1,); not to be written to. A tensor is returned as it is.

    >>> number_on(3, torch.device("cpu"))
    tensor([3], dtype=torch.int32)
    """
    if isinstance(number, Tensor):
        return number
    kind = torch.int32 if isinstance(number, Integral) else torch.float32
    return torch.full((1,), number, dtype=kind, device=device) if number else _zero(kind, device)


@lru_cache(REMEMBERED)
def _zero(kind: torch.dtype, device: torch.device) -> Tensor:
    return torch.zeros(1, dtype=kind, device=device)


@lru_cache(REMEMBERED)
def _known(content: bytes, shape: tuple[int, ...], kind: str, device: torch.device) -> Tensor:
    return moved(np.frombuffer(content, kind).reshape(shape).copy(), device)


def moved(array: NDArray[np.generic], device: torch.device) -> Tensor:
    """Return an array as a tensor on a device, without waiting for the copy.

    >>> moved(np.array([3, 4]), torch.device("cpu")).tolist()
    [3, 4]
    """
    here = torch.from_numpy(array)
    return here if device.type == "cpu" else here.pin_memory().to(device, non_blocking=True)


def moved_at_once(arrays: Sequence[NDArray[np.float32]], device: torch.device) -> list[Tensor]:
    """Return arrays of float32 on a device, which one copy moves there, for which nothing waits.

    >>> [t.shape for t in moved_at_once([np.zeros((2, 3), np.float32), np.ones(1, np.float32)], torch.device("cpu"))]
    [torch.Size([2, 3]), torch.Size([1])]
    """
    if device.type == "cpu":
        return [torch.from_numpy(a) for a in arrays]
    starts = np.cumsum([0, *(-(-a.size // ALIGNED) * ALIGNED for a in arrays)])
    whole = torch.empty(int(starts[-1]), pin_memory=True)
    for first, array in zip(starts, arrays, strict=False):
        whole.numpy()[first : first + array.size] = array.ravel()
    there = whole.to(device, non_blocking=True)
    return [there[first : first + a.size].view(a.shape) for first, a in zip(starts, arrays, strict=False)]


ALIGNED = 4
"""Numbers to whose multiples arrays are moved: kernels are compiled again for addresses that are no multiple of 16."""

MOST_PINNED = 64 << 20
"""Bytes of images in memory that the system cannot swap; a program that keeps more images gets ordinary memory."""

_pinned: list[tuple[weakref.ref[NDArray[np.uint8]], int]] = []


def fetched(there: Tensor) -> NDArray[np.uint8]:
    """Return the content of a GPU's memory, uint8 (N,), when it is done. The caller owns the array.

    A GPU copies several times as fast into memory that cannot be swapped, and torch reuses it once the array is gone.
    """
    _pinned[:] = [(ref, size) for ref, size in _pinned if ref() is not None]
    pinned = sum(size for _, size in _pinned) + len(there) <= MOST_PINNED
    here = torch.empty(len(there), dtype=torch.uint8, pin_memory=pinned)
    here.copy_(there, non_blocking=True)
    torch.cuda.current_stream(there.device).synchronize()
    array = here.numpy()
    if pinned:
        _pinned.append((weakref.ref(array), len(there)))  # every view of the array holds it
    return array
