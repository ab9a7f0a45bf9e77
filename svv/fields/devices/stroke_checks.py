"""Checks of the kernels that evaluate strokes in images, as in :mod:`svv.fields.devices.kernel_checks`.

They are compared with the CPU's, which the tests compare with :mod:`svv.core.strokes.stroke_reference`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from svv.core.strokes.strokes import Brush, Strokes, joined
from svv.fields.strokes.stored_strokes import Brushed
from svv.kernels.types import Kernels, Samples

BRUSHES = {
    "oil": Brush(relief=0.5, dry=0.6, mixed=0.7, rim=0.3),
    "wash": Brush(0.0, 0.0, 0.5, rim=0.6, body=0.0, grain=0.4, flow=0.4, blunt=1.0, ground=(0.9, 0.8, 0.7)),
    "chalk": Brush(0.2, 1.5, 0.3, rim=-0.2, body=0.6, grain=0.5, tooth=0.15, flow=0.2, feather=0.4, blunt=0.5),
}
"""A brush for each branch of the kernels: bristles, wet paint, the tooth of the paper, and the ground's colour."""

STEP = 0.01
SAME, SHARE = 1e-3, 0.998
"""Largest difference of colours, and the share of the samples that must stay below: of two points of a stroke that are
equally near but for rounding, either may count, and where a stroke begins, noise has no derivative."""


def curved_strokes(count: int, seed: int) -> Strokes:
    """Return strokes along arcs near the middle of the box, a third of them laid by wet brushes."""
    rng, parts = np.random.default_rng(seed), []
    for _ in range(count):
        points = int(rng.integers(2, 12))
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        right = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
        right /= np.linalg.norm(right)
        turn = np.linspace(0.0, rng.uniform(0.2, 1.5), points)[:, None]
        arc = np.cos(turn) * right + np.sin(turn) * np.cross(normal, right)
        radius = rng.uniform(0.02, 0.05, points).astype(np.float32)
        colour, second = rng.uniform(0.0, 1.0, (2, 1, 3)).astype(np.float32)
        bristles = rng.choice([0.125, 0.25, 2.0, 3.5, 4.0, 5.0], 1).astype(np.float32)
        where = (rng.uniform(0.35, 0.65, 3) + 0.15 * arc).astype(np.float32)
        parts.append(Strokes(
            where, np.tile(normal.astype(np.float32), (points, 1)), radius, 0.8 * radius, 0.6 * radius,
            np.array([0, points]), colour, second, bristles, rng.integers(0, 1024, 1),
        ))  # fmt: skip
    return joined(parts)


def samples_near(strokes: Strokes, counts: Sequence[int], seed: int) -> Samples:
    """Return rays of a few samples each that begin near strokes, with gaps here and there."""
    rng, total, count = np.random.default_rng(seed), sum(counts), np.array(counts, np.int64)
    ray, start = np.repeat(np.arange(len(count)), count), np.cumsum(count) - count
    origin = strokes.where[rng.integers(0, len(strokes.where), len(count))] + rng.normal(0.0, 0.015, (len(count), 3))
    direction = rng.normal(size=(len(count), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    run = np.cumsum(np.where(rng.random(total) < 0.2, 0.06, STEP))
    along = run - run[np.minimum(start, max(total - 1, 0))][ray] if total else run
    position = (origin[ray] + along[:, None] * direction[ray]).astype(np.float32)
    sigma, skipped = (rng.uniform(0.0, most, total).astype(np.float32) for most in (60.0, 0.3))
    arrays = position, sigma, skipped, ray.astype(np.int32), start, count
    return Samples(*map(torch.from_numpy, arrays), torch.zeros(len(count)), STEP)  # type: ignore[arg-type, call-arg]


def check_strokes(
    kernels: Kernels, device: torch.device, seed: int, brush: str, counts: Sequence[int], strokes: int = 12,
    soft: float = 0.004,
) -> None:  # fmt: skip
    """Compare the colours of samples with strokes over them, for two regions with strokes and one without."""
    assert kernels.STROKES is not None, "these kernels leave strokes to the CPU"
    one, other = curved_strokes(strokes, seed), curved_strokes(strokes, seed + 1000)
    plain = replace(BRUSHES[brush], ground=(0.2, 0.5, 0.4))
    flats = np.random.default_rng(seed).random((3, 3)).astype(np.float32)
    brushed = Brushed({0: (one, BRUSHES[brush]), 2: (other, plain)}, flats=flats)
    samples = samples_near(joined([one, other]), counts, seed)
    generator = torch.Generator().manual_seed(seed)
    region = torch.randint(0, 2, (len(samples.count),), generator=generator)[samples.ray.long()]
    region = torch.where(torch.rand(len(samples), generator=generator) < 0.2, 2, region)
    own = torch.rand(len(samples), 3, generator=generator)
    for colours in (None, own):
        expected = brushed.over(colours, samples, region, {0: 0, 2: 2}, [0, 1, 2], soft)
        below = None if colours is None else colours.to(device)
        got = brushed.over_there(
            kernels.STROKES, below, samples.to(device), region.to(device), {0: 0, 2: 2}, [0, 1, 2], soft
        ).cpu()
        assert got.shape == expected.shape and bool(got.isfinite().all())
        if len(samples):
            apart = (got - expected).abs().amax(dim=1)
            share = float((apart < SAME).float().mean())
            assert share >= SHARE, f"{1 - share:.2%} of the samples have other colours, by {float(apart.max()):.1e}"
            plain_colours = torch.from_numpy(flats)[region] if colours is None else colours
            changed = (expected - plain_colours).abs().amax(dim=1) > 0.01
            assert len(samples) < 100 or float(changed.float().mean()) > 0.2, "too few samples are painted to compare"
