"""MatCaps: pictures of a lit sphere, from which a surface takes the colour of the place that faces the same way.

(Sloan et al. 2001, "The lit sphere"; Bruckner and Groeller 2007, "Style transfer functions".) The pictures here are
computed: a sphere of a material under a key light at the upper left, a fill light and a studio that it reflects.
Letters: S samples, H and W rows and columns of a picture, N pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.light import LEAST_COSINE
from svv.core.colour.srgb import encoded

if TYPE_CHECKING:
    from torch import Tensor

SIDE = 256
"""Side of the pictures in pixels."""

BEHIND = -0.35
"""Cosine between a normal and the direction to the viewer below which the surface is seen from inside, and turned: just
behind the rim, the colours of the rim continue."""

INSET = 0.985
"""Radius of the sphere that is looked up, as a fraction of half the picture: rims of photographs have dark edges."""

KEY, FILL = (-0.45, 0.62, 0.64), (0.75, -0.15, 0.5)
"""Directions towards the key light and the fill light, x to the right, y up, z to the viewer."""

Floats = NDArray[np.float64]


def matcap_colours(normal: Tensor, facing: Tensor, up: Tensor, picture: Tensor) -> Tensor:
    """Return the sRGB colours in [0, 1] of a MatCap for normals, as seen by their viewers. (S, 3)

    The axes of each look-up are perpendicular to its own ray, so under perspective a sphere looks the same wherever it
    is in the image. Normals (S, 3), of either sign, shorter than 1 away from surfaces, are looked up nearer to the
    middle. ``facing``: unit vectors towards the viewer (S, 3); ``up``: the camera's axis (3,); ``picture``: sRGB, row 0
    at the top (H, W, 3).

    >>> import torch
    >>> picture = torch.rand(9, 9, 3)
    >>> front = torch.tensor([[0.0, 0.0, 1.0]])
    >>> bool(torch.allclose(matcap_colours(front, front, torch.tensor([0.0, 1.0, 0.0]), picture)[0], picture[4, 4]))
    True
    """
    import torch

    right = torch.linalg.cross(up.expand_as(facing), facing)
    right = right / right.norm(dim=1, keepdim=True).clamp(min=LEAST_COSINE)
    above = torch.linalg.cross(facing, right)
    side = torch.where((normal * facing).sum(1) < BEHIND, -1.0, 1.0)
    x, y = side * (normal * right).sum(1), side * (normal * above).sum(1)
    shrink = INSET / torch.stack([x, y]).norm(dim=0).clamp(min=1.0)
    height, width = picture.shape[:2]
    column = (0.5 + 0.5 * shrink * x) * (width - 1)
    row = (0.5 - 0.5 * shrink * y) * (height - 1)
    left, top = column.floor().clamp(0, width - 2), row.floor().clamp(0, height - 2)
    across, down = (column - left)[:, None], (row - top)[:, None]
    first = top.long() * width + left.long()
    flat = picture.reshape(-1, 3)
    upper = torch.lerp(flat[first], flat[first + 1], across)
    lower = torch.lerp(flat[first + width], flat[first + width + 1], across)
    return torch.lerp(upper, lower, down)


@lru_cache(maxsize=16)
def matcap_picture(name: str, side: int = SIDE) -> NDArray[np.float32]:
    """Return one of :data:`MATCAPS`, float32 sRGB in [0, 1]; raises KeyError for any other name. (side, side, 3)"""
    x = (2.0 * np.arange(side) + 1.0) / side - 1.0
    place = np.stack(np.broadcast_arrays(x[None, :], -x[:, None]), axis=-1).reshape(-1, 2) / INSET
    place = place / np.maximum(np.linalg.norm(place, axis=1, keepdims=True), 1.0)
    depth = np.sqrt(np.maximum(1.0 - np.square(place).sum(1), 0.0))
    colour = MATCAPS[name][0](np.column_stack([place, depth]))
    found = np.clip(encoded(colour), 0.0, 1.0).reshape(side, side, 3).astype(np.float32)
    found.setflags(write=False)
    return found


def _unit(direction: Sequence[float]) -> Floats:
    return np.asarray(direction, np.float64) / np.linalg.norm(direction)


def _lit(normal: Floats, direction: Sequence[float], wrap: float = 0.0) -> Floats:
    """Return how much of a light arrives, in [0, 1]; ``wrap``: how far it reaches around the sphere. (N, 1)"""
    return np.clip((normal @ _unit(direction) + wrap) / (1.0 + wrap), 0.0, 1.0)[:, None]


def _shine(normal: Floats, direction: Sequence[float], power: float) -> Floats:
    """Return a highlight (Blinn 1977) in [0, 1]. (N, 1)"""
    half = _unit(_unit(direction) + np.array([0.0, 0.0, 1.0]))
    return np.clip(normal @ half, 0.0, 1.0)[:, None] ** power


def _rim(normal: Floats, power: float) -> Floats:
    """Return how far a place faces away from the viewer, in [0, 1]. (N, 1)"""
    return (1.0 - normal[:, 2:]) ** power


def _step(value: Floats, edge: float, width: float) -> Floats:
    """Return a soft step from 0 to 1 around an edge."""
    t = np.clip((value - edge) / width + 0.5, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _mixed(low: Sequence[float], high: Sequence[float], share: Floats) -> Floats:
    return np.asarray(low) * (1.0 - share) + np.asarray(high) * share


def _studio(normal: Floats) -> Floats:
    """Return the light of a studio from where a mirror reflects it: a softbox, a bright wall, a dark floor. (N, 1)"""
    z = normal[:, 2:]
    mirrored = 2.0 * z * normal - np.array([0.0, 0.0, 1.0])
    height = mirrored[:, 1:2]
    room = 0.10 + 0.55 * _step(height, 0.05, 0.5) - 0.25 * _step(height, 0.75, 0.5)
    box = _step(mirrored[:, :1] + 0.95, 0.35, 0.25) * (1.0 - _step(mirrored[:, :1] + 0.95, 0.95, 0.25))
    box = box * _step(height, 0.35, 0.2) * (1.0 - _step(height, 0.92, 0.15))
    return np.asarray(room + 2.2 * box)


def _clay(n: Floats) -> Floats:
    light = 0.07 + 0.95 * _lit(n, KEY, 0.1) ** 1.2 + 0.12 * _lit(n, FILL)
    return np.asarray([0.60, 0.225, 0.115] * light * (1.0 - 0.5 * _rim(n, 3.0)) + 0.03 * _shine(n, KEY, 8.0))


def _wax(n: Floats) -> Floats:
    deep, near = _lit(n, KEY, 0.9), _lit(n, KEY, 0.1)
    body = np.array([0.80, 0.22, 0.04]) * deep**2.4 * 0.62 + np.array([0.50, 0.38, 0.16]) * near**1.3 * 0.7
    return np.asarray(np.array([0.03, 0.009, 0.004]) + body + 0.30 * _shine(n, KEY, 30.0) + 0.07 * _rim(n, 3.0))


def _bronze(n: Floats) -> Floats:
    tint = _mixed((0.62, 0.33, 0.13), (1.0, 0.78, 0.52), _rim(n, 3.0))
    return np.asarray(tint * (_studio(n) * 0.85 + 0.10 * _lit(n, KEY, 0.3)) + [0.012, 0.006, 0.003])


def _jade(n: Floats) -> Floats:
    deep = _lit(n, KEY, 1.0)
    body = _mixed((0.002, 0.022, 0.014), (0.10, 0.40, 0.19), deep**2.2)
    glow = np.array([0.16, 0.34, 0.10]) * _lit(n, (0.55, -0.75, 0.2), 0.1) ** 2.5 * 0.55
    return np.asarray(body + glow + 0.85 * _shine(n, KEY, 160.0) + 0.10 * _shine(n, KEY, 18.0) + 0.10 * _rim(n, 3.5))


def _porcelain(n: Floats) -> Floats:
    light = _lit(n, KEY, 0.35)
    body = _mixed((0.13, 0.16, 0.24), (0.84, 0.83, 0.80), light**1.1)
    return np.asarray(body * (1.0 - 0.35 * _rim(n, 4.0)) + _studio(n) * (0.05 + 0.22 * _rim(n, 4.0)))


def _chalk(n: Floats) -> Floats:
    light = 0.17 + 0.68 * _lit(n, KEY, 0.5) ** 1.4 + 0.06 * _lit(n, FILL, 0.4)
    return np.asarray([0.95, 0.92, 0.85] * light * (1.0 - 0.6 * _rim(n, 3.0)))


def _toon(n: Floats) -> Floats:
    light = _lit(n, KEY, 0.0)
    body = _mixed((0.035, 0.10, 0.30), (0.08, 0.27, 0.66), _step(light, 0.16, 0.03))
    body = body + (np.array([0.30, 0.58, 0.90]) - body) * _step(light, 0.62, 0.03)
    body = body + (1.0 - body) * _step(_shine(n, KEY, 60.0), 0.55, 0.08)
    return np.asarray(body * _step(n[:, 2:], 0.24, 0.05) + 0.008)


def _x_ray(n: Floats) -> Floats:
    return np.asarray(np.array([0.005, 0.015, 0.035]) + np.array([0.45, 0.75, 1.0]) * _rim(n, 1.6) * 0.95)


def _pearl(n: Floats) -> Floats:
    angle = 2.0 * np.pi * (0.85 * n[:, 2:] + 0.12 * n[:, 1:2] + 0.10 * n[:, :1])
    sheen = 0.5 + 0.5 * np.cos(angle + np.array([0.0, 2.1, 4.2]))
    light = 0.12 + 0.78 * _lit(n, KEY, 0.4) ** 1.2
    return np.asarray(light * (np.array([0.84, 0.80, 0.78]) * 0.74 + 0.28 * sheen) + 0.5 * _shine(n, KEY, 60.0))


def _velvet(n: Floats) -> Floats:
    fibre = _rim(n, 2.2) * (0.35 + 0.65 * _lit(n, (0.0, 0.9, 0.4), 0.8))
    return np.asarray(
        np.array([0.075, 0.004, 0.03]) * (0.5 + _lit(n, KEY, 0.5)) + np.array([0.75, 0.10, 0.30]) * fibre * 0.9
    )


MATCAPS: dict[str, tuple[Callable[[Floats], Floats], str]] = {
    "clay": (_clay, "unglazed terracotta, matt"),
    "wax": (_wax, "amber wax that light enters"),
    "bronze": (_bronze, "polished bronze in a studio"),
    "jade": (_jade, "green stone, translucent and polished"),
    "porcelain": (_porcelain, "white glaze with blue shadows"),
    "chalk": (_chalk, "dry white chalk, little shade"),
    "toon": (_toon, "three flat blues with a dark outline"),
    "x-ray": (_x_ray, "dark, with light rims"),
    "pearl": (_pearl, "white with a sheen of other hues"),
    "velvet": (_velvet, "dark red with light rims"),
}
"""Name -> linear RGB of normals (N, 3) on the visible side of a sphere, (N, 3), and a description of the material."""
