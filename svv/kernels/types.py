"""What kernels take and give, and the functions that each set of them has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from torch import Tensor


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


@dataclass(frozen=True)
class Surface:
    """What samples look like before light falls on them.

    ``raw`` (S, 1 + 4 P): what the palette MLP says (:func:`svv.core.palette_shading.material`); ``region`` (S,) int64:
    of the largest palette weight; ``colour`` (S, 3): diffuse, until :meth:`ImageKernels.light` and its like light it.
    """

    raw: Tensor
    region: Tensor
    colour: Tensor


class ImageKernels(Protocol):
    """What stands around the networks in an image of a palette scene, without gradients.

    Each is one pass over the samples. What it must give is said in plain torch by :mod:`svv.core.palette_shading`,
    :mod:`svv.core.light` and :mod:`svv.core.compositing`. Letters as of :class:`Kernels`, and P palette colours, H
    spherical harmonics.
    """

    def features(self, samples: Samples, harmonics: Tensor, lattice: Lattice, tables: Tensor) -> tuple[Tensor, Tensor]:
        """Inputs of the lighting MLP (S, L F + H) and of the palette MLP (S, L F), from one look-up of each vertex.

        ``harmonics`` (R, H): of each ray's direction; ``tables`` (V, 2 F): features of geometry and material.
        """

    def material(self, raw: Tensor, colours: Tensor) -> Surface:
        """Equation 4 without light (:mod:`svv.core.palette_shading`): (S, 1 + 4 P) and palette colours (P, 3)."""

    def light(self, surface: Surface, raw: Tensor, lights: Tensor) -> None:
        """Light the surface's colour, in place, as the lighting MLP says: ``raw`` (S, 1 or 2).

        ``lights`` (P, 3): f, a and b of each region, see :func:`svv.core.palette_shading.lit`.
        """

    def phong(
        self, surface: Surface, samples: Samples, beams: tuple[Tensor, Tensor, float], lattice: Lattice, table: Tensor,
        coefficients: Tensor, lights: Tensor,
    ) -> None:  # fmt: skip
        """Light the surface's colour, in place, as an explicit light does (:func:`svv.core.light.blinn_phong`).

        ``beams``: unit vectors of rays towards the viewer and the light, (R, 3) each, and the light's intensity;
        ``table`` (V, 3): normals, as :func:`svv.core.light.normals_of` takes them; ``coefficients`` (P, 4), which the
        palette weights mix; ``lights`` as of :meth:`light`.
        """

    def composite(
        self, samples: Samples, sigma: Tensor, surface: Surface, opacity: Tensor, origins: Tensor, size: float,
        images: tuple[Tensor, Tensor, Tensor],
    ) -> None:  # fmt: skip
        """Write what rays see into ``images``: straight RGBA (R, 4), depth (R,) and region (R,) int16.

        Pixels whose alpha is not above :data:`svv.core.compositing.LEAST_ALPHA` stay as they are. ``opacity`` (P,)
        scales each region's extinction; a pixel's region is that which holds most of its weight; ``size``: world units
        of a box unit, in which depth is measured from ``origins`` (R, 3).
        """


class Kernels(Protocol):
    """The hot functions. All tensors of a call lie on one device; positions and directions are float32.

    Letters: S samples, R rays, L levels, F features a level, V rows of a table, C channels.
    """

    NAME: str
    """``reference``, ``numba`` or ``triton``, for reports; what a set can do is never asked by its name."""
    RAYS: int
    """Rays of an image that are rendered at a time."""
    SAMPLES: int
    """Samples whose network is run with a graph at a time."""
    IMAGE: ImageKernels | None
    """What draws palette scenes on lattices; None where that is done in plain torch, with what training has."""

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

        ``cameras``: rotations (N, 3, 3), positions (N, 3) and focal lengths (N,), see :mod:`svv.kernels.numba_rays`.
        """

    def pixels_in_sight(
        self, camera: tuple[Tensor, Tensor, Tensor], width: int, height: int, distance: Tensor, cells: int,
        extent: Sequence[float],
    ) -> Tensor:  # fmt: skip
        """Flat indices of the pixels whose rays may meet an occupied cell, int64, in their order if all may. (R,)

        All of them, where it costs less to march them than to find out. ``camera``: rotation (3, 3), position (3,) and
        focal length (); ``distance``, ``cells`` and ``extent`` as of :meth:`march`.
        """

    def march(
        self, origins: Tensor, directions: Tensor, distance: Tensor, cells: int, extent: Sequence[float],
        lattice: Lattice, table: Tensor, ceiling: float, limits: Limits, seed: int, room: int,
    ) -> tuple[Samples, int]:  # fmt: skip
        """March rays through the occupied cells and keep the samples that matter (:mod:`svv.kernels.numba_marching`).

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
