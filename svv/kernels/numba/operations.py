"""Operations on tensors that :mod:`svv.kernels.numba.kernels` offers and whole training steps are made of.

Those that the former names as well are described in :class:`svv.kernels.types.Kernels`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.kernels.numba import bfloat16
from svv.kernels.numba import lattice as numba_lattice
from svv.kernels.numba import marching as numba_marching
from svv.kernels.numba import networks as numba_networks
from svv.kernels.numba import rays as numba_rays
from svv.kernels.types import HARMONICS, Lattice, Samples


def lattice_encode(x: Tensor, where: Lattice, table: Tensor) -> Tensor:
    """Return the trilinear features of all levels."""
    out = torch.empty(len(x), len(where.scales) * table.shape[1])
    encode_into(out, x, where, table)
    return out


def encode_into(out: Tensor, x: Tensor, where: Lattice, table: Tensor) -> None:
    """Write the features of a lattice at positions (S, 3) to columns of an array. (S, L F)"""
    x = x.contiguous()  # each layout of an array would be compiled separately
    numba_lattice.encode(x.numpy(), *arrays_of(where), table.detach().numpy(), (0.0,) * table.shape[1], out.numpy())


def lattice_backward(x: Tensor, g: Tensor, where: Lattice, gradient: Tensor, used: Tensor) -> None:
    """Add the table's gradient, and mark its rows."""
    width = (0.0,) * gradient.shape[1]
    x, g = x.contiguous(), g.contiguous()
    numba_lattice.encode_backward(x.numpy(), g.numpy(), *arrays_of(where), width, gradient.numpy(), used.numpy())


def representatives(samples: Samples, every: float, shift: Tensor) -> tuple[Tensor, Tensor]:
    """Return rows of representative samples, and each sample's index in them."""
    own, start, count = (samples.sigma * samples.step).numpy(), samples.start.numpy(), samples.count.numpy()
    begin, end, taken = np.empty_like(own), np.empty_like(own), np.empty_like(count)
    numba_marching.cut(samples.skipped.numpy(), own, start, count, np.float32(every), shift.numpy(), begin, end, taken)
    rows, place = np.empty(int(taken.sum()), np.int64), np.empty(len(own), np.int64)
    numba_marching.choose(start, count, begin, end, np.cumsum(taken) - taken, rows, place)
    return torch.from_numpy(rows), torch.from_numpy(place)


def directions_of_samples(directions: Tensor, ray: Tensor) -> Tensor:
    """Return spherical harmonics of each sample's ray."""
    out = torch.empty(len(ray), HARMONICS)
    harmonics_into(out, directions, ray)
    return out


def harmonics_into(out: Tensor, directions: Tensor, ray: Tensor) -> None:
    """Write the spherical harmonics of each sample's ray to columns of an array. (S, 16)"""
    numba_rays.harmonics(directions.contiguous().numpy(), ray.numpy(), out.numpy())


def network(x: Tensor, weights: Sequence[Tensor], rough: bool) -> Tensor:
    """Run a small network."""
    return (bfloat16.HalfNetwork if _halved(x, rough) else numba_networks.Network).apply(x, *weights)


def _halved(x: Tensor, rough: bool) -> bool:
    return rough and len(x) >= bfloat16.LEAST_SAMPLES and bfloat16.cpu_has_bfloat16()


def network_and_back(
    x: Tensor, weights: Sequence[Tensor], of_inputs: bool
) -> tuple[Tensor, Callable[[Tensor], Sequence[Tensor]]]:
    """Run a small network, three digits of which are enough; returns its outputs, and what gives gradients.

    Of the outputs' gradient (S, O), that makes those of the inputs, if they are asked for, and of each weight. torch's
    graph would take half a millisecond more.
    """
    if not _halved(x, rough=True):
        back = partial(numba_networks.gradients_of, x, weights, of_inputs=of_inputs)
        with torch.no_grad():
            return network(x, weights, rough=True), lambda g: back(g)[0 if of_inputs else 1 :]
    leaves = [each.detach().requires_grad_() for each in ([x, *weights] if of_inputs else weights)]
    with torch.enable_grad():
        out = network(leaves[0] if of_inputs else x, leaves[1:] if of_inputs else leaves, rough=True)
    return out.detach(), lambda g: torch.autograd.grad(out, leaves, g)


def arrays_of(where: Lattice) -> tuple[NDArray[np.generic], ...]:
    """Return a lattice's layout as the compiled functions take it."""
    return where.shapes.numpy(), where.scales.numpy(), where.bases.numpy(), where.index.numpy()
