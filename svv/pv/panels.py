"""What our filters share in ParaView's panel: place in the menu, inputs, and groups of properties."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from paraview.util.vtkAlgorithm import smdomain, smhint, smproperty

from svv.options.editing import LightEdit, OutlineEdit, RegionEdit
from svv.options.making import DRAWN, DeviceOptions, PresetName, RenderOptions, TrainOptions, ViewOptions
from svv.pv.option_panel import properties_of
from svv.pv.properties import (
    Property,
    button,
    choice,
    client_switch,
    file,
    group,
    hidden_text,
    integer,
    number,
    numbers,
    scalars,
    shown_where,
    switch,
    text,
    transfer_function,
)
from svv.styles.offered import GALLERY, INKS

PICTURES = "png jpg jpeg tif tiff bmp webp"
TAKE_HELP = (
    "Look at the transfer function again, and at the time step that is shown. Neither editing the one nor playing an "
    "animation starts minutes of work by itself; nothing is done where nothing changed. What a saved state misses "
    "is made again."
)
REGIONS = 8
"""Regions that the panel of StyleRF Edit shows, as many as a palette may have; those that a scene lacks do nothing."""

ROW = ("Style", "Positive", "Negative", "Mask", "Part")
"""What StyleRF Stylize asks about each region."""
AUTOMATIC, AS_IT_IS, PICTURE, NO_GALLERY = "by mapping", "as it is", "picture ", "none"
OFFERED = (*GALLERY, *(DRAWN + kind for kind in INKS))
"""Styles that need no picture of the user's."""
AS_IT_CAME, BESIDE, IN_WORLD = "as it came", "beside the camera", "in the world"
"""Where StyleRF Edit can put the light."""
COLOURS, FALSE_COLOURS, IN_COLOUR = "image", "numbered regions", "regions in their colours"
ADDED = 3
"""Colours that the panel of StyleRF Palette can add at once."""


def menu(cls: Any) -> Any:
    """Show the filter under Filters > StyleRF."""
    # From 5.12 on, a category without a label of its own would be made pretty: "Style RF".
    return smhint.xml('<ShowInMenu category="StyleRF" menu_label="StyleRF"/>')(cls)


def keep_input_visible(cls: Any) -> Any:
    """Let the input stay visible when the filter is applied."""
    return smhint.xml('<Visibility replace_input="0"/>')(cls)


def takes_volume(cls: Any) -> Any:
    """Give the filter an image as its input."""
    arrays = '<InputArrayDomain name="input_array" attribute_type="any" number_of_components="1" optional="1"/>'
    cls = smdomain.datatype(dataTypes=["vtkImageData"], composite_data_supported=False)(cls)
    return smproperty.input(name="Input", port_index=0)(smdomain.xml(arrays)(cls))


def takes_scene(cls: Any) -> Any:
    """Give the filter a scene's table as its input."""
    cls = smdomain.datatype(dataTypes=["vtkTable"], composite_data_supported=False)(cls)
    return smproperty.input(name="Input", port_index=0)(cls)


def volume_properties(views: ViewOptions) -> list[Property]:
    """How a volume is shown, and how many views are drawn of it."""
    return [
        scalars(),
        transfer_function(),
        number(
            "OpacityUnitDistance", 0.0,
            "Distance, in the volume's units, after which the opacity is that of the transfer function; 0 takes "
            "ParaView's default for this volume.", low=0.0,
        ),
        switch("Shade", True, "Light the volume from the camera."),
        *group("Shading", [
            number("Ambient", 0.0, "Ambient reflection.", 0.0, 1.0, True),
            number("Diffuse", 1.0, "Diffuse reflection.", 0.0, 1.0, True),
            number("Specular", 0.0, "Specular reflection.", 0.0, 1.0, True),
            number("SpecularPower", 100.0, "Exponent of the specular highlights.", 0.0, 128.0, True),
        ]),
        *properties_of(views),
    ]  # fmt: skip


def training_properties(preset: PresetName) -> list[Property]:
    """How much is learned."""
    return [
        *properties_of(TrainOptions(preset=preset), skip=("device",)),
        switch("TrainEachTimeStep", False,
               "Learn a scene for each time step that is shown; else time passes, and the scene stays until Take As "
               "Edited. The scenes of the last steps are kept."),
        device(),
    ]  # fmt: skip


def device() -> Property:
    """Where work runs."""
    (made,) = properties_of(DeviceOptions())
    return made


def preview_file() -> Property:
    """Where a painting can be watched."""
    return file("PreviewFile", "png", "Pictures",
                "Where the painting is shown while it is made: a small picture, after some seconds and then again and "
                "again. ParaView's own windows wait for the end.", save=True)  # fmt: skip


def image_properties(size: int) -> list[Property]:
    """Which image of a scene is made."""
    return [
        client_switch("FollowCamera",
                      "Whether the image follows the camera of the view that shows the volume, small while the mouse "
                      "drags, sharp on release. It is shown in a view of its own, right of that one."),
        numbers("ImageSize", (size, size), "Width and height of the image in pixels."),
        choice("Show", (COLOURS, FALSE_COLOURS, IN_COLOUR), COLOURS,
               "What the picture shows: the scene, or its regions, numbered, in false colours or in their own."),
        *properties_of(RenderOptions(), skip=("device",)),
        switch("Background", False, "Give the image a background; otherwise it is transparent."),
        numbers("BackgroundColour", (1.0, 1.0, 1.0), "Colour of the background.", "color_selector"),
        numbers("Camera", (0.0,) * 9 + (30.0,),
                "Position, focal point, view up (x, y, z each) and angle of view in degrees. All zeros: the orbit "
                "around the scene.", None, True),
        integer("Frame", 0, "Which frame of the orbit around the scene is shown, where Camera is all zeros. The macro "
                "StyleRF play orbit lets an animation go through them.", 0, 180),
    ]  # fmt: skip


def region_properties(region: int) -> Sequence[Property]:
    """What can be edited of one region."""
    name, advanced = f"Region{region}", region > 3
    return group(f"Region {region}", [
        *properties_of(RegionEdit(), name, advanced),
        switch(f"{name}Hide", False, "Hide the region and keep its opacity.", advanced),
    ])  # fmt: skip


def light_properties() -> Sequence[Property]:
    """Where the light of a scene stands that was trained with the lighting phong."""
    return group("Light", [
        choice("LightFrom", (AS_IT_CAME, BESIDE, IN_WORLD), AS_IT_CAME,
               "Where the light comes from, for scenes trained with the lighting phong."),
        *shown_where("LightFrom", 1, [
            number("LightAzimuth", 0.0, "Degrees to the right of the camera, which the light follows.", -180.0, 180.0),
            number("LightElevation", 0.0, "Degrees above the camera.", -90.0, 90.0),
        ]),
        *shown_where("LightFrom", 2, [
            numbers("LightDirection", (0.0, 0.0, 1.0), "Direction of the light (x, y, z) in world coordinates, "
                "whatever the camera does."),
        ]),
        *properties_of(LightEdit()),
    ])  # fmt: skip


def outline_properties() -> Sequence[Property]:
    """Silhouettes and creases as ink."""
    return group("Outline", [
        *properties_of(OutlineEdit()),
        text("OutlineRegions", "Numbers of the regions that are outlined so, such as 0, 2. Empty: all.", "", True),
    ])  # fmt: skip


def correction_properties(region: int) -> Sequence[Property]:
    """What can be corrected about one palette colour."""
    name, advanced = f"Region{region}", region > 3
    return group(f"Region {region}", [
        switch(f"{name}SetColour", False, "Start training with another colour for the region.", advanced),
        numbers(f"{name}Colour", (1.0, 0.5, 0.0), "The region's palette colour.", "color_selector", advanced),
        switch(f"{name}Remove", False, "Remove the region; others take over what it shows.", advanced),
        switch(f"{name}Split", False, "Split the region into one region for each of its ranges of the transfer "
            "function.",
               advanced),
    ])  # fmt: skip


def added_properties(number: int) -> Sequence[Property]:
    """A colour that the palette lacks."""
    name, advanced = f"Colour{number}", number > 1
    return group(f"New colour {number}", [
        switch(f"{name}Add", False, "Add a colour to the palette.", advanced),
        numbers(f"{name}Value", (1.0, 0.5, 0.0), "The colour that the palette lacks.", "color_selector", advanced),
    ])  # fmt: skip


def point_properties() -> Sequence[Property]:
    """Points of a mask, set in the view that shows it."""
    return [
        button("ClickInside", "From now on, until it is pressed again, clicks into the picture of the second output "
               "say what the region of Shown Mask learns from."),
        button("ClickOutside", "... what it does not learn from."),
        button("ClickRemove", "... which point is taken away: the nearest."),
        hidden_text("PictureSize", "GetPictureSize", "Sizes of the picture as it is shown, and of its file."),
    ]  # fmt: skip


def style_properties(region: int) -> Sequence[Property]:
    """Which style a region gets, and which part of its picture."""
    name, advanced = f"Region{region}", region > 3
    return group(f"Region {region}", [
        choice(f"{name}Style", (AUTOMATIC, AS_IT_IS, *(f"{PICTURE}{k}" for k in range(REGIONS)), *OFFERED),
               AUTOMATIC, "The region's picture: by the mapping, none, one of Style Files (from 0), or one of the "
               "gallery; or a drawing in ink, which needs none.",
               advanced),
        text(f"{name}Positive", "Places in the picture that the region learns from, x,y in its pixels from the upper "
             "left, with semicolons between: 310,120; 40,300. Empty, and without a mask: all of it.", "", advanced),
        text(f"{name}Negative", "Points that the region does not learn from.", "", advanced),
        file(f"{name}Mask", "png", "Masks", "A mask of the picture to go on from, with the points kept beside it; "
             "white is learned from.", advanced=advanced),
        integer(f"{name}Part", -1, "Number of the part of the picture, if Picture Parts divides it; -1: do not use "
            "parts.",
                -1, None, advanced),
    ])  # fmt: skip
