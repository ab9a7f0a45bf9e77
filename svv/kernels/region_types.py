"""Inputs of the kernels that find the regions of a scene without its volume, and the functions that they provide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from torch import Tensor


@dataclass(frozen=True)
class RaySamples:
    """What rays see of the vertices of a grid: S samples in the order of their R rays, each standing for a vertex."""

    first: Tensor
    """First sample of each ray, and the number of samples, int32. (R + 1,)"""
    vertex: Tensor
    """Vertex of each sample, int32. (S,)"""
    weight: Tensor
    """Weight of each sample in its pixel. (S,)"""
    cosine: Tensor
    """Cosine between each sample's normal and the headlight. (S,)"""
    pixel: Tensor
    """Colours of pixels over black, RGB. (R, 3)"""
    along: Tensor
    """Directions of the pixels' colours; 0 for black. (R, 3)"""


@dataclass(frozen=True)
class VertexSamples:
    """The same samples in the order of the V vertices, and how vertices lie beside each other."""

    first: Tensor
    """First sample of each vertex, and the number of samples, int32. (V + 1,)"""
    ray: Tensor
    """Ray of each sample, int32. (S,)"""
    weight: Tensor
    """Weight of each sample in its pixel. (S,)"""
    lit: Tensor
    """Weight times cosine. (S,)"""
    neighbours: Tensor
    """Vertices beside each; itself where there is none, int32. (V, 6)"""
    root: Tensor
    """Square root of each vertex's light: neighbours must agree by the product of both. (V,)"""
    least: float
    """What is added to that product."""


class RegionKernels(Protocol):
    """What finds regions along rays (:mod:`svv.train.palette.along_rays`); P regions, Q >= P an even number.

    Plain torch (:mod:`svv.kernels.reference_regions`) defines the results.
    """

    def normal_equations(self, seen: RaySamples, region: Tensor, count: int) -> Tensor:
        """Return the normal equations of what ``count`` regions reflect of light from everywhere and of a headlight.

        The sums over rays of the products of what each sees of the 2 P unknowns, and of their products with its pixel,
        float64; the entries above the diagonal may be anything. ``region`` (V,) int64: of each vertex. (2 P, 2 P + 3)
        """

    def errors(self, seen: RaySamples, kept: float, light: Tensor, member: Tensor) -> Tensor:
        """Return what is shown less the pixels, of which the part ``kept`` is left along the pixels' colours. (R, 3)

        ``light`` (P, 6): what regions reflect of light from everywhere, and of a headlight; ``member`` (V, Q):
        memberships of vertices in regions.
        """

    def descend(
        self, near: VertexSamples, error: Tensor, light: Tensor, step: Tensor, pace: tuple[float, float], ahead: Tensor,
        member: Tensor, following: Tensor,
    ) -> None:  # fmt: skip
        """Take a step down the slope of the errors (R, 3), back to memberships >= 0 with sum 1, and look ahead.

        ``step`` (V,): length of each vertex's step; ``pace``: weight of the differences of neighbours, and how far to
        look ahead, in units of the step taken; ``ahead`` (V, Q): where the slope is taken; ``member`` (V, Q):
        memberships, before and after; ``following`` (V, Q): receives where to take the next slope.
        """

    def blurred(self, values: Tensor, deviation: float) -> Tensor:
        """Return grids blurred with a Gaussian (:func:`svv.core.geometry.surfaces.blurred`), nothing beyond them.

        ``values`` (C, X, Y, Z); ``deviation``: in voxels.
        """

    def normals(self, field: Tensor, places: Tensor, deviations: Sequence[float]) -> Tensor:
        """Return the directions in which a field (X, Y, Z) changes most at some voxels (V, 3) int64. (V, 3)

        See :func:`svv.core.geometry.surfaces.surface_normals`; ``deviations``: inner and outer one.
        """
