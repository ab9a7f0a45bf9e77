"""What the panels of the StyleRF filters hold: a value for each property, under the property's name.

Options of the engine's steps are read by :func:`svv.pv.panel.option_panel.options_in`; all others are listed here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeAlias, TypedDict, cast

from svv.core.json_values import Json
from svv.errors import BadInput

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkImplicitFunction
    from vtkmodules.vtkRenderingCore import vtkDiscretizableColorTransferFunction

    from svv.options.figures import VisionName
    from svv.options.making import DeviceName, PresetName
    from svv.pv.paraview_types import PVDataRepresentation

Triple: TypeAlias = tuple[float, float, float]


class DisplayValues(TypedDict, total=False):
    """The properties by which a display changes a volume, which the panels have under the same names."""

    InterpolationType: str
    UseCropping: bool
    CroppingOrigin: Triple
    CroppingScale: Triple
    Position: Triple
    Scale: Triple
    Orientation: Triple
    Origin: Triple


class Values(DisplayValues, total=False):
    """The values of a panel; which of them it has depends on its filter."""

    # the volume and how it is shown
    Scalars: str
    ScalarsOnCells: bool
    TransferFunction: vtkDiscretizableColorTransferFunction | Json | None
    """ParaView's own, or as :meth:`svv.dvr.functions.transfer_functions.TransferFunction.to_dict` writes it."""
    OpacityUnitDistance: float
    ResampleTo: int
    Shade: bool
    Ambient: float
    Diffuse: float
    Specular: float
    SpecularPower: float
    Refusal: str
    Notice: str
    DefaultColours: str
    Display: PVDataRepresentation
    Distance: float

    # views and scenes
    Views: int
    ViewSize: int
    TestViews: int
    ShownView: int
    Folder: str
    FileName: str
    ViewsFile: str
    KeyOfViews: str
    """Hash of the views in ViewsFile for the process that learns from them; ParaView may know it from their filter."""
    SceneFile: str
    TrainEachTimeStep: bool
    TimeLimit: float
    Device: DeviceName
    Preset: PresetName
    Settings: str
    KeptAs: str
    SaveFile: str

    # learning beside the window
    Live: bool
    InWindow: bool
    Late: bool
    LiveState: str

    # edits
    Undo: int
    AsTrained: bool
    Variant: str
    ShowHidden: bool
    Parts: str
    Pick: str
    Say: str
    Isolate: str
    Cuts: str
    CutOpen: bool
    CutOpenBy: str
    """The text of the shape (:mod:`svv.pv.panel.cutting_shapes`)."""
    InvertCut: bool
    CutRegions: str
    OutlineRegions: str
    LightFrom: str
    LightAzimuth: float
    LightElevation: float
    LightDirection: Triple
    ShadowFrom: str
    ShadowAzimuth: float
    ShadowElevation: float
    ShadowDirection: Triple
    MoveStrokeLight: bool
    StrokeLight: Triple
    StrokePalette: str
    Merge: str
    PointRegion: int
    Points: str
    Look: str
    LookFile: str
    Pairs: str
    SaveLookFile: str

    # painting
    StyleFiles: tuple[str, ...]
    Gallery: str
    Mapping: str
    StrokeSize: float
    PictureParts: int
    ShownMask: int
    MaskFolder: str
    PreviewOnly: bool
    PreviewFile: str
    ShowVariant: str
    Continue: bool
    Strength: float

    # images and baked volumes
    Camera: tuple[float, ...]
    """Position, focal point and view-up vector, and the angle of view in degrees."""
    ParallelScale: float
    Frame: int
    ImageSize: tuple[float, float]
    Show: str
    SeenWith: VisionName
    Background: bool
    BackgroundColour: Triple
    Moving: bool
    FollowCamera: bool
    WithValues: bool
    Opaque: bool
    FigureFile: str
    VolumeRendering: bool
    VolumeFile: str
    Cut: bool
    CutBy: vtkImplicitFunction | None
    Invert: bool


class RegionRow(TypedDict, total=False):
    """The properties of one region, named ``Region0Style`` and so on, besides those of its options."""

    Hide: bool
    SetColour: bool
    Colour: Triple
    Remove: bool
    Split: bool
    Style: str
    Positive: str
    Negative: str
    Mask: str
    Part: int
    Share: str


class ColourRow(TypedDict, total=False):
    """The properties of a colour to add to the palette, named ``Colour0Add`` and so on."""

    Add: bool
    Value: Triple


def region_row(values: Values, region: int) -> RegionRow:
    """Return the properties of a region that a panel has, without their prefix."""
    return cast(RegionRow, _row(values, f"Region{region}", RegionRow))


def colour_row(values: Values, number: int) -> ColourRow:
    """Return the properties of a colour to add that a panel has, without their prefix."""
    return cast(ColourRow, _row(values, f"Colour{number}", ColourRow))


def _row(values: Values, prefix: str, kind: type) -> dict[str, object]:
    held = by_name(values)
    return {name: held[prefix + name] for name in kind.__annotations__ if prefix + name in held}


def points_in(text: str, count: int, wrong: str) -> list[tuple[float, ...]]:
    """Parse '1,2; 3,4' as points of so many numbers; raise BadInput for anything else: wrong, and the text."""
    points = []
    for place in filter(None, (p.strip() for p in text.split(";"))):
        try:
            point = tuple(float(word) for word in place.split(","))
        except ValueError:
            point = ()
        if len(point) != count:
            raise BadInput(f"{wrong}, not '{text}'.")
        points.append(point)
    return points


def by_name(values: Values) -> dict[str, object]:
    """Return the values for code that has a property's name from elsewhere; not a copy."""
    return cast("dict[str, object]", values)


def with_names(values: Mapping[str, object]) -> Values:
    """Return what :func:`by_name` returned, or a part of it, as values again; not a copy."""
    return cast(Values, values)


def label_of(name: str) -> str:
    """Return the label of a property: 'View Size' for 'ViewSize'. ParaView's Python removes the spaces again."""
    return re.sub(r"(?<=[a-z])(?=[A-Z0-9])|(?<=[0-9])(?=[A-Z])", " ", name)
