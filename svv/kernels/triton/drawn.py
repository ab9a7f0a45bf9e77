"""Everything but the networks in an image, on the GPU: Triton. See :class:`svv.kernels.types.ImageKernels`."""

from __future__ import annotations

from collections.abc import Sequence

import torch
import triton
from torch import Tensor

from svv.core.colour.colour import with_change
from svv.core.colour.light import LEAST_COSINE, NORMAL_SCALE, NORMAL_SOFTNESS, RIM_COSINE
from svv.core.colour.palette_shading import INTENSITY_SHIFT, SPECULAR_SHIFT, WEIGHT_FLOOR
from svv.core.rays.compositing import LEAST_ALPHA
from svv.kernels.triton import image as triton_image
from svv.kernels.triton import networks as triton_networks
from svv.kernels.types import HARMONICS, Lattice, Samples, Surface

BLOCK = 128
"""Samples per program."""
RAY_BLOCK = 32
"""Rays per program: one warp, which finishes with its longest ray."""


def _grid(count: int) -> tuple[int]:
    return (triton.cdiv(count, BLOCK),)


def end(samples: Samples) -> None:
    """Move what is behind the last samples into them."""
    rays = len(samples.tail)
    if rays:
        triton_image.end[_grid(rays)](
            samples.sigma, samples.tail, samples.start, samples.count, samples.step, rays, BLOCK
        )  # fmt: skip


def features(samples: Samples, along: Tensor, lattice: Lattice, tables: Tensor) -> tuple[Tensor, Tensor]:
    """Look up both tables, level by level, beside the harmonics of the rays."""
    each, levels, device = tables.shape[1] // 2, len(lattice.scales), tables.device
    lit = torch.empty(len(samples), levels * each + HARMONICS, device=device)
    plain = torch.empty(len(samples), levels * each, device=device)
    if len(samples):
        triton_image.features[triton.cdiv(len(samples), BLOCK), levels](
            samples.position, samples.ray, samples.ray, along, lattice.shapes, lattice.scales, lattice.bases,
            lattice.index, tables, lit, plain, len(samples), levels, each, triton.next_power_of_2(2 * each), True,
            False, BLOCK,
        )  # fmt: skip
    return lit, plain


def looks(
    samples: Samples, along: Tensor, lattice: Lattice, tables: Tensor, lighting: Sequence[Tensor],
    palette: Sequence[Tensor],
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Run both networks on the features."""
    lit, plain = features(samples, along, lattice, tables)
    return triton_networks.run(lit, lighting), triton_networks.run(plain, palette)


def shift(raw: Tensor, column: int, colour: Tensor, change: Tensor, among: Tensor | None) -> None:
    """Change colours in plain torch: an edit is drawn anew only when it changes."""
    offsets = raw[:, column : column + 3]
    shifted = with_change(colour + offsets, change) - colour
    offsets.copy_(shifted if among is None else torch.where(among[:, None], shifted, offsets))


def material(raw: Tensor, colours: Tensor) -> Surface:
    """Mix the palette's colours."""
    count, device = len(raw), raw.device
    surface = Surface(raw, torch.empty(count, dtype=torch.int64, device=device), torch.empty(count, 3, device=device))
    if count:
        triton_image.material[_grid(count)](
            raw.contiguous(), colours, INTENSITY_SHIFT, WEIGHT_FLOOR, surface.region, surface.colour, count,
            len(colours), BLOCK,
        )  # fmt: skip
    return surface


def overpaint(surface: Surface, paint: Tensor, share: Tensor, strokes: Tensor, sigma: Tensor) -> Tensor:
    """Blend the paint, and let the extinction follow it."""
    followed = torch.empty_like(sigma)
    if len(sigma):
        triton_image.overpaint[_grid(len(sigma))](
            paint.contiguous(), surface.region, share, strokes, sigma, surface.colour, followed, len(sigma), BLOCK
        )
    return followed


def light(surface: Surface, raw: Tensor, lights: Tensor) -> None:
    """Light the colours by the lighting network."""
    if len(raw):
        triton_image.light[_grid(len(raw))](
            raw.contiguous(), lights, surface.region, SPECULAR_SHIFT, surface.colour, len(raw), raw.shape[1], BLOCK
        )


def phong(
    surface: Surface, samples: Samples, beams: tuple[Tensor, Tensor, float], lattice: Lattice, table: Tensor,
    coefficients: Tensor, lights: Tensor,
) -> None:  # fmt: skip
    """Light the colours by an explicit light."""
    facing, toward, intensity = beams
    half = torch.nn.functional.normalize(facing + toward, dim=1)
    if len(samples):
        triton_image.phong[_grid(len(samples))](
            samples.position, samples.ray, facing.contiguous(), toward.contiguous(), half, float(intensity),
            lattice.shapes, lattice.scales, lattice.bases, lattice.index, table.detach(), NORMAL_SCALE, NORMAL_SOFTNESS,
            RIM_COSINE, LEAST_COSINE, surface.raw.contiguous(), coefficients.contiguous(), int(coefficients.dim() > 2),
            WEIGHT_FLOOR, lights, surface.region, surface.colour, len(samples), len(lattice.scales),
            coefficients.shape[-2], BLOCK,
        )  # fmt: skip


def composite(
    samples: Samples, sigma: Tensor, surface: Surface, opacity: Tensor, origins: Tensor, size: float,
    images: tuple[Tensor, Tensor, Tensor],
) -> None:  # fmt: skip
    """Composite rays into images."""
    rays, regions = len(samples.start), len(opacity)
    if rays:
        triton_image.composite[(triton.cdiv(rays, RAY_BLOCK),)](
            samples.position, sigma, samples.skipped, surface.colour, surface.region, opacity, origins, samples.start,
            samples.count, samples.tail, samples.step, float(size), LEAST_ALPHA, *images, rays, regions,
            triton.next_power_of_2(regions), RAY_BLOCK, num_warps=1,
        )  # fmt: skip
