"""How a volume is lit where views of it are drawn."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from svv.core.json_values import needed, number_in, object_in, switch_in


@dataclass(frozen=True)
class Shading:
    """Phong shading with one white light at the camera (a headlight).

    The coefficients are the defaults of ParaView's volume representation. (VTK's own are 0.1, 0.7, 0.2, 10.)
    """

    on: bool = True
    """False: colours of the transfer function as they are."""
    ambient: float = 0.0
    """Light that comes from everywhere, >= 0."""
    diffuse: float = 1.0
    """Share of the headlight that a surface facing the camera reflects in its own colour, >= 0."""
    specular: float = 0.0
    """Share that is mirrored as a white highlight, >= 0. The CPU's highlights are wider than the GPU's."""
    specular_power: float = 100.0
    """Sharpness of the highlight, > 0."""

    @property
    def seen(self) -> bool:
        """Whether colours depend on the direction from which they are seen."""
        return self.on and bool(self.diffuse or self.specular)

    @classmethod
    def from_json(cls, content: object, name: str = "shading") -> Shading:
        """The inverse of :meth:`to_json`.

        Args:
            content: What a file holds.
            name: What errors call it.

        Raises:
            BadInput: a value that is missing or none.
        """
        values = object_in(content, name)
        ambient, diffuse, specular, power = (
            number_in(needed(values, key, name), f"{name}.{key}")
            for key in ("ambient", "diffuse", "specular", "specular_power")
        )
        return cls(switch_in(needed(values, "on", name), f"{name}.on"), ambient, diffuse, specular, power)

    def to_json(self) -> dict[str, object]:
        """As plain values under the names of the fields."""
        return asdict(self)
