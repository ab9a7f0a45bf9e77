"""What view sets say about how their images were made: the object under the key ``svv`` of their JSON file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

from svv.core.cameras import CameraRig
from svv.core.json_values import (
    Json,
    list_in,
    needed,
    number_in,
    object_in,
    pair_in,
    switch_in,
    text_in,
    vector_in,
    whole_in,
)
from svv.core.shading import Shading
from svv.errors import BadInput

Value = TypeVar("Value")
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class VolumeGrid:
    """The grid of a volume: where its voxels are, and what they hold."""

    dimensions: tuple[int, int, int]
    """Voxels along x, y and z."""
    spacing: Vector
    """Distances between voxels, world units."""
    origin: Vector
    """Of the first voxel, world units."""
    direction: tuple[Vector, Vector, Vector]
    """Rows of the matrix whose columns are the grid's axes in the world."""
    type: str
    """Of the voxels: NumPy's name, such as ``uint8``."""
    range: tuple[float, float]
    """Smallest and largest value."""

    @classmethod
    def from_json(cls, content: object, name: str = "grid") -> VolumeGrid:
        """The inverse of :meth:`to_json`.

        Args:
            content: What a file holds.
            name: What errors call it.

        Raises:
            BadInput: a value that is missing or none.
        """
        values = object_in(content, name)
        size, spacing, origin, direction, kind, range_ = (
            (needed(values, key, name), f"{name}.{key}")
            for key in ("dimensions", "spacing", "origin", "direction", "type", "range")
        )
        x, y, z = (whole_in(count, size[1]) for count in list_in(size[0], 3, size[1]))
        first, second, third = (vector_in(row, direction[1]) for row in list_in(direction[0], 3, direction[1]))
        return cls(
            (x, y, z), vector_in(*spacing), vector_in(*origin), (first, second, third), text_in(*kind), pair_in(*range_)
        )

    def to_json(self) -> dict[str, object]:
        """As plain values under the names of the fields."""
        return {
            "dimensions": list(self.dimensions),
            "spacing": list(self.spacing),
            "origin": list(self.origin),
            "direction": [list(row) for row in self.direction],
            "type": self.type,
            "range": list(self.range),
        }


@dataclass(frozen=True)
class ViewMeta:
    """How the images of a view set were made, as far as that is known: of other people's sets nothing is.

    Views that were drawn of a volume (:func:`svv.dvr.views.make_views`) have all but ``assumed``.
    """

    volume: str | None = None
    """Name of the volume."""
    grid: VolumeGrid | None = None
    bounds: tuple[Vector, Vector] | None = None
    """Lower and upper corner of the visible data, world units."""
    rig: CameraRig | None = None
    """Where the cameras stood."""
    tf: Json | None = None
    """The transfer function as it was used, as a preset of ParaView
    (:meth:`svv.dvr.transfer_functions.TransferFunction.from_dict`)."""
    tf_rescaled: bool | None = None
    """Whether it was stretched over the data's range for that."""
    shading: Shading | None = None
    sample_distance: float | None = None
    """Of the ray caster, world units."""
    mapper: str | None = None
    """The ray caster: ``cpu`` or ``gpu``."""
    vtk: str | None = None
    """VTK's version."""
    seconds: float | None = None
    """That drawing took."""
    assumed: str | None = None
    """One sentence where the images had no alpha: what counts as empty."""
    other: Json = field(default_factory=dict)
    """What is said besides, under keys that are not known here: it is written as it was read."""

    @classmethod
    def from_json(cls, content: object, name: str = "svv") -> ViewMeta:
        """The inverse of :meth:`to_json`; ``null`` under a known key says nothing.

        Args:
            content: What a file holds under ``svv``; None where it has no such key.
            name: What errors call it.

        Raises:
            BadInput: no object, or a known key whose value is none: the error names the key.
        """
        values = object_in({} if content is None else content, name)

        def read(key: str, reader: Callable[[object, str], Value]) -> Value | None:
            value = values.get(key)
            return None if value is None else reader(value, f"{name}.{key}")

        meta = cls(
            volume=read("volume", text_in),
            grid=read("grid", VolumeGrid.from_json),
            bounds=read("bounds", _bounds),
            rig=read("rig", CameraRig.from_json),
            tf=read("tf", object_in),
            tf_rescaled=read("tf_rescaled", switch_in),
            shading=read("shading", Shading.from_json),
            sample_distance=read("sample_distance", number_in),
            mapper=read("mapper", text_in),
            vtk=read("vtk", text_in),
            seconds=read("seconds", number_in),
            assumed=read("assumed", text_in),
        )
        return replace(meta, other=_left(values, meta.to_json()))

    def to_json(self) -> dict[str, object]:
        """As plain values under the names of the fields, without what is not known, and with the others."""
        own = {
            "volume": self.volume,
            "grid": self.grid and self.grid.to_json(),
            "bounds": self.bounds and [list(corner) for corner in self.bounds],
            "rig": self.rig and self.rig.to_json(),
            "tf": self.tf,
            "tf_rescaled": self.tf_rescaled,
            "shading": self.shading and self.shading.to_json(),
            "sample_distance": self.sample_distance,
            "mapper": self.mapper,
            "vtk": self.vtk,
            "seconds": self.seconds,
            "assumed": self.assumed,
        }
        return _joined({key: value for key, value in own.items() if value is not None}, self.other)


def known(value: Value | None, key: str) -> Value:
    """What views say under a key; raises BadInput where they do not."""
    if value is None:
        raise BadInput(f"The views do not say their {key}: they were not drawn of a volume by svv; draw them anew.")
    return value


def _bounds(value: object, name: str) -> tuple[Vector, Vector]:
    low, high = (vector_in(corner, name) for corner in list_in(value, 2, name))
    return low, high


def _left(content: Json, own: Json) -> dict[str, object]:
    """What of an object another one does not hold; of objects within both, what is left of them."""
    left: dict[str, object] = {}
    for key, value in content.items():
        ours = own.get(key)
        if key not in own:
            left[key] = value
        elif isinstance(value, Mapping) and isinstance(ours, Mapping) and (rest := _left(value, ours)):
            left[key] = rest
    return left


def _joined(own: Json, other: Json) -> dict[str, object]:
    """The inverse of :func:`_left`: both in one, where they differ ``own``."""
    joined = dict(other)
    for key, value in own.items():
        theirs = other.get(key)
        joined[key] = _joined(value, theirs) if isinstance(value, Mapping) and isinstance(theirs, Mapping) else value
    return joined
