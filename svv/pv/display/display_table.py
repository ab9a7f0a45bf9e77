"""What becomes of each property of ParaView's volume representation, colour map and opacity function.

The tables are complete for ParaView 5.11 and 6.1: one test compares them with ParaView's own lists, another sees in its
pictures that the properties under ``NO_EFFECT`` have none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from svv.pv.paraview_types import Display, Proxy, View

REPRODUCED, NO_EFFECT, REFUSED = "reproduced", "no effect on a volume", "refused"


class Row(NamedTuple):
    """What becomes of a property."""

    becomes: str
    """One of ``REPRODUCED``, ``NO_EFFECT`` and ``REFUSED``; of the last, values that are not refused are reproduced."""
    why: str
    """If it is refused, a sentence for the user that names it and says what to do; otherwise how, or why not."""
    refuses: Callable[[object], bool] = bool
    """Whether a value of it is refused."""


def _other_than(*values: object) -> Callable[[object], bool]:
    return lambda value: value not in values


PANEL = Row(REPRODUCED, "the property of the same name in the filter's panel")
WITH = Row(NO_EFFECT, "belongs to another property, which is refused")
STATE = Row(NO_EFFECT, "concerns the panel or the session, not the picture")
SURFACE = Row(NO_EFFECT, "belongs to surfaces, or to colour maps that are applied to single values")
SEVERAL = Row(NO_EFFECT, "of arrays with several components, which are refused")
NO_NUMBER = Row(NO_EFFECT, "of values that are not numbers, which are refused")
MOVES = Row(NO_EFFECT, "moves the points, which are reproduced")

NOT_SHADED = (
    "The volume is shown with Volumetric Scattering Blending, and StyleRF's light is not scattered: set it to 0 in the "
    "display's properties."
)

REPRESENTATION: Mapping[str, Row] = {
    **dict.fromkeys(("DummyInput", "ForceUseCache", "ForcedCacheKey", "Pickable"), STATE),
    **dict.fromkeys(("InterpolationType", "UseCropping", "CroppingOrigin", "CroppingScale"), PANEL),
    **dict.fromkeys(("Position", "Scale", "Orientation", "Origin"), PANEL),
    **dict.fromkeys(("Shade", "Diffuse", "Specular", "SpecularPower"), PANEL),
    "Input": Row(REPRODUCED, "the filter's input"),
    "Visibility": Row(NO_EFFECT, "an invisible volume may be drawn, too"),
    "ColorArrayName": Row(REPRODUCED, "the panel's Scalars, with the association to points or cells"),
    "LookupTable": Row(REPRODUCED, "the panel's Transfer Function"),
    "ScalarOpacityFunction": Row(REPRODUCED, "the opacities of the Transfer Function"),
    "ScalarOpacityUnitDistance": Row(
        REFUSED,
        "The volume is shown with the Scalar Opacity Unit Distance {value:g}, at which all that is visible is opaque: "
        "set it to a positive number in the display's properties.",
        lambda value: isinstance(value, float | int) and not value > 0.0,
    ),
    "Translation": Row(REPRODUCED, "the panel's Position: its name since ParaView 5.13"),
    "Ambient": Row(REPRODUCED, "the panel's Ambient; 0 in the light kit, in which ParaView shows none"),
    "VolumeRenderingMode": Row(
        REFUSED,
        "The volume is shown with the Volume Rendering Mode {value}, and StyleRF draws as ParaView does on a graphics "
        "card: set it to Smart in the display's properties.",
        _other_than("Smart", "GPU Based"),  # Ray Cast Only ignores blanking and turned axes, OSPRay has its own light
    ),
    "BlendMode": Row(
        REFUSED,
        "The volume is shown with the blend mode {value}, and StyleRF draws composites only: set Blend Mode to "
        "Composite in the display's properties; an isosurface is a narrow peak of the opacity function.",
        _other_than("Composite"),
    ),
    "IsosurfaceValues": WITH,
    "SliceFunction": WITH,
    "UseSeparateOpacityArray": Row(
        REFUSED,
        "The volume is shown with a separate opacity array, and StyleRF draws one array: turn Use Separate Opacity "
        "Array off in the display's properties, or combine both arrays with the filter Calculator.",
    ),
    "OpacityArrayName": WITH,
    "OpacityComponent": WITH,
    "UseTransfer2D": Row(
        REFUSED,
        "The volume is shown with a 2D transfer function, and StyleRF draws with a 1D one: turn Use 2D Transfer "
        "Function off in the Color Map Editor.",
    ),
    "UseGradientForTransfer2D": WITH,
    "ColorArray2Name": WITH,
    "ColorArray2Component": WITH,
    "TransferFunction2D": WITH,
    "MapScalars": Row(
        REFUSED,
        "The volume is shown in the colours that its array contains, and StyleRF draws one number per voxel: turn Map "
        "Scalars on in the display's properties, and choose an array with one component.",
        lambda value: not value,
    ),
    "MultiComponentsMapping": Row(
        REFUSED,
        "The volume is shown with Multi Components Mapping, and StyleRF draws one number per voxel: turn it off in the "
        "display's properties, and choose an array with one component.",
    ),
    "VolumetricScatteringBlending": Row(
        REFUSED, NOT_SHADED, lambda value: isinstance(value, float | int) and value > 0.0
    ),
    "GlobalIlluminationReach": WITH,
    "VolumeAnisotropy": WITH,
    "CoordinateSystem": Row(
        REFUSED,
        "The volume is shown with the Coordinate System {value}, in which it does not stay in its place: set it to "
        "Navigable in the display's properties.",
        _other_than("Navigable"),
    ),
}
"""Rows of the properties of the representation, by name."""

WITH_SHADE = ("VolumetricScatteringBlending",)
"""Properties that show only if the volume is shaded."""

COLOURS: Mapping[str, Row] = {
    **dict.fromkeys(("UseBelowRangeColor", "BelowRangeColor"), Row(REPRODUCED, "a jump at the first point")),
    **dict.fromkeys(("UseAboveRangeColor", "AboveRangeColor"), Row(REPRODUCED, "a jump at the last point")),
    "RGBPoints": Row(REPRODUCED, "the points of the Transfer Function"),
    "ColorSpace": Row(REPRODUCED, "its colour space"),
    "HSVWrap": Row(REPRODUCED, "its way around the circle of hues"),
    "UseLogScale": Row(REPRODUCED, "its scale, as ParaView draws it in volumes (svv.dvr.functions.scales)"),
    "AllowDuplicateScalars": Row(REPRODUCED, "points that it removes are not there"),
    "ScalarOpacityFunction": Row(REPRODUCED, "the opacities of the Transfer Function"),
    "TransferFunction2D": WITH,
    **dict.fromkeys(("VectorMode", "VectorComponent"), SEVERAL),
    **dict.fromkeys(("NanColor", "NanOpacity"), NO_NUMBER),
    **dict.fromkeys(("AutomaticRescaleRangeMode", "RescaleOnVisibilityChange"), MOVES),
    **dict.fromkeys(("Discretize", "NumberOfTableValues", "InterpretValuesAsCategories", "IndexedColors"), SURFACE),
    **dict.fromkeys(("IndexedOpacities", "EnableOpacityMapping", "ShowCategoricalColorsinDataRangeOnly"), SURFACE),
    **dict.fromkeys(("Annotations", "ActiveAnnotatedValues", "AnnotationsInitialized"), SURFACE),
    **dict.fromkeys(("Use2DTransferFunction", "Using2DTransferFunction", "UsingSeparateOpacityArray"), STATE),
    **dict.fromkeys(("NameOfLastPresetApplied", "UseOpacityControlPointsFreehandDrawing"), STATE),
    **dict.fromkeys(("ScalarRangeInitialized", "ShowDataHistogram", "AutomaticDataHistogramComputation"), STATE),
    **dict.fromkeys(("DataHistogramNumberOfBins", "Build"), STATE),
}
"""Rows of the properties of the colour map."""

OPACITIES: Mapping[str, Row] = {
    "Points": Row(REPRODUCED, "the opacities of the Transfer Function"),
    "UseLogScale": Row(REPRODUCED, "straight lines along the curve (svv.dvr.functions.scales)"),
    "AllowDuplicateScalars": Row(REPRODUCED, "points that it removes are not there"),
    "ScalarRangeInitialized": STATE,
}
"""Rows of the properties of the opacity function."""

LIGHTS = (
    "The volume is shaded by other lights than the light kit, and StyleRF's light stays at the camera: under Lights in "
    "the view's properties, turn the light kit on and remove the added lights, or leave one white Headlight alone; or "
    "turn Shade off in the display's properties."
)
LIGHT_KIT = "Lit from the camera, which is darker than the light kit of ParaView's view."
"""What is said about volumes that are shaded in ParaView's default light."""


CROPPED = (
    "The volume is cropped by its display, and how ParaView 5.12 does that was not compared with StyleRF: turn Use "
    "Cropping off in the display's properties, and insert the filter Extract Subset."
)


def crops_as_known() -> bool:
    """Return whether this ParaView crops in a known way: that changed between 5.11 and 5.13, and 5.12 was not seen."""
    from paraview.servermanager import vtkSMProxyManager

    return (vtkSMProxyManager.GetVersionMajor(), vtkSMProxyManager.GetVersionMinor()) != (5, 12)


def refused_by(display: Display) -> str:
    """Return the sentence that says why a display cannot be reproduced; empty if it can."""
    if name_in(display, "UseCropping") is not None and value_of(display, "UseCropping") and not crops_as_known():
        return CROPPED
    for name, row in REPRESENTATION.items():
        if row.becomes is not REFUSED or (name in WITH_SHADE and not getattr(display, "Shade", 0)):
            continue
        value = None if name_in(display, name) is None else value_of(display, name)
        if value is not None and row.refuses(value):
            return row.why.format(value=value)
    return ""


def light_of(view: View) -> str:
    """Return what the light of a view means for a shaded volume: empty, ``LIGHT_KIT`` or the refusal ``LIGHTS``."""
    added = [light for light in view.AdditionalLights if light.Enable]
    if view.UseLight:
        return LIGHTS if added else LIGHT_KIT
    alike = [
        value_of(light, "Coords") == "Headlight" and light.Intensity == 1.0 and list(light.DiffuseColor) == [1.0] * 3
        for light in added
    ]
    return "" if alike == [True] else LIGHTS


RENAMED = {"Position": "Translation"}
"""Names of properties since ParaView 5.13, which refuses the old ones."""


def name_in(proxy: Proxy, name: str) -> str | None:
    """Return the name of a property in this version of ParaView; None if the proxy does not have it."""
    names = (name, RENAMED.get(name, name))
    return next((own for own in names if proxy.SMProxy.GetProperty(own) is not None), None)


def value_of(proxy: Proxy, name: str) -> object:
    """Return a property's value as numbers or text, not as an object that goes on changing with the property."""
    return proxy.GetProperty(name).GetData()
