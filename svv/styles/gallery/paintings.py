"""Paintings of the gallery: watercolour and impasto. Letters as in ``subjects``."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

from svv.styles.gallery.drawings import paper_grain
from svv.styles.gallery.subjects import flowers, hills
from svv.styles.gallery.textures import Canvas, Dab, Floats, from_hex, ramp, rank, smooth, spectrum_noise


def watercolour(rng: Generator, n: int) -> Floats:
    """Paint transparent glazes on white paper: dried rims, pigment in the grain, blooms and bleeding."""
    unit = n / 512
    subject = hills(rng, n, 5, steep=0.11, fall=1.2)
    grain = paper_grain(rng, n, 1.3 * unit)
    light = np.ones((n, n, 3), np.float32) * from_hex("fdfbf5")[0]
    # Transmittance of a glaze of unit thickness; it darkens by Beer's law (Kubelka and Munk's limit of thin layers).
    glazes = from_hex("7fb6dd", "f6c445", "a9b7d9", "7aa6b8", "6fae8f", "5f9a4f", "3f6f4a")
    accents = from_hex("e79ab0", "f08a4b", "c99ac4", "8fa0cf", "b8c46a", "c9a545", "6a5a78")

    def glaze(mask: Floats, colour: Floats, strength: Floats) -> None:
        """Lay one wash of thickness ``strength``; ``mask`` goes from about 0 to 1 over a soft rim."""
        inside = distance_transform_edt(mask > 0.5) / unit
        rim = 0.55 * np.exp(-inside / 1.6) + 0.2 * np.exp(-inside / 7.0)
        thick = (mask > 0.5) * strength * (1 + rim)
        thick = gaussian_filter(thick, 0.6 * unit) * (0.8 + 0.4 * (1 - grain))
        light[:] = light * np.exp(-thick[..., None] * -np.log(np.clip(colour, 0.03, 0.99)))

    for number in range(len(glazes)):
        upper = subject.part >= number if number >= 2 else subject.part == number
        if number == 0:
            upper = subject.part != 1
        for layer in range(2):
            wander = np.stack([smooth(rng, n, 5 * unit), smooth(rng, n, 5 * unit)]) * 1.6 * unit
            wander += np.stack([smooth(rng, n, 20 * unit), smooth(rng, n, 20 * unit)]) * 3.0 * unit * layer
            y, x = np.mgrid[:n, :n] + wander
            mask = map_coordinates(upper.astype(np.float32), (y, x), order=1, mode="nearest")
            depth = distance_transform_edt(mask > 0.5) / n
            fade = np.exp(-depth / 0.16) if number != 1 else np.ones((n, n))
            if number == 0:  # the sky pales towards the horizon
                fade = np.clip(1.15 - np.mgrid[:n, :n][0] / (0.5 * n), 0, 1)
            flow = np.clip(0.75 + 0.32 * spectrum_noise(rng, n, 1.7), 0.1, 1.8)
            accent = layer == 1
            wet = rank(smooth(rng, n, 0.07 * n)) if accent else 1.0
            strength = (0.46 + 0.07 * number) * fade * flow * (np.clip(wet * 2.4 - 1.1, 0, 1) if accent else 1.0)
            glaze(mask, accents[number] if accent else glazes[number], strength)
    for cy, cx in rng.uniform(0.1, 0.9, (7, 2)) * n:  # blooms: returning water pushed the pigment outwards
        y, x = np.mgrid[:n, :n]
        ragged = np.hypot(y - cy, x - cx) + 5 * unit * smooth(rng, n, 4 * unit) + 8 * unit * smooth(rng, n, 14 * unit)
        radius = rng.uniform(18, 44) * unit
        inside = np.clip((radius - ragged) / (6 * unit), 0, 1)
        rim = np.exp(-(((ragged - radius) / (2.2 * unit)) ** 2))
        light[:] = light + (1 - light) * 0.22 * inside[..., None] - light * 0.06 * rim[..., None]
    dy, dx = np.gradient(gaussian_filter(grain, 0.8 * unit))
    return np.clip(light * (1 + 0.1 * (dx + dy))[..., None], 0, 1).astype(np.float32)


def impasto(rng: Generator, n: int) -> Floats:
    """Paint thick oil with every stroke in relief: sunflower yellows on green and turquoise."""
    unit = n / 512
    subject = flowers(rng, n, 8)
    sets = ("1d6e73 2f9a94 7cc7b4", "1f4d2b 3d7a35 86a93c", "3a1d10 6b3414 a35a1c",
            "c9790f f0a818 ffd84d", "d9901a f7c331 fff08a", "b85a12 e88a1a ffc24a")  # fmt: skip
    colours = [from_hex(*s.split()) for s in sets]
    canvas = Canvas(np.ones((n, n, 3), np.float32) * from_hex("5a4a2a")[0])
    tone = np.empty((n, n), np.float32)
    for number in range(len(sets)):
        here = subject.part == number
        if here.any():
            tone[here] = rank(subject.tone[here])
    for width, cover in ((9.5, 1.6), (6.5, 2.2), (4.2, 1.7)):
        wide = width * unit
        long = 2.9 * wide
        for y, x in rng.uniform(0, n, (int(cover * n * n / (4 * wide * long) * 2.2), 2)):
            iy, ix = int(y), int(x)
            part = subject.part[iy, ix]
            if part < 2 and width < 5:
                continue
            colour = ramp(colours[part], np.array(tone[iy, ix] + 0.16 * rng.normal()))
            colour = np.clip(colour * rng.uniform(0.88, 1.14) + rng.normal(0, 0.02, 3), 0, 1)
            reach = long * rng.uniform(0.7, 1.2) * (0.5 if part == 2 else 1.0)
            angle = subject.angle[iy, ix] + rng.normal(0, 0.14)
            canvas.dab(rng, Dab(y, x, angle, reach, wide, rng.normal(0, 0.08)), colour, 0.75)
            canvas.thickness[max(0, iy - 1) : iy + 2, max(0, ix - 1) : ix + 2] += 0.02
    return canvas.lit(2.2)
