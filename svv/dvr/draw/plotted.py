"""A volume as one of VTK's actors shows it, such as that of a ``pyvista.Plotter``: its values, function, light, place.

What an actor, its mapper or its property asks for is reproduced, or refused in a sentence.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction, vtkUnstructuredGrid
from vtkmodules.vtkRenderingCore import (
    vtkColorTransferFunction,
    vtkRenderer,
    vtkRenderWindow,
    vtkVolume,
    vtkVolumeProperty,
)

from svv.core.colour.shading import Shading
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance, put
from svv.dvr.read.grids import (
    ORTHOGONAL_TOLERANCE,
    as_volume,
    assumed_of,
    from_array,
    index_to_world,
    put_assumed,
    set_geometry,
    to_array,
)
from svv.dvr.read.meshes import describe_resampling, is_mesh, resampled
from svv.errors import BadInput

Array = NDArray[np.float64]

CLOSED = (
    "The plotter shows no volume. One that show() has closed has forgotten what it showed: give the actor that "
    "add_volume returned, or show(auto_close=False)."
)
SEVERAL = (
    "There are {count} volumes, and a scene is made of one: give the actor of one (what add_volume returned), and put "
    "several scenes together with svv join."
)
SHEARED = "{who} scales a volume whose axes are turned differently along x, y and z, which shears it: {instead}."
NOTHING = "{who} scales the volume to nothing: no number of Scale may be 0."
LIGHTS = "The volume is lit from the camera alone, not by the plotter's {count} lights."
BESIDE = "Only the volume is painted, not the {count} other things that the plotter shows."
BETWEEN = "Values are interpolated, because a {kind} was resampled; the actor shows each without interpolation."

COMPOSITE, HEADLIGHT = 0, 1
"""VTK's numbers of the blend mode, and of the kind of light, that are reproduced."""

FIELD_DATA, CELLS = (3, 4), (2, 4)
"""Scalar modes of VTK's mappers that take an array by its name, and those that take one of the cells."""


def actor_of(given: object) -> vtkVolume | None:
    """Return the only volume that an actor, renderer, window or plotter shows, or raise BadInput; None for others."""
    if isinstance(given, vtkVolume):
        return given
    if isinstance(given, (list, tuple)) and given and all(isinstance(one, vtkVolume) for one in given):
        shown = list(given)
    elif (renderers := _renderers(given)) is not None:
        shown = [volume for renderer in renderers for volume in renderer.GetVolumes() if volume.GetVisibility()]
    else:
        return None
    if not shown:
        raise BadInput(CLOSED)
    if len(shown) > 1:
        raise BadInput(SEVERAL.format(count=len(shown)))
    return shown[0]


def _renderers(given: object) -> list[vtkRenderer] | None:
    """Return the renderers of a plotter or window; None for anything else."""
    if isinstance(given, vtkRenderer):
        return [given]
    found: Any = given.GetRenderers() if isinstance(given, vtkRenderWindow) else getattr(given, "renderers", None)
    if found is None:
        return None
    each = list(found)
    return each if each and all(isinstance(one, vtkRenderer) for one in each) else None


def image_shown(given: object) -> vtkImageData | None:
    """Return the volume that :func:`actor_of` finds, in its place in the world; None if that returns None.

    Values, interpolation, position and scale are those of the actor; what may look otherwise is noted
    (:func:`svv.dvr.read.grids.assumed_of`). Raises BadInput if the actor shows its volume in a way that is not
    reproduced.
    """
    actor = actor_of(given)
    if actor is None:
        return None
    mapper, shown = actor.GetMapper(), actor.GetProperty()
    data = None if mapper is None else mapper.GetInputDataObject(0, 0)
    if data is None and mapper is not None and mapper.GetNumberOfInputConnections(0):
        mapper.GetInputAlgorithm().Update()
        data = mapper.GetInputDataObject(0, 0)
    if data is None:
        raise BadInput("The volume's actor has no data: give its mapper some.")
    _refuse(mapper, shown)
    array, cells = _array_of(mapper, data), mapper.GetScalarMode() in CELLS
    notes = []
    voxels, nearest = shown.GetInterpolationType() == 0, False
    if is_mesh(data):
        image = as_volume(resampled(data, array, cells, name="The volume"))
        notes += [describe_resampling(data, image)]
        if voxels and not isinstance(data, vtkUnstructuredGrid):  # those are always interpolated
            notes.append(BETWEEN.format(kind=data.GetClassName()))
    else:
        image, nearest = as_volume(data, array, "The volume", cells), voxels
        if image.GetDimensions() != data.GetDimensions():  # its voxels are the cells of the data
            image, crop = with_outer_halves(image, None)
            put(image, replace(Appearance.of(image), crop=crop))
    image = moved(image, matrix_of(actor), "The actor", "give it three equal numbers, or resample the grid")
    put(image, replace(Appearance.of(image), nearest=nearest))
    renderers = _renderers(given) or []
    if shown.GetShade() and renderers:
        notes += _describe_lights(next(renderer for renderer in renderers if actor in list(renderer.GetVolumes())))
    beside = sum(bool(one.GetVisibility()) for renderer in renderers for one in renderer.GetActors())
    notes += [BESIDE.format(count=beside)] if beside else []
    put_assumed(image, " ".join(filter(None, [assumed_of(image), *notes])) or None)
    return image


def function_of(given: object, name: str = "transfer function") -> TransferFunction | None:
    """Return the transfer function, unit distance and shading of a property, actor or plotter; None for anything else.

    Raises BadInput for the reasons of :func:`actor_of`, for 2D functions, and for opacities that depend on gradients.
    """
    actor = None if isinstance(given, vtkVolumeProperty) else actor_of(given)
    shown = given if actor is None else actor.GetProperty()
    if not isinstance(shown, vtkVolumeProperty):
        return None
    _refuse_property(shown)
    scale = 1.0 if actor is None else float(np.cbrt(abs(np.linalg.det(matrix_of(actor)[:3, :3]))))
    if not scale:
        raise BadInput(NOTHING.format(who="The actor"))
    colour = shown.GetRGBTransferFunction() if shown.GetColorChannels() == 3 else _coloured(shown)
    unit = scale * shown.GetScalarOpacityUnitDistance()
    function = TransferFunction.from_vtk(colour, shown.GetScalarOpacity(), unit, name)
    light = (shown.GetAmbient(), shown.GetDiffuse(), shown.GetSpecular(), shown.GetSpecularPower())
    return replace(function, shading=Shading(bool(shown.GetShade()), *light))


def shows_voxels(given: object) -> bool:
    """Return whether a property, actor or plotter shows voxels without interpolation."""
    actor = None if isinstance(given, vtkVolumeProperty) else actor_of(given)
    shown = given if actor is None else actor.GetProperty()
    return isinstance(shown, vtkVolumeProperty) and shown.GetInterpolationType() == 0


def moved(image: vtkImageData, matrix: Array, who: str, instead: str) -> vtkImageData:
    """Move an image by a matrix (4, 4); what scales its axes differently is kept as :attr:`.Appearance.stretch`.

    If the matrix shears the volume, or scales it to nothing, BadInput says who moves it, and what to do instead.
    """
    place = index_to_world(image)
    after = matrix @ place
    longer = np.linalg.norm(after[:3, :3], axis=0) / np.linalg.norm(place[:3, :3], axis=0)
    if longer.min() <= 0:
        raise BadInput(NOTHING.format(who=who))
    axes = after[:3, :3] / np.linalg.norm(after[:3, :3], axis=0)
    if np.abs(axes.T @ axes - np.eye(3)).max() > ORTHOGONAL_TOLERANCE:
        raise BadInput(SHEARED.format(who=who, instead=instead))
    set_geometry(image, after[:3, :3], after[:3, 3])
    put(image, replace(Appearance.of(image), stretch=longer / np.cbrt(longer.prod())))
    return image


def with_outer_halves(image: vtkImageData, crop: Array | None) -> tuple[vtkImageData, Array]:
    """Return an image of cells with another layer around it, and a part (2, 3) that ends at its outermost cells' faces.

    Voxels lie at the centres of cells; beyond those of the outermost cells, VTK shows their values.
    """
    shown, axes = Appearance.of(image), index_to_world(image)
    wider = from_array(np.pad(to_array(image), 1, mode="edge"), name=image.GetPointData().GetScalars().GetName())
    set_geometry(wider, axes[:3, :3], axes[:3, 3] - axes[:3, :3].sum(axis=1))
    put(wider, Appearance(None if shown.blank is None else np.pad(shown.blank, 1, mode="edge")))
    put_assumed(wider, assumed_of(image))
    whole = np.array([np.full(3, 0.5), np.array(image.GetDimensions()) + 0.5])
    if crop is None:
        return wider, whole
    return wider, np.array([np.maximum(whole[0], crop[0] + 1.0), np.minimum(whole[1], crop[1] + 1.0)])


def matrix_of(actor: vtkVolume) -> Array:
    """Return the matrix from an actor's data to the world. (4, 4)"""
    matrix = actor.GetMatrix()
    return np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])


def _array_of(mapper: Any, data: Any) -> str | None:
    """Return the name of the array that a mapper shows; None if it shows the first that suits."""
    if mapper.GetScalarMode() in FIELD_DATA:
        return str(mapper.GetArrayName())
    if not hasattr(data, "GetPointData"):
        return None
    scalars = (data.GetCellData() if mapper.GetScalarMode() in CELLS else data.GetPointData()).GetScalars()
    return None if scalars is None else scalars.GetName()  # also one with several components, which is refused later


def _refuse(mapper: Any, shown: vtkVolumeProperty) -> None:
    """Raise BadInput if a mapper, or its property, shows a volume in a way that is not reproduced."""

    def of(name: str, otherwise: Any = None) -> Any:
        return getattr(mapper, f"Get{name}", lambda: otherwise)()

    _refuse_property(shown)
    planes = of("ClippingPlanes")
    for refused, why in (
        (of("BlendMode", COMPOSITE) != COMPOSITE, "in another blend mode than composite: give it blending='composite'"),
        (of("Cropping", 0), "cropped by its mapper: cut the grid instead, such as with extract_subset"),
        (planes and planes.GetNumberOfItems(), "cut by clipping planes: cut the grid instead, such as with clip"),
        (of("MaskInput"), "with a mask: set the values outside of it to one that is transparent"),
        (
            of("FinalColorWindow", 1.0) != 1.0 or of("FinalColorLevel", 0.5) != 0.5,
            "with another final colour window and level than 1 and 0.5: change the transfer function instead",
        ),
        (
            shown.GetShade() and of("VolumetricScatteringBlending", 0.0) > 0.0,
            "with volumetric scattering: set the mapper's volumetric scattering blending to 0",
        ),
    ):
        if refused:
            raise BadInput(f"The actor shows its volume {why}.")


def _refuse_property(shown: vtkVolumeProperty) -> None:
    if shown.GetTransferFunctionMode() != vtkVolumeProperty.TF_1D:
        raise BadInput("The volume's property has a 2D transfer function: set its transfer function mode to 1D.")
    if not shown.GetDisableGradientOpacity() and shown.HasGradientOpacity():
        ends = [0.0] * 4
        function = shown.GetStoredGradientOpacity()
        for i in range(function.GetSize()):
            function.GetNodeValue(i, ends)
            if ends[1] != 1.0:
                raise BadInput(
                    "The volume's property has opacities that depend on gradients: turn them off "
                    "(DisableGradientOpacityOn), and thin out by value instead."
                )


def _coloured(shown: vtkVolumeProperty) -> vtkColorTransferFunction:
    """Return the colours of a property that has levels of grey."""
    grey: vtkPiecewiseFunction = shown.GetGrayTransferFunction()
    colour = vtkColorTransferFunction()
    colour.AllowDuplicateScalarsOn()
    colour.SetClamping(grey.GetClamping())
    for i in range(grey.GetSize()):
        grey.GetNodeValue(i, node := [0.0] * 4)
        value, level, middle, sharp = node
        colour.AddRGBPoint(value, level, level, level, middle, sharp)
    return colour


def _describe_lights(renderer: vtkRenderer) -> Iterator[str]:
    """Yield a sentence if a renderer's lights are others than one white headlight."""
    lights = [light for light in renderer.GetLights() if light.GetSwitch()]
    head = [light.GetLightType() == HEADLIGHT and light.GetIntensity() == 1.0 for light in lights]
    white = [tuple(light.GetDiffuseColor()) == (1.0, 1.0, 1.0) for light in lights]
    if lights and not (len(lights) == 1 and head[0] and white[0]):
        yield LIGHTS.format(count=len(lights))
