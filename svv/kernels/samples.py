"""What every kernel works on: the layout of a lattice, the limits of a march, and the samples that it finds."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, device
from torch.autograd.function import FunctionCtx


class Context(FunctionCtx):
    """What a differentiable function keeps from its forward pass for its backward pass."""

    saved_tensors: tuple[Tensor, ...]
    needs_input_grad: tuple[bool, ...]


@dataclass(frozen=True)
class Lattice:
    """Layout of a sparse lattice's features; L levels, on the device of its table."""

    shapes: Tensor
    """Number of vertices of each level along x, y, z, int64. (L, 3)"""
    scales: Tensor
    """Cells per box unit of each level, float32. (L,)"""
    bases: Tensor
    """First word of each level in ``index``, and the last row but one, which no look-up exceeds, int64. (L + 1,)"""
    index: Tensor
    """Which vertices are stored, and in which rows, int64; see :func:`svv.core.rays.encodings.stored_rows`."""


@dataclass(frozen=True)
class Room:
    """Room for the samples of rays on a GPU, where the CPU does not wait for their number."""

    samples: int
    """Number of samples for which there is room, > 0."""
    dropped: Tensor
    """Receives, added to what it holds, the number of rays for which there was none, int64. (1,)"""


@dataclass(frozen=True)
class Limits:
    """Limits that decide which samples a march keeps; see :class:`svv.fields.radiance.rendering.Marching`."""

    step: float
    """Sample spacing in box units."""
    least_weight: float
    """Smallest weight of a sample that is kept."""
    keep: float
    """Share of the samples of less weight that is kept all the same."""
    stop: float
    """Optical depth at which a ray ends."""
    fade: float
    """Smallest factor by which extinctions will be scaled later."""
    merge: bool
    """Whether samples of less weight are merged into the next one."""
    room: Room | None = None
    """Room for the samples; None for as much as they need. Only kernels with ``TRAINING`` take one."""


@dataclass(frozen=True)
class Samples:
    """The samples of rays that matter, in the order of their rays, front to back.

    ``position`` (S, 3): box coordinates; ``sigma`` (S,): extinction in 1 / box unit; ``skipped`` (S,): optical depth
    left out before each sample; ``ray`` (S,) int32: ray of each sample; ``start`` and ``count`` (R,) int64: first
    sample and number of samples of each ray; ``tail`` (R,): optical depth left out behind the last sample; ``step``:
    sample spacing in box units; ``total`` (1,) int64, if kernels read it on the device: number of samples. If there was
    more room (:class:`Room`), what follows them may be any numbers, and a ray without room has a count of -1.
    """

    position: Tensor
    sigma: Tensor
    skipped: Tensor
    ray: Tensor
    start: Tensor
    count: Tensor
    tail: Tensor
    step: float
    total: Tensor | None = None

    def to(self, where: device) -> Samples:
        """Return the samples on a device."""
        position, sigma, skipped, ray, start, count, tail = (
            tensor.to(where)
            for tensor in (self.position, self.sigma, self.skipped, self.ray, self.start, self.count, self.tail)
        )
        return Samples(position, sigma, skipped, ray, start, count, tail, self.step, self.total)

    def __len__(self) -> int:
        return len(self.sigma)

    @property
    def number(self) -> Tensor | int:
        """How many samples there are, as kernels of training steps take it: a number, or where on the GPU it lies."""
        return len(self) if self.total is None else self.total
