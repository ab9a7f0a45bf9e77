"""The filters' work in terms of the engine: drawing views, training scenes, keys of paintings, rendering images.

The functions take the panel's ``values`` and determine on which inputs a result depends: none is computed twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData

from svv.core.geometry.cameras import Camera, CameraRig
from svv.dvr.read.appearance import GHOSTS
from svv.dvr.read.grids import direction_of
from svv.dvr.read.meshes import is_mesh
from svv.errors import BadInput, Progress
from svv.io.files.keyed_results import digest
from svv.options.described import chosen
from svv.options.figures import VISIONS, VisionName
from svv.options.making import DeviceOptions, RenderOptions, TrainOptions, ViewOptions
from svv.pv.display.shown import CROPS_INDICES, DIVIDED, chosen_of, scale_of, volume_shown
from svv.pv.failed import check_there, pressing
from svv.pv.panel.groups import COLOURS, DOUBT, IN_COLOUR
from svv.pv.panel.option_panel import options_in
from svv.pv.panel_values import Values
from svv.pv.results.keys import key_of
from svv.pv.results.time_steps import Moment
from svv.pv.work.base import ORBIT
from svv.pv.work.connected import BAKED, OF_SCENE, is_baked, is_flat, what_is
from svv.pv.work.parallel import crew_of
from svv.pv.work.resampled import image_of
from svv.pv.work.vtk_data import camera_of, digest_of, key_of_views, time_of

if TYPE_CHECKING:
    from svv.core.colour.shading import Shading
    from svv.dvr.functions.transfer_functions import TransferFunction
    from svv.fields.scene.scene import Scene
    from svv.io.views.viewset import ViewSet
    from svv.job.moving import Moving
    from svv.pv.results.stored import Stored
    from svv.render.baking.baked_volume import BakedVolume


# --- views ----------------------------------------------------------------------------------------------------------


def volume_of(data: vtkDataObject | None, values: Values) -> vtkImageData:
    """Return the input as an image, resampled if need be; BadInput if it is empty, flat, of a scene, or no grid."""
    check_there(data)
    what, crew = what_is(data), crew_of(data)
    if isinstance(data, vtkImageData) and data.GetNumberOfPoints() == 0 and crew is None:
        raise BadInput("The input is empty; apply the filter or reader before this one first.")
    if key_of_views(data) is not None:
        raise BadInput(f"The input is {what} already: connect StyleRF Train or Stylized View to it.")
    if what in OF_SCENE and not _has_values(data, values):
        raise BadInput(
            f"The input is {what}, and this filter needs a volume: connect the one that it was learned from."
        )
    if data is not None and is_flat(data) and crew is None:
        raise BadInput(f"The input is {what}, and StyleRF needs a volume: connect data with more than one slice.")
    if isinstance(data, vtkImageData):
        return data
    if data is not None and is_mesh(data):
        return image_of(data, values)
    grid = "Table To Structured Grid" if data is not None and data.IsA("vtkTable") else "a filter that makes a grid"
    raise BadInput(f"The input is {what}, and StyleRF needs a volume: insert {grid} before this filter.")


def _has_values(data: vtkDataObject | None, values: Values) -> bool:
    """Return whether a baked volume has been given other values than its colours, and these are chosen."""
    name = values.get("Scalars", "")
    if not isinstance(data, vtkImageData) or not is_baked(data) or name == BAKED:
        return False
    return bool(data.GetPointData().HasArray(name) or data.GetCellData().HasArray(name))


def _is_volume(data: vtkDataObject | None) -> bool:
    return isinstance(data, vtkImageData) or (data is not None and is_mesh(data))


def is_whole_volume(data: vtkDataObject | None) -> bool:
    """Return whether data is a volume that is in one piece."""
    return _is_volume(data) and crew_of(data) is None


def views_key(image: vtkImageData, values: Values) -> str:
    """Return a hash of everything that a volume's views depend on: data, transfer function, shading, number, size."""
    return digest(_digest_of(image, values), _drawing(values), transfer_function_of(values).to_dict())


def _digest_of(image: vtkImageData, values: Values) -> str:
    """Return a hash of the grid and of the displayed array; with several ranks, also of how these are divided."""
    crew = crew_of(image)
    if crew is not None:
        image = crew.piece.whole
    place = [image.GetDimensions(), image.GetSpacing(), image.GetOrigin(), direction_of(image)]
    if crew is not None:
        return digest(*place, crew.digest())
    first, second = image.GetPointData(), image.GetCellData()
    if values.get("ScalarsOnCells"):
        first, second = second, first
    array = first.GetArray(values["Scalars"]) or second.GetArray(values["Scalars"])
    array = array or first.GetScalars() or second.GetScalars()
    content = None if array is None else [digest_of(array), array.GetDataTypeAsString()]
    ghosts = [data.GetArray(GHOSTS) for data in (image.GetPointData(), image.GetCellData())]
    return digest(*place, content, *(digest_of(one) for one in ghosts if one is not None))


def _drawing(values: Values) -> list[object]:
    """Return how the volume is displayed, except for the transfer function, and the options of its views."""
    drawing: list[object] = [values["Scalars"], chosen(options_in(ViewOptions, values)), asdict(shading_of(values))]
    display = chosen_of(values)
    # Versions of ParaView crop differently, and may share a folder of kept results.
    ours = [CROPS_INDICES] if "UseCropping" in display and CROPS_INDICES else []
    return [*drawing, display, *ours] if display else drawing


def moment_of(data: vtkDataObject | None, values: Values, asked: float | None) -> Moment:
    """Return what the views of a volume depend on, its time, and the time that was asked for; or raise BadInput."""
    image, look = volume_of(data, values), digest(transfer_function_of(values).to_dict())
    settings = digest(_drawing(values), values["OpacityUnitDistance"])
    # Choosing another table counts as a changed setting; changing the same table counts as an edit.
    table = f"{id(values['TransferFunction']):x}"
    return Moment(settings, look, _digest_of(image, values), asked, time_of(data), table)


def transfer_function_of(values: Values) -> TransferFunction:
    """Return the panel's transfer function; raise BadInput if it has none, or the volume's display is not supported."""
    from svv.dvr.functions.transfer_functions import TransferFunction

    if values.get("Refusal"):
        raise BadInput(f"{values['Refusal']} Then {pressing()}.")
    table = values["TransferFunction"]
    if isinstance(table, Mapping):  # handed from another process
        return TransferFunction.from_dict(table, "the transfer function")
    opacity = None if table is None else table.GetScalarOpacityFunction()
    if table is None or opacity is None:
        raise BadInput(
            "There is no transfer function: show the filter's input in the active view with the representation Volume, "
            f"and then {pressing()}."
        )
    unit = scale_of(values) * values["OpacityUnitDistance"] or None
    return TransferFunction.from_vtk(table, opacity, unit, "the transfer function")


def shading_of(values: Values) -> Shading:
    """Return the panel's shading."""
    from svv.core.colour.shading import Shading

    return Shading(
        bool(values["Shade"]), values["Ambient"], values["Diffuse"], values["Specular"], values["SpecularPower"]
    )


def draw_views(
    image: vtkImageData, values: Values, options: ViewOptions, progress: Progress
) -> tuple[ViewSet, ViewSet | None]:
    """Draw training and test views of a volume as the panel shows it; raises as ``make_views``."""
    from svv.dvr.draw.views import make_views
    from svv.dvr.parallel.crew_views import make_crew_views

    crew, name = crew_of(image), values["Scalars"] or "volume"
    if crew is not None:
        if chosen_of(values):
            raise BadInput(DIVIDED)
        return make_crew_views(crew, transfer_function_of(values), options, shading_of(values), name, progress)
    return make_views(
        volume_shown(image, values),
        transfer_function_of(values),
        options,
        shading=shading_of(values),
        rescale=False,  # in ParaView the user has already placed the function
        name=name,
        progress=progress,
    )


# --- scenes ---------------------------------------------------------------------------------------------------------


def training_moment(data: vtkDataObject | None, values: Values, asked: float | None) -> Moment:
    """Return what a scene is trained on, and its time: as :func:`moment_of`, or the views that the data belongs to.

    Views change only when their filter is asked to draw others; a change of views counts at any time.
    """
    views = key_of_views(data)
    if views is None:
        moment = moment_of(data, {**values, "TestViews": 0}, asked)  # test views do not affect training
    else:
        moment = Moment("views", "", digest("views", views))
    settings = digest(moment.settings, chosen(options_in(TrainOptions, values)))
    return replace(moment, settings=settings, here=f"{moment.here} {values.get('SceneFile', '')}")


def follows(scene: Scene, data: vtkDataObject | None, made: Moment | None, now: Moment) -> bool:
    """Return whether a scene of the encoding ``values`` can follow a volume in one piece from one time to another."""
    moved = made is not None and made.data != now.data and None not in (made.time, now.time) and made.time != now.time
    return moved and None not in (scene.values, scene.steps) and is_whole_volume(data)


def moving_from(
    scene: Scene, data: vtkDataObject | None, values: Values, now: Moment, times: Sequence[float]
) -> Moving | None:  # fmt: skip
    """Return what follows a volume's matter from the time, one of ``times``, at which a scene is painted.

    None if the scene cannot follow its volume, has no paint, or the data have no time.
    """
    if scene.values is None or scene.styled is None or now.time is None or not _is_volume(data):
        return None
    from svv.job.moving import Moving

    return Moving(volume_shown(volume_of(data, values), values), scene.values.interval, now.time, times)


def followed(scene: Scene, data: vtkDataObject, values: Values, now: Moment, moving: Moving | None = None) -> Scene:
    """Return a scene as another time step of its volume makes it; paint moves with the matter where that is known.

    Raises BadInput if the scene shows nothing of the volume, or has paint or parts that cannot follow.
    """
    from svv.dvr.draw.classify import classified_as
    from svv.dvr.functions.transfer_functions import TransferFunction
    from svv.fields.following.followed_scene import at_volume

    volume = volume_shown(volume_of(data, values), values)
    told = scene.made.get("source", {}).get("tf")
    tf = transfer_function_of(values) if told is None else TransferFunction.from_dict(told)
    time = now.time or 0.0
    if moving is None:
        return at_volume(scene, classified_as(volume, tf), time)
    return at_volume(scene, classified_as(volume, tf), time, moving.matter(volume, time), moving.strokes.at(time))


def scene_in(file: Path, now: Moment, values: Values) -> Scene | None:
    """Return the scene in the user's file; None if there is none, or it was trained on something else."""
    from svv.fields.devices.gpu import device_named
    from svv.fields.scene.scene import Scene

    scene = Scene.load(file) if file.exists() else None
    if scene is None or scene.made.get("key") != key_of(now):
        return None
    return scene.on(device_named(options_in(DeviceOptions, values).device))


def describe_regions(scene: Scene | Stored) -> str:
    """Say how many regions a scene has and what it was learned from, which scenes of older versions do not tell."""
    origin = f", learned from {scene.made['learned_from']}" if "learned_from" in scene.made else ""
    return f"{len(scene.regions)} regions{origin}"


def as_cut(volume: BakedVolume, values: Values) -> BakedVolume:
    """Return a baked volume, cut as the panel asks."""
    from svv.pv.work.vtk_data import evaluated
    from svv.render.baking.cut import cut

    function, sign = values["CutBy"], 1.0 if values["Invert"] else -1.0
    if not values["Cut"] or function is None:
        return volume
    return cut(volume, lambda at: sign * evaluated(function, at))


# --- images ---------------------------------------------------------------------------------------------------------


def camera_for(rig: CameraRig, values: Values) -> Camera:
    """Return the panel's camera, or if it is all zeros, that of the panel's frame of an orbit; or raise BadInput."""
    width, height = size_of(values)
    if any(values["Camera"][:6]):
        return camera_of(values["Camera"], width, height, values["ParallelScale"])
    frame = values["Frame"]
    if not 0 <= frame < ORBIT:
        raise BadInput(f"Frame must be 0 to {ORBIT - 1}, the frames of the orbit, not {frame}.")
    (camera,) = rig.orbit(ORBIT, width, [frame])
    return camera.resized(width, height)


def size_of(values: Values) -> tuple[int, int]:
    """Return width and height of the image that the panel asks for, in pixels."""
    width, height = (int(v) for v in values["ImageSize"])
    if not (1 <= width <= 16384 and 1 <= height <= 16384):
        raise BadInput(f"The image's size must be 1 to 16384 pixels along each side, not {width} x {height}.")
    return width, height


def as_seen_with(rgba: NDArray[np.uint8], vision: VisionName) -> NDArray[np.uint8]:
    """Return straight RGBA (..., 4) as it looks with one of the ways to see."""
    from svv.core.colour.colour_vision import simulated
    from svv.io.pictures.output import to_bytes

    if vision == VISIONS[0]:
        return rgba
    return np.concatenate([to_bytes(simulated(rgba[..., :3] / 255.0, vision)), rgba[..., 3:]], axis=-1)


def emptiness_of(scene: Scene, depth: NDArray[np.number]) -> str:
    """Return a sentence, after a space, if an image of a scene shows nothing; '' if it shows something."""
    from svv.render.emptiness import HIDDEN, why_empty

    why = why_empty(scene, np.asarray(depth, np.float32))
    if not why:
        return ""
    return f" The image is empty, because {why}{': show one with StyleRF Edit' if why == HIDDEN else ''}."


def draw(scene: Scene, camera: Camera, values: Values, progress: Progress) -> dict[str, NDArray[np.number]]:
    """Render RGBA (uint8), depth and regions of a scene from a camera; raise BadInput without network or device."""
    from svv.fields.devices.gpu import device_named
    from svv.io.pictures.mask_pictures import region_map_overlay
    from svv.io.pictures.output import darkest_from, doubt_picture, to_bytes
    from svv.render.frames import region_colours
    from svv.render.supersampled import supersampled

    options = options_in(RenderOptions, values)
    background = values["BackgroundColour"] if values["Background"] else None
    if options.variant is not None:
        scene = scene.with_variant(options.variant)
    if values["Moving"]:
        scene = scene.while_moving()
    drawn = scene.on(device_named(options.device))
    shown = supersampled(drawn, camera, options.network, background, progress)
    rgba = to_bytes(shown.rgba)
    arrays: dict[str, NDArray[np.number]] = {"Depth": shown.depth, "Region": shown.region}
    if values.get("Show", COLOURS) == DOUBT:
        arrays["Doubt"] = drawn.doubt(camera, progress)
        rgba = to_bytes(doubt_picture(arrays["Doubt"], darkest_from(arrays["Doubt"])))
    elif values.get("Show", COLOURS) != COLOURS:
        colours = region_colours(scene) if values["Show"] == IN_COLOUR else None
        rgba = region_map_overlay(shown.region, colours)
    rgba = as_seen_with(rgba, values.get("SeenWith", VISIONS[0]))
    return {"RGBA": rgba, **arrays}


def with_values(
    scene: Scene, camera: Camera, values: Values, progress: Progress
) -> tuple[dict[str, NDArray[np.number]], str]:  # fmt: skip
    """Return the volume's values in an image of a scene as an array, or none and a sentence on why, after a space."""
    from svv.fields.scene.probing import why_no_values

    options = options_in(RenderOptions, values)
    if options.variant is not None:
        scene = scene.with_variant(options.variant)
    image = scene.value_image(camera, options.network, progress)
    return ({}, f" There are no values, because {why_no_values(scene)}.") if image is None else ({"Value": image}, "")
