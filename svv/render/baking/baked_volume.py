"""Volumes of bytes that VTK's volume mappers draw: a colour and a code of the extinction a point. (Z, Y, X)

They are drawn with their colours as they are (``MapScalars`` off, no independent components) and with the opacity
function of :mod:`svv.core.volumes.opacity_code` over the volume's unit distance. Points around the visible ones are
empty but have their neighbours' colour, because mappers interpolate colours and codes apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.core.volumes.opacity_code import codes_of, depths, most_of, opacity_points
from svv.errors import BadInput, Progress, silent
from svv.io.files.atomic import write_json
from svv.io.pictures.output import write_volume
from svv.render.baking.baking_kernels import add_up, extend_colours, halve, longest
from svv.render.baking.voxels import Grid

OPACITY, UNIT_DISTANCE = "StyleRF Opacity", "StyleRF Unit Distance"
"""Field data of a baked volume: the opacity function, pairs of code and opacity, and its unit distance."""

COLOURS = "RGBA"
"""Name of a baked volume's array."""


@dataclass(frozen=True)
class BakedVolume:
    """A scene as a volume.

    ``rgba`` (Z, Y, X, 4) uint8: the colour of each point and the code of its extinction
    (:mod:`svv.core.volumes.opacity_code`); ``grid``: where the points are; ``most``: what code 255 stands for.
    """

    rgba: NDArray[np.uint8]
    grid: Grid
    most: float
    ranges: tuple[NDArray[np.float64], tuple[float, float]]
    """Smallest and largest value of each component (4, 2), and of the length of a point's vector of all four."""

    @property
    def empty(self) -> bool:
        """Whether nothing in it is visible."""
        return not self.rgba[..., 3].any()

    def fields(self) -> dict[str, NDArray[np.float64]]:
        """Return the field data that go with it: the opacity function (256, 2) and its unit distance (1, 1)."""
        return {OPACITY: np.array(opacity_points(self.most)), UNIT_DISTANCE: np.array([[self.grid.unit_distance]])}

    def describe(self) -> str:
        """Return its size for the user."""
        x, y, z = self.grid.shape
        nothing = ", nothing of it visible" * self.empty
        return f"{x} x {y} x {z} points, {self.rgba.nbytes / 1e6:.0f} MB{nothing}"


def halved(volume: BakedVolume, grid: Grid) -> BakedVolume:
    """Return a volume on a grid of half its resolution, between whose points those of the volume lie.

    Points of a coarse grid miss what is thinner than its voxels, so points around each are averaged: the square root of
    their extinction, which gives better images than its logarithm, opacity, or extinction itself
    (docs/measurements/large.md#baked-volumes).
    """
    fine = volume.grid
    first = 2 * np.array(grid.first[::-1]) - np.array(fine.first[::-1])
    rgba = np.zeros((*grid.shape[::-1], 4), np.uint8)
    root = np.zeros(grid.shape[::-1], np.float32)
    halve(volume.rgba, np.sqrt(depths(volume.most)), first, rgba, root)
    with np.errstate(divide="ignore"):
        logs = (2.0 * np.log(root) + np.log(grid.unit_distance / fine.unit_distance)).astype(np.float32)
    most = _encode(rgba, logs)
    ends = np.array([*volume.ranges[0][:3], [0.0, rgba[..., 3].max()]])
    return replace(volume, rgba=rgba, grid=grid, most=most, ranges=(ends, volume.ranges[1]))


def summed(volumes: Sequence[BakedVolume], grid: Grid) -> BakedVolume:
    """Return one or more volumes in one, on a grid of its own: extinctions add, and colours mix by extinctions.

    Between the points of a volume, codes and colours are interpolated as mappers do it.
    """
    rgba = np.zeros((*grid.shape[::-1], 4), np.uint8)
    total = np.zeros(grid.shape[::-1], np.float32)
    add_up(
        tuple(volume.rgba for volume in volumes),
        np.stack([depths(volume.most) / volume.grid.unit_distance for volume in volumes]),
        np.stack([np.subtract(grid.origin, v.grid.origin)[::-1] / v.grid.spacing for v in volumes]),
        np.array([grid.spacing / volume.grid.spacing for volume in volumes]),
        rgba, total,
    )  # fmt: skip
    with np.errstate(divide="ignore"):
        logs = np.log(total, out=total) + np.float32(np.log(grid.unit_distance))
    most = _encode(rgba, logs)
    ends = np.array([*volumes[0].ranges[0][:3], [0.0, rgba[..., 3].max()]])
    return BakedVolume(rgba, grid, most, (ends, (0.0, longest(rgba))))


def _encode(rgba: NDArray[np.uint8], logs: NDArray[np.float32]) -> float:
    """Set the codes of logarithms of extinctions, and the colours where nothing is; return what the codes refer to."""
    most = most_of(logs)
    rgba[..., 3] = codes_of(logs, most)
    extend_colours(rgba, np.flatnonzero(rgba[..., 3] == 0))
    span_all_bytes(rgba.reshape(-1, 4))
    return most


def span_all_bytes(flat: NDArray[np.uint8]) -> None:
    """Let every colour range from 0 to 255 and codes begin at 0, by two points that show nothing or next to nothing.

    VTK's mappers on the GPU scale each component by its range, and colours are to stay what they are.
    """
    words = flat.view("<u4").ravel()  # the code is the last and most significant byte
    white = words.argmin()
    words[white] = 0xFFFFFFFF
    black = words.argmin()
    flat[white, 3], flat[black] = 0, 0


def write_baked(path: Path, volume: BakedVolume, progress: Progress = silent) -> Path:
    """Write a volume as VTK image data, ``NAME.vti``, and beside it its opacity function as a ParaView preset.

    The file's field data hold the function and its unit distance as well (:data:`OPACITY`, :data:`UNIT_DISTANCE`).
    Returns the preset's file, ``NAME.json``. Raises BadInput if nothing is visible, or a file cannot be written.
    """
    if volume.empty:
        raise BadInput("Nothing in the scene is visible: show a region, or make it more opaque.")
    preset = path.with_suffix(".json")
    place = volume.grid.origin, (volume.grid.spacing,) * 3
    write_volume(path, {COLOURS: volume.rgba}, *place, volume.fields(), progress)
    write_json(preset, [{
        "Name": "StyleRF Volume", "ColorSpace": "RGB", "ScalarOpacityUnitDistance": volume.grid.unit_distance,
        "RGBPoints": [0.0, 0.0, 0.0, 0.0, 255.0, 1.0, 1.0, 1.0],
        "Points": [x for code, opacity in opacity_points(volume.most) for x in (code, opacity, 0.5, 0.0)],
    }])  # fmt: skip
    return preset
