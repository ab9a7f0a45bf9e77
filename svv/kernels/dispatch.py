"""Which device calculates, and which kernels run there."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, Protocol, cast

import torch
from torch import Tensor

from svv.errors import BadInput

CPU = torch.device("cpu")

KERNELS = "SVV_KERNELS"
"""Variable of the environment that says ``torch`` where our kernels are to be compared with the plain reference."""


@dataclass(frozen=True)
class Lattice:
    """Where a sparse lattice keeps its features; L levels, on the device of its table."""

    shapes: Tensor
    """Vertices of each level along x, y, z, int64. (L, 3)"""
    scales: Tensor
    """Cells per box unit of each level, float32. (L,)"""
    bases: Tensor
    """Where each level begins in ``index``, int64. (L,)"""
    index: Tensor
    """Row in the table of every vertex of every level, raster order, int32."""


@dataclass(frozen=True)
class Limits:
    """Which samples a march keeps; see :class:`svv.fields.rendering.Marching`."""

    step: float
    least_weight: float
    keep: float
    stop: float
    fade: float
    merge: bool


@dataclass(frozen=True)
class Samples:
    """Samples of rays that matter, in the order of their rays, front to back.

    ``position`` (S, 3) box coordinates; ``sigma`` (S,) extinction in 1 / box unit; ``skipped`` (S,) optical depth
    that was left out before each; ``ray`` (S,) int32; ``start`` and ``count`` (R,) int64 where each ray's samples lie;
    ``tail`` (R,) optical depth left out behind the last; ``step`` the sample distance in box units.
    """

    position: Tensor
    sigma: Tensor
    skipped: Tensor
    ray: Tensor
    start: Tensor
    count: Tensor
    tail: Tensor
    step: float

    def __len__(self) -> int:
        return len(self.sigma)


class Kernels(Protocol):
    """The hot functions. All tensors of a call lie on one device; positions and directions are float32.

    Letters: S samples, R rays, L levels, F features a level, V rows of a table, C channels.
    """

    NAME: str
    RAYS: int
    """Rays of an image that are rendered at a time."""
    SAMPLES: int
    """Samples whose network is run with a graph at a time."""

    def lattice_encode(self, x: Tensor, lattice: Lattice, table: Tensor) -> Tensor:
        """Trilinear features of all levels side by side: (S, 3) and (V, F) -> (S, L * F)."""

    def lattice_backward(self, x: Tensor, g: Tensor, lattice: Lattice, gradient: Tensor, used: Tensor) -> None:
        """Add the table's gradient for ``g`` (S, L * F) to ``gradient`` (V, F); mark its rows in ``used`` (V,)."""

    def hash_encode(self, x: Tensor, resolutions: Tensor, offsets: Tensor, table: Tensor) -> Tensor:
        """Features of a hash grid: (S, 3) in [0, 1] and (V, F) -> (S, L * F)."""

    def hash_backward(
        self, x: Tensor, g: Tensor, resolutions: Tensor, offsets: Tensor, gradient: Tensor, used: Tensor
    ) -> None:
        """As :meth:`lattice_backward`."""

    def adam(
        self, table: Tensor, gradient: Tensor, used: Tensor, moments: Tensor, age: Tensor, rate: float,
        constants: tuple[float, float, float], pull: float, finer: int,
    ) -> None:  # fmt: skip
        """One Adam step on the rows marked in ``used``; clears their gradient and mark.

        ``moments`` (2, V, F), ``age`` (V,) int32: steps of each row. ``constants``: beta1, beta2 and epsilon.
        ``pull`` times the value is added to the gradient of the rows from ``finer`` on.
        """

    def pixel_rays(
        self, pixels: Tensor, cameras: tuple[Tensor, Tensor, Tensor], width: int, height: int
    ) -> tuple[Tensor, Tensor]:
        """Origins and unit directions (R, 3) of rays through flat pixel indices (R,) int64.

        ``cameras``: rotations (N, 3, 3), positions (N, 3) and focal lengths (N,), see :mod:`svv.kernels.rays`.
        """

    def march(
        self, origins: Tensor, directions: Tensor, distance: Tensor, cells: int, extent: Sequence[float],
        lattice: Lattice, table: Tensor, ceiling: float, limits: Limits, seed: int, room: int,
    ) -> tuple[Samples, int]:  # fmt: skip
        """March rays through the occupied cells and keep the samples that matter; see :mod:`svv.kernels.marching`.

        ``distance`` (X, Y, Z) uint8: how far a ray may leap; ``extent``: sides of the box; ``table`` (V, 1);
        ``room``: samples a ray for which there is room, to begin with; the number returned is what sufficed.
        """

    def representatives(self, samples: Samples, every: float, shift: Tensor) -> tuple[Tensor, Tensor]:
        """Rows of samples that stand for others (K,) and each sample's place in them (S,), both int64.

        ``shift`` (R,) in [0, 1) moves each ray's cuts; see :func:`svv.core.representatives.representatives`.
        """

    def composite(self, sigma: Tensor, values: Tensor, samples: Samples) -> tuple[Tensor, Tensor, Tensor]:
        """Sum of weight times value (R, C), transmittance (R,) and weights (S,), for any ``sigma`` of the samples."""

    def composite_backward(
        self, sigma: Tensor, values: Tensor, weights: Tensor, samples: Samples, out: Tensor, transmittance: Tensor,
        g_out: Tensor, g_transmittance: Tensor,
    ) -> tuple[Tensor, Tensor]:  # fmt: skip
        """Gradients of :meth:`composite` with respect to ``sigma`` (S,) and ``values`` (S, C)."""

    def leaps(self, occupied: Tensor) -> Tensor:
        """How far a ray may leap in each cell (X, Y, Z) uint8; see :func:`svv.core.cells.leaps`."""

    def directions_of_samples(self, directions: Tensor, ray: Tensor) -> Tensor:
        """Spherical harmonics of degree 4 of each sample's ray: (R, 3) and (S,) -> (S, 16), without a graph."""

    def network(self, x: Tensor, weights: Sequence[Tensor], rough: bool) -> Tensor:
        """A small network without biases, ReLU between its layers: (S, I) -> (S, O), differentiable in everything.

        ``weights``: of each layer, (to, from). ``rough``: half precision will do, as for colours. See
        :func:`svv.core.networks.relu_layers`.
        """


@cache
def kernels_of(kind: str) -> Kernels:
    """The kernels for a kind of device, ``cpu`` or ``cuda``.

    Raises:
        BadInput: the environment's ``SVV_KERNELS`` is neither ``torch``, for the plain reference, nor empty.
    """
    wanted = os.environ.get(KERNELS, "")
    if wanted not in ("", "torch"):
        raise BadInput(f"{KERNELS} can be 'torch', for the plain reference, or unset, not '{wanted}'.")
    name = "plain" if wanted else "compiled" if kind == "cpu" else "fused"
    try:
        kernels: Any = import_module(f"svv.kernels.{name}")
    except ImportError as error:
        print(f"The GPU runs plain torch, which is slower, because Triton is missing ({error}).", file=sys.stderr)
        kernels = import_module("svv.kernels.plain")
    return cast(Kernels, kernels)


def kernels_for(tensor: Tensor) -> Kernels:
    """The kernels that run where a tensor lies."""
    return kernels_of(tensor.device.type)


def device_named(name: str) -> torch.device:
    """The device of the option ``auto``, ``cpu`` or ``cuda``; ``auto`` takes the GPU where there is one.

    Raises:
        BadInput: ``cuda`` where torch finds no GPU, or another name.
    """
    if name not in ("auto", "cpu", "cuda"):
        raise BadInput(f"There is no device '{name}'; choose auto, cpu or cuda.")
    there = torch.cuda.is_available()
    if name == "cuda" and not there:
        why = "this torch was built without CUDA" if torch.version.cuda is None else "torch finds no GPU"
        raise BadInput(f"CUDA cannot be used here, because {why}; choose the device cpu or auto.")
    return torch.device("cuda" if there and name != "cpu" else "cpu")


def forget_gpu_peak(device: torch.device) -> None:
    """Let :func:`device_report` count the GPU's memory anew."""
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)


def device_report(device: torch.device) -> dict[str, Any]:
    """What calculated: ``device``, ``gpu`` (its name), ``kernels``, ``peak_gpu_bytes`` (both None on a CPU)."""
    on_gpu = device.type == "cuda"
    return {
        "device": device.type,
        "gpu": torch.cuda.get_device_name(device) if on_gpu else None,
        "kernels": kernels_of(device.type).NAME,
        "peak_gpu_bytes": torch.cuda.max_memory_allocated(device) if on_gpu else None,
    }
