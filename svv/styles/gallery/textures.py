"""Tools that paint the gallery's pictures (noise of a given spectrum, colour ramps, dabs of paint), and two of these.

Letters: n is the side of a (square) picture in pixels, rng the random generator.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Floats = NDArray[np.float32]


def spectrum_noise(rng: Generator, n: int, exponent: float) -> Floats:
    """Return noise (n, n) whose amplitude falls as frequency^-exponent; mean 0, standard deviation 1; periodic."""
    f = np.fft.fftfreq(n)
    angle = rng.uniform(0, np.pi)
    u = f * np.cos(angle) + f[:, None] * np.sin(angle)
    v = f[:, None] * np.cos(angle) - f * np.sin(angle)
    radius = np.hypot(u, v)
    radius[0, 0] = np.inf
    noise = np.real(np.fft.ifft2(np.fft.fft2(rng.normal(size=(n, n))) * radius**-exponent))
    return (noise / noise.std()).astype(np.float32)


def smooth(rng: Generator, n: int, sigma: float) -> Floats:
    """Return Gaussian-blurred noise (n, n), mean 0, standard deviation 1; ``sigma`` in pixels; periodic."""
    noise = gaussian_filter(rng.normal(size=(n, n)), sigma, mode="wrap")
    return ((noise - noise.mean()) / noise.std()).astype(np.float32)


def rank(field_: NDArray[np.generic]) -> Floats:
    """Return the field with its values spread evenly over [0, 1]."""
    order = np.empty(field_.size, np.float32)
    order[np.argsort(field_, axis=None)] = np.linspace(0, 1, field_.size, dtype=np.float32)
    return order.reshape(field_.shape)


def ramp(colours: Floats, t: NDArray[np.generic]) -> Floats:
    """Return colours of a palette (k, 3), interpolated linearly at t in [0, 1]; (..., 3)."""
    x = np.clip(t, 0, 1) * (len(colours) - 1)
    i = np.minimum(x.astype(int), len(colours) - 2)
    w = (x - i)[..., None]
    return (colours[i] * (1 - w) + colours[i + 1] * w).astype(np.float32)


class Dab(NamedTuple):
    """Shape of one touch of the brush, in pixels: an ellipse, or a bent stroke if it is long."""

    y: float
    x: float
    angle: float
    """Angle of its long axis from the x-axis, in radians."""
    length: float
    """Half its length."""
    width: float
    """Half its width."""
    bend: float = 0.0
    """Its sagitta, as a fraction of ``length``."""


@dataclass
class Canvas:
    """A picture in progress: its colours and the thickness of the paint, which is lit at the end."""

    colours: Floats
    """Colours, in [0, 1]. (n, n, 3)"""
    thickness: Floats = field(init=False)
    """Thickness of the paint, about 1 under a dab. (n, n)"""
    tooth: Floats | None = None
    """Fraction of a dab that each pixel takes up, as on rough paper, in [0, 1]; None takes up all of it. (n, n)"""

    def __post_init__(self) -> None:
        self.thickness = np.zeros(self.colours.shape[:2], np.float32)

    def dab(
        self, rng: Generator, shape: Dab, colour: NDArray[np.generic], bristles: float = 0.3, cover: float = 1.0
    ) -> None:
        """Lay a dab of this shape, with streaks as strong as ``bristles`` along it, and of the opacity ``cover``."""
        y, x, angle, length, width, bend = shape
        n, m = self.thickness.shape
        reach = max(length, width) + abs(bend) * length + 1.5
        y0, y1 = max(0, int(y - reach)), min(n, int(y + reach) + 2)
        x0, x1 = max(0, int(x - reach)), min(m, int(x + reach) + 2)
        if y0 >= y1 or x0 >= x1:
            return
        dy, dx = np.arange(y0, y1, dtype=np.float32)[:, None] - y, np.arange(x0, x1, dtype=np.float32) - x
        along = (dx * np.cos(angle) + dy * np.sin(angle)) / length
        across = (dy * np.cos(angle) - dx * np.sin(angle) - bend * length * along**2) / width
        # |along|^4: the blunt ends of a flat brush, if the dab is longer than wide.
        power = 2 if length < 1.5 * width else 4
        edge = (1 - np.abs(along) ** power - across**2) * min(width, length) / 2
        alpha = np.clip(edge + 0.5, 0, 1)
        streaks = np.sin(across * rng.uniform(3, 5) + rng.uniform(0, 6)) + np.sin(
            across * rng.uniform(6, 11) + rng.uniform(0, 6) + along
        )
        if bristles > 0.05:  # a dry brush leaves gaps towards the end of a stroke
            alpha = alpha * np.clip(1.6 - bristles * (1 + streaks) * np.maximum(along, 0) * 1.5, 0.15, 1)
        here = (slice(y0, y1), slice(x0, x1))
        if self.tooth is not None:
            alpha = alpha * self.tooth[here]
        alpha = (alpha * cover)[..., None]
        paint = colour * (1 + 0.22 * bristles * streaks[..., None])
        self.colours[here] += alpha * (paint - self.colours[here])
        body = 0.75 + 0.25 * bristles * streaks + 0.25 * across**2  # paint is pushed to the rims
        self.thickness[here] += alpha[..., 0] * (body - self.thickness[here])

    def lit(self, strength: float) -> Floats:
        """Return the picture with light falling on its relief from the upper left."""
        relief = gaussian_filter(self.thickness, 0.6)
        dy, dx = np.gradient(relief)
        return np.clip(self.colours * (1 + strength * (dx + dy))[..., None], 0, 1).astype(np.float32)


def style_picture(name: str, size: int = 512, seed: int = 0) -> Floats:
    """Paint a picture of :data:`STYLE_PICTURES`, float32 sRGB in [0, 1]; strokes scale with it. (size, size, 3)"""
    return STYLE_PICTURES[name](np.random.default_rng(seed), size)


def from_hex(*codes: str) -> Floats:
    """Convert colours 'rrggbb' to sRGB in [0, 1]. (N, 3)"""
    return np.array([[int(code[i : i + 2], 16) / 255 for i in (0, 2, 4)] for code in codes], np.float32)


def _whirls(rng: Generator, n: int, count: int) -> tuple[Floats, Floats]:
    """Return angles (n, n) of a wind with ``count`` eddies, and its stream function, spread evenly over [0, 1]."""
    y, x = np.mgrid[:n, :n].astype(np.float32) / n
    stream = 0.9 * y + 0.12 * smooth(rng, n, 0.12 * n)
    for k in range(count):
        cx, cy, radius = (k + rng.uniform(0.3, 0.7)) / count, rng.uniform(0.2, 0.8), rng.uniform(0.12, 0.2)
        stream += (-1) ** k * 0.5 * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * radius**2))
    dy, dx = np.gradient(stream)
    return np.arctan2(-dx, dy).astype(np.float32), rank(stream)


def brush_strokes(rng: Generator, n: int) -> Floats:
    """Paint thick oil strokes along a wind with eddies: night blues, turquoise, ochre and vermilion."""
    colours = from_hex("14213d", "1d3f8a", "2a6fb8", "3fa7b5", "a9d5c2", "f4e3a1", "f2b134", "e4572e", "8c1c2b")
    angles, stream = _whirls(rng, n, 3)
    tone = rank(stream + 0.12 * smooth(rng, n, 0.04 * n))
    canvas = Canvas(ramp(colours, tone) * 0.6)
    for width, per_area, wander in ((n / 55, 1.6, 0.04), (n / 90, 1.5, 0.06), (n / 130, 0.7, 0.09)):
        length = 5.5 * width
        for y, x in rng.uniform(0, n, (int(per_area * n * n / (4 * width * length) * 3), 2)):
            iy, ix = int(y), int(x)
            colour = ramp(colours, np.array(tone[iy, ix] + wander * rng.normal()))
            colour = np.clip(colour * rng.uniform(0.85, 1.18) + rng.normal(0, 0.03, 3), 0, 1)
            # The stroke bends with the wind, by the angle that the wind turns from its middle to its end.
            ahead = angles[
                int(np.clip(y + length * np.sin(angles[iy, ix]), 0, n - 1)),
                int(np.clip(x + length * np.cos(angles[iy, ix]), 0, n - 1)),
            ]
            turn = (ahead - angles[iy, ix] + np.pi) % (2 * np.pi) - np.pi
            bend = float(np.clip(turn / 2, -0.35, 0.35))
            angle = angles[iy, ix] + rng.normal(0, 0.07)
            canvas.dab(rng, Dab(y, x, angle, length * rng.uniform(0.7, 1.2), width, bend), colour, bristles=0.7)
    return canvas.lit(1.1)


def stippling(rng: Generator, n: int) -> Floats:
    """Paint dots of unmixed colour on warm paper, lights against darks: orange, yellow, green, violet, ultramarine."""
    colours = from_hex("2b2d8f", "5b3fa8", "c23b6e", "f0653a", "f9b233", "f6e27f", "7fb84f", "1f8a83", "2455a4")
    paper = from_hex("f3e7cf")[0]
    tone, depth = rank(smooth(rng, n, 0.10 * n)), rank(smooth(rng, n, 0.07 * n))
    canvas = Canvas(np.tile(paper, (n, n, 1)))
    for radius, cover in ((n / 85, 0.75), (n / 110, 0.95), (n / 160, 0.95)):
        pitch = 2.3 * radius
        grid = np.mgrid[0 : n + pitch : pitch, 0 : n + pitch : pitch].reshape(2, -1).T
        grid = grid + rng.normal(0, 0.27 * pitch, grid.shape)
        for y, x in rng.permutation(grid):
            iy, ix = int(np.clip(y, 0, n - 1)), int(np.clip(x, 0, n - 1))
            t = tone[iy, ix] + 0.07 * rng.normal()
            if rng.random() < 0.13:  # divisionism: the complement makes its neighbours glow
                t = (t + 0.45) % 1
            colour = np.clip(ramp(colours, np.array(t)) * rng.uniform(0.88, 1.12), 0, 1)
            if rng.random() < 0.45 + 0.55 * (1 - depth[iy, ix]):
                size = radius * rng.uniform(0.75, 1.15)
                canvas.dab(rng, Dab(y, x, rng.uniform(0, np.pi), size * 1.12, size), colour, bristles=0, cover=cover)
    return canvas.lit(0.25)


STYLE_PICTURES: dict[str, Callable[[Generator, int], Floats]] = {"brush strokes": brush_strokes, "stippling": stippling}
