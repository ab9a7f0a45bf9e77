"""Shading of a volume when views of it are rendered."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from svv.core.json_values import needed, number_in, object_in, switch_in
from svv.errors import BadInput


@dataclass(frozen=True)
class Shading:
    """Phong shading with one white light at the camera (a headlight); BadInput for coefficients that are not >= 0.

    The coefficients are the defaults of ParaView's volume representation. (VTK's own are 0.1, 0.7, 0.2, 10.)
    """

    on: bool = True
    """Whether the volume is shaded; otherwise the colours are those of the transfer function."""
    ambient: float = 0.0
    """Share of the light from all directions that a surface reflects in its own colour, >= 0."""
    diffuse: float = 1.0
    """Share of the headlight that a surface facing the camera reflects in its own colour, >= 0."""
    specular: float = 0.0
    """Share that is reflected as a white highlight, >= 0. Highlights are wider on the CPU than on the GPU."""
    specular_power: float = 100.0
    """Sharpness of the highlight, >= 0."""

    def __post_init__(self) -> None:
        for name in ("ambient", "diffuse", "specular", "specular_power"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                called = name.replace("_", " ")
                raise BadInput(f"The {called} of a volume's shading must be a number of at least 0, not {value:g}.")

    @property
    def seen(self) -> bool:
        """Whether colours depend on the viewing direction."""
        return self.on and bool(self.diffuse or self.specular)

    @classmethod
    def from_json(cls, content: object, name: str = "shading") -> Shading:
        """Invert :meth:`to_json`; raises BadInput, with the value's ``name``, if something is missing or invalid."""
        values = object_in(content, name)
        ambient, diffuse, specular, power = (
            number_in(needed(values, key, name), f"{name}.{key}")
            for key in ("ambient", "diffuse", "specular", "specular_power")
        )
        return cls(switch_in(needed(values, "on", name), f"{name}.on"), ambient, diffuse, specular, power)

    def to_json(self) -> dict[str, object]:
        """Return the fields as plain values under their names."""
        return asdict(self)
