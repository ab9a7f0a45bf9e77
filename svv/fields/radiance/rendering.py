"""Rays, their samples, and compositing, as shared by training and rendering.

Letters: R rays, S samples (of all rays, concatenated), C channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera
from svv.core.rays.extinction import MOST_LOG_EXTINCTION
from svv.core.strokes.strokes import Floats
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.kernels.constants import fetched, moved_at_once
from svv.kernels.dispatch import kernels_for
from svv.kernels.types import Context, Left, Limits, Room, Samples


@dataclass(frozen=True)
class Rays:
    """Origins in box coordinates and unit directions, float32. (R, 3) each"""

    origins: Tensor
    directions: Tensor
    axes: Tensor | None = None
    """Unit vectors along the axes of the rays' cameras if a light at the camera shines along them. (R, 3)"""

    @property
    def lit_along(self) -> Tensor:
        """Unit vectors in which a light at the camera shines: along the rays, or along their cameras' axes. (R, 3)"""
        return self.directions if self.axes is None else self.axes

    def __len__(self) -> int:
        return len(self.origins)


class RayCaster:
    """Makes the rays of a list of cameras that share one image size, on a device.

    ``headlight`` is that of the scene; see :attr:`svv.fields.radiance.networks.FieldSettings.headlight`.
    """

    def __init__(self, cameras: Sequence[Camera], box: Box, device: torch.device, headlight: str = "point") -> None:
        self._along_axis = headlight == "axis"
        self.width, self.height, self.device = cameras[0].width, cameras[0].height, device
        matrices = np.stack([c.camera_to_world for c in cameras])
        rotations = np.ascontiguousarray(matrices[:, :3, :3], np.float32)
        positions = box.to_box(matrices[:, :3, 3]).astype(np.float32)
        lenses = np.array([_lens(c, box) for c in cameras], np.float32)
        self._rotations, self._positions, self._lenses = moved_at_once((rotations, positions, lenses), device)

    @property
    def cameras(self) -> tuple[Tensor, Tensor, Tensor]:
        """Rotations (N, 3, 3), positions (N, 3) and lenses (N, 4); see :mod:`svv.kernels.numba.rays`."""
        return self._rotations, self._positions, self._lenses

    def rays(self, pixels: Tensor) -> Rays:
        """Return the rays through flat pixel indices ``(view * height + row) * width + column``, int64. (R,)"""
        pixels = pixels.to(self.device)
        origins, directions = kernels_for(pixels).pixel_rays(pixels, self.cameras, self.width, self.height)
        if not self._along_axis:
            return Rays(origins, directions)
        axes = -self._rotations[:, :, 2]
        if len(axes) == 1 and self.device.type == "cpu":  # a GPU's kernels read a row of memory for each ray
            return Rays(origins, directions, axes.expand(len(pixels), 3))
        return Rays(origins, directions, axes.index_select(0, pixels // (self.width * self.height)))

    def in_sight(self, occupancy: Occupancy) -> Tensor:
        """Return the pixels of the first view that may show something, as flat indices, int64. (R,)

        If all pixels may, they are in ascending order. See :meth:`svv.kernels.types.Kernels.pixels_in_sight`.
        """
        camera = self._rotations[0], self._positions[0], self._lenses[0]
        distance = occupancy.distance_on(self.device)
        return kernels_for(self._lenses).pixels_in_sight(
            camera, self.width, self.height, distance, occupancy.cells, occupancy.box.extent
        )

    def view(self, view: int) -> Rays:
        """Return all rays of one view, row by row from the top."""
        n = self.width * self.height
        return self.rays(torch.arange(view * n, (view + 1) * n, device=self.device))


def _lens(camera: Camera, box: Box) -> tuple[float, float, float, float]:
    """Return a camera's lens as the kernels take it; see :func:`svv.kernels.numba.rays.pixel_rays`."""
    column, row = camera.principal_point
    focal = camera.focal * box.size if camera.is_orthographic else camera.focal
    return focal, 0.5 - column, 0.5 - row, float(camera.is_orthographic)


@dataclass(frozen=True)
class Marching:
    """How rays are sampled."""

    step: float
    """Sample distance in box units."""
    least_weight: float = 1e-3
    """Weight in the pixel below which a sample is left out of colour evaluation."""
    keep: float = 0.0
    """Fraction of the samples below ``least_weight`` that is kept nevertheless, to let them learn."""
    stop: float = 7.0
    """Optical depth at which a ray ends: exp(-7) is below what 8 bits can show."""
    fade: float = 1.0
    """Smallest factor by which extinctions will be scaled afterwards; rays continue correspondingly deeper."""
    merge: bool = False
    """Whether samples of low weight are joined to the next (for images) or left out (for training)."""


def march(
    rays: Rays,
    occupancy: Occupancy,
    density: SparseLattice | None,
    how: Marching,
    seed: int | Tensor = 0,
    first_ray: int = 0,
    room: Room | None = None,
    left: Left | None = None,
) -> Samples:
    """Sample rays in occupied cells, leaving out samples that cannot be seen.

    Args:
        rays: R rays.
        occupancy: The cells to sample in.
        density: Lattice with one feature per level; the exponential of their sum is the extinction. Without it every
            sample is kept and ``sigma`` is 1, or the part of a step for which a sample stands.
        how: Sample distance and thresholds.
        seed: > 0 shifts each ray's samples at random; 0 puts them in the middle of their steps.
        first_ray: Number of the first ray in its batch: a ray's random numbers depend on its number.
        room: Room for the samples on a GPU, for which nothing waits; see :attr:`svv.kernels.types.Samples.total`.
        left: The pieces of the rays that are sampled, without a seed; by default all.
    """
    lattice = density if density is not None else _constant(rays.origins.device)
    limits = (how.least_weight, how.keep, how.stop, how.fade) if density is not None else (-1.0, 0.0, 0.0, 0.0)
    samples, occupancy.samples_a_ray = kernels_for(rays.origins).march(
        rays.origins, rays.directions, occupancy.distance_on(rays.origins.device), occupancy.cells,
        occupancy.box.extent, lattice.layout, lattice.table, MOST_LOG_EXTINCTION,
        Limits(how.step, *limits, how.merge, room), seed, occupancy.samples_a_ray, first_ray, left,
    )  # fmt: skip
    return samples


@torch.no_grad()
def ended(samples: Samples) -> Samples:
    """Give the optical depth behind each ray's last sample to that sample, as part of its extinction.

    In an image, it thus has a colour, and the edits of a region act on it; behind a hidden region it would otherwise
    leave a grey haze. Rays without samples keep theirs: all of a skin of 1 % may lie there. The samples given must not
    be used any more.
    """
    if not len(samples):
        return samples
    kernels = kernels_for(samples.sigma).IMAGE
    if kernels is not None:
        kernels.end(samples)
        return samples
    last = (samples.start + samples.count - 1).clamp_(min=0)
    moved = samples.tail * (samples.count > 0)
    sigma = samples.sigma.index_add(0, last, moved, alpha=1.0 / samples.step)
    return replace(samples, sigma=sigma, tail=samples.tail - moved)


@torch.no_grad()
def not_hidden(samples: Samples, sigma: Tensor, how: Marching) -> tuple[Samples, Tensor]:
    """Leave out the samples behind which :func:`march` would have ended a ray, had it known their extinction.

    ``sigma`` (S,): that extinction of samples of a march without a density, in 1 / box unit. Returns the K samples that
    are left, with the optical depth of the others in ``tail``, and their indices (K,).
    """
    own = (samples.skipped + sigma * samples.step).double()
    total = own.cumsum(0)
    ray: Tensor = samples.ray.long()
    before = total - own - torch.cat([total.new_zeros(1), total])[samples.start][ray]
    seen = how.fade * before <= how.stop
    rows = seen.nonzero()[:, 0]
    count = torch.bincount(ray[rows], minlength=len(samples.count))
    tail = samples.tail.index_add(0, ray[~seen], own[~seen].float())
    left = Samples(
        samples.position[rows], sigma[rows], samples.skipped[rows], samples.ray[rows], count.cumsum(0) - count, count,
        tail, samples.step,
    )  # fmt: skip
    return left, rows


@torch.no_grad()
def representatives(samples: Samples, every: float, shift: Tensor) -> tuple[Tensor, Tensor]:
    """Choose samples whose colour can stand for that of the samples around them on their ray.

    The cumulative weight along a ray is cut at k * ``every``, a fraction of a pixel > 0, shifted by a random fraction
    of it, ``shift`` in [0, 1) of each ray (R,) (systematic sampling). A sample that contains a cut is chosen, so any
    sample that weighs more than ``every`` is. It represents the samples to which its cut is the nearest. On a ray
    without a cut, the last sample represents all. Returns rows of the chosen samples (K,), ascending, and for each
    sample the index in them of its representative (S,).
    """
    return kernels_for(shift).representatives(samples, every, shift)


def composite(samples: Samples, sigma: Tensor, values: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Composite values along rays, differentiable in ``sigma`` (S,) and ``values`` (S, C).

    Returns sums of weight times value (R, C), transmittance behind the ray (R,), and weights (S,) without a gradient.
    """
    return _Composite.apply(sigma, values, samples)


def empty_images(pixels: int, device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    """Return straight RGBA (pixels, 4), depth and region (pixels,) of images that show nothing."""
    if device.type != "cpu":
        images = new_images(pixels, device)
        show_nothing(images)
        return images
    rgba = torch.from_numpy(np.zeros((pixels, 4), np.float32))  # no memory where nothing is written
    return rgba, torch.full((pixels,), torch.nan), torch.full((pixels,), -1, dtype=torch.int16)


def show_nothing(images: tuple[Tensor, Tensor, Tensor]) -> None:
    """Empty images from :func:`new_images`."""
    for image, value in zip(images, (0.0, torch.nan, -1), strict=True):
        image.fill_(value)


def new_images(pixels: int, device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    """Return memory for straight RGBA (pixels, 4), depth and region (pixels,), which may hold anything."""
    if device.type == "cpu":
        return torch.empty(pixels, 4), torch.empty(pixels), torch.empty(pixels, dtype=torch.int16)
    # In one piece of memory, so that one copy brings all three to the CPU.
    whole = torch.empty(BYTES * pixels, dtype=torch.uint8, device=device)
    rgba, depth, region = whole.split([16 * pixels, 4 * pixels, 2 * pixels])
    return rgba.view(torch.float32).view(-1, 4), depth.view(torch.float32), region.view(torch.int16)


BYTES = 22
"""Bytes of a pixel: four and one numbers of four bytes, and one of two."""


def on_cpu(images: tuple[Tensor, Tensor, Tensor]) -> tuple[Floats, Floats, NDArray[np.int16]]:
    """Return images from :func:`new_images`, when they are drawn, as arrays."""
    rgba, depth, region = images
    if rgba.device.type == "cpu":
        return rgba.numpy(), depth.numpy(), region.numpy()
    pixels = len(depth)
    whole = torch.empty(0, dtype=torch.uint8, device=rgba.device)
    content = fetched(whole.set_(rgba.untyped_storage(), 0, (BYTES * pixels,), (1,)))
    a, b, c = np.split(content, [16 * pixels, 20 * pixels])
    return a.view(np.float32).reshape(-1, 4), b.view(np.float32), c.view(np.int16)


class _Along(Context):
    samples: Samples
    density: SparseLattice


class _Composite(torch.autograd.Function):
    @staticmethod
    def forward(ctx: _Along, sigma: Tensor, values: Tensor, samples: Samples) -> tuple[Tensor, Tensor, Tensor]:
        s, v = sigma.detach(), values.detach().contiguous()
        out, transmittance, weights = kernels_for(s).composite(s, v, samples)
        ctx.save_for_backward(s, v, weights, out, transmittance)  # an output kept on ctx is never freed
        ctx.samples = samples
        ctx.mark_non_differentiable(weights)
        ctx.set_materialize_grads(False)  # no zeros for the weights, which have no gradient
        return out, transmittance, weights

    @staticmethod
    def backward(
        ctx: _Along, g_out: Tensor | None, g_transmittance: Tensor | None, _: None
    ) -> tuple[Tensor, Tensor, None]:
        s, v, weights, out, transmittance = ctx.saved_tensors
        pairs = (g_out, out), (g_transmittance, transmittance)
        upstream = tuple(torch.zeros_like(own) if g is None else g.contiguous() for g, own in pairs)
        gradients = kernels_for(s).composite_backward(s, v, weights, ctx.samples, out, transmittance, *upstream)
        return *gradients, None


class Extinction(torch.autograd.Function):
    """The extinction of samples as a function of the density lattice; the marcher has already computed its value."""

    @staticmethod
    def forward(ctx: _Along, samples: Samples, table: Tensor, density: SparseLattice) -> Tensor:
        ctx.samples, ctx.density = samples, density
        return samples.sigma.detach()

    @staticmethod
    def backward(ctx: _Along, gradient: Tensor) -> tuple[None, None, None]:
        samples, density = ctx.samples, ctx.density
        raw = (gradient * samples.sigma)[:, None].expand(-1, density.levels).contiguous()
        density.add_gradient(samples.position, raw)
        return None, None, None


@cache
def _constant(device: torch.device) -> SparseLattice:
    """Return a lattice that is zero everywhere: extinction 1."""
    return SparseLattice(np.ones((1, 1, 1), np.uint8), 1, (1,), 1).to(device)
