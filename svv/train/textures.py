"""Pictures of textures and strokes, generated: nothing of anybody else's, any number of them, from a seed.

They serve twice: the embedded style features are trained on them (:mod:`svv.train.train_features`), and
:func:`style_picture` draws the two style pictures of the demo. Everything is painted from a few primitives: a
spectrum, a palette, a flow field and one dab of paint, whose bristles and thickness are shaded at the end.

Letters: n is the size of a (square) picture in pixels, rng the random generator.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

Floats = NDArray[np.float32]


def hsv(hue: NDArray, saturation: NDArray, value: NDArray) -> Floats:
    """Colours (..., 3) in [0, 1] of hue (in turns, wraps), saturation and value (Smith 1978)."""
    k = (np.array([5.0, 3.0, 1.0]) + np.asarray(hue)[..., None] * 6) % 6
    ramp = np.clip(np.minimum(k, 4 - k), 0, 1)
    return (np.asarray(value)[..., None] * (1 - np.asarray(saturation)[..., None] * ramp)).astype(np.float32)


def palette(rng: Generator, count: int | np.integer) -> Floats:
    """So many colours (count, 3) that go together: one to three hues, dark to light, some of them greyish."""
    k = int(count)
    hues = rng.random() + rng.choice([0, 0.08, 0.33, 0.5], 3) * rng.choice([-1, 1], 3)
    hue = rng.choice(hues, k) + rng.normal(0, 0.03, k)
    return hsv(hue, rng.beta(1.6, 1.6, k) * rng.uniform(0.3, 1), np.clip(rng.normal(0.6, 0.3, k), 0.03, 1))


def spectrum_noise(rng: Generator, n: int, exponent: float, stretch: float = 1.0) -> Floats:
    """Noise (n, n) whose amplitude falls as frequency^-exponent; mean 0, deviation 1; periodic."""
    f = np.fft.fftfreq(n)
    angle = rng.uniform(0, np.pi)
    u = (f * np.cos(angle) + f[:, None] * np.sin(angle)) * stretch
    v = f[:, None] * np.cos(angle) - f * np.sin(angle)
    radius = np.hypot(u, v)
    radius[0, 0] = np.inf
    noise = np.real(np.fft.ifft2(np.fft.fft2(rng.normal(size=(n, n))) * radius**-exponent))
    return (noise / noise.std()).astype(np.float32)


def smooth(rng: Generator, n: int, sigma: float) -> Floats:
    """Gaussian-blurred noise (n, n), mean 0, deviation 1; ``sigma`` in pixels; periodic."""
    noise = gaussian_filter(rng.normal(size=(n, n)), sigma, mode="wrap")
    return ((noise - noise.mean()) / noise.std()).astype(np.float32)


def rank(field_: NDArray) -> Floats:
    """The field with its values spread evenly over [0, 1]."""
    order = np.empty(field_.size, np.float32)
    order[np.argsort(field_, axis=None)] = np.linspace(0, 1, field_.size, dtype=np.float32)
    return order.reshape(field_.shape)


def ramp(colours: Floats, t: NDArray) -> Floats:
    """Colours along a palette (k, 3), interpolated linearly at t in [0, 1]; (..., 3)."""
    x = np.clip(t, 0, 1) * (len(colours) - 1)
    i = np.minimum(x.astype(int), len(colours) - 2)
    w = (x - i)[..., None]
    return (colours[i] * (1 - w) + colours[i + 1] * w).astype(np.float32)


@dataclass
class Canvas:
    """A picture in work: its colours and, for the light at the end, how thick the paint lies."""

    colours: Floats
    """(n, n, 3) in [0, 1]."""
    thickness: Floats = field(init=False)
    """(n, n), about 1 under a dab."""
    tooth: Floats | None = None
    """How much of a dab each place takes, (n, n) in [0, 1]: rough paper lets only its heights be painted. None: all."""

    def __post_init__(self) -> None:
        self.thickness = np.zeros(self.colours.shape[:2], np.float32)

    def dab(
        self, rng: Generator, y: float, x: float, angle: float, length: float, width: float,
        colour: NDArray, bend: float = 0.0, bristles: float = 0.3, cover: float = 1.0,
    ) -> None:  # fmt: skip
        """Lay one dab of paint: an ellipse (or, when long, a bent stroke) streaked along its length.

        ``length`` and ``width`` are its half axes in pixels, ``bend`` its sagitta as a part of the length,
        ``bristles`` the strength of the streaks, ``cover`` its opacity.
        """
        n, m = self.thickness.shape
        reach = max(length, width) + abs(bend) * length + 1.5
        y0, y1 = max(0, int(y - reach)), min(n, int(y + reach) + 2)
        x0, x1 = max(0, int(x - reach)), min(m, int(x + reach) + 2)
        if y0 >= y1 or x0 >= x1:
            return
        dy, dx = np.arange(y0, y1, dtype=np.float32)[:, None] - y, np.arange(x0, x1, dtype=np.float32) - x
        along = (dx * np.cos(angle) + dy * np.sin(angle)) / length
        across = (dy * np.cos(angle) - dx * np.sin(angle) - bend * length * along**2) / width
        # |along|^4: blunt ends, as a flat brush leaves them, once the dab is longer than wide.
        power = 2 if length < 1.5 * width else 4
        edge = (1 - np.abs(along) ** power - across**2) * min(width, length) / 2
        alpha = np.clip(edge + 0.5, 0, 1)
        streaks = np.sin(across * rng.uniform(3, 5) + rng.uniform(0, 6)) + np.sin(
            across * rng.uniform(6, 11) + rng.uniform(0, 6) + along
        )
        if bristles > 0.05:  # a dry brush leaves gaps towards the end of its way
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
        """The picture with light falling on its relief from the upper left."""
        relief = gaussian_filter(self.thickness, 0.6)
        dy, dx = np.gradient(relief)
        return np.clip(self.colours * (1 + strength * (dx + dy))[..., None], 0, 1).astype(np.float32)


def flow_field(rng: Generator, n: int) -> Floats:
    """Angles (n, n) of a smooth flow: along the level lines of blurred noise, or nearly straight."""
    heights = smooth(rng, n, rng.uniform(0.06, 0.25) * n)
    if rng.random() < 0.5:
        dy, dx = np.gradient(heights)
        return np.arctan2(dx, -dy).astype(np.float32)
    return (rng.uniform(0.2, 1.2) * heights + rng.uniform(0, np.pi)).astype(np.float32)


def clouds(rng: Generator, n: int) -> Floats:
    noise = spectrum_noise(rng, n, rng.uniform(0.6, 2.2), rng.uniform(1, 4))
    return ramp(palette(rng, rng.integers(2, 7)), rank(noise))


def leaves(rng: Generator, n: int) -> Floats:
    """Dead leaves: ellipses that hide each other (Lee, Mumford and Huang 2001)."""
    colours, largest = palette(rng, 7), rng.uniform(4, 26)
    canvas = Canvas(np.tile(colours[0], (n, n, 1)))
    slim, spread, angle = rng.uniform(0.2, 1), rng.choice([0.2, 3]), rng.uniform(0, np.pi)
    for _ in range(int(min(900, 4 * n * n / largest**2))):
        y, x = rng.uniform(-5, n + 5, 2)
        length = 1.5 + largest * 0.9 * rng.power(2)
        colour = np.clip(rng.choice(colours) + rng.normal(0, 0.05, 3), 0, 1)
        canvas.dab(rng, y, x, angle + spread * rng.normal(), length, length * slim, colour, bristles=0)
    return canvas.lit(rng.uniform(-1, 2))


def strokes(rng: Generator, n: int) -> Floats:
    """Brush strokes along a flow field, their colours from a smooth field and jittered."""
    colours, angles, hues = (
        palette(rng, 6),
        flow_field(rng, n),
        rank(smooth(rng, n, rng.uniform(0.03, 0.2) * n)),
    )
    canvas = Canvas(ramp(colours, hues) * 0.7)
    width = rng.uniform(1, 4.5)
    length, jitter, mix = width * rng.uniform(2.5, 9), rng.uniform(0.02, 0.12), rng.uniform(0.02, 0.5)
    bristles, bend = rng.uniform(0, 0.9), rng.uniform(0, 0.15)
    for y, x in rng.uniform(0, n, (int(min(1500, 0.9 * n * n / (width * length))), 2)):
        t = hues[int(y), int(x)] + mix * rng.normal()
        colour = np.clip(ramp(colours, np.array(t)) + rng.normal(0, jitter, 3) + rng.normal(0, jitter), 0, 1)
        angle = angles[int(y), int(x)] + rng.normal(0, 0.08)
        stretch = rng.uniform(0.6, 1.2)
        canvas.dab(rng, y, x, angle, length * stretch, width, colour, rng.normal(0, bend), bristles)
    return canvas.lit(rng.uniform(0, 1.5))


def cells(rng: Generator, n: int) -> Floats:
    """Worley's cells (1996): a mosaic with joints, or the distance to the seeds or between them."""
    count = int(np.exp(rng.uniform(np.log(20), np.log(800))))
    seeds = rng.random((count, 2)) * n
    tiles = np.concatenate([seeds + np.array((a, b)) for a in (-n, 0, n) for b in (-n, 0, n)])
    squeeze, bend = [1, rng.uniform(0.4, 1.6)], rng.uniform(0, 6)
    y, x = np.mgrid[:n, :n] + bend * np.stack([smooth(rng, n, 8), smooth(rng, n, 8)])
    distance, index = cKDTree(tiles * squeeze).query(np.stack([y, x], -1) * squeeze, k=2)
    gap = distance[..., 1] - distance[..., 0]
    kind = rng.integers(3)
    if kind == 0:
        joint = np.clip(gap / rng.uniform(1, 4), 0, 1)[..., None]
        colours = palette(rng, 12)
        return (colours[index[..., 0] % count % 11] * joint + colours[11] * (1 - joint)).astype(np.float32)
    return ramp(palette(rng, rng.integers(2, 5)), rank(distance[..., 0] if kind == 1 else gap))


def hatching(rng: Generator, n: int) -> Floats:
    """Parallel lines, one to three directions over each other, as dense as a tone asks."""
    y, x = np.mgrid[:n, :n].astype(np.float32)
    wave, tone = smooth(rng, n, rng.uniform(8, 40)) * rng.uniform(0, 8), spectrum_noise(rng, n, 1.6)
    ink = np.zeros((n, n), np.float32)
    for _ in range(rng.integers(1, 4)):
        angle, frequency = rng.uniform(0, np.pi), rng.uniform(0.3, 1.6)
        line = np.sin((x * np.cos(angle) + y * np.sin(angle) + wave) * frequency)
        ink = np.maximum(ink, np.clip((line - rng.uniform(-0.5, 0.7)) * 3, 0, 1) * (tone > 0.6 * rng.normal()))
    return ramp(palette(rng, 2), ink)


def dots(rng: Generator, n: int) -> Floats:
    """Stippling: round dabs, as dense as a tone asks, in one ink or in many colours."""
    tone, size = rank(smooth(rng, n, rng.uniform(6, 30))), rng.uniform(0.9, 4)
    colours = palette(rng, rng.integers(2, 8))
    canvas = Canvas(np.tile(colours[0], (n, n, 1)))
    wanted, contrast, hues = (
        rng.uniform(0.3, 2.5),
        rng.uniform(0, 2),
        rank(smooth(rng, n, rng.uniform(5, 40))),
    )
    for y, x in rng.uniform(0, n, (int(min(1800, wanted * n * n / (4 * size**2))), 2)):
        if rng.random() < tone[int(y), int(x)] ** contrast:
            t = hues[int(y), int(x)] + rng.normal(0, 0.25)
            colour = ramp(colours[1:], np.array(t)) if len(colours) > 2 else colours[1]
            radius = size * rng.uniform(0.7, 1.2)
            canvas.dab(rng, y, x, 0, radius, radius, colour, bristles=0)
    return canvas.lit(rng.uniform(0, 1))


def labyrinth(rng: Generator, n: int) -> Floats:
    """Spots and labyrinths of short-range activation and long-range inhibition (Turing 1952)."""
    pattern, inner = rng.normal(size=(n, n)), rng.uniform(1, 3)
    outer, bias = inner * rng.uniform(1.4, 2.5), rng.normal(0, 0.1)
    for _ in range(20):
        difference = gaussian_filter(pattern, inner, mode="wrap") - gaussian_filter(pattern, outer, mode="wrap")
        pattern = np.tanh(27 * difference + bias)
    return ramp(palette(rng, 3), rank(gaussian_filter(pattern, 0.7) + 0.02 * smooth(rng, n, 1)))


def ripples(rng: Generator, n: int) -> Floats:
    """Wood, marble, weave and scales: a few waves, bent by noise and multiplied or added."""
    y, x = np.mgrid[:n, :n].astype(np.float32)
    bend, total = (
        spectrum_noise(rng, n, rng.uniform(1.5, 2.5)) * rng.uniform(0, 12),
        np.zeros((n, n), np.float32),
    )
    angle = rng.uniform(0, np.pi)
    for _ in range(rng.integers(1, 4)):
        wave = np.sin((x * np.cos(angle) + y * np.sin(angle) + bend) * rng.uniform(0.1, 1.2) + rng.uniform(0, 6))
        total = total + np.abs(wave) if rng.random() < 0.4 else total + wave
        angle += rng.choice([np.pi / 2, np.pi / 3, rng.uniform(0, np.pi)])
    sharp = np.exp(rng.uniform(-0.5, 2))
    return ramp(palette(rng, rng.integers(2, 6)), 0.5 + 0.5 * np.tanh(sharp * (total - total.mean())))


def bodies(rng: Generator, n: int) -> Floats:
    """Large shaded shapes with sharp outlines: what renders of a volume look like before they are stylized."""
    picture = np.tile(palette(rng, 1)[0], (n, n, 1))
    for colour in palette(rng, rng.integers(2, 7)):
        height = smooth(rng, n, rng.uniform(4, 25)) - rng.uniform(-0.3, 1.2)
        dy, dx = np.gradient(gaussian_filter(height, 2)) / (np.std(np.gradient(height)) + 1e-6)
        light = np.clip(0.75 + rng.uniform(0.05, 0.3) * (dy * rng.normal() + dx * rng.normal()), 0, 1.4)
        inside = np.clip(height * rng.uniform(4, 20), 0, 1)[..., None]
        picture = picture * (1 - inside) + inside * colour * light[..., None]
    return np.clip(picture, 0, 1).astype(np.float32)


GENERATORS: tuple[Callable[[Generator, int], Floats], ...] = (
    clouds, leaves, strokes, cells, hatching, dots, labyrinth, strokes, ripples, bodies,
)  # fmt: skip


def warped(rng: Generator, picture: Floats) -> Floats:
    """The picture bent by a smooth displacement of a few pixels."""
    n = len(picture)
    sigma, strength = rng.uniform(10, 40), rng.uniform(1, 9)
    grid = np.mgrid[:n, :n] + strength * np.stack([smooth(rng, n, sigma), smooth(rng, n, sigma)])
    return np.stack([map_coordinates(picture[..., c], grid, order=1, mode="reflect") for c in range(3)], -1)


def texture(seed: int, size: int = 224) -> Floats:
    """Generated picture number ``seed``: (size, size, 3) float32 in [0, 1]; the same on every machine."""
    rng = np.random.default_rng(seed)
    picture = GENERATORS[seed % len(GENERATORS)](rng, size)
    if rng.random() < 0.3:
        picture = warped(rng, picture)
    if rng.random() < 0.3:  # a second texture in patches, or laid over the first
        other = GENERATORS[rng.integers(len(GENERATORS))](rng, size)
        patch = np.clip(spectrum_noise(rng, size, 1.8) * 4 + 0.5, 0, 1)[..., None]
        picture = picture * (1 - patch) + other * patch if rng.random() < 0.6 else picture * (0.4 + 0.6 * other)
    if rng.random() < 0.15:
        picture = gaussian_filter(picture, (rng.uniform(0.3, 1), rng.uniform(0.3, 1), 0))
    return np.clip(picture, 0, 1).astype(np.float32)


def style_picture(name: str, size: int = 512, seed: int = 0) -> Floats:
    """One of the demo's style pictures, painted by this module.

    Args:
        name: ``"brush strokes"`` or ``"stippling"``.
        size: Side in pixels; strokes scale with it.
        seed: Another seed is another painting in the same manner.

    Returns:
        (size, size, 3) float32 sRGB in [0, 1].
    """
    return STYLE_PICTURES[name](np.random.default_rng(seed), size)


def from_hex(*codes: str) -> Floats:
    return np.array([[int(code[i : i + 2], 16) / 255 for i in (0, 2, 4)] for code in codes], np.float32)


def _whirls(rng: Generator, n: int, count: int) -> tuple[Floats, Floats]:
    """Angles (n, n) of a wind that eddies around ``count`` centres, and its stream function, spread over [0, 1]."""
    y, x = np.mgrid[:n, :n].astype(np.float32) / n
    stream = 0.9 * y + 0.12 * smooth(rng, n, 0.12 * n)
    for k in range(count):
        cx, cy, radius = (k + rng.uniform(0.3, 0.7)) / count, rng.uniform(0.2, 0.8), rng.uniform(0.12, 0.2)
        stream += (-1) ** k * 0.5 * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * radius**2))
    dy, dx = np.gradient(stream)
    return np.arctan2(-dx, dy).astype(np.float32), rank(stream)


def brush_strokes(rng: Generator, n: int) -> Floats:
    """Oil paint laid thickly along a wind with eddies: night blues, turquoise, ochre and vermilion."""
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
            # The stroke follows the wind's own curvature: how far the angle turns from its middle to its end.
            ahead = angles[
                int(np.clip(y + length * np.sin(angles[iy, ix]), 0, n - 1)),
                int(np.clip(x + length * np.cos(angles[iy, ix]), 0, n - 1)),
            ]
            turn = (ahead - angles[iy, ix] + np.pi) % (2 * np.pi) - np.pi
            bend = float(np.clip(turn / 2, -0.35, 0.35))
            angle = angles[iy, ix] + rng.normal(0, 0.07)
            canvas.dab(rng, y, x, angle, length * rng.uniform(0.7, 1.2), width, colour, bend, bristles=0.7)
    return canvas.lit(1.1)


def stippling(rng: Generator, n: int) -> Floats:
    """Dots of unmixed colour on warm paper, lights against darks: orange, yellow, green, violet and ultramarine."""
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
                canvas.dab(rng, y, x, rng.uniform(0, np.pi), size * 1.12, size, colour, bristles=0, cover=cover)
    return canvas.lit(0.25)


STYLE_PICTURES: dict[str, Callable[[Generator, int], Floats]] = {
    "brush strokes": brush_strokes,
    "stippling": stippling,
}
