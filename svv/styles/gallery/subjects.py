"""Subjects of the gallery's pictures: lightness, part of the motif and direction of strokes of each pixel.

:mod:`svv.styles.gallery.drawings`, ``prints`` and ``paintings`` do the rest. Letters: n is the side of the picture in
pixels, rng the random generator; y runs down, x to the right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from svv.styles.gallery.textures import Floats, smooth


@dataclass(frozen=True)
class Subject:
    """A motif before it is painted."""

    tone: Floats
    """Lightness of each pixel, 0 to 1. (n, n)"""
    part: NDArray[np.int64]
    """Number of the part of the motif that each pixel belongs to, from 0; equal numbers look alike. (n, n)"""
    angle: Floats
    """Direction of a stroke that follows the form, in radians from x towards y. (n, n)"""

    @property
    def outline(self) -> NDArray[np.bool_]:
        """Pixels on the border to another part. (n, n)"""
        p = self.part
        edge = np.zeros(p.shape, bool)
        edge[1:] |= p[1:] != p[:-1]
        edge[:, 1:] |= p[:, 1:] != p[:, :-1]
        return edge


def _grid(n: int) -> tuple[Floats, Floats]:
    y, x = np.mgrid[:n, :n].astype(np.float32) / n
    return y, x


def _line(rng: Generator, n: int, waves: int, fall: float) -> Floats:
    """Return a random line (n,), a sum of waves whose amplitude falls as frequency^-fall; in [-1, 1]."""
    x = np.arange(n) / n
    k = np.arange(1, waves + 1)
    sines = np.sin(2 * np.pi * k[:, None] * x * rng.uniform(0.7, 1.1) + rng.uniform(0, 6.3, (waves, 1)))
    line = (k[:, None] ** -fall * sines).sum(0)
    return (line / np.abs(line).max()).astype(np.float32)


def hills(rng: Generator, n: int, ridges: int = 5, steep: float = 0.1, fall: float = 1.1) -> Subject:
    """Return ridges behind each other under a low sun. Parts: 0 sky, 1 sun, then the ridges from the farthest."""
    y, x = _grid(n)
    tone, part = 0.62 + 0.5 * y, np.zeros((n, n), np.int64)
    angle = 0.15 * smooth(rng, n, 0.15 * n)
    sun = np.hypot(x - rng.uniform(0.6, 0.75), y - 0.2) < 0.095
    tone[sun], part[sun] = 1.0, 1
    for k in range(ridges):
        far = k / max(ridges - 1, 1)
        line = 0.34 + 0.46 * far + steep * (1.15 - 0.7 * far) * _line(rng, n, 9, fall)
        slope = np.gradient(line) * n
        depth = y - line
        below = depth > 0
        light = 0.7 - 0.55 * far - 0.14 * np.tanh(1.5 * slope)[None] + 0.9 * np.minimum(depth, 0.3) * (1 - 0.7 * far)
        tone[below], part[below] = light[below], 2 + k
        follow = np.broadcast_to(np.arctan(slope)[None], (n, n)) * np.exp(-4 * np.maximum(depth, 0))
        angle[below] = (follow + 0.12 * smooth(rng, n, 0.08 * n))[below]
    return Subject(np.clip(tone, 0, 1).astype(np.float32), part, angle.astype(np.float32))


def sea(rng: Generator, n: int) -> Subject:
    """Return waves with curling crests under a round sun. Parts: 0 sky, 1 sun, 2 clouds, 3 dark water, 4 foam."""
    y, x = _grid(n)
    tone, part = 0.75 + 0.3 * y, np.zeros((n, n), np.int64)
    angle = np.zeros((n, n), np.float32)
    sun = np.hypot(x - 0.3, y - 0.2) < 0.12
    tone[sun], part[sun] = 0.55, 1
    for cy, cx, wide in ((0.1, 0.72, 0.2), (0.16, 0.86, 0.16), (0.27, 0.12, 0.16)):
        cloud = ((x - cx) / wide) ** 2 + ((y - cy) / 0.035) ** 2 < 1 + 0.35 * np.sin(22 * x)
        tone[cloud], part[cloud] = 0.97, 2
    for near in (k / 6 for k in range(7)):
        length, height = 0.16 + 0.3 * near, 0.02 + 0.075 * near
        phase = (x + rng.uniform(0, 1)) / length + 0.3 * height * np.sin(9 * x)
        # A trochoid: sharp crests and wide troughs, leaning forwards.
        turn = 2 * np.pi * (phase + 0.16 * np.sin(2 * np.pi * phase))
        crest = 1 - 2 * np.abs(np.sin(turn / 2)) ** 0.8
        line = 0.4 + 0.55 * near**1.15 - height * crest
        depth = y - line
        body, foam = depth > 0, (depth > 0) & (depth < (0.008 + 0.02 * near) * (1.1 + crest))
        light = 0.55 - 0.25 * near - 0.9 * np.minimum(depth, 0.25) + 0.12 * crest
        tone[body], part[body] = light[body], 3
        tone[foam], part[foam] = 0.95, 4
        slope = np.gradient(line, axis=1) * n
        angle[body] = (np.arctan(slope) * np.exp(-5 * np.maximum(depth, 0)))[body]
    return Subject(np.clip(tone, 0, 1).astype(np.float32), part, angle)


def still_life(rng: Generator, n: int) -> Subject:
    """Return a bottle and fruit on a table, lit from the upper left. Parts: 0 wall, 1 table, 2 bottle, 3 to 6 fruit."""
    y, x = _grid(n)
    tone = np.clip(0.72 - 0.38 * np.hypot(x - 0.2, y - 0.25) + 0.03 * smooth(rng, n, 0.1 * n), 0, 1)
    part, angle = np.zeros((n, n), np.int64), np.full((n, n), -0.9, np.float32)
    table = y > 0.63
    tone[table], part[table], angle[table] = (0.86 - 0.3 * (x + y - 0.63))[table], 1, 0.05
    fruit = [(0.27, 0.68, 0.135, 3), (0.79, 0.66, 0.12, 4), (0.55, 0.75, 0.145, 5), (0.4, 0.83, 0.085, 6)]
    for cx, cy, r, _ in [*fruit, (0.6, 0.6, 0.11, 2)]:
        dy, dx = (y - cy - 0.85 * r) / (0.32 * r), (x - cx - 0.75 * r) / (1.5 * r)
        tone = np.where(table, tone * (1 - 0.75 * np.clip(1.3 - np.hypot(dx, dy), 0, 1)), tone)
    height = np.clip((y - 0.1) / 0.57, 0, 1)
    half = 0.035 + 0.07 / (1 + np.exp(-28 * (height - 0.42)))
    half = np.where(height < 0.06, 0.045, half)
    across = (x - 0.6) / half
    bottle = (np.abs(across) < 1) & (y > 0.1) & (y < 0.665 + 0.02 * np.sqrt(np.clip(1 - across**2, 0, 1)))
    shine = 0.7 * np.exp(-(((across + 0.45) / 0.14) ** 2)) * (height > 0.12)
    glass = 0.12 + 0.3 * np.sqrt(np.clip(1 - across**2, 0, 1)) * (1 - across) / 2 + shine
    tone[bottle], part[bottle], angle[bottle] = glass[bottle], 2, (0.35 * across)[bottle]
    for cx, cy, r, number in fruit:
        dx, dy = (x - cx) / r, (y - cy) / r
        inside = dx**2 + dy**2 < 1
        z = np.sqrt(np.clip(1 - dx**2 - dy**2, 0, 1))
        light = np.clip(-0.5 * dx - 0.58 * dy + 0.64 * z, 0, 1)
        back = 0.16 * np.clip(dx + dy - 0.6, 0, 1)  # light reflected by the table
        ball = 0.08 + 0.78 * light**0.9 + 0.5 * light**24 + back
        tone[inside], part[inside] = ball[inside], number
        angle[inside] = (np.arctan2(dy + 0.58, dx + 0.5) + np.pi / 2)[inside]
    return Subject(np.clip(tone, 0, 1).astype(np.float32), part, angle)


def flowers(rng: Generator, n: int, count: int = 9) -> Subject:
    """Return round blossoms over leaves. Parts: 0 ground, 1 leaves, 2 centres, 3 to 5 petals of three kinds."""
    y, x = _grid(n)
    tone = np.clip(0.35 + 0.1 * smooth(rng, n, 0.07 * n), 0, 1)
    part = np.zeros((n, n), np.int64)
    angle = smooth(rng, n, 0.12 * n)
    for cy, cx in rng.random((60, 2)):
        turn, long = rng.uniform(0, np.pi), rng.uniform(0.07, 0.13)
        u = (x - cx) * np.cos(turn) + (y - cy) * np.sin(turn)
        v = (y - cy) * np.cos(turn) - (x - cx) * np.sin(turn)
        leaf = (np.abs(u) < long) & (np.abs(v) < 0.33 * long * (1 - (u / long) ** 2))
        light = 0.42 + 0.22 * np.sign(v) * (np.abs(v) > 0.004) + 0.1 * rng.normal()
        tone[leaf], part[leaf], angle[leaf] = light[leaf], 1, turn
    places: list[tuple[float, float, float]] = []
    while len(places) < count:
        cy, cx = rng.uniform(0.02, 0.98, 2)
        r = rng.uniform(0.11, 0.19) * (9 / count) ** 0.5
        tries = 1.0 - 0.02 * len(places)
        if all(np.hypot(cy - b, cx - a) > 0.8 * tries * (r + q) for b, a, q in places) or rng.random() < 0.01:
            places.append((cy, cx, r))
    for number, (cy, cx, r) in enumerate(places):
        dy, dx = y - cy, x - cx
        radius, around = np.hypot(dx, dy) / r, np.arctan2(dy, dx)
        petals, start = rng.integers(6, 11), rng.uniform(0, 6.3)
        wave = np.abs(np.cos(petals * (around - start) / 2))
        inside, heart = radius < 0.72 + 0.28 * wave**0.6, radius < 0.27
        light = 0.5 + 0.35 * radius * wave**0.5 - 0.22 * (wave < 0.25) + 0.12 * np.cos(around + 2.3)
        tone[inside], part[inside], angle[inside] = light[inside], 3 + number % 3, around[inside]
        tone[heart], part[heart] = (0.25 + 1.2 * radius - 0.35 * np.cos(around - 0.8) * radius)[heart], 2
        angle[heart] = (around + np.pi / 2)[heart]
    return Subject(np.clip(tone, 0, 1).astype(np.float32), part, angle.astype(np.float32))
