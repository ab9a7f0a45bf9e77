"""Small tensors of constants on a device, without waiting for it.

A tensor made of Python's numbers on a GPU is copied there, and torch waits until that copy is done, for everything
that was started before. An image has a dozen of these: what its edits say of each region. Here they are remembered
by their values, so that most images copy none.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

REMEMBERED = 512
"""Number of tensors that are remembered, of a few numbers each."""


def on_device(array: NDArray[Any], device: torch.device) -> Tensor:
    """Return an array as a tensor on a device; it may be shared, so it must not be written to.

    >>> on_device(np.array([0.5, 1.0], np.float32), torch.device("cpu")).tolist()
    [0.5, 1.0]
    """
    if device.type == "cpu":
        return torch.from_numpy(np.array(array))
    return _known(array.tobytes(), array.shape, array.dtype.str, device)


@lru_cache(REMEMBERED)
def _known(content: bytes, shape: tuple[int, ...], kind: str, device: torch.device) -> Tensor:
    array = np.frombuffer(content, kind).reshape(shape).copy()
    return torch.from_numpy(array).pin_memory().to(device, non_blocking=True)
