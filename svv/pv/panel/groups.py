"""Parts of ParaView's panels that several filters share: menu entry, inputs, and groups of properties."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from paraview.util.vtkAlgorithm import smdomain, smhint, smproperty

from svv.options.editing import (
    LightEdit,
    OcclusionEdit,
    OutlineEdit,
    PaintEdit,
    PartEdit,
    RegionEdit,
    SectionEdit,
    ShadowEdit,
)
from svv.options.figures import VISIONS
from svv.options.making import (
    DRAWN,
    DeviceOptions,
    PaletteOptions,
    PresetName,
    RenderOptions,
    TrainOptions,
    ViewOptions,
)
from svv.pv.panel.cutting_shapes import cutting_shape
from svv.pv.panel.option_panel import properties_of
from svv.pv.panel.properties import (
    Class,
    Property,
    button,
    capture_reports,
    choice,
    client_switch,
    file,
    group,
    hidden_text,
    integer,
    moving,
    number,
    numbers,
    picked,
    scalars,
    shape,
    shown_where,
    switch,
    text,
    transfer_function,
)
from svv.styles.gallery.offered import GALLERY, INKS

PICTURES = "png jpg jpeg tif tiff bmp webp"
TAKE_HELP = (
    "Take the volume as it is shown now: changes of its display, its transfer function and time step; and make again "
    "what a saved state cannot find."
)
PALETTE = 8
"""The most regions that a palette can have."""
REGIONS = PALETTE + 4
"""Number of regions in a panel: a palette's, and parts. StyleRF Edit ignores those that a scene lacks."""

AUTOMATIC, AS_IT_IS, PICTURE, NO_GALLERY = "by mapping", "as it is", "picture ", "none"
OFFERED = (*GALLERY, *(DRAWN + kind for kind in INKS))
"""Styles that need no picture from the user."""
AS_IT_CAME, BESIDE, IN_WORLD = "as it came", "beside the camera", "in the world"
"""Places where StyleRF Edit can put the light."""
COLOURS, FALSE_COLOURS, IN_COLOUR, DOUBT = "image", "numbered regions", "regions in their colours", "expected error"
OF_SCENE = '<InputArrayDomain name="of_scene" attribute_type="field" number_of_components="16"/>'
"""Domain of data that are of a scene (:data:`svv.pv.work.shown_scene.KEY`)."""
ADDED = 3
"""Number of colours that the panel of StyleRF Palette can add at once."""


def menu(cls: Class) -> Class:
    """Show the filter under Filters > StyleRF."""
    # Since 5.12 ParaView would insert a space into the name of a category without a label: "Style RF".
    return smhint.xml('<ShowInMenu category="StyleRF" menu_label="StyleRF"/>')(cls)


def keep_input_visible(cls: Class) -> Class:
    """Keep the input visible when the filter is applied."""
    return smhint.xml('<Visibility replace_input="0"/>')(cls)


def shown_beside(cls: Class) -> Class:
    """Keep Apply from showing the filter's image in the 3D view: client code shows it beside that."""
    return smhint.xml('<View type="None"/>')(cls)


def takes_volume(cls: Class) -> Class:
    """Give the filter a grid as its input, which may consist of blocks."""
    arrays = '<InputArrayDomain name="input_array" attribute_type="any" number_of_components="1" optional="1"/>'
    cls = smdomain.datatype(dataTypes=["vtkDataSet", "vtkHyperTreeGrid"], composite_data_supported=True)(cls)
    return smproperty.input(name="Input", port_index=0)(smdomain.xml(arrays)(cls))


def _takes(*kinds: str, **options: bool) -> Callable[[Class], Class]:
    """Return a decorator that gives a filter data of a scene, of these kinds, as its input; no other can be chosen."""

    def decorate(cls: Class) -> Class:
        cls = smdomain.datatype(dataTypes=list(kinds), composite_data_supported=False)(cls)
        return smproperty.input(name="Input", port_index=0, **options)(smdomain.xml(OF_SCENE)(cls))

    return decorate


takes_image = _takes("vtkImageData")
"""Give the filter an image of a scene as its input."""
takes_scene = _takes("vtkTable", "vtkImageData")
"""Give the filter a scene as its input: its table, or an image of it."""
takes_scenes = _takes("vtkTable", "vtkImageData", multiple_input=True)
"""Give the filter several scenes as its input."""


def volume_properties(views: ViewOptions) -> list[Property]:
    """Return the properties of how a volume is shown and how many views of it are drawn."""
    return [
        scalars(),
        transfer_function(),
        number(
            "OpacityUnitDistance", 0.0,
            "Distance, in the volume's units, for which the function's opacities are defined; 0: ParaView's default.",
            low=0.0,
        ),
        switch("Shade", True, "Light the volume from the camera."),
        *group("Shading", [
            number("Ambient", 0.0, "Ambient reflection.", 0.0, 1.0, True),
            number("Diffuse", 1.0, "Diffuse reflection.", 0.0, 1.0, True),
            number("Specular", 0.0, "Specular reflection.", 0.0, 1.0, True),
            number("SpecularPower", 100.0, "Exponent of the specular highlights.", 0.0, 128.0, True),
        ]),
        integer(
            "ResampleTo", 0, "Points along the longest side, for inputs that are no images; 0: as cells and memory "
                             "suggest.", 0, advanced=True,
        ),
        *group("Display", [
            choice("InterpolationType", ("Nearest", "Linear", "Cubic"), "Linear",
                   "Interpolation between voxels. ParaView draws Cubic as it does Linear.", True),
            switch("UseCropping", False, "Show only a part of the volume.", True),
            numbers("CroppingOrigin", (0.0, 0.0, 0.0), "Offset of that part, in the volume's units.", None, True),
            numbers("CroppingScale", (1.0, 1.0, 1.0), "Factor of the volume's bounds (since ParaView 5.13, of its "
                                                      "extent in voxels) that gives that part.", None, True),
            numbers("Position", (0.0, 0.0, 0.0), "Where the volume is moved.", None, True),
            numbers("Scale", (1.0, 1.0, 1.0), "Factors of the volume's size along x, y and z.", None, True),
            numbers("Orientation", (0.0, 0.0, 0.0), "Angles by which the volume is turned, degrees.", None, True),
            numbers("Origin", (0.0, 0.0, 0.0), "Point around which the volume is scaled and turned.", None, True),
        ]),
        *capture_reports(),
        *properties_of(views),
    ]  # fmt: skip


def learning_properties(options: TrainOptions | PaletteOptions, skip: tuple[str, ...] = ()) -> list[Property]:
    """Return the properties of training options, but skipped fields: first those of what to learn from, then others."""
    heading = [made for made in properties_of(options, skip=skip) if made.name in ("ViewsOnly", "IgnoreFixed")]
    return [*group("Learn From", heading), *properties_of(options, skip=(*skip, "views_only", "ignore_fixed"))]


def training_properties(preset: PresetName, skip: tuple[str, ...] = ()) -> list[Property]:
    """Return the properties of training, except for those of fields in ``skip``."""
    return [
        *learning_properties(TrainOptions(preset=preset), skip=("device", *skip)),
        switch("TrainEachTimeStep", False,
               "Train a scene for each time step that is shown; otherwise the scene stays until Take What Is Shown Now "
               "is pressed."),
        device(),
    ]  # fmt: skip


def take_buttons() -> list[Property]:
    """Return the button that takes the volume as it is shown now, and its older name for scripts."""
    older = button("TakeAsEdited", TAKE_HELP)
    hidden = replace(older, xml=older.xml.replace('"default"', '"never"', 1))
    return [button("TakeWhatIsShownNow", TAKE_HELP, "TakeAsEdited"), hidden]


def device() -> Property:
    """Return the property that chooses the device."""
    (made,) = properties_of(DeviceOptions())
    return made


def preview_file() -> Property:
    """Return the property that names the file for a preview of the painting."""
    return file("PreviewFile", "png", "Pictures",
                "File for a small preview of the painting while it is made. Without Live, ParaView's own windows show "
                "the painting only when it is finished.",
                save=True)  # fmt: skip


def image_properties(size: int) -> list[Property]:
    """Return the properties of the image of a scene, of so many pixels along each side by default."""
    return [
        client_switch("FollowCamera",
                      "Follow the camera of the volume's view: the image stands in a view to the right, where the "
                      "mouse turns the same camera, or in the same by StyleRF Place In View."),
        numbers("ImageSize", (size, size), "Width and height of the image in pixels."),
        choice("Show", (COLOURS, FALSE_COLOURS, IN_COLOUR, DOUBT), COLOURS,
               "The scene, its numbered regions in false colours or their own, or how far its image may be off, light "
               "to dark red, as the array Doubt."),
        seen_with(),
        *properties_of(RenderOptions(), skip=("device",)),
        switch("Background", False, "Give the image a background; otherwise it is transparent."),
        numbers("BackgroundColour", (1.0, 1.0, 1.0), "Colour of the background.", "color_selector"),
        numbers("Camera", (0.0,) * 9 + (30.0,),
                "Position, focal point and view-up vector (x, y, z each), and angle of view in degrees; all zeros: the "
                "orbit around the scene.", None, True),
        number("ParallelScale", 0.0, "Half of the image's height in world units, with parallel rays; 0 for "
                                     "perspective.", 0.0, None, True),
        integer("Frame", 0, "Frame of the orbit to show if Camera is all zeros; the macro StyleRF play orbit, imported "
                            "from plugin/macros, plays them.", 0, 180),
        moving(),
        hidden_text("SeenFrom", "GetSeenFrom", "Camera of the last image, for a view that has none of its own."),
    ]  # fmt: skip


def seen_with() -> Property:
    """Return the property that simulates a colour vision deficiency, or a grey print."""
    return choice(
        "SeenWith", VISIONS, VISIONS[0],
        "Show the image as without one of the three kinds of cones (Machado et al. 2009), or in a grey print, to see "
        "whether everybody can tell its regions apart.",
    )  # fmt: skip


def scene_bounds() -> Property:
    """Return the bounds of the scene, for the surfaces that cut it (:class:`svv.pv.work.bounded.Bounded`)."""
    return hidden_text("SceneBounds", "GetSceneBounds", "Lowest and highest corner of the scene: x y z x y z.")


def cut_properties() -> Sequence[Property]:
    """Return the properties for cutting a volume open."""
    return [
        switch("Cut", False, "Cut the volume open; ParaView draws a Clip of it without its colours."),
        *shown_where("Cut", 1, [
            shape("CutBy", "Plane, box, sphere or cylinder."),
            switch("Invert", True, "Keep what is behind or inside it; otherwise the rest."),
        ]),
        scene_bounds(),
    ]  # fmt: skip


def region_properties(region: int) -> Sequence[Property]:
    """Return the properties for editing one region."""
    name, advanced = f"Region{region}", region > 3
    return group(f"Region {region}", [
        *properties_of(RegionEdit(), name, advanced),
        switch(f"{name}Hide", False, "Hide the region without changing its opacity.", advanced),
    ])  # fmt: skip


def value_properties() -> list[Property]:
    """Return the properties for reading values off an image of a scene."""
    return [
        button("ClickValue", "Clicks in the image or the 3D view say below which region is there, where, and the "
                             "volume's value, and how far it is from the last place, until the button is pressed "
                             "again."),
        switch("WithValues", False,
               "Add the array Value: the volume's value where each pixel's region is most visible, NaN where none is "
               "known, for Find Data and Hover Points On; it takes a scene trained with Keep Values, or of the "
               "encoding values.", True),
    ]  # fmt: skip


def part_properties() -> Sequence[Property]:
    """Return the properties for splitting regions into connected parts."""
    return group("Parts", [
        button("ClickPart", "Clicks in the image or the 3D view make the connected part that is visible there a region "
                            "of its own, until the button is pressed again."),
        text("Parts", "Points in the parts that become regions, after the others: x,y,z in the world, with semicolons "
                      "between several; clicks add to them."),
        *properties_of(PartEdit()),
        *picked(),
    ])  # fmt: skip


def pointing_properties() -> Sequence[Property]:
    """Return the properties for correcting regions by pointing at places."""
    return group("Points", [
        integer("PointRegion", 0, "Region that is at the places of Click Region; the number after the last region is a "
                "new one.", 0, PALETTE - 1),
        button("ClickRegion", "Clicks in a view make the connected piece there Point Region, until the button is "
                              "pressed again; if one piece holds two regions, click on both."),
        button("ClickSame", "Two clicks in a view merge the regions of both places, until the button is pressed "
                            "again."),
        text("Points", "Places in a scene learned from views alone, with the region there or another place of the same "
                       "one: x,y,z=1; x,y,z=x,y,z in the world; clicks add to them."),
        *picked(),
    ])  # fmt: skip


def edit_properties() -> Sequence[Property]:  # long: one list
    """Return the properties for editing a scene: its light, regions, paint and outlines, and edits in words."""
    return [
        *group("Light", [
            choice("LightFrom", (AS_IT_CAME, BESIDE, IN_WORLD), AS_IT_CAME,
                   "Where the light comes from; needs lighting phong."),
            *shown_where("LightFrom", 1, [
                number("LightAzimuth", 0.0, "Degrees to the right of the camera, which the light follows.",
                       -180.0, 180.0),
                number("LightElevation", 0.0, "Degrees above the camera.", -90.0, 90.0),
            ]),
            *shown_where("LightFrom", 2, [
                numbers("LightDirection", (0.0, 0.0, 1.0), "Direction of the light (x, y, z) in the world."),
            ]),
            *properties_of(LightEdit()),
            *properties_of(ShadowEdit()),
            choice("ShadowFrom", (AS_IT_CAME, BESIDE, IN_WORLD), AS_IT_CAME,
                   "Where shadows come from; as it came, from the light that was moved, or the camera's upper left.",
                   True),
            *shown_where("ShadowFrom", 1, [
                number("ShadowAzimuth", -35.0, "Degrees to the right of the camera, which the shadows follow.",
                       -180.0, 180.0),
                number("ShadowElevation", 40.0, "Degrees above the camera.", -90.0, 90.0),
            ]),
            *shown_where("ShadowFrom", 2, [
                numbers("ShadowDirection", (-1.0, 2.0, 1.0), "Direction (x, y, z) in the world from which they come."),
            ]),
            *properties_of(OcclusionEdit()),
        ]),
        *(p for region in range(REGIONS) for p in region_properties(region)),
        text("Isolate", "The only regions to show, such as 0, 2. Empty: all that are not hidden."),
        text(
            "Cuts",
            "Cut the scene open, with semicolons between several: x>50%; 0=y>50% & z<12.5 for region 0 alone; "
            "plane:x,y,z:nx,ny,nz; box:x,y,z:x,y,z; sphere:x,y,z:r; cylinder:x,y,z:dx,dy,dz:r; outside sphere:x,y,z:r "
            "for all but the ball.",
        ),
        switch("CutOpen", False, "Cut the scene at a surface with handles."),
        *shown_where("CutOpen", 1, [
            cutting_shape("CutOpenBy", "Plane, box, sphere or cylinder."),
            switch("InvertCut", True, "Keep what is behind or inside it; otherwise the rest."),
            text("CutRegions", "Regions, such as 0, 2; empty: all."),
        ]),
        *properties_of(SectionEdit()),
        *(made for made in properties_of(PaintEdit()) if made.name == "Strength"),
        *group("Strokes", [
            *properties_of(PaintEdit(), skip=("strength",)),
            switch("MoveStrokeLight", False, "Light the relief of brush strokes from another direction."),
            *shown_where("MoveStrokeLight", 1, [
                numbers("StrokeLight", (-0.447, 0.744, 0.496), "Direction (x, y, z) in the world from which that light "
                                                               "comes."),
            ]),
            text("StrokePalette", "Other colours of brush strokes, with their light and dark: a picture's file, "
                                  "gallery:NAME, or #102040,#f0d090. Empty: no change; own: the painting's."),
        ]),
        *group("Outline", [
            *properties_of(OutlineEdit()),
            text("OutlineRegions", "Regions to outline, such as 0, 2. Empty: all.", "", True),
        ]),
        text(
            "Say",
            "What should change, in words, after everything else: make the core pale jade, thinner, hide region 1, "
            "light from the left; Status shows what was understood.",
        ),
    ]  # fmt: skip


EDITS = {made.name: made.default for made in edit_properties() if made.setters}
"""The properties by which a panel edits a scene, with their defaults."""


def save_properties() -> list[Property]:
    """Return the button Save Scene and the property with its file."""
    return [
        file("SaveFile", "svv", "Scenes", "File to which Save Scene writes the scene.", save=True),
        button("SaveScene", "Write the filter's scene to the file above."),
    ]


def correction_properties(region: int) -> Sequence[Property]:
    """Return the properties for correcting one palette colour."""
    name, advanced = f"Region{region}", region > 3
    return group(f"Region {region}", [
        switch(f"{name}SetColour", False, "Start training with another colour for the region.", advanced),
        *shown_where(f"{name}SetColour", 1, [
            numbers(f"{name}Colour", (1.0, 0.5, 0.0), "The region's palette colour.", "color_selector", advanced),
        ]),
        switch(f"{name}Remove", False, "Remove the region; other regions take over what it shows.", advanced),
        switch(f"{name}Split", False, "Split the region into one region for each of its ranges of the transfer "
            "function.",
               advanced),
    ])  # fmt: skip


def added_properties(number: int) -> Sequence[Property]:
    """Return the properties for adding a colour to the palette."""
    name, advanced = f"Colour{number}", number > 1
    return group(f"New colour {number}", [
        switch(f"{name}Add", False, "Add a colour to the palette.", advanced),
        *shown_where(f"{name}Add", 1, [
            numbers(f"{name}Value", (1.0, 0.5, 0.0), "The colour to add.", "color_selector", advanced),
        ]),
    ])  # fmt: skip


def point_properties() -> Sequence[Property]:
    """Return the properties for setting points of a mask in the view that shows it."""
    return [
        button("ClickInside", "Clicks in the second output's picture mark what the region of Shown Mask learns from, "
                              "until the button is pressed again."),
        button("ClickOutside", "Clicks in the picture mark what the region does not learn from."),
        button("ClickRemove", "Clicks in the picture remove the nearest point."),
        hidden_text("PictureSize", "GetPictureSize",
                    "Width and height of the picture as it is shown, then those of its file."),
    ]  # fmt: skip


def style_properties(region: int) -> Sequence[Property]:
    """Return the properties of one region's style, and of the part of the picture that it uses."""
    name, advanced = f"Region{region}", region > 3
    return group(f"Region {region}", [
        choice(f"{name}Style", (AUTOMATIC, AS_IT_IS, *(f"{PICTURE}{k}" for k in range(REGIONS)), *OFFERED),
               AUTOMATIC, "The region's style: chosen by the mapping, none, one of Style Files (counted from 0), from "
                          "the gallery, or in ink.",
               advanced),
        text(f"{name}Positive", "Points in the picture that the region learns from, in pixels from the upper left: "
                                "310,120; 40,300. Empty and without a mask: the whole picture.", "",
             advanced),
        text(f"{name}Negative", "Points that the region does not learn from.", "", advanced),
        file(f"{name}Mask", "png", "Masks", "Mask to start from, with the points saved beside it; the region learns "
                                            "from the white part.", advanced=advanced),
        integer(f"{name}Part", -1, "Part of the picture to use, if Picture Parts divides it; -1: none of them.", -1,
                None, advanced),
        text(f"{name}Share", "Name of the part of a shared picture that paints this region, such as sky; Status tells "
                             "them. Empty: as Divide finds it.", "", advanced),
    ])  # fmt: skip
