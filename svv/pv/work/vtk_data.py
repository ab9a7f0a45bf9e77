"""Convert scenes, images and views to VTK data and back: scenes become tables, images and views become image data.

Only plain VTK data passes between filters, so ParaView can show, save and transfer it. A scene's table carries the
scene file as bytes; unpacked scenes are cached, because a moving camera reads the same one again and again.
"""

from __future__ import annotations

import weakref
from collections import OrderedDict
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkDoubleArray, vtkInformationVector, vtkPoints
from vtkmodules.vtkCommonDataModel import (
    vtkCellArray,
    vtkDataObject,
    vtkImageData,
    vtkImplicitFunction,
    vtkPolyData,
    vtkTable,
)

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, look_at
from svv.core.geometry.depth_mesh import DepthMesh
from svv.dvr.read.appearance import named, named_text
from svv.errors import BadInput
from svv.io.files.keyed_results import digest
from svv.io.scene_file import header_in
from svv.pv.failed import check_there
from svv.pv.results.keys import digest_of_views
from svv.pv.work.connected import BAKED, CAMERA, SCENE, VIEWS, what_is
from svv.pv.work.shown_scene import table_of
from svv.pv.work.unfinished import NotYetThere, is_unfinished

if TYPE_CHECKING:
    from svv.fields.scene.region import Region
    from svv.fields.scene.scene import Scene
    from svv.io.views.viewset import ViewSet
    from svv.pv.results.stored import Stored
    from svv.render.baking.baked_volume import BakedVolume

SCENE_INSTEAD = "connect StyleRF Train, Edit, Stylize or Stylized View, or open a .svv file."

KEPT = 3
"""Maximum number of unpacked scenes in memory."""

_scenes: OrderedDict[str, Scene] = OrderedDict()
_digests: dict[tuple[str, int], str] = {}
"""Address and modification time of an array -> hash of its content; hashing a scene of 20 MB takes 0.05 s."""
KNOWN = 256
"""Maximum number of arrays whose hashes are cached."""
_views: weakref.WeakValueDictionary[str, ViewSet] = weakref.WeakValueDictionary()


# --- scenes ---------------------------------------------------------------------------------------------------------


def put_scene(scene: Scene, table: vtkTable) -> None:
    """Fill a table with one row per region, and with the scene itself as field data."""
    _put_regions(scene.regions, table)
    content = scene.to_bytes()
    table.GetFieldData().AddArray(named(SCENE, np.frombuffer(content, np.uint8)))
    _keep(digest(np.frombuffer(content, np.uint8)), scene)


def put_stored(stored: Stored, content: bytes, table: vtkTable) -> None:
    """Fill a table as :func:`put_scene` does, with the scene in a file, which is not read for it."""
    _put_regions(stored.regions, table)
    table.GetFieldData().AddArray(named(SCENE, np.frombuffer(content, np.uint8)))


def _put_regions(regions: Sequence[Region], table: vtkTable) -> None:
    table.Initialize()
    colours = np.array([r.edited_colour or r.colour for r in regions], np.float64).reshape(-1, 3)
    columns: list[tuple[str, NDArray[np.number]]] = [
        ("Region", np.arange(len(regions), dtype=np.int32)),
        ("Colour", colours),
        ("Share", np.array([r.share for r in regions], np.float64)),
        ("Part Of", np.array([-1 if r.part_of is None else r.part_of for r in regions], np.int32)),
        ("Values", np.array([r.values or (np.nan, np.nan) for r in regions], np.float64).reshape(-1, 2)),
        ("Opacity", np.array([r.opacity for r in regions], np.float64)),
        ("Lighting", np.array([r.lighting for r in regions], np.float64)),
    ]
    for name, values in columns:
        table.AddColumn(named(name, values))
    for heading, words in (("Name", [r.name for r in regions]), ("Style", [r.style for r in regions])):
        table.AddColumn(named_text(heading, *(word or "" for word in words)))


def finished_scene_of(data: vtkDataObject | None) -> Scene:
    """Return the scene as :func:`scene_of`, for work not worth while on a sketch: NotYetThere while it is learned."""
    if is_unfinished(data):
        raise NotYetThere("The scene is still being learned: this is done when it is there.")
    return scene_of(data)


def scene_of(data: vtkDataObject | None) -> Scene:
    """Return the scene that a table carries, or that an image shows.

    Raises NotYetThere if there will be one, FailedBefore if a filter before has failed, BadInput if there is none.
    """
    data = table_of(data)
    if is_unfinished(data) and data is not None and not data.GetFieldData().HasArray(SCENE):
        raise NotYetThere("The scene is being learned: this filter follows as soon as there is something to show.")
    check_there(data)
    from svv.fields.scene.scene import Scene

    array = None if data is None else data.GetFieldData().GetArray(SCENE)
    if array is None:
        raise BadInput(f"The input is not a scene but {what_is(data)}: {SCENE_INSTEAD}")
    key = digest_of(array)
    if key not in _scenes:
        _keep(key, Scene.from_bytes(vtk_to_numpy(array).tobytes(), "The scene in the input"))
    _scenes.move_to_end(key)
    return _scenes[key]


def content_of(data: vtkDataObject) -> bytes:
    """Return the content of the scene file that a table carries, or of the scene that an image shows."""
    return vtk_to_numpy(_table(data).GetFieldData().GetArray(SCENE)).tobytes()


def bounds_of_scene(data: vtkDataObject | None) -> NDArray[np.float64] | None:
    """Return the bounds of the scene that a table carries or an image shows, from its header; None without one. (2, 3)

    Raises BadInput as :func:`table_of`, or if the header is damaged.
    """
    table = table_of(data)
    array = None if table is None else table.GetFieldData().GetArray(SCENE)
    if array is None:
        return None
    content, name = vtk_to_numpy(array), "The scene in the input"
    header = header_in(content[: int.from_bytes(content[:8].tobytes(), "little") + 8].tobytes(), name)
    try:
        boxes = np.stack([Box(**told["box"]).bounds for told in (header, *header.get("layers", []))])
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"The header of {name[0].lower()}{name[1:]} is damaged.") from error
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def key_of_scene(data: vtkDataObject) -> str:
    """Return a hash of the scene that a table carries or an image shows, with its edits."""
    return digest_of(_table(data).GetFieldData().GetArray(SCENE))


def _table(data: vtkDataObject) -> vtkDataObject:
    table = table_of(data)
    assert table is not None
    return table


def time_of(data: vtkDataObject | None) -> float | None:
    """Return the time of a data object; None if it has none."""
    key = vtkDataObject.DATA_TIME_STEP()
    return float(data.GetInformation().Get(key)) if data is not None and data.GetInformation().Has(key) else None


def digest_of(array: vtkDataArray) -> str:
    """Return a hash of an array's content; it is cached until the array is modified."""
    place = array.GetAddressAsString(""), array.GetMTime()
    if place not in _digests:
        if len(_digests) >= KNOWN:
            _digests.clear()
        _digests[place] = digest(vtk_to_numpy(array))
    return _digests[place]


def _keep(key: str, scene: Scene) -> None:
    _scenes[key] = scene
    _scenes.move_to_end(key)
    while len(_scenes) > KEPT:
        _scenes.popitem(last=False)


def forget_scenes() -> None:
    """Release the unpacked scenes and the cached hashes."""
    _scenes.clear()
    _digests.clear()


# --- images ---------------------------------------------------------------------------------------------------------


def put_image(image: vtkImageData, arrays: dict[str, NDArray[np.number]]) -> None:
    """Fill an image of one slice with arrays (height, width) or (height, width, channels), row 0 at the top.

    The first becomes its scalars; its own row 0 is at the bottom, as usual in VTK.
    """
    image.Initialize()
    height, width = next(iter(arrays.values())).shape[:2]
    image.SetDimensions(width, height, 1)
    for number, (name, values) in enumerate(arrays.items()):
        upside = np.ascontiguousarray(values[::-1])
        array = named(name, upside.reshape(width * height, -1) if values.ndim == 3 else upside.ravel())
        _tell_ranges(array, values.reshape(width * height, -1))
        image.GetPointData().AddArray(array)
        if number == 0:
            image.GetPointData().SetActiveScalars(name)


def put_drawn(image: vtkImageData, arrays: dict[str, NDArray[np.number]], camera: Camera) -> None:
    """Fill an image as :func:`put_image` does, and record its camera."""
    put_image(image, arrays)
    put_camera(camera, image)


def put_camera(camera: Camera, data: vtkDataObject) -> None:
    """Record the camera of an image, or of what was made of it."""
    numbers = [*camera.camera_to_world.ravel(), camera.fov_x, camera.span_x or 0.0]
    data.GetFieldData().AddArray(named(CAMERA, np.array(numbers)))


def drawn_in(data: vtkDataObject | None) -> tuple[NDArray[np.uint8], NDArray[np.float32], Camera]:
    """Return RGBA (height, width, 4), depth (height, width) and camera of an image, row 0 at the top; or BadInput."""
    check_there(data)
    fields = None if data is None else data.GetFieldData().GetArray(CAMERA)
    if data is None or fields is None or not data.IsA("vtkImageData"):
        raise BadInput(
            f"The input is not an image of a scene but {what_is(data)}: connect StyleRF Render or Stylized View."
        )
    image = vtkImageData.SafeDownCast(data)
    numbers = vtk_to_numpy(fields).astype(np.float64)
    width, height, _ = image.GetDimensions()
    camera = Camera(numbers[:16].reshape(4, 4), float(numbers[16]), width, height, float(numbers[17]) or None)
    rgba, depth = (vtk_to_numpy(image.GetPointData().GetArray(name)) for name in ("RGBA", "Depth"))
    return rgba.reshape(height, width, 4)[::-1], depth.reshape(height, width)[::-1], camera


def put_mesh(mesh: DepthMesh, data: vtkPolyData) -> None:
    """Fill a data object with a surface in its own colours, array ``RGBA`` of the points."""
    data.Initialize()
    points, cells = vtkPoints(), vtkCellArray()
    points.SetData(named("Points", mesh.points))
    cells.SetData(4, named("Vertices", mesh.quads.ravel()))
    data.SetPoints(points)
    data.SetPolys(cells)
    data.GetPointData().SetScalars(named("RGBA", mesh.colours))


def put_baked(volume: BakedVolume, image: vtkImageData) -> None:
    """Fill an image with a baked volume, with its opacity function and unit distance as field data."""
    image.Initialize()
    image.SetDimensions(*volume.grid.shape)
    image.SetOrigin(*volume.grid.origin)
    image.SetSpacing(*(volume.grid.spacing,) * 3)
    colours = named(BAKED, volume.rgba.reshape(-1, 4))
    _store_ranges(colours, *volume.ranges)  # at 256^3, VTK would look for them for seconds
    image.GetPointData().SetScalars(colours)
    for name, values in volume.fields().items():
        image.GetFieldData().AddArray(named(name, values))


def evaluated(function: vtkImplicitFunction, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of an implicit function of VTK at world coordinates (N, 3). (N,)"""
    values = vtkDoubleArray()
    values.SetNumberOfTuples(len(at))  # not every function does
    function.FunctionValue(numpy_to_vtk(np.ascontiguousarray(at)), values)
    return vtk_to_numpy(values)


def _tell_ranges(array: vtkDataArray, values: NDArray[np.number]) -> None:
    """Store the ranges of an array's components (N, C) where VTK caches them; VTK needs 0.1 s for a small image."""
    finite = values if values.dtype.kind in "iu" else np.where(np.isfinite(values), values, np.nan)
    if values.dtype.kind == "f" and (np.isinf(values).any() or np.isnan(finite).all(axis=0).any()):
        return  # the ranges of all and of finite values differ, or there are no finite values
    norm = np.linalg.norm(finite.astype(np.float64), axis=1)
    ends = np.stack([np.nanmin(finite, axis=0), np.nanmax(finite, axis=0)], axis=1).astype(np.float64)
    _store_ranges(array, ends, (float(np.nanmin(norm)), float(np.nanmax(norm))))


def _store_ranges(array: vtkDataArray, ends: NDArray[np.float64], norms: tuple[float, float]) -> None:
    """Store ranges, of components (C, 2) and of lengths, where VTK caches them."""
    information = array.GetInformation()
    for key in (vtkDataArray.PER_COMPONENT(), vtkDataArray.PER_FINITE_COMPONENT()):
        components = vtkInformationVector()
        components.SetNumberOfInformationObjects(len(ends))
        for component, (low, high) in enumerate(ends.tolist()):
            components.GetInformationObject(component).Set(vtkDataArray.COMPONENT_RANGE(), (low, high), 2)
        key.Set(information, components)
    for length in (vtkDataArray.L2_NORM_RANGE(), vtkDataArray.L2_NORM_FINITE_RANGE()):
        information.Set(length, norms, 2)


def camera_of(numbers: Sequence[float], width: int, height: int, parallel_scale: float = 0.0) -> Camera:
    """Return a camera from VTK's ten numbers and its parallel scale, in world units; 0 for perspective.

    They are position, focal point, view up, and the vertical angle of view in degrees. Raises BadInput if position and
    focal point coincide, or the angle or scale is out of range.
    """
    position, focal, up = (np.array(numbers[k : k + 3], np.float64) for k in (0, 3, 6))
    if parallel_scale:
        return Camera.orthographic(look_at(position, focal, up), 2.0 * parallel_scale * width / height, width, height)
    angle = np.radians(numbers[9])
    if not 0 < angle < np.pi:
        raise BadInput(f"The camera's angle of view must lie between 0 and 180 degrees, not {numbers[9]:g}.")
    fov_x = 2.0 * np.arctan(np.tan(0.5 * angle) * width / height)
    return Camera(look_at(position, focal, up), float(fov_x), width, height)


def numbers_of(camera: Camera, centre: Sequence[float]) -> list[float]:
    """Return VTK's ten numbers of a camera, with its horizontal angle; the focal point is as far away as ``centre``."""
    ahead = -camera.camera_to_world[:3, 2]
    focal = camera.position + ahead * max(float(ahead @ (np.asarray(centre) - camera.position)), 1e-6)
    return [*camera.position, *focal, *camera.camera_to_world[:3, 1], float(np.degrees(camera.fov_x))]


# --- views ----------------------------------------------------------------------------------------------------------


def put_views(
    views: ViewSet, index: int, image: vtkImageData, cameras: vtkPolyData, key: str = "", file: str = ""
) -> None:
    """Fill the outputs with one view as an image and all cameras as points; both refer to the views they belong to.

    The views stay with the filter that made them: a token in the field data refers to them as long as that exists.
    ``key`` is a hash of what they depend on, by default theirs, ``file`` the one that lists them, if they were read.
    """
    put_image(image, {"RGBA": views.images[index]})
    token = f"{id(views):x}"
    _views[token] = views
    put_cameras(views.cameras, cameras)
    _mark(token, key, file, image, cameras)


def put_no_views(key: str, image: vtkImageData, cameras: vtkPolyData) -> None:
    """Mark empty outputs with the key of the missing views: results made from those views may still be kept."""
    _mark("", key, "", image, cameras)


def _mark(token: str, key: str, file: str, *outputs: vtkDataObject) -> None:
    for data in outputs:
        data.GetFieldData().AddArray(named_text(VIEWS, token, key, file))


def key_of_views(data: vtkDataObject | None) -> str | None:
    """Return a hash of what an image's views depend on, None if it has none; raise as :func:`views_of`."""
    array = None if data is None else data.GetFieldData().GetAbstractArray(VIEWS)
    if array is None:
        return None
    if array.GetValue(1):
        return str(array.GetValue(1))
    views = views_of(data)
    assert views is not None
    return digest_of_views(views)


def views_of(data: vtkDataObject | None) -> ViewSet | None:
    """Return the views that an image belongs to, or None; raise BadInput if the filter that made them is gone."""
    array = None if data is None else data.GetFieldData().GetAbstractArray(VIEWS)
    if array is None:
        return None
    views = _views.get(array.GetValue(0))
    if views is None:
        check_there(data)
        raise BadInput(
            "The input's views are no longer in memory: apply StyleRF Views, or open the folder of views, again."
        )
    return views


def put_cameras(cameras: Sequence[Camera], data: vtkPolyData) -> None:
    """Fill a data object with cameras as points, with their direction, up, and vertical angle of view (degrees).

    If any is orthographic, there is the parallel scale (world units), half the height of its image, and its angle is 0.
    """
    data.Initialize()
    matrices = np.stack([camera.camera_to_world for camera in cameras])
    points = vtkPoints()
    points.SetData(named("Points", matrices[:, :3, 3]))
    data.SetPoints(points)
    vertices = vtkCellArray()
    for number in range(len(cameras)):
        vertices.InsertNextCell(1, [number])
    data.SetVerts(vertices)
    angles = [0.0 if c.is_orthographic else 2.0 * np.arctan(0.5 * c.height / c.focal) for c in cameras]
    arrays = {"Direction": -matrices[:, :3, 2], "Up": matrices[:, :3, 1], "View Angle": np.degrees(angles)}
    if any(c.is_orthographic for c in cameras):
        arrays["Parallel Scale"] = np.array([0.5 * c.height / c.focal * c.is_orthographic for c in cameras])
    for name, values in arrays.items():
        data.GetPointData().AddArray(named(name, values))
