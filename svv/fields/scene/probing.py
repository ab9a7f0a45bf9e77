"""Reading off: what a pixel of a scene's picture shows, where that is, and the volume's value there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.colour.hex_codes import to_hex
from svv.core.geometry.given_cameras import GivenCamera, camera_of
from svv.core.volumes.classified import ALIKE
from svv.errors import BadInput, Progress, silent
from svv.fields.radiance.kept_values import KeptValues, Reading, read_at
from svv.fields.radiance.time_steps import TimeSteps
from svv.fields.scene.images import Together, Visible, pixel_in, resolving
from svv.fields.scene.joined import members
from svv.fields.scene.region import label_of
from svv.kernels.dispatch import kernels_of

if TYPE_CHECKING:
    from svv.fields.scene.model import Model

NOT_KEPT = "the scene does not keep its volume's values: train it with `svv train --keep-values`"
VIEWS_ONLY = "the scene was learned from views only, which have no values"
ELSEWHERE = "the scene keeps no value there"
OF_NETWORK = "the network base has no regions"
"""Why a probe has no value, or no region."""

DIGITS = 5
"""Digits of coordinates, distances and values in words."""


@dataclass(frozen=True)
class Probe:
    """What a pixel of a scene's picture shows.

    >>> found = Probe((4, 2), 0, "bone", 1.0, (1.0, 2.0, 3.0), 50.0, 1.0, (1.0, 1.0, 1.0), why=VIEWS_ONLY)
    >>> found.value, found.why
    (None, 'the scene was learned from views only, which have no values')
    """

    pixel: tuple[int, int]
    """Column from the left and row from the top of the picture."""
    region: int | None
    """Number of the region that the pixel shows most of; None with the network ``base``, which has none."""
    name: str
    """What the region is called: its name, or ``Region`` and its number."""
    share: float
    """Part of what is visible in the pixel that is this region, in (0, 1]."""
    point: tuple[float, float, float]
    """Where the region is most visible along the pixel's ray, in world coordinates."""
    distance: float
    """Distance of that point from the camera along the ray, in world units."""
    alpha: float
    """Opacity of the pixel, in (0, 1]."""
    colour: tuple[float, float, float]
    """Colour of the pixel without a background, RGB in [0, 1]."""
    value: float | None = None
    """The volume's value at the point; None if it is not known."""
    uncertainty: float | None = None
    """How far that may be from the volume's own interpolated value, on either side, at 19 of 20 places or more; None if
    ``beyond`` says which side."""
    spread: float | None = None
    """Standard deviation of the value along the ray within the region, each place weighted as it is visible."""
    beyond: str = ""
    """``at least`` or ``at most`` if the value is the last one that is told apart; otherwise empty."""
    mean_of: int = 1
    """Number of voxels whose mean the value is: volumes larger than memory are classified at a coarser level."""
    array: str | None = None
    """Name of the array, or of the volume, that the value is of; None if the scene does not tell."""
    time: float | None = None
    """Time of the step that is shown, of a scene that has several."""
    why: str = ""
    """Why there is no value; empty if there is one."""

    def describe(self, unit: str | None = None, value_unit: str | None = None) -> str:
        """Return one line, with the units of the volume's lengths and values, if any.

        >>> probe = Probe((4, 2), 0, "bone", 0.9, (1.0, 2.0, 3.0), 50.0, 1.0, (1.0, 1.0, 1.0), 1240.0, 8.0, 31.0)
        >>> probe.describe("mm", "HU").partition(";")[0]
        '4,2: bone (90 % of the pixel) at 1,2,3 (50 mm from the camera), 1240 ± 8 HU'
        """
        place = ",".join(_number(v) for v in self.point)
        said = (
            f"{self.pixel[0]},{self.pixel[1]}: {self.name} ({100 * self.share:.0f} % of the pixel) at {place} "
            f"({_with(_number(self.distance), unit)} from the camera)"
        )
        opacity = f"; opacity {self.alpha:.2f}, colour {to_hex(self.colour)}"
        if self.value is None:
            return f"{said}{opacity}; no value: {self.why}"
        told = f"{self.beyond} " * bool(self.beyond) + _number(self.value)
        told += "" if not self.uncertainty else f" ± {self.uncertainty:.2g}"
        said += ", " + _with(told, value_unit) + (f" of {self.array}" if self.array else "")
        said += f" (mean of {self.mean_of} voxels)" if self.mean_of > 1 else ""
        said += "" if self.time is None else f" at time {self.time:g}"
        return (
            said + (f"; spread along the ray {_with(f'{self.spread:.2g}', value_unit)}" * bool(self.spread)) + opacity
        )


@torch.no_grad()
def probe(
    scene: Model, camera: GivenCamera, pixel: tuple[float, float], network: str | None = None
) -> Probe | None:  # fmt: skip
    """Return what a pixel of a scene's picture shows, with the volume's value there; None if nothing is visible.

    The value is that of the time step that the scene shows. It is known for scenes trained with ``keep_values`` or of
    the encoding ``values``; other results say why it is not.

    Args:
        scene: The scene.
        camera: Camera of the picture in world units, also a plotter's, or the name of a side such as ``xy``.
        pixel: Column from the left and row from the top of the picture.
        network: ``base``, ``pcn`` or ``styled``; by default the last one that the scene has.

    Raises:
        BadInput: The pixel is outside the picture, the scene does not have that network, or its values are damaged.
    """
    camera, network = camera_of(camera, scene), network or scene.networks[-1]
    if network not in scene.networks:
        raise BadInput(f"The scene has no network '{network}', only {', '.join(scene.networks)}.")
    column, row = pixel_in(camera, pixel)
    drawn = resolving(scene, camera) if network == "styled" and scene.still else scene
    seen = Together(drawn, camera, network).most_visible(torch.tensor([row * camera.width + column]))
    if seen is None:
        return None
    known = network != "base" and bool(scene.regions)
    name = label_of(scene.regions, seen.region) if known else "Something"
    found = Probe(
        (column, row), seen.region if known else None, name, seen.share, seen.point, seen.away, seen.alpha, seen.colour
    )
    return _with_value(scene, found, seen)


@torch.no_grad()
def value_image(
    scene: Model, camera: GivenCamera, network: str | None = None, progress: Progress = silent
) -> NDArray[np.float32] | None:  # fmt: skip
    """Return the volume's value at each pixel of a picture, where the region that it shows is most visible; or None.

    NaN where nothing is visible, or no value is kept (height, width); None if the scene keeps no values at all.
    Arguments and errors are those of :func:`probe`; ``progress`` is called before every chunk of rays.
    """
    camera, network, every = camera_of(camera, scene), network or scene.networks[-1], members(scene)
    if all((member.steps or member.kept) is None for member in every):
        return None
    drawn = resolving(scene, camera) if network == "styled" and scene.still else scene
    together = Together(drawn, camera, network)
    image, (origins, directions) = np.full(camera.width * camera.height, np.nan, np.float32), camera.rays()
    pixels, chunk = together.in_sight(), kernels_of(scene.device.type).RAYS
    for first in range(0, len(pixels), chunk):
        progress(first / len(pixels), "values")
        found, away, region = (part.cpu().numpy() for part in together.places(pixels[first : first + chunk]))
        points = origins.reshape(-1, 3)[found] + away[:, None] * directions.reshape(-1, 3)[found]
        for number in np.unique(region):
            own, of = region == number, scene.regions[number] if scene.regions else None
            member = every[0 if of is None else of.layer]
            if (kept := member.steps or member.kept) is not None:
                image[found[own]] = _read(kept, points[own], None if of is None else of.values).value
    return image.reshape(camera.height, camera.width)


def why_no_values(scene: Model) -> str:
    """Return why a scene that keeps no values of its volume does not; older scenes do not tell what they are from."""
    only = all(member.made.get("learned_from") == "views only" for member in members(scene))
    return VIEWS_ONLY if only else NOT_KEPT


def _read(kept: KeptValues | TimeSteps, points: NDArray[np.float64], within: tuple[float, float] | None) -> Reading:
    """Return values at points; raises BadInput if they are damaged."""
    try:
        return read_at(kept, points, within)
    except ValueError as error:
        raise BadInput(f"The volume's values in the scene cannot be read ({error}): train it again.") from error


def _with_value(scene: Model, found: Probe, seen: Visible) -> Probe:
    """Return a probe with the volume's value, or why there is none."""
    if found.region is None and scene.layers:
        return replace(found, why=OF_NETWORK)
    region = None if found.region is None else scene.regions[found.region]
    member = members(scene)[0 if region is None else region.layer]
    kept: KeptValues | TimeSteps | None = member.steps or member.kept
    if kept is None:
        return replace(found, why=why_no_values(member))
    read = _read(kept, np.concatenate([[seen.point], seen.along]), None if region is None else region.values)
    value, off = float(read.value[0]), float(read.uncertainty[0])
    if np.isnan(value):
        return replace(found, why=ELSEWHERE)
    source = member.made.get("source", {})
    grid = source.get("grid")
    beyond = _beyond(read, kept, grid)
    time = kept.times[kept.own] if isinstance(kept, TimeSteps) and kept.times != (0.0,) else None
    return replace(
        found, value=value, uncertainty=None if beyond else off, spread=_spread(read, seen), beyond=beyond,
        mean_of=voxels_in_one(kept, grid), array=source.get("array") or source.get("volume"), time=time,
    )  # fmt: skip


def voxels_in_one(kept: KeptValues | TimeSteps, grid: dict[str, Any] | None) -> int:
    """Return how many voxels of the volume are one of the level of which the values are."""
    if grid is None or kept.edges == ALIKE:  # which also scenes of older versions have
        return 1
    own = np.linalg.norm(kept.edges, axis=1) * kept.box.size / kept.cells
    return round(float(np.prod(np.maximum(np.rint(own / np.asarray(grid["spacing"])), 1.0))))


def _beyond(read: Reading, kept: KeptValues | TimeSteps, grid: dict[str, Any] | None) -> str:
    """Return on which side of the value told the volume's may be, unless it has no values beyond."""
    side, (low, high) = int(read.beyond[0]), kept.interval
    least, most = (-np.inf, np.inf) if grid is None else grid["range"]
    margin = 1e-6 * (high - low)
    return "at most" if side < 0 and least < low - margin else "at least" if side > 0 and most > high + margin else ""


def _spread(read: Reading, seen: Visible) -> float:
    """Return the weighted standard deviation of the values along a ray within its region."""
    value = read.value[1:]
    known = np.isfinite(value)
    weight = seen.weights[known].astype(np.float64)
    if not weight.sum() > 0.0:
        return 0.0
    mean = np.average(value[known], weights=weight)
    return float(np.sqrt(np.average(np.square(value[known] - mean), weights=weight)))


def measure(points: Sequence[Sequence[float]]) -> tuple[list[float], float | None]:
    """Return the distances from each of the points in the world to the next one, and the angle at the middle of three.

    The angle is in degrees, in [0, 180]; None unless there are three points, all of them different.

    >>> measure([(0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (4.0, 0.0, 0.0)])
    ([3.0, 4.0], 90.0)
    """
    lengths = [float(np.linalg.norm(np.subtract(b, a))) for a, b in pairwise(points)]
    if len(points) != 3 or min(lengths) == 0.0:
        return lengths, None
    first, second = np.subtract(points[0], points[1]), np.subtract(points[2], points[1])
    across = np.linalg.norm(np.cross(first, second))  # exact at small angles, too
    return lengths, float(np.degrees(np.arctan2(across, first @ second)))


def describe_measures(points: Sequence[Sequence[float]], unit: str | None = None) -> str:
    """Return the distances and the angle of :func:`measure` in words; empty for fewer than two points.

    >>> describe_measures([(0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (4.0, 0.0, 0.0)], "mm")
    'distances 3, 4 mm; angle 90°'
    """
    lengths, angle = measure(points)
    if not lengths:
        return ""
    said = f"distance{'s' * (len(lengths) > 1)} {_with(', '.join(map(_number, lengths)), unit)}"
    return said + ("" if angle is None else f"; angle {angle:.4g}°")


def _number(value: float) -> str:
    return f"{value:.{DIGITS}g}"


def _with(text: str, unit: str | None) -> str:
    return f"{text} {unit}" if unit else text
