"""Where splats lie in a file: programs keep their positions in single or half precision."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput
from svv.fields.splats.splats import Splats

SIZES = (0.1, 1000.0)
"""Longest sides of all centres together, in world units, between which a file is in world units: Spark 2.2 keeps half
floats, and the clipping planes of GaussianSplats3D 0.4 lie at 0.1 and 1000."""

FAR = 5.0
"""Distance from the origin, in longest sides, above which a file has an origin of its own: in Spark 2.2, fine splats
lose 5 dB at 15 sides and 21 dB at 100."""


@dataclass(frozen=True)
class Place:
    """Where a file's positions are in the world: at ``origin + unit * position``."""

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """In world units."""
    unit: float = 1.0
    """In world units, a power of 1000."""

    def describe(self) -> str:
        """Return a sentence on the place, empty if positions are the world's.

        >>> Place((1e6, 0.0, 0.0)).describe()
        "Because viewers keep few digits, the file's origin is the world's (1000000, 0, 0)."
        >>> Place(unit=1e-9).describe()
        "Because viewers keep few digits, the file's unit is 1e-09 world units."
        """
        at = ", ".join(f"{x:.12g}" for x in self.origin)
        told = [f"the file's unit is {self.unit:g} world units"] if self.unit != 1.0 else []
        whose = "its" if told else "the file's"
        told += [f"{whose} origin is the world's ({at})"] if any(self.origin) else []
        return f"Because viewers keep few digits, {' and '.join(told)}." if told else ""


def place_of(splats: Splats, sizes: tuple[float, float] = SIZES) -> Place:
    """Return the place that keeps the digits of the splats' positions: the world's, unless they are far or extreme.

    ``sizes``: longest sides between which a file is in world units; at least a factor of 1000 apart.
    """
    corners = np.stack([splats.centres.min(axis=0), splats.centres.max(axis=0)]).astype(float)
    side = max(float(np.ptp(corners, axis=0).max()), float(splats.scales.max()))
    middle = corners.mean(axis=0)
    step = 10.0 ** np.floor(np.log10(side))  # for a short number
    x, y, z = np.rint(middle / step) * step if np.abs(middle).max() > FAR * side else np.zeros(3)
    low, high = sizes
    unit = 1.0 if low <= side <= high else 10.0 ** (3 * np.floor(np.log10(side / low) / 3))
    return Place((float(x), float(y), float(z)), unit)


def placed(splats: Splats, place: Place) -> Splats:
    """Return the splats as a file in a place holds them."""
    if place == Place():
        return splats
    centres = ((splats.centres.astype(float) - place.origin) / place.unit).astype(np.float32)
    return replace(splats, centres=centres, scales=(splats.scales.astype(float) / place.unit).astype(np.float32))


def in_world(splats: Splats, place: Place) -> Splats:
    """Return the splats of a file in world units, the inverse of :func:`placed`."""
    if place == Place():
        return splats
    centres = (splats.centres.astype(float) * place.unit + place.origin).astype(np.float32)
    return replace(splats, centres=centres, scales=(splats.scales.astype(float) * place.unit).astype(np.float32))


def regions_of(numbers: np.ndarray, named: Mapping[int, object]) -> tuple[NDArray[np.int16], tuple[str, ...]]:
    """Return the regions (N,) of a file's numbers (N,), -1 for what is none, and the regions' names, or numbers."""
    regions = np.clip(np.nan_to_num(numbers, nan=-1.0), -1, np.iinfo(np.int16).max).astype(np.int16)
    count = max(int(regions.max(initial=0)) + 1, len(named))
    return regions, tuple(str(named.get(k, k)) for k in range(count))


def check_splats(splats: Splats) -> None:
    """Raise BadInput if there are no splats, or arrays do not belong together or hold what no file can."""
    n = len(splats)
    if not n:
        raise BadInput("There are no splats: show a region, or make it more opaque.")
    shapes = {
        "centres": (n, 3), "scales": (n, 3), "rotations": (n, 4), "opacities": (n,), "regions": (n,),
        "harmonics": (n, splats.harmonics.shape[1] if splats.harmonics.ndim == 3 else 0, 3),
    }  # fmt: skip
    for name, shape in shapes.items():
        values = getattr(splats, name)
        if values.shape != shape:
            raise BadInput(f"The {name} of {n} splats must have the shape {shape}, not {values.shape}.")
        if not np.isfinite(values).all():
            raise BadInput(f"The {name} of splats must be finite numbers.")
    if splats.harmonics.shape[1] not in (1, 4, 9, 16):
        raise BadInput(f"Splats have 1, 4, 9 or 16 harmonics, not {splats.harmonics.shape[1]}.")
    if splats.scales.min() <= 0.0:
        raise BadInput("The scales of splats must be above 0.")
    if not np.allclose(np.linalg.norm(splats.rotations, axis=1), 1.0, atol=1e-3):
        raise BadInput("The rotations of splats must be quaternions of length 1.")
    if splats.opacities.min() < 0.0 or splats.opacities.max() > 1.0:
        raise BadInput("The opacities of splats must lie between 0 and 1.")
    if splats.regions.min() < 0 or splats.regions.max() >= len(splats.names):
        raise BadInput(f"The regions of splats must be numbers of the {len(splats.names)} names.")
