"""Swatches of a legend: a small sphere in the paint and light of each region, as opaque as the region looks.

The paint is cut from a picture of the region alone, without its light, where most of it is in one piece. The light is
the scene's own where it can be moved; of a learned one is measured how dark and how bright it makes the region.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

from svv.core.colour.light import Lamp, blinn_phong
from svv.core.colour.matcaps import matcap_colours
from svv.core.colour.palette_shading import lit
from svv.core.geometry.cameras import Camera
from svv.fields.scene.matcap_pictures import picture_of
from svv.fields.scene.paint_light import lights_of
from svv.fields.scene.region import label_of
from svv.fields.scene.scene import Rendering, Scene

LEAST_ALPHA = 0.02
"""Alpha below which a pixel says nothing about the colour of a region."""

LEAST_ROOM = 0.8
"""Part of the most room that paint has in one piece, from which a place will do."""

MAGNIFIED = 0.4
"""Size at which paint appears on a swatch, relative to the panel, where enough of it lies in one piece."""

LIGHT_VIEW = 120
"""Width in pixels of the pictures in which a learned light is measured."""

PALEST = 0.45
"""Least alpha of the middle of a swatch: paler ones could not be told apart."""

DARKEST, BRIGHTEST = 5.0, 95.0
"""Percentiles of a region's brightness that count as its shadow and its light."""

Picture = NDArray[np.float32]


@dataclass(frozen=True)
class Entry:
    """One line of a legend."""

    number: int
    """Number of the region."""
    name: str
    values: str
    """Its ranges of values; empty where they are not known."""
    swatch: Picture
    """Straight RGBA in [0, 1]. (size, size, 4)"""


def format_ranges(ranges: tuple[tuple[float, float], ...], unit: str | None) -> str:
    """Return ranges of values with their unit.

    >>> format_ranges(((450.0, 900.0), (-1000.0, -300.0)), "HU")
    '450 to 900, −1000 to −300 HU'
    """
    text = ", ".join(" to ".join(f"{value:.4g}".replace("-", "−") for value in ends) for ends in ranges)
    return f"{text} {unit}" if unit and text else text


def entries_of(
    scene: Scene, camera: Camera, network: str, size: int, diameter: float, unit: str | None = None
) -> list[Entry]:
    """Return the lines of the legend of a scene with a palette network: its visible regions, in their order.

    A picture of the camera may be smaller than the panel's. For ``size`` and ``diameter``, see :func:`swatch`.
    """
    found = []
    for number, region in enumerate(scene.regions):
        if region.seen_opacity == 0.0:
            continue
        ranges = region.ranges or (() if region.values is None else (region.values,))
        picture = swatch(scene, number, camera, network, size, diameter)
        if picture is not None:
            found.append(Entry(number, label_of(scene.regions, number), format_ranges(ranges, unit), picture))
    return found


def swatch(scene: Scene, number: int, camera: Camera, network: str, size: int, diameter: float) -> Picture | None:
    """Return the swatch of one region, straight RGBA (size, size, 4); None if no pixel of the camera shows it.

    The network is ``pcn`` or ``styled``; ``diameter`` is the swatch's in pixels of the camera's picture.
    """
    flat = _alone(scene, number, camera, network, light=False)
    seen = flat.rgba[..., 3] > max(LEAST_ALPHA, 0.1 * float(flat.rgba[..., 3].max()))
    if not seen.any():
        return None
    alpha = float(np.median(flat.rgba[..., 3][seen]))
    x, y, facing, cover = _sphere(size)
    paint = _wrapped(flat.rgba[..., :3], seen, diameter, x, y, facing)
    matcap = scene.regions[number].matcap
    if matcap is None:
        colour = _lit(scene, number, camera, network, paint, (x, y, facing))
    else:
        colour = _of_matcap(matcap, x, y, facing)
    through = 1.0 - (1.0 - min(max(alpha, PALEST), 1.0)) ** (1.0 / np.maximum(facing, 0.25))
    out = np.concatenate([colour.clip(0.0, 1.0), (cover * through)[..., None]], axis=2).astype(np.float32)
    region = scene.regions[number]
    if region.outline > 0.0:
        ring = region.outline * np.clip(1.5 - np.abs(np.hypot(x, y) - 0.93) * 0.5 * size / 1.2, 0.0, 1.0) * cover
        out[..., :3] += ring[..., None] * (np.array(region.outline_colour, np.float32) - out[..., :3])
        out[..., 3] = np.maximum(out[..., 3], ring)
    return out


def _of_matcap(matcap: str, x: Picture, y: Picture, facing: Picture) -> Picture:
    """Return a MatCap on the sphere that it is a picture of. (size, size, 3)"""
    normal = torch.from_numpy(np.stack([x, y, facing], axis=2).reshape(-1, 3).astype(np.float32))
    toward = torch.tensor([0.0, 0.0, 1.0]).expand_as(normal)
    colour = matcap_colours(normal, toward, torch.tensor([0.0, 1.0, 0.0]), picture_of(matcap))
    return np.asarray(colour.numpy().reshape(*x.shape, 3), np.float32)


def _alone(scene: Scene, number: int, camera: Camera, network: str, light: bool) -> Rendering:
    """Render one region without the others, without ink, and with or without its light."""
    regions = tuple(
        replace(r, hidden=k != number, outline=0.0, occlusion=0.0, lighting=r.lighting if light else 0.0)
        for k, r in enumerate(scene.regions)
    )
    return replace(scene, regions=regions, lamp=replace(scene.lamp, shadow=0.0)).render(camera, network)


def _sphere(size: int) -> tuple[Picture, Picture, Picture, Picture]:
    """Return x to the right and y up in [-1, 1], the cosine towards the viewer, and how far pixels are covered."""
    middle = (np.arange(size, dtype=np.float32) + 0.5) / (0.5 * size) - 1.0
    x, y = np.meshgrid(middle, -middle)
    r = np.hypot(x, y)
    cover = np.clip((1.0 - r) * 0.5 * size, 0.0, 1.0)
    return x, y, np.sqrt(np.maximum(1.0 - np.minimum(r, 1.0) ** 2, 0.0)), cover.astype(np.float32)


def _wrapped(
    rgb: Picture, seen: NDArray[np.bool_], diameter: float, x: Picture, y: Picture, facing: Picture
) -> Picture:
    """Return the paint of the largest piece of a region on the sphere, RGB. (size, size, 3)"""
    inside = np.minimum(distance_transform_edt(np.pad(seen, 1))[1:-1, 1:-1], 0.5 * diameter / MAGNIFIED)
    radius, mean = float(inside.max()), rgb[seen].mean(0)
    if radius < 2.0:
        return np.broadcast_to(mean, (*x.shape, 3)).astype(np.float32)
    # Of the places with about as much room, the one that looks most like the whole region.
    blurred = np.stack([gaussian_filter(np.where(seen, rgb[..., c], mean[c]), 0.5 * radius) for c in range(3)], axis=2)
    unlike = np.where(inside >= LEAST_ROOM * radius, ((blurred - mean) ** 2).sum(2), np.inf)
    row, column = np.unravel_index(int(unlike.argmin()), unlike.shape)
    radius = float(inside[row, column])
    nearest = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    filled = rgb[tuple(nearest)]
    r = np.maximum(np.hypot(x, y), 1e-6)
    stretch = radius * (2.0 / np.pi) * np.arcsin(np.minimum(r, 1.0)) / r
    at = np.stack([row - y * stretch, column + x * stretch])
    return np.stack([map_coordinates(filled[..., c], at, order=1, mode="nearest") for c in range(3)], axis=2)


def _lit(
    scene: Scene, number: int, camera: Camera, network: str, paint: Picture, sphere: tuple[Picture, Picture, Picture]
) -> Picture:
    """Return the paint on a sphere under the light of its region. (size, size, 3)"""
    coefficients = scene.coefficients()
    if coefficients is not None:
        return _under_lamp(scene, coefficients[number], lights_of(scene, network)[number], camera, paint, sphere)
    small = camera.resized(LIGHT_VIEW, max(1, round(LIGHT_VIEW * camera.height / camera.width)))
    rough = scene.while_moving()  # how bright a region is does not depend on single strokes
    dark, bright = (_alone(rough, number, small, network, light).rgba for light in (False, True))
    seen = dark[..., 3] > LEAST_ALPHA
    if not seen.any():
        return paint
    ratio = bright[..., :3][seen].sum(1) / np.maximum(dark[..., :3][seen].sum(1), 0.05)
    low, high = (float(v) for v in np.percentile(ratio, [DARKEST, BRIGHTEST]))
    return paint * (low + (high - low) * sphere[2])[..., None]


def _under_lamp(
    scene: Scene,
    coefficients: torch.Tensor,
    light: torch.Tensor,
    camera: Camera,
    paint: Picture,
    sphere: tuple[Picture, Picture, Picture],
) -> Picture:
    """Return the paint on a sphere under a light that can be moved (:func:`svv.core.colour.light.blinn_phong`)."""
    x, y, facing = sphere
    normal = torch.from_numpy(np.stack([x, y, facing], axis=2).reshape(-1, 3))
    toward = torch.tensor([0.0, 0.0, 1.0]).expand_as(normal)
    beam = torch.from_numpy(_towards(scene.lamp, camera)).to(normal).expand_as(normal)
    rows = coefficients.cpu().expand(len(normal), -1)
    specular, shade = blinn_phong(normal, toward, beam, scene.lamp.intensity, rows)
    factor, scale, less = (part.expand(len(normal)) for part in light.cpu())
    colour = lit(torch.from_numpy(paint).view(-1, 3), specular, shade, factor, scale, less)
    return np.asarray(colour.view(paint.shape).numpy(), np.float32)


def _towards(lamp: Lamp, camera: Camera) -> NDArray[np.float64]:
    """Return the direction towards a light in the camera's axes. (3,)"""
    axes = camera.camera_to_world[:3, :3]
    if lamp.direction is not None:
        world = np.asarray(lamp.direction)
        return np.asarray(axes.T @ world / np.linalg.norm(world))
    return np.asarray(axes.T @ lamp.turn(axes) @ axes[:, 2])
