"""Prints and mosaic of the gallery: woodcut, screen print, mosaic. Letters as in ``subjects``."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, shift
from scipy.spatial import cKDTree

from svv.styles.gallery.drawings import mixed, paper_grain, streamed
from svv.styles.gallery.subjects import flowers, hills, sea
from svv.styles.gallery.textures import Floats, from_hex, rank, smooth


def woodcut(rng: Generator, n: int) -> Floats:
    """Print a black block, its lights cut with a gouge along the form, over flat blocks of red and indigo."""
    m = 2 * n
    unit = m / 512
    subject = sea(rng, m)
    cuts = streamed(smooth(rng, m, 1.7 * unit), subject.angle, 34 * unit)
    sky = subject.part == 0
    # Long gouges: the amount of black follows the tone, but the waves are never entirely black or white.
    tone = np.where(sky, 0.8 + 0.1 * subject.tone, np.clip(0.2 + 0.95 * subject.tone, 0.2, 0.8))
    tone = np.where(subject.part == 4, 1.0, np.where(subject.part == 1, 1.0, tone))
    tone = np.where(subject.part == 2, 1.0, tone)
    black = np.clip((cuts - tone) * 22 + 0.5, 0, 1)
    outline = np.clip(gaussian_filter(subject.outline.astype(np.float32), 1.1 * unit) * 5 * unit - 0.35, 0, 1)
    black = np.maximum(black, outline * (subject.part != 0) + outline * (subject.part == 0))
    y, x = np.mgrid[:m, :m] / m
    rim = np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y)) + 0.0015 * smooth(rng, m, 3 * unit)
    black = np.where(rim < 0.022, 1.0, black)
    margin = rim < 0.008
    grain = rank(gaussian_filter(rng.normal(size=(m, m)), (0.7 * unit, 30 * unit)))  # of the plank
    red, blue = (subject.part == 1).astype(float), (subject.part == 3) * 1.0
    paper = from_hex("f3d78f")[0] * (0.96 + 0.04 * paper_grain(rng, m, unit)[..., None])
    print_ = mixed(paper, from_hex("d8391e")[0], shift(red, (1.5 * unit, -1 * unit), order=1) * (0.86 + 0.14 * grain))
    print_ = mixed(print_, from_hex("2f6da8")[0], blue * (0.7 + 0.25 * grain))
    print_ = mixed(print_, from_hex("14110f")[0], black * (grain > 0.015) * 0.97)
    print_ = np.where(margin[..., None], paper, print_)
    return np.clip(print_.reshape(n, 2, n, 2, 3).mean((1, 3)), 0, 1).astype(np.float32)


def screen_print(rng: Generator, n: int) -> Floats:
    """Print flat, loud inks with dots for shades, slightly out of register: pink, cyan, yellow and black."""
    m = 2 * n
    unit = m / 512
    subject = flowers(rng, m, 6)
    y, x = np.mgrid[:m, :m].astype(np.float32)

    def dots(turn: float, pitch: float, amount: NDArray[np.generic]) -> Floats:
        u = (x * np.cos(turn) + y * np.sin(turn)) / (pitch * unit)
        v = (y * np.cos(turn) - x * np.sin(turn)) / (pitch * unit)
        away = np.hypot(u - np.rint(u), v - np.rint(v))
        return np.clip((np.sqrt(np.clip(amount, 0, 1)) * 0.66 - away) * pitch * unit + 0.5, 0, 1)

    flat = from_hex("18b6c9", "ffd400", "ff7a00", "ff2f92", "fff3df", "ffd400")
    print_ = np.ones((m, m, 3), np.float32) * from_hex("fff8ea")[0]
    for number, colour in enumerate(flat):
        off = rng.uniform(-2.2, 2.2, 2) * unit
        block = shift((subject.part == number).astype(np.float32), off, order=1)
        if number == 1:  # leaves: cyan dots on yellow make green
            print_ = mixed(print_, from_hex("b5d334")[0], block)
        else:
            print_ = mixed(print_, colour, block)
    shade = np.clip(1.15 - 1.7 * subject.tone, 0, 1)
    print_ = mixed(print_, from_hex("e0147a")[0], dots(0.35, 8.5, shade * (subject.part >= 3)))
    print_ = mixed(print_, from_hex("0b4f9c")[0], dots(1.1, 8.5, 0.75 * shade * (subject.part <= 1)))
    edge = gaussian_filter(subject.outline.astype(np.float32), 1.3 * unit) * 4.6 * unit
    black = np.clip((edge - 0.45) * 3, 0, 1)
    black = np.maximum(black, (subject.part == 2) * np.clip((0.42 - subject.tone) * 9, 0, 1))
    black = shift(black, (2.0 * unit, -1.6 * unit), order=1)
    worn = paper_grain(rng, m, 1.1 * unit) > 0.03
    print_ = mixed(print_, from_hex("171418")[0], black * worn)
    return np.clip(print_.reshape(n, 2, n, 2, 3).mean((1, 3)), 0, 1).astype(np.float32)


def mosaic(rng: Generator, n: int) -> Floats:
    """Set small stones along the forms, gold, lapis and terracotta, in pale mortar (Hausner 2001)."""
    subject = hills(rng, n, 4, steep=0.1, fall=1.3)
    side = n / 512 * 12.5
    y, x = np.mgrid[:n, :n].astype(np.float32)
    sun_y, sun_x = np.argwhere(subject.part == 1).mean(0)
    angle = subject.angle.copy()
    around = np.arctan2(y - sun_y, x - sun_x) + np.pi / 2
    sky = subject.part <= 1
    angle[sky] = around[sky]  # rays and rings about the sun
    for number in range(2, 6):  # rows of stones follow the ridge above them
        top = np.where(subject.part >= number, 1, 0).argmax(0).astype(np.float32)
        slope = np.arctan(gaussian_filter(np.gradient(gaussian_filter(top, 6)), 4))
        here = subject.part == number
        angle[here] = np.broadcast_to(slope, (n, n))[here]
    pitch = side * 1.02
    at = np.mgrid[0 : n + pitch : pitch, 0 : n + pitch : pitch].reshape(2, -1).T + rng.normal(0, 0.2 * side, (1, 2))
    at = at + rng.normal(0, 0.12 * side, at.shape)
    places = np.stack([y.ravel(), x.ravel()], 1)

    def frames() -> tuple[Floats, Floats]:
        iy, ix = np.clip(at.astype(int), 0, n - 1).T
        return np.cos(angle[iy, ix]), np.sin(angle[iy, ix])

    def owners() -> tuple[Floats, Floats, Floats]:
        """Return distances to the nearest and second stone in the stones' square frames, and the nearest stone."""
        c, s = frames()
        index = cKDTree(at).query(places, k=6)[1]
        dy, dx = (places[:, None] - at[index]).transpose(2, 0, 1)
        far = np.maximum(np.abs(dx * c[index] + dy * s[index]), np.abs(dy * c[index] - dx * s[index]))
        order = np.argsort(far, 1)[:, :2]
        best = np.take_along_axis(far, order, 1)
        return best[:, 0], best[:, 1], np.take_along_axis(index, order, 1)[:, 0]

    for _ in range(9):
        owner = owners()[2]
        mass = np.maximum(np.bincount(owner, minlength=len(at)), 1)
        sums = np.stack([np.bincount(owner, places[:, k], len(at)) for k in (0, 1)], 1)
        at = np.where(np.bincount(owner, minlength=len(at))[:, None] > 0, sums / mass[:, None], at)
    first, second, owner = owners()
    iy, ix = np.clip(at.astype(int), 0, n - 1).T
    sets = ("d9a520 f0c64a b8860b", "fff3c4 ffe08a fbd15b", "8fb3cf 6c9cc4 b9d0de", "2f6fae 1f4f96 4f8cc0",
            "1d2f73 16235c 2c4a9a", "b4472c 8f2f22 cc6a3c")  # fmt: skip
    colours = np.stack([from_hex(*s.split()) for s in sets])
    stone = colours[subject.part[iy, ix], rng.integers(0, 3, len(at))]
    stone = stone * np.clip(0.72 + 0.45 * subject.tone[iy, ix] + rng.normal(0, 0.07, len(at)), 0.4, 1.25)[:, None]
    away = np.clip((second - first).reshape(n, n), 0, None)
    joint = np.minimum(away - 1.0 * side / 12.5, (0.50 * side - first.reshape(n, n)) * 1.3)
    cover = np.clip(joint / 1.4 + 0.5, 0, 1)
    body = stone[owner].reshape(n, n, 3) * (0.95 + 0.05 * paper_grain(rng, n, 1.5)[..., None])
    height = gaussian_filter(cover, 0.9)
    dy, dx = np.gradient(height)
    tilt = rng.normal(0, 0.05, (len(at), 2))[owner].reshape(n, n, 2)
    light = 1 + 0.35 * (dx + dy) + tilt[..., 0] * 1.0
    mortar = from_hex("cbbfa8")[0] * (0.8 + 0.12 * paper_grain(rng, n, 0.8)[..., None])
    return np.clip(mixed(mortar, body * light[..., None], cover), 0, 1)
