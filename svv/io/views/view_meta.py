"""Metadata on how the images of a view set were made: the object under the key ``svv`` of the JSON file."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import CameraRig
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
from svv.errors import BadInput

Value = TypeVar("Value")
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class VolumeGrid:
    """The grid of a volume: position, type and range of its voxels."""

    dimensions: tuple[int, int, int]
    """Number of voxels along x, y and z."""
    spacing: Vector
    """Distances between voxels along x, y and z, world units."""
    origin: Vector
    """Position of the first voxel, world units."""
    direction: tuple[Vector, Vector, Vector]
    """Rows of the matrix whose columns are the grid's axes in the world."""
    type: str
    """NumPy's name of the voxel type, such as ``uint8``."""
    range: tuple[float, float]
    """Smallest and largest value."""

    @property
    def corners(self) -> NDArray[np.float64]:
        """Lowest and highest corners of the box around its voxels, world units. (2, 3)"""
        ends = [(0.0, (count - 1) * apart) for count, apart in zip(self.dimensions, self.spacing, strict=True)]
        every = np.array(list(itertools.product(*ends))) @ np.array(self.direction).T + self.origin
        return np.stack([every.min(axis=0), every.max(axis=0)])

    @classmethod
    def from_json(cls, content: object, name: str = "grid") -> VolumeGrid:
        """Invert :meth:`to_json`; raises BadInput, with the object's name, if a value is missing or invalid."""
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
        """Return plain values under the names of the fields."""
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
    """Metadata on how the images of a view set were made; it is empty for sets from other programs.

    Views that were rendered from a volume (:func:`svv.dvr.draw.views.make_views`) have all fields, ``nearest`` and
    ``assumed`` only if there is something to say, and ``file`` if the volume was read from one by the command.
    """

    volume: str | None = None
    """Name of the volume."""
    grid: VolumeGrid | None = None
    """Grid of the volume."""
    bounds: tuple[Vector, Vector] | None = None
    """Lower and upper corners of the visible data, world units."""
    rig: CameraRig | None = None
    """Sphere on which the cameras of the training views lie."""
    tf: Json | None = None
    """Transfer function that was used, as a ParaView preset
    (:meth:`svv.dvr.functions.transfer_functions.TransferFunction.from_dict`)."""
    tf_rescaled: bool | None = None
    """Whether the transfer function was stretched over the data's range."""
    shading: Shading | None = None
    """Shading of the volume."""
    sample_distance: float | None = None
    """Sample distance of the ray caster, world units."""
    mapper: str | None = None
    """Ray caster that was used: ``cpu`` or ``gpu``."""
    vtk: str | None = None
    """Version of VTK."""
    seconds: float | None = None
    """Time taken to make the views, in seconds."""
    nearest: bool | None = None
    """True if each voxel's own value was shown, without interpolation."""
    assumed: str | None = None
    """Sentences on what was assumed or changed, or may look otherwise than expected. When images of another program
    were read: which pixels count as empty if they had no alpha, and how they were resampled. When a volume was drawn:
    what its file does not tell, such as the size of a voxel, outliers among its values, another ray caster than the one
    that was asked for, labels that are interpolated, and views that show nothing."""
    other: Json = field(default_factory=dict)
    """Values under unknown keys, which are written unchanged."""
    file: Json | None = None
    """How the volume's file was read, and a hash of its content (:func:`svv.job.source.content_of`), so that it is
    known again (:mod:`svv.job.volume_panels`). It does not say where the file is: scenes are given to others."""
    array: str | None = None
    """Name of the array that was drawn, if the volume's file has names for its arrays."""

    @classmethod
    def from_json(cls, content: object, name: str = "svv") -> ViewMeta:
        """Invert :meth:`to_json`; None is no metadata, and ``null`` under a known key is ignored.

        Raises BadInput, with the object's name and the key, if ``content`` is not an object, or the value of a known
        key is invalid.
        """
        values = object_in({} if content is None else content, name)
        there = [key for key in READERS if values.get(key) is not None]
        meta = cls(**{key: READERS[key](values[key], f"{name}.{key}") for key in there})
        return replace(meta, other=_left(values, meta.to_json()))

    def to_json(self) -> dict[str, object]:
        """Return the known values and ``other`` as plain values under the names of the fields."""
        own = {key: value for key in READERS if (value := getattr(self, key)) is not None}
        own |= {key: own[key].to_json() for key in ("grid", "rig", "shading") if key in own}
        if self.bounds is not None:
            own["bounds"] = [list(corner) for corner in self.bounds]
        return _joined(own, self.other)


def known(value: Value | None, key: str) -> Value:
    """Return the value of a key in the metadata; raises BadInput if the views do not have it."""
    if value is None:
        raise BadInput(
            f"The views do not state their {key}: svv did not make them from a volume; make them with svv views."
        )
    return value


def _bounds(value: object, name: str) -> tuple[Vector, Vector]:
    low, high = (vector_in(corner, name) for corner in list_in(value, 2, name))
    return low, high


READERS: dict[str, Callable[[object, str], Any]] = {
    "volume": text_in, "grid": VolumeGrid.from_json, "bounds": _bounds, "rig": CameraRig.from_json, "tf": object_in,
    "tf_rescaled": switch_in, "shading": Shading.from_json, "sample_distance": number_in, "mapper": text_in,
    "vtk": text_in, "seconds": number_in, "file": object_in, "nearest": switch_in, "assumed": text_in,
    "array": text_in,
}  # fmt: skip
"""Key of a file -> what checks and reads its value, for the field of the same name; in the order of files."""


def _left(content: Json, own: Json) -> dict[str, object]:
    """Return the entries of an object that another one does not have; nested objects are compared likewise."""
    left: dict[str, object] = {}
    for key, value in content.items():
        ours = own.get(key)
        if key not in own:
            left[key] = value
        elif isinstance(value, Mapping) and isinstance(ours, Mapping) and (rest := _left(value, ours)):
            left[key] = rest
    return left


def _joined(own: Json, other: Json) -> dict[str, object]:
    """Invert :func:`_left` by merging two objects; ``own`` has priority."""
    joined = dict(other)
    for key, value in own.items():
        theirs = other.get(key)
        joined[key] = _joined(value, theirs) if isinstance(value, Mapping) and isinstance(theirs, Mapping) else value
    return joined
