"""Scenes and volumes handed from one process to another in files; volumes' arrays are mapped into its memory."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData, vtkTable

from svv.dvr.read.appearance import GHOSTS
from svv.dvr.read.grids import grid_numbers, image_on
from svv.io.files.atomic import cannot_write
from svv.io.files.cache import Cache
from svv.pv.panel_values import Values
from svv.pv.results.keys import name_of
from svv.pv.work.connected import VIEWS
from svv.pv.work.vtk_data import content_of, put_scene, time_of

WARM = "warm.svv"
"""File in a learner's folder with a small scene, drawing which loads all that it takes."""

SCENE_FILE = "scene.svv"
"""File with the scene, if that is the input."""

LISTED = "transforms_train.json"
"""File that lists the views in a folder of the cache."""

ABOUT = "about.json"
"""File with the grid, the time and the names of the arrays."""


def hand_over(image: vtkImageData, values: Values, time: float | None, folder: Path) -> None:
    """Write a volume to a new folder: its grid, and the arrays that a panel's values choose or may choose."""
    arrays: list[list[object]] = []
    try:
        folder.mkdir()
        for cells, data in enumerate((image.GetPointData(), image.GetCellData())):
            active = data.GetScalars()
            chosen = {values["Scalars"], GHOSTS, None if active is None else active.GetName()}
            for number in range(data.GetNumberOfArrays()):
                array = data.GetArray(number)  # None for text
                if array is None or (array.GetName() not in chosen and array is not active):
                    continue
                file = f"{len(arrays)}.npy"
                np.save(folder / file, vtk_to_numpy(array))
                arrays.append([file, cells, array.GetName(), array.GetDataType(), array is active])
        (folder / ABOUT).write_text(json.dumps({"grid": grid_numbers(image), "time": time, "arrays": arrays}))
    except OSError as error:
        raise cannot_write(folder, error) from error


def hand_over_scene(table: vtkDataObject, folder: Path) -> None:
    """Write the scene of a table to a new folder; raises BadInput if it cannot be written."""
    try:
        folder.mkdir()
        (folder / SCENE_FILE).write_bytes(content_of(table))
    except OSError as error:
        raise cannot_write(folder, error) from error


def file_of_views(data: vtkDataObject | None) -> Path | None:
    """Return the file that lists the views of an image: their own, or the one in the cache; None if there is none."""
    array = None if data is None else data.GetFieldData().GetAbstractArray(VIEWS)
    if array is None:
        return None
    _, key, own = (array.GetValue(k) for k in range(3))
    if not own and not key:
        return None
    file = Path(own) if own else Cache.of_user().folder / name_of("views", *key.split("-", 1)) / LISTED
    return file if file.is_file() else None


def taken(folder: Path) -> vtkImageData | vtkTable:
    """Return the scene's table, or the volume, in a folder; its arrays are read from the disk when needed."""
    if (folder / SCENE_FILE).exists():
        from svv.fields.scene.scene import Scene

        table = vtkTable()
        put_scene(Scene.load(folder / SCENE_FILE), table)
        return table
    about = json.loads((folder / ABOUT).read_text())
    image = image_on(about["grid"])
    for file, cells, name, kind, active in about["arrays"]:
        array = numpy_to_vtk(np.load(folder / file, mmap_mode="c"), array_type=kind)  # VTK has several for a size
        array.SetName(name)
        data = image.GetCellData() if cells else image.GetPointData()
        data.AddArray(array)
        if active:
            data.SetScalars(array)
    if about["time"] is not None:
        image.GetInformation().Set(vtkDataObject.DATA_TIME_STEP(), about["time"])
    assert time_of(image) == about["time"]
    return image
