"""Scenes that images show: a filter behind an image of a scene takes that scene.

An image is sent to ParaView's client and saved, and a scene is up to a hundred times as large: the image carries only a
key, and the scene stays with the filter that made it, for as long as that exists.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from uuid import uuid4

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkTable

from svv.dvr.read.appearance import named
from svv.errors import BadInput
from svv.io.files.atomic import atomic_path
from svv.pv.failed import check_there
from svv.pv.work.connected import SCENE
from svv.pv.work.unfinished import is_unfinished

KEY, LENGTH = "StyleRF Scene Key", 16
"""Field data of images of scenes, and its number of components. Scenes' tables have it, too, for the menus: ParaView
enables filters of scenes for data that have an array with so many components."""

GONE = (
    "The scene of this image is no longer in memory: apply the filter that made the image again, or connect a scene, "
    "such as a .svv file."
)

_shown: weakref.WeakValueDictionary[bytes, ShownScene] = weakref.WeakValueDictionary()


class ShownScene:
    """The scene of an image; ``fill`` puts it into an empty table when a filter asks for it first."""

    def __init__(self, fill: Callable[[vtkTable], object]) -> None:
        self._fill, self._key = fill, uuid4().bytes
        _shown[self._key] = self

    @cached_property
    def table(self) -> vtkTable:
        """The scene's table."""
        table = vtkTable()
        self._fill(table)
        return table

    def save(self, file: Path) -> None:
        """Write it to a scene file; raises BadInput if that fails, or if it is still being learned."""
        if is_unfinished(self.table):
            raise BadInput("The scene is still being learned: save it when it is there.")
        content = vtk_to_numpy(self.table.GetFieldData().GetArray(SCENE)).tobytes()
        with atomic_path(file) as partial:
            partial.write_bytes(content)

    def mark(self, image: vtkDataObject) -> None:
        """Mark an image as one of this scene."""
        mark_scene(image, self._key)


def mark_scene(data: vtkDataObject, key: bytes = bytes(LENGTH)) -> None:
    """Mark data as a scene, or as an image of one, so that ParaView's menus enable filters of scenes for them."""
    data.GetFieldData().AddArray(named(KEY, np.frombuffer(key, np.uint8).reshape(1, LENGTH)))


def shown_in(data: vtkDataObject) -> ShownScene:
    """Return the scene that a table carries, or an image shows, for another image of it; raise as :func:`table_of`."""
    table = table_of(data) or data
    return ShownScene(lambda copy: copy.ShallowCopy(table))


def table_of(data: vtkDataObject | None) -> vtkDataObject | None:
    """Return the table of the scene that an image shows; any other data as they are.

    Raises BadInput if the filter that made the image no longer exists, or the image was read from a file.
    """
    array = None if data is None or data.IsA("vtkTable") else data.GetFieldData().GetArray(KEY)
    if array is None:
        return data
    key = vtk_to_numpy(array).tobytes()
    if key == bytes(LENGTH):  # there is no scene yet
        return data
    known = _shown.get(key)
    if known is None:
        check_there(data)
        raise BadInput(GONE)
    return known.table
