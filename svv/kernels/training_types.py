"""Inputs and outputs of the kernels of training steps, and the functions that they provide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

from svv.kernels.samples import Lattice, Samples


@dataclass(frozen=True)
class Target:
    """What the rays of a step should show."""

    along: Tensor
    """Unit vectors in which a light at the camera shines. (R, 3)"""
    shown: Tensor
    """Premultiplied RGBA in [0, 1]. (R, 4)"""
    weight: Tensor
    """Weight of each ray in the loss. (R,)"""


@dataclass(frozen=True)
class Table:
    """A lattice's features, which learn."""

    lattice: Lattice
    """Where they lie."""
    features: Tensor
    """The table. (V, F)"""
    gradient: Tensor
    """Receives the table's gradient, added to what it holds. (V, F)"""
    used: Tensor
    """Receives marks of the rows that have a gradient, uint8. (V,)"""


@dataclass(frozen=True)
class Owned:
    """The regions to which samples belong, and the penalty of palette weights in others.

    It is ``weight`` times -ln w of a sample's own region, averaged over the samples of each region.
    """

    owner: Tensor
    """Region of each sample, int64; any number behind the samples that there are. (S,)"""
    number: Tensor
    """Number of samples of each region, of all ranks, int64. (P,)"""
    weight: float
    """Weight of the penalty."""


class TrainingKernels(Protocol):
    """Whole training steps between the march and the optimisers, forward and backward, without autograd.

    Nothing waits for the GPU unless something is counted; samples may have room to spare
    (:class:`svv.kernels.types.Samples`). Without these kernels, :mod:`svv.train` computes the same in plain torch.
    Letters as in :class:`Kernels`, and P palette colours.
    """

    def fits(self, weights: Sequence[Tensor]) -> bool:
        """Return whether a network, given by the weights of its layers (to, from), can be part of such a step."""

    def base(
        self, samples: Samples, target: Target, tables: tuple[Table, Table], weights: Sequence[Tensor], every: float,
        shift: Tensor, alpha: float, counted: bool,
    ) -> tuple[Tensor, list[Tensor], int]:  # fmt: skip
        """Sum the gradients of stage 1's loss (:mod:`svv.train.base.reconstruct`) into its tables.

        The loss is the mean squared error of colour plus ``alpha`` times that of alpha. ``tables``: log extinction and
        features; ``weights``: those of the colour network; ``every`` and ``shift``: as in
        :meth:`Kernels.representatives`.

        Returns the mean squared error of colour, a scalar, the gradients of the weights, and the number of colours for
        which there was room; if ``counted``, for which the CPU waits, it is the number that was computed.
        """

    def palette(
        self, samples: Samples, target: Target, geometry: tuple[Lattice, Tensor], material: Table,
        networks: tuple[Sequence[Tensor], Sequence[Tensor]], colours: Tensor, penalties: Sequence[float] | Tensor,
        owned: Owned | None,
    ) -> tuple[Tensor, list[Tensor]]:  # fmt: skip
        """Sum the gradient of stage 2's loss (:mod:`svv.train.palette.recolour`) into the table of the material.

        The loss is the mean squared error of colour (:mod:`svv.core.colour.palette_shading`) plus, composited like
        colours, three ``penalties`` times squared offsets, squared deviation of the shade from 1, and 1 minus the sum
        of squared palette weights; plus the penalty of what is ``owned``. ``geometry``: layout and frozen features;
        ``networks``: weights of the lighting and palette MLP; ``colours``: (P, 3).

        Returns the mean squared error of colour, a scalar, and the gradients of both networks' weights and of the
        colours.
        """

    def owned_by(self, samples: Samples, owner: Tensor, regions: int) -> Tensor:
        """Return how many samples each region owns, int64: (S,) int64 -> (regions,)."""

    def loss(
        self, out: Tensor, transmittance: Tensor, shown: Tensor, weight: Tensor, each: Tensor, alpha: bool
    ) -> tuple[Tensor, Tensor]:
        """Return a loss, and the mean squared error of colour without a graph, both scalars.

        ``out`` (R, C): colour, of which the squared difference from ``shown`` (R, 4) counts, and penalties, which count
        themselves; ``weight`` (R,): weight of each ray; ``each`` (C + 1,): that of each channel, and of the squared
        difference of 1 - ``transmittance`` (R,) from alpha, which counts if ``alpha``.
        """
