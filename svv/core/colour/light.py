"""Movable light: its position, and its reflection by a surface (Blinn-Phong).

Letters: S samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput

if TYPE_CHECKING:
    from torch import Tensor

COEFFICIENTS = ("ambient", "diffuse", "specular", "shininess")
"""Reflection coefficients of a surface, in the order in which tensors hold them: fractions of the light, >= 0, and the
exponent of the highlight."""

RIM_COSINE = 0.3
"""Cosine by which a surface may face away from the viewer without being turned, under light from the side; otherwise
the back of a silhouette would shine on the dark side. Under a headlight the bound is 0."""

LEAST_COSINE = 1e-4
"""Lower bound of cosines that are raised to a power, so that their logarithm is finite."""

NORMAL_SCALE = 10.0
"""Factor from the values in the normals' lattice to vectors; with it normals learn at the rate of features."""

UPPER_LEFT = (-35.0, 40.0)
"""Degrees to the right of the camera and above it from which shadows come if nothing else is asked for: a light at the
camera, and one that a network learned, would hide them behind what casts them."""

SHADOW_SOFTNESS = 6.0
"""Default opening angle of the light that casts shadows, in degrees; the sun has half a degree."""

MOST_SOFTNESS = 60.0
"""Largest opening angle: with more, cast shadows cannot be told from ambient occlusion."""

NORMAL_SOFTNESS = 0.1
"""Length of a vector whose normal is 1 / sqrt(2) long; much shorter vectors belong to no surface and stay unlit."""


@dataclass(frozen=True)
class Lamp:
    """A white directional light, besides the ambient light from everywhere; raises BadInput if a value is out of range.

    Without a ``direction`` it follows the camera at fixed angles; at azimuth and elevation 0 it is a headlight.
    """

    azimuth: float = 0.0
    """Degrees to the right of the camera, as seen from the centre of the scene, in [-180, 180]."""
    elevation: float = 0.0
    """Degrees above the camera, in [-90, 90]."""
    direction: tuple[float, float, float] | None = None
    """World direction from which the light comes, whatever the camera does; of any length but 0."""
    intensity: float = 1.0
    """Factor on the brightness, >= 0; 1 is the light under which the views were rendered."""
    shadow: float = 0.0
    """How far cast shadows darken, in [0, 1]; 0 casts none."""
    shadow_softness: float = SHADOW_SOFTNESS
    """Opening angle in degrees, in [0, 60], under which the light that casts them is seen; 0 gives sharp edges."""
    shadow_light: tuple[float, ...] | None = None
    """Where shadows come from instead: azimuth and elevation, which follow the camera, or a world direction of any
    length but 0. None for this light if it was moved, and otherwise :data:`UPPER_LEFT`."""

    def __post_init__(self) -> None:
        if not (-180.0 <= self.azimuth <= 180.0 and -90.0 <= self.elevation <= 90.0):
            raise BadInput(
                f"A light's azimuth must lie between -180 and 180 degrees and its elevation between -90 and 90, "
                f"not {self.azimuth:g} and {self.elevation:g}."
            )
        if not (np.isfinite(self.intensity) and self.intensity >= 0):
            raise BadInput(f"The light's intensity must be a number of at least 0, not {self.intensity}.")
        if self.direction is not None:
            object.__setattr__(self, "direction", _validate_direction(self.direction))
        self._check_shadow()

    def _check_shadow(self) -> None:
        if not 0.0 <= self.shadow <= 1.0:
            raise BadInput(f"Shadows must lie between 0, none, and 1, fully dark, not {self.shadow}.")
        if not 0.0 <= self.shadow_softness <= MOST_SOFTNESS:
            raise BadInput(
                f"The softness of shadows must lie between 0 and {MOST_SOFTNESS:g} degrees, not {self.shadow_softness}."
            )
        if self.shadow_light is None:
            return
        if len(self.shadow_light) == 2:
            azimuth, elevation = map(float, self.shadow_light)
            Lamp(azimuth, elevation)
            object.__setattr__(self, "shadow_light", (azimuth, elevation))
        else:
            object.__setattr__(self, "shadow_light", _validate_direction(self.shadow_light))

    @property
    def moved(self) -> bool:
        """Whether the light is not a headlight."""
        return self.direction is not None or self.azimuth != 0.0 or self.elevation != 0.0

    def turn(self, rotation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the world rotation (3, 3) from directions towards the camera to directions towards the light.

        ``rotation``: the camera's axes in the world, columns right, up and backwards. (3, 3)
        """
        a, e = np.radians(self.azimuth), np.radians(self.elevation)
        up = np.array([[1, 0, 0], [0, np.cos(e), np.sin(e)], [0, -np.sin(e), np.cos(e)]])
        right = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
        return np.asarray(rotation @ right @ up @ rotation.T)

    @property
    def casting(self) -> Lamp:
        """The light from which shadows come."""
        if self.shadow_light is None:
            return self if self.moved else Lamp(*UPPER_LEFT)
        if len(self.shadow_light) == 2:
            return Lamp(*self.shadow_light)
        x, y, z = self.shadow_light
        return Lamp(direction=(x, y, z))

    @property
    def shadows_follow(self) -> bool:
        """Whether it casts shadows that follow the camera."""
        return self.shadow > 0.0 and self.casting.direction is None

    @property
    def casts(self) -> dict[str, Any]:
        """Its fields about shadows alone."""
        return {name: getattr(self, name) for name in ("shadow", "shadow_softness", "shadow_light")}

    def towards(self, rotation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the world direction towards the light, for all that a camera sees alike; of length 1. (3,)

        ``rotation``: as for :meth:`turn`.
        """
        if self.direction is None:
            return np.asarray(self.turn(rotation) @ rotation[:, 2])
        return np.asarray(self.direction) / np.linalg.norm(self.direction)

    def describe(self) -> str:
        """Return a short description."""
        bright = "" if self.intensity == 1.0 else f", intensity {self.intensity:g}"
        return f"light {self._where()}{bright}" + (f", {self.describe_shadow()}" if self.shadow else "")

    def describe_shadow(self) -> str:
        """Return a short description of its shadows alone."""
        return f"shadows {self.shadow:g} by a light {self.shadow_softness:g} degrees wide, {self.casting._where()}"

    def _where(self) -> str:
        if self.direction is not None:
            return "from " + ", ".join(f"{v:g}" for v in self.direction)
        if not self.moved:
            return "at the camera"
        aside, above = "right" if self.azimuth >= 0.0 else "left", "up" if self.elevation >= 0.0 else "down"
        return f"{abs(self.azimuth):g} degrees {aside}, {abs(self.elevation):g} {above}"

    def to_json(self) -> dict[str, Any]:
        """Return plain values for files: those of shadows only where they were set, so that older versions read it."""
        values = {f.name: (getattr(self, f.name), f.default) for f in fields(self)}
        return {name: value for name, (value, plain) in values.items() if value != plain or "shadow" not in name}


def _validate_direction(given: Sequence[float]) -> tuple[float, float, float]:
    """Return a direction whose square is finite and not 0; raises BadInput if it is none."""
    direction = np.asarray(given, np.float64)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise BadInput(f"Light cannot come from {given}: give a direction x, y and z, not all 0.")
    largest = np.abs(direction).max()
    if not 1e-100 < largest < 1e100:
        direction = direction / largest
    x, y, z = direction.tolist()
    return x, y, z


def validate_coefficients(given: Mapping[str, float | None]) -> dict[str, float]:
    """Return those of some :data:`COEFFICIENTS` that are not None; raises TypeError for other names.

    Raises BadInput if a coefficient is negative, a highlight's exponent below 1, or one of them not finite.
    """
    found: dict[str, float] = {}
    for name, value in given.items():
        if name not in COEFFICIENTS:
            raise TypeError(f"edited() got an unexpected keyword argument '{name}'")
        if value is not None:
            least = 1.0 if name == "shininess" else 0.0
            if not (np.isfinite(value) and value >= least):
                raise BadInput(f"The {name} of a region must be a number of at least {least:g}, not {value}.")
            found[name] = float(value)
    return found


def normals_of(held: Tensor) -> Tensor:
    """Return normals n = v / sqrt(s^2 + |v|^2), |n| < 1, of either sign, of what a lattice holds. (S, 3)

    That is v / :data:`NORMAL_SCALE`; s is :data:`NORMAL_SOFTNESS`.
    """
    v = NORMAL_SCALE * held
    return v / (NORMAL_SOFTNESS * NORMAL_SOFTNESS + v.square().sum(dim=1, keepdim=True)).sqrt()


def blinn_phong(
    normal: Tensor, facing: Tensor, toward: Tensor, intensity: float, coefficients: Tensor
) -> tuple[Tensor, Tensor]:
    """Return highlight c_s = i k_s (n . h)^p and shade m = k_a + i k_d max(n . l, 0), h = (l + v) / |l + v|, (S,) each.

    (Blinn 1977.) The normal n, of either sign, is first turned to the viewer if n . v < -RIM_COSINE (1 - v . l):
    surfaces are two-sided, as in VTK's volume ray casters. A normal shorter than 1 is lit less. There is no highlight
    where n . l <= 0. ``facing`` v, ``toward`` l: unit vectors towards the viewer and the light (S, 3); ``intensity``:
    i; ``coefficients``: k_a, k_d, k_s and p of each sample (S, 4).
    """
    import torch

    ambient, diffuse, specular, shininess = coefficients.unbind(1)
    rim = RIM_COSINE * (1.0 - (facing * toward).sum(1)).clamp(0.0, 1.0)
    side = torch.where((normal * facing).sum(1) < -rim, -1.0, 1.0)
    cosine = (side * (normal * toward).sum(1)).clamp(min=0.0)
    half = torch.nn.functional.normalize(toward + facing, dim=1)
    highlight = (side * (normal * half).sum(1)).clamp(min=LEAST_COSINE).pow(shininess)
    highlight = torch.where(cosine > 0.0, highlight, 0.0)
    return intensity * specular * highlight, ambient + intensity * diffuse * cosine


def direction_of(azimuth: float, elevation: float) -> tuple[float, float, float]:
    """Return the world direction of a light at degrees to the right and above, as seen from the front (along -z).

    >>> [round(x, 3) for x in direction_of(90.0, 0.0)]
    [1.0, 0.0, 0.0]
    """
    right, above = np.radians(azimuth), np.radians(elevation)
    return float(np.sin(right) * np.cos(above)), float(np.sin(above)), float(np.cos(right) * np.cos(above))
