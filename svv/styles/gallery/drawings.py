"""Drawings of the gallery: stipple, cross-hatching, charcoal, pastel, ink wash. Letters as in ``subjects``."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from svv.styles.gallery.subjects import hills, still_life
from svv.styles.gallery.textures import Canvas, Dab, Floats, from_hex, rank, smooth, spectrum_noise


def paper_grain(rng: Generator, n: int, size: float) -> Floats:
    """Return the height of a paper's surface (n, n), spread evenly over [0, 1]; ``size`` of its grains in pixels."""
    return rank(smooth(rng, n, size) + 0.4 * spectrum_noise(rng, n, 0.5))


def streamed(noise: Floats, angle: Floats, length: float) -> Floats:
    """Smear noise along a direction field, in radians (line integral convolution, Cabral and Leedom 1993). (n, n) each

    ``length`` is that of the smear to either side, in pixels; the result is spread evenly over [0, 1].
    """
    # Long smears advance by about the width of the noise's features: 24 steps are as good as one per pixel.
    stride, last = max(1.0, length / 24), len(noise) - 1
    step_y, step_x = stride * np.sin(angle), stride * np.cos(angle)
    total = noise.copy()
    for sign in (1.0, -1.0):
        y, x = np.mgrid[: len(noise), : len(noise)].astype(np.float32)
        for k in range(1, int(length / stride) + 1):
            at = np.clip(np.rint(y), 0, last).astype(np.intp), np.clip(np.rint(x), 0, last).astype(np.intp)
            y, x = y + sign * step_y[at], x + sign * step_x[at]
            total += map_coordinates(noise, (y, x), order=1, mode="reflect") * (1 - (k * stride / (length + 1)) ** 2)
    return rank(total)


def mixed(paper: NDArray[np.floating], ink: NDArray[np.floating], cover: NDArray[np.floating]) -> Floats:
    """Blend ink over paper: colours (..., 3), cover (n, n) in [0, 1]."""
    return (paper + (ink - paper) * np.clip(cover, 0, 1)[..., None]).astype(np.float32)


def discs(n: int, y: NDArray[np.generic], x: NDArray[np.generic], radius: NDArray[np.generic]) -> Floats:
    """Return the cover (n, n) of round dots with soft rims of a pixel; positions and radii in pixels."""
    cover = np.zeros((n, n), np.float32)
    reach = int(np.ceil(radius.max())) + 1
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    iy = np.rint(y).astype(int)[:, None, None] + dy
    ix = np.rint(x).astype(int)[:, None, None] + dx
    distance = np.hypot(iy - y[:, None, None], ix - x[:, None, None])
    value = np.clip(radius[:, None, None] - distance + 0.5, 0, 1)
    inside = (iy >= 0) & (iy < n) & (ix >= 0) & (ix < n)
    np.maximum.at(cover, (iy[inside], ix[inside]), value[inside].astype(np.float32))
    return cover


def stipple(rng: Generator, n: int) -> Floats:
    """Draw pen dots, denser in the dark: ultramarine on white (weighted Voronoi stippling, Secord 2002)."""
    subject = still_life(rng, n)
    dark = np.clip(1.04 - subject.tone, 0.0, 1) ** 1.7 + 0.012
    count = 9000
    weight = dark.ravel() / dark.sum()
    at = np.stack(np.divmod(rng.choice(n * n, count, p=weight), n), 1) + rng.random((count, 2))
    places = np.stack(np.divmod(np.arange(n * n), n), 1) + 0.5
    for _ in range(14):
        owner = cKDTree(at).query(places)[1]
        mass = np.bincount(owner, weight, count)
        sums = np.stack([np.bincount(owner, weight * places[:, c], count) for c in (0, 1)], 1)
        at = np.where(mass[:, None] > 0, sums / np.maximum(mass, 1e-30)[:, None], at)
    y, x = at.T - 0.5
    here = subject.tone[np.clip(y.astype(int), 0, n - 1), np.clip(x.astype(int), 0, n - 1)]
    radius = n / 512 * (1.05 + 1.0 * (1 - here)) * rng.uniform(0.85, 1.15, count)
    paper = from_hex("fbf8ef")[0] * (0.985 + 0.015 * paper_grain(rng, n, n / 300)[..., None])
    return np.clip(mixed(paper, from_hex("1f2f86")[0], discs(n, y, x, radius)), 0, 1)


def cross_hatching(rng: Generator, n: int) -> Floats:
    """Draw pen lines, in up to four directions in the dark: sepia on tan paper, heightened with white."""
    m = 2 * n  # drawn twice as large: lines are thinner than a pixel
    subject = still_life(rng, m)
    y, x = np.mgrid[:m, :m].astype(np.float32)
    unit = m / 512
    ink = np.zeros((m, m), np.float32)
    layers = ((-0.75, 0.82, 7.0), (0.7, 0.56, 6.6), (0.02, 0.36, 6.2), (1.5, 0.2, 5.6))
    for turn, below, pitch in layers:
        bend = 5 * unit * smooth(rng, m, 0.09 * m) + 0.5 * unit * smooth(rng, m, 4 * unit)
        # The lines bend, as if they lay on the form.
        across = (x * np.sin(turn) - y * np.cos(turn) + bend) / (pitch * unit)
        wanted = below - subject.tone + 0.05 * smooth(rng, m, 9 * unit)
        width = np.clip(0.55 + 2.4 * wanted, 0, 1.35) * (wanted > 0)
        away = np.abs(across % 1 - 0.5) * pitch * unit
        ink = np.maximum(ink, np.clip(width * unit - away + 0.5, 0, 1))
    contour = gaussian_filter(subject.outline.astype(np.float32), 0.8 * unit) * 3.2 * unit
    ink = np.maximum(ink, np.clip(contour * (0.7 + 0.5 * smooth(rng, m, 20 * unit)), 0, 1))
    lights = np.clip((subject.tone - 0.8) * 6, 0, 1)
    away = np.abs(((x * 0.7 + y * 0.7 + 3 * unit * smooth(rng, m, 0.1 * m)) / (6 * unit)) % 1 - 0.5) * 6 * unit
    chalk = np.clip(1.5 * lights * unit - away + 0.5, 0, 1) * (paper_grain(rng, m, unit) > 0.25)
    fibres = 0.94 + 0.06 * paper_grain(rng, m, 1.2 * unit)[..., None]
    drawn = mixed(from_hex("cda877")[0] * fibres, from_hex("fdf6e6")[0], 0.9 * chalk)
    drawn = mixed(drawn, from_hex("3a1f12")[0], 0.95 * ink)
    return np.clip(drawn.reshape(n, 2, n, 2, 3).mean((1, 3)), 0, 1).astype(np.float32)


def charcoal(rng: Generator, n: int) -> Floats:
    """Rub black chalk into rough paper, draw over it in broad strokes, and lift out lights with an eraser."""
    subject = hills(rng, n, 5, steep=0.16, fall=0.9)
    unit = n / 512
    grain = paper_grain(rng, n, 1.0 * unit)
    smudged = gaussian_filter(subject.tone, 6 * unit) + 0.05 * smooth(rng, n, 20 * unit)
    dust = np.clip(0.9 - smudged, 0, 1) * (0.32 + 0.66 * grain)
    lines = streamed(smooth(rng, n, 1.3 * unit), subject.angle - 0.9, 26 * unit)
    wanted = np.clip(1.02 - subject.tone - 0.1, 0, 1)
    strokes = np.clip((wanted - 0.62 * lines - 0.35 * grain + 0.1) * 5, 0, 1)
    edge = gaussian_filter(subject.outline.astype(np.float32), 1.6 * unit) * 4.5 * unit
    edge *= np.clip(0.8 + 0.7 * smooth(rng, n, 25 * unit), 0.1, 2)
    contour = np.clip((edge - 0.55 * grain) * 2.5, 0, 1)
    cover = np.clip(dust + 0.8 * strokes * (1 - dust) + 0.85 * contour, 0, 1)
    rubbed = np.clip((streamed(smooth(rng, n, 5 * unit), 0 * lines - 0.5, 20 * unit) - 0.9) * 9, 0, 1)
    cover *= 1 - 0.75 * rubbed * (subject.part < 2)
    laid = 0.97 + 0.03 * np.cos(np.arange(n) / (2.6 * unit) * 2 * np.pi)[:, None, None] * grain[..., None]
    return np.clip(mixed(from_hex("d6d4d0")[0] * laid, from_hex("232224")[0], cover), 0, 1)


def pastel(rng: Generator, n: int) -> Floats:
    """Draw with soft chalks on rough dark paper that shows between strokes: rose, lilac, peach, a little turquoise."""
    subject = hills(rng, n, 5, steep=0.09)
    unit = n / 512
    grain = paper_grain(rng, n, 1.1 * unit)
    sets = [  # for each part a dark, a middle and a light chalk
        ("b98ac9", "f2a7b5", "ffd9b8"), ("ffc76b", "ffe7a3", "fff7da"), ("8c7fc0", "b59fd6", "d9c3ea"),
        ("6d74b8", "9a8fce", "c9a9d8"), ("4f7fa8", "6fa9b8", "a8d3cf"), ("466a8c", "5b94a0", "8cc4b4"),
        ("3d4f7c", "55729c", "79a6a8"),
    ]  # fmt: skip
    colours = np.stack([from_hex(*codes) for codes in sets])
    tone = np.empty((n, n), np.float32)
    for number in range(len(sets)):
        here = subject.part == number
        tone[here] = rank(subject.tone[here] + 0.05 * smooth(rng, n, 0.03 * n)[here])
    canvas = Canvas(np.tile(from_hex("4b4358")[0], (n, n, 1)))
    for width, gap, tooth in ((9, 1.3, 0.38), (6, 1.5, 0.55), (3.5, 2.4, 0.6)):
        length = 5.5 * width
        canvas.tooth = np.clip((grain - tooth + 0.45) * 1.6, 0.07, 1)
        count = int(n * n / (4 * width * length * unit * unit) * 6 / gap)
        for y, x in rng.uniform(0, n, (count, 2)):
            iy, ix = int(y), int(x)
            part = subject.part[iy, ix]
            shade = np.clip(tone[iy, ix] + 0.2 * rng.normal(), 0, 1)
            colour = colours[part][int(np.clip(shade * 3, 0, 2))] + rng.normal(0, 0.03, 3)
            angle = subject.angle[iy, ix] + (0.35 if part > 1 else -0.5) + rng.normal(0, 0.12)
            reach = length * unit * (0.35 if part == 1 else rng.uniform(0.5, 1.0))
            dab = Dab(y, x, angle, reach, width * unit, rng.normal(0, 0.06))
            canvas.dab(rng, dab, np.clip(colour, 0, 1), 0.25, 0.85)
    return np.clip(canvas.colours, 0, 1).astype(np.float32)


def _leaf(rng: Generator, n: int, y: float, x: float, angle: float, length: float, wide: float) -> Floats:
    """Return the cover (n, n) of one brush stroke, pressed and lifted, with a pointed end."""
    gy, gx = np.mgrid[:n, :n].astype(np.float32)
    u = ((gx - x) * np.cos(angle) + (gy - y) * np.sin(angle)) / length
    v = (gy - y) * np.cos(angle) - (gx - x) * np.sin(angle) - rng.normal(0, 0.06) * length * u**2
    belly = wide * np.clip(u, 0, 1) ** 0.45 * np.clip(1 - u, 0, 1) ** 0.8 * 1.8
    return np.clip(belly - np.abs(v) + 0.5, 0, 1) * ((u > 0) & (u < 1))


def ink_wash(rng: Generator, n: int) -> Floats:
    """Paint a sumi-e: mountains in mist and bamboo, in washes of one ink, with the painter's red seal."""
    unit = n / 512
    y, x = np.mgrid[:n, :n].astype(np.float32) / n
    fibres = paper_grain(rng, n, 1.2 * unit)
    ink = 0.05 * np.clip(smooth(rng, n, 0.12 * n), 0, 2)
    subject = hills(rng, n, 4, steep=0.2, fall=1.0)
    for number in range(2, 6):
        top = np.where(subject.part >= number, 1.0, 0.0).argmax(0) / n  # where the ridge begins, (n,)
        wobble = 0.006 * smooth(rng, n, 3 * unit) + 0.01 * smooth(rng, n, 12 * unit)
        depth = y - top[None] + wobble
        strength = 0.14 + 0.17 * (number - 2)
        wash = np.clip(depth / 0.006, 0, 1) * np.exp(-np.maximum(depth, 0) / (0.10 + 0.03 * number))
        texture = 0.75 + 0.35 * rank(smooth(rng, n, 5 * unit) + smooth(rng, n, 18 * unit))
        rim = 0.5 * np.exp(-((depth / 0.008) ** 2))  # pigment gathers where a wash ends
        ink = np.maximum(ink, strength * (wash + rim * wash) * texture)
    dry = streamed(smooth(rng, n, 0.8 * unit), np.full((n, n), np.pi / 2, np.float32), 40 * unit)
    for cx, wide, lean in ((0.16, 0.021, 0.05), (0.27, 0.013, -0.04)):
        bottom = 1.02
        while bottom > -0.05:
            top = bottom - rng.uniform(0.17, 0.25)
            middle = cx + lean * (1 - (bottom + top) / 2)
            across = (x - middle - lean * ((bottom + top) / 2 - y)) / wide
            along = (y - top) / (bottom - top)
            half = 1 + 0.3 * (2 * along - 1) ** 8
            stalk = np.clip((half - np.abs(across)) * wide * n + 0.5, 0, 1) * ((along > 0.02) & (along < 0.98))
            body = (0.5 + 0.35 * np.abs(across) ** 2) * np.clip(1.25 - 0.8 * dry * (1 - np.abs(across) * 0.6), 0, 1)
            ink = np.where(stalk > 0, np.maximum(ink * (1 - stalk), stalk * body), ink)
            bottom = top - 0.004
            for _ in range(rng.integers(1, 4)):
                turn = rng.choice([0.55, 2.4]) + rng.normal(0, 0.35)
                long = rng.uniform(0.13, 0.23) * n
                start = (top * n + rng.normal(0, 6 * unit), middle * n + rng.normal(0, 5 * unit))
                leaf = _leaf(rng, n, *start, turn, long, 0.085 * long)
                ink = np.maximum(ink, leaf * rng.uniform(0.62, 0.97) * (0.88 + 0.2 * (dry - 0.5)))
    ink = np.clip(ink * (0.92 + 0.16 * (1 - fibres)), 0, 1)
    paper = from_hex("f2ecdd")[0] * (0.97 + 0.03 * fibres[..., None])
    picture = mixed(paper, from_hex("14171f")[0], ink**0.9)
    top_, left, side = 0.83, 0.83, 0.085
    seal = (np.abs(y - top_ - side / 2) < side / 2) & (np.abs(x - left - side / 2) < side / 2)
    u, v = (x - left) / side, (y - top_) / side
    marks = (np.abs(u - 0.5) < 0.05) | (np.abs(v - 0.3) < 0.05) | ((np.abs(v - 0.68) < 0.05) & (np.abs(u - 0.5) < 0.32))
    marks &= (np.abs(u - 0.5) < 0.37) & (np.abs(v - 0.5) < 0.37)
    red = gaussian_filter((seal & ~marks) * (fibres > 0.06) * 0.95, 0.5 * unit)
    return np.clip(mixed(picture, from_hex("c4281f")[0], red), 0, 1)
