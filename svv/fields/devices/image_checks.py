"""Checks of the kernels that draw images and training pixels, as in :mod:`svv.fields.devices.kernel_checks`.

Image kernels are compared with those of the CPU, which tests compare with :mod:`svv.core`; pixels with plain torch.
Letters: S samples, R rays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from torch import Tensor

from svv.core.rays.encodings import lattice_features, spherical_harmonics
from svv.core.rounding import KERNELS
from svv.fields.devices.kernel_checks import CPU, Check, points_in, random_lattice, random_samples
from svv.kernels import reference
from svv.kernels.numba import image as numba_image
from svv.kernels.types import ImageKernels, Kernels, Lattice, PixelSource, Surface

COLOURS, EACH = 3, 4
"""Palette colours, which are also the regions, and features per level."""

Part = Callable[[ImageKernels, "Inputs"], list[Tensor]]


class Inputs:
    """Random samples and everything that an image takes of them, on a device."""

    def __init__(self, device: torch.device, seed: int, counts: Sequence[int], cells: int) -> None:
        generator = torch.Generator().manual_seed(seed)

        def numbers(*shape: int, scale: float = 1.0) -> Tensor:
            return (scale * torch.randn(shape, generator=generator)).to(device)

        lattice, occupied = random_lattice(seed, 1, (cells, 2 * cells), cells)
        samples = random_samples(counts, seed)
        samples = replace(samples, position=points_in(occupied, len(samples), seed), sigma=4.0 * samples.sigma)
        self.samples = samples.to(device)
        self.lattice: Lattice = lattice.to(device).layout
        rows, total, rays = len(lattice.table), len(samples), len(counts)
        self.tables, self.normals = numbers(rows, 2 * EACH), numbers(rows, 3, scale=0.1)
        self.raw = numbers(total, 1 + 4 * COLOURS)
        self.colours, self.paint = numbers(COLOURS, 3).abs(), numbers(total, 3).sigmoid()
        self.share, self.strokes = numbers(COLOURS).sigmoid(), numbers(COLOURS, 4, scale=0.5)
        self.strokes[:, 3].abs_()
        self.lit, self.lights = numbers(total, 2), numbers(COLOURS, 3).abs()
        self.coefficients = numbers(COLOURS, 4).abs() * torch.tensor([1.0, 1.0, 1.0, 9.0], device=device)
        self.facing, self.toward = (torch.nn.functional.normalize(numbers(rays, 3), dim=1) for _ in range(2))
        self.origins = numbers(rays, 3)


def _surface(own: ImageKernels, at: Inputs) -> Surface:
    return own.material(at.raw, at.colours)


def _ended(own: ImageKernels, at: Inputs) -> list[Tensor]:
    samples = replace(at.samples, sigma=at.samples.sigma.clone(), tail=at.samples.tail.clone())
    own.end(samples)
    return [samples.sigma, samples.tail]


def _features(own: ImageKernels, at: Inputs) -> list[Tensor]:
    if own is not numba_image:
        return list(own.features(at.samples, at.facing, at.lattice, at.tables))  # type: ignore[attr-defined]
    # The CPU keeps no features: they go from look-ups into networks.
    layout = at.lattice.shapes, at.lattice.scales, at.lattice.bases, at.lattice.index
    lit, plain = (
        lattice_features(at.samples.position, *layout, half.contiguous()) for half in at.tables.split(EACH, 1)
    )
    return [torch.cat([lit, spherical_harmonics(at.facing)[at.samples.ray.long()]], dim=1), plain]


def _material(own: ImageKernels, at: Inputs) -> list[Tensor]:
    surface = _surface(own, at)
    return [surface.colour, surface.region.float()]


def _overpaint(own: ImageKernels, at: Inputs) -> list[Tensor]:
    surface = _surface(own, at)
    followed = own.overpaint(surface, at.paint, at.share, at.strokes, at.samples.sigma)
    return [surface.colour, followed]


def _light(own: ImageKernels, at: Inputs) -> list[Tensor]:
    surface = _surface(own, at)
    own.light(surface, at.lit, at.lights)
    return [surface.colour]


def _phong(own: ImageKernels, at: Inputs) -> list[Tensor]:
    surface = _surface(own, at)
    beams = at.facing, at.toward, 0.8
    own.phong(surface, at.samples, beams, at.lattice, at.normals, at.coefficients, at.lights)
    return [surface.colour]


def _composite(own: ImageKernels, at: Inputs) -> list[Tensor]:
    surface, rays, device = _surface(own, at), len(at.origins), at.origins.device
    rgba, depth = torch.full((rays, 4), 9.0, device=device), torch.full((rays,), 9.0, device=device)
    seen = torch.full((rays,), 9, dtype=torch.int16, device=device)
    own.composite(at.samples, at.samples.sigma, surface, at.share, at.origins, 3.0, (rgba, depth, seen))
    # A mean is a sum divided by alpha, and its error grows as that falls. Where nothing is seen, it has no depth.
    return [rgba[:, :3] * rgba[:, 3:], rgba[:, 3], (depth * rgba[:, 3]).nan_to_num(0.0), seen.float()]


PARTS: dict[str, Part] = {
    "depth behind": _ended,
    "features of both": _features,
    "material": _material,
    "paint": _overpaint,
    "light": _light,
    "light, explicit": _phong,
    "pixels": _composite,
}
"""Each kernel of an image."""

TOLERANCE = 20 * KERNELS["value"]
"""Largest difference: highlights raise cosines, and their errors, to a power of about 20."""


def check_image(
    kernels: Kernels, device: torch.device, seed: int, part: str, counts: Sequence[int], cells: int = 4
) -> None:
    """Compare one kernel of an image; where two regions weigh the same but for rounding, either may be a pixel's."""
    assert kernels.IMAGE is not None
    expected = PARTS[part](numba_image, Inputs(CPU, seed, counts, cells))
    got = [t.cpu() for t in PARTS[part](kernels.IMAGE, Inputs(device, seed, counts, cells))]
    for mine, theirs in zip(got, expected, strict=True):
        if part in ("material", "pixels") and mine is got[-1]:
            assert int((mine != theirs).sum()) <= max(1, len(mine) // 1000), "regions differ"
        else:
            torch.testing.assert_close(mine, theirs, atol=TOLERANCE, rtol=TOLERANCE)


def check_draw(kernels: Kernels, device: torch.device, seed: int, rays: int) -> None:
    """Compare the pixels of rays with plain torch, of a whole batch and of a part of it."""
    generator, steps = np.random.default_rng(seed), 8
    counts = generator.integers(0, 900, steps) * (generator.random(steps) < 0.8)
    counts[2] = 700
    shares = generator.uniform(0.2, 3.0, steps)
    arrays: dict[str, object] = {
        "index": generator.permutation(int(counts.sum())).astype(np.int32),
        "levels": generator.integers(0, 256, (int(counts.sum()), 4)).astype(np.uint8),
        "first": np.concatenate([[0], np.cumsum(counts)]),
        "ends": np.concatenate([[0.0], np.cumsum(counts * shares)]),
        "shares": shares,
    }
    source, there = (
        PixelSource(**{name: torch.from_numpy(array).to(where) for name, array in arrays.items()})
        for where in (CPU, device)
    )
    for first, count in ((0, rays), (rays // 3, rays // 2)):
        pixels, weight, shown = reference.draw_pixels(source, 5 + seed, first, count, rays)
        got = [t.cpu() for t in kernels.draw_pixels(there, 5 + seed, first, count, rays)]
        # A number within rounding of the next pixel may fall on it.
        same = got[0] == pixels
        assert int((~same).sum()) <= max(1, count // 10000), "pixels differ"
        torch.testing.assert_close(got[1][same], weight[same], atol=0.0, rtol=1e-6)
        torch.testing.assert_close(got[2][same], shown[same], atol=1e-6, rtol=0.0)


def image_checks(samples: int) -> dict[str, Check]:
    """Return these checks by name, with about so many samples each."""
    counts = tuple(np.random.default_rng(1).integers(0, 9, max(30, samples // 4)).tolist())
    cells = 32 if samples > 1 << 12 else 4
    found: dict[str, Check] = {
        f"image, {part}": partial(check_image, part=part, counts=counts, cells=cells) for part in PARTS
    }
    found["pixels drawn"] = partial(check_draw, rays=samples)
    return found
