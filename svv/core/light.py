"""Light that can be moved: where it stands, and what a surface makes of it (Blinn-Phong).

Letters: S samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.errors import BadInput

COEFFICIENTS = ("ambient", "diffuse", "specular", "shininess")
"""What a surface makes of light, in the order in which tensors hold it: parts of the light that are >= 0, and the
exponent of the highlight."""

RIM_COSINE = 0.3
"""Cosine by which a surface may look away from the viewer and yet not be turned, under light that comes from beside:
what is seen of the back of an outline would shine on the dark side. Under a headlight 0."""

LEAST_COSINE = 1e-4
"""Smallest cosine that is raised to a power: its logarithm is finite."""

NORMAL_SCALE = 10.0
"""A vector is this many times what the lattice of the normals holds, so that it learns at the rate of features."""

NORMAL_SOFTNESS = 0.1
"""Length of a vector whose normal is 1 / sqrt(2) long: much shorter ones are no surface's, and stay unlit."""


@dataclass(frozen=True)
class Lamp:
    """A light that is so far away that its rays are parallel, white, beside what comes from everywhere (ambient).

    Without a ``direction`` it stands beside the camera and follows it; at azimuth and elevation 0 it is a headlight.

    Raises:
        BadInput: angles, a direction or an intensity that are none.
    """

    azimuth: float = 0.0
    """Degrees to the right of the camera, as seen from the scene's middle, in [-180, 180]."""
    elevation: float = 0.0
    """Degrees above the camera, in [-90, 90]."""
    direction: tuple[float, float, float] | None = None
    """Where the light comes from in the world, whatever the camera does; of any length but 0."""
    intensity: float = 1.0
    """Factor on its brightness, >= 0; 1 is the light that the views were drawn under."""

    def __post_init__(self) -> None:
        if not (-180.0 <= self.azimuth <= 180.0 and -90.0 <= self.elevation <= 90.0):
            raise BadInput(
                f"A light stands -180 to 180 degrees beside the camera and -90 to 90 above it, not {self.azimuth:g} "
                f"and {self.elevation:g}."
            )
        if not (np.isfinite(self.intensity) and self.intensity >= 0):
            raise BadInput(f"The light's intensity must be a number of at least 0, not {self.intensity}.")
        if self.direction is not None:
            direction = np.asarray(self.direction, np.float64)
            if direction.shape != (3,) or not np.isfinite(direction).all() or not np.linalg.norm(direction) > 0:
                raise BadInput(f"Light cannot come from {self.direction}: give a direction x, y and z, not all 0.")
            object.__setattr__(self, "direction", tuple(float(v) for v in direction))

    @property
    def moved(self) -> bool:
        """Whether it is no headlight."""
        return self.direction is not None or self.azimuth != 0.0 or self.elevation != 0.0

    def turn(self, rotation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rotation (3, 3) in the world that brings directions towards a camera to directions towards the light.

        Args:
            rotation: The camera's axes in the world, columns right, up and backwards. (3, 3)
        """
        a, e = np.radians(self.azimuth), np.radians(self.elevation)
        up = np.array([[1, 0, 0], [0, np.cos(e), np.sin(e)], [0, -np.sin(e), np.cos(e)]])
        right = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
        return np.asarray(rotation @ right @ up @ rotation.T)

    def said(self) -> str:
        """In a few words."""
        if self.direction is not None:
            where = "from " + ", ".join(f"{v:g}" for v in self.direction)
        else:
            where = f"{self.azimuth:g} degrees right, {self.elevation:g} up" if self.moved else "at the camera"
        return f"light {where}" + ("" if self.intensity == 1.0 else f", intensity {self.intensity:g}")


def normals_of(held: Tensor) -> Tensor:
    """Normals n = v / sqrt(s^2 + |v|^2) of vectors v, for s = :data:`NORMAL_SOFTNESS`: shorter than 1.

    Args:
        held: What the lattice holds, v / :data:`NORMAL_SCALE`. (S, 3)

    Returns:
        Normals, of either side. (S, 3)
    """
    v = NORMAL_SCALE * held
    return v / (NORMAL_SOFTNESS * NORMAL_SOFTNESS + v.square().sum(dim=1, keepdim=True)).sqrt()


def blinn_phong(
    normal: Tensor, facing: Tensor, toward: Tensor, intensity: float, coefficients: Tensor
) -> tuple[Tensor, Tensor]:
    """Highlight c_s = i k_s (n . h)^p and shade m = k_a + i k_d max(n . l, 0), for h = (l + v) / |l + v|.

    (Blinn 1977.) The normal n is turned to the viewer first, if n . v < -RIM_COSINE (1 - v . l): surfaces have two
    sides, as VTK's ray casters shade volumes. One shorter than 1 is lit so much less. No highlight where n . l <= 0.

    Args:
        normal: Of either side. (S, 3)
        facing: Unit vectors v towards the viewer. (S, 3)
        toward: Unit vectors l towards the light. (S, 3)
        intensity: i, brightness of the light.
        coefficients: k_a, k_d, k_s and p of each sample. (S, 4)

    Returns:
        c_s and m, (S,) each.
    """
    ambient, diffuse, specular, shininess = coefficients.unbind(1)
    rim = RIM_COSINE * (1.0 - (facing * toward).sum(1)).clamp(0.0, 1.0)
    side = torch.where((normal * facing).sum(1) < -rim, -1.0, 1.0)
    cosine = (side * (normal * toward).sum(1)).clamp(min=0.0)
    half = torch.nn.functional.normalize(toward + facing, dim=1)
    highlight = (side * (normal * half).sum(1)).clamp(min=LEAST_COSINE).pow(shininess)
    highlight = torch.where(cosine > 0.0, highlight, 0.0)
    return intensity * specular * highlight, ambient + intensity * diffuse * cosine
