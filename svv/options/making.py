"""Options for drawing views, training and painting a scene, and rendering it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from svv.errors import BadInput
from svv.options.described import Setting

DRAWN, PREFIX = "ink:", "gallery:"
"""Prefixes of an ink's name and of a gallery picture's name, where a style is expected."""

LEAST_STROKE, MOST_STROKE = 0.25, 4.0
"""Range of the stroke size: within it, a stroke is larger than a pixel of the render and smaller than most regions."""

PresetName = Literal["draft", "fast", "balanced", "best", "paper"]
EncodingName = Literal["lattice", "hash", "values"]
LightingName = Literal["network", "phong", "auto"]
DeviceName = Literal["cpu", "cuda", "auto"]
MapperName = Literal["auto", "gpu", "cpu", "bricks"]
MannerName = Literal["auto", "strokes", "pieces"]
HandName = Literal["oil", "watercolour", "dots", "ink-wash", "dry-brush", "pastel", "print"]
AskedHandName = Literal["auto", "oil", "watercolour", "dots", "ink-wash", "dry-brush", "pastel", "print"]
DivisionName = Literal["areas", "colours"]
AskedDivisionName = Literal["auto", "areas", "colours", "no"]
NetworkName = Literal["base", "pcn", "styled"]
PictureName = Literal["rgba", "depth", "region", "doubt"]

Changes = Annotated[tuple[str, ...], Setting("--set", metavar="STAGE.NAME=VALUE", panel="Settings", advanced=True)]
TimeLimit = Annotated[
    float | None, Setting(least=1, metavar="SECONDS", slider=(0, None), unset=0.0, unset_says="0: no limit.")
]

PRESET_NAMES: tuple[str, ...] = get_args(PresetName)
LIGHTINGS: tuple[str, ...] = get_args(LightingName)


@dataclass(frozen=True)
class VolumeOptions:
    """Which transfer function shows a volume, and how its file is read."""

    tf: Annotated[tuple[Path, ...], Setting(metavar="TF.json")] = ()
    """Transfer function: of ParaView, 3D Slicer, VisIt, Inviwo, Voreen or ImageJ, one of several in a file
    (presets.xml:CT-Bone), a colour map of matplotlib (viridis), or a list of opacity bumps."""
    array: Annotated[tuple[str, ...], Setting(metavar="NAME")] = ()
    """Name of the array, if the file has several; of several arrays, svv views makes layers of one scene."""
    channel: Annotated[str | None, Setting(metavar="N|NAME")] = None
    """Number (from 0) or name of the channel, if the file has several."""
    time: Annotated[int | None, Setting(least=0, metavar="N")] = None
    """Number (from 0) of the time point, if the file has several."""
    dims: Annotated[tuple[int, int, int] | None, Setting(metavar="X,Y,Z", syntax="dims")] = None
    """For raw files: number of voxels along each axis."""
    dtype: str | None = None
    """For raw files: type of a voxel, such as uint8, int16 or float32."""
    spacing: Annotated[tuple[float, float, float] | None, Setting(metavar="X,Y,Z", syntax="spacing")] = None
    """For raw files, stacks and .npy: size of a voxel."""
    resample_to: Annotated[int | None, Setting(least=2, metavar="POINTS")] = None
    """For grids that are no images: points along the longest side; by default, as cells and memory suggest."""

    @property
    def only_array(self) -> str | None:
        """The array; None if none is named. BadInput is raised if there are several."""
        if len(self.array) > 1:
            raise BadInput(
                "Give one --array here: svv views takes several, and svv train makes one scene of their views."
            )
        return self.array[0] if self.array else None

    @property
    def only(self) -> Path | None:
        """The transfer function; None if there is none. BadInput is raised if there are several."""
        if len(self.tf) > 1:
            raise BadInput("Give one --tf here: svv views takes several, and svv train makes one scene of their views.")
        return self.tf[0] if self.tf else None

    def to_read(self) -> dict[str, Any]:
        """Return the arguments of :class:`svv.job.source.VolumeSource`, apart from the volume."""
        return {**vars(self), "tf": self.only, "array": self.only_array}


@dataclass(frozen=True)
class ShownVolumeOptions(VolumeOptions):
    """Which transfer function shows a volume of which views are drawn, and how its file is read."""

    rescale: Annotated[bool | None, Setting(flag="--rescale/--no-rescale", panel="")] = None
    """Stretch the transfer function over the data's range; by default, if it has no opacity points, or runs from 0 or
    -1 to 1 and the data does not."""
    nearest: Annotated[bool, Setting("--nearest", panel="")] = False
    """Show each voxel's own value, without interpolation, as labels need; ParaView's Interpolation Type Nearest."""


@dataclass(frozen=True)
class ViewOptions:
    """Which views of a volume are drawn.

    >>> options = svv.ViewOptions(n=42, test=20, size=400)
    >>> options.n, options.test, options.size
    (42, 20, 400)
    """

    n: Annotated[int, Setting(least=3, panel="Views", advanced=True)] = 92
    """Number of training views, spread evenly around the volume."""
    test: Annotated[int, Setting(least=0, panel="TestViews", advanced=True, slider=(0, 181))] = 16
    """Number of test views on the orbit, which are not trained on."""
    size: Annotated[int, Setting(least=16, panel="ViewSize", advanced=True, slider=(64, 4096))] = 800
    """Width and height of the views in pixels."""
    mapper: Annotated[MapperName, Setting(panel="RayCaster", advanced=True)] = "auto"
    """Ray caster: VTK's gpu or cpu, or bricks, our own, for any size. auto takes the GPU if OpenGL runs on hardware and
    the volume fits, otherwise mostly bricks."""
    memory: Annotated[float | None, Setting(metavar="GB", least=0.25, panel="")] = None
    """Gigabytes that drawing may take; by default half of the memory."""
    fov: Annotated[float, Setting(least=1, most=150, panel="")] = 30.0
    """Full angle of view in degrees."""
    step: Annotated[float | None, Setting(metavar="VOXELS", panel="")] = None
    """Distance between samples in voxels; by default as fine as makes a difference."""
    frame: Annotated[Literal["visible", "whole"], Setting(panel="")] = "visible"
    """What fills the views: what the transfer function shows, or the whole volume."""
    projection: Annotated[Literal["perspective", "orthographic"], Setting(panel="")] = "perspective"
    """Perspective, or orthographic: parallel rays, as wide at the centre."""


@dataclass(frozen=True)
class TrainOptions:
    """How a scene is trained on views.

    >>> svv.TrainOptions("fast", encoding="lattice").preset
    'fast'
    """

    preset: PresetName = "balanced"
    """How long to train: draft takes seconds, fast and balanced minutes, best a quarter of an hour, paper hours."""
    time_limit: TimeLimit = None
    """Train for at most this many seconds."""
    seed: Annotated[int, Setting(least=0, advanced=True)] = 0
    """The same seed gives the same result."""
    device: Annotated[DeviceName, Setting(advanced=True, result=False)] = "auto"
    """Where to run; auto takes a GPU that passes a check (25 s on its first use), otherwise the CPU."""
    encoding: Annotated[EncodingName | None, Setting(advanced=True, unset="as the preset")] = None
    """Sparse lattice, the paper's hash grid, or the volume's values, if known; by default the preset's."""
    lighting: Annotated[LightingName | None, Setting(advanced=True, unset="as the views allow")] = None
    """Light: network stays at the camera, phong can be moved, auto is phong if unseen views lose nothing; by default
    network, or auto below 32 views."""
    views_only: bool = False
    """Learn from views only, as in the paper, even if the volume is known."""
    keep_values: Annotated[bool, Setting("--keep-values", advanced=True)] = False
    """Keep the volume's values where the scene shows something, for `svv probe` to read off: up to a byte a voxel."""
    ignore_fixed: Annotated[bool, Setting("--ignore-fixed", advanced=True)] = False
    """Leave out what stands still on the screen: colour bars, axes, logos, text."""
    change: Changes = ()
    """Change one setting of the preset, such as reconstruct.iterations=4000."""


@dataclass(frozen=True)
class PaletteOptions:
    """How the regions of a corrected palette are trained again.

    >>> svv.PaletteOptions("draft").preset
    'draft'
    """

    preset: PresetName = "balanced"
    """How long to train the regions; draft gives a first look."""
    time_limit: TimeLimit = None
    """Train for at most this many seconds."""
    seed: Annotated[int, Setting(least=0, advanced=True)] = 0
    """The same seed gives the same result."""
    views_only: bool = False
    """Use the palette as given, even if the volume says otherwise."""


@dataclass(frozen=True)
class SharingOptions:
    """Which region gets which style, or which part of a picture that several share."""

    mapping: Annotated[
        dict[int, int | str] | dict[int, int] | Literal["colour"] | None,
        Setting("--map", metavar="0=0,1=1|0=PART|colour", syntax="mapping", panel=""),
    ] = None
    """Pairs of region and style, or of region and part of a divided picture (0=sky; 0=1:sky in style 1), or colour to
    pair them by likeness; in turn by default."""
    divide: AskedDivisionName = "auto"
    """Divide a picture among the regions that share it: by areas (a sky, a field) or colours; auto takes what tells the
    regions apart, no gives each the whole."""


@dataclass(frozen=True)
class PaintOptions(SharingOptions):
    """How the regions of a scene are painted.

    >>> options = svv.PaintOptions(mapping={0: 1, 1: 0}, preset="draft", stroke_size=1.5)
    >>> options.manner, options.hand
    ('auto', 'auto')
    """

    keep: Annotated[tuple[int, ...], Setting(metavar="K", panel="")] = ()
    """A region to leave unpainted."""
    stroke_size: Annotated[float, Setting(metavar="F", slider=(LEAST_STROKE, MOST_STROKE))] = 1.0
    """Scale of the strokes, from 0.25 to 4; at 1 they are 10 pixels wide in a picture of 800."""
    manner: MannerName = "auto"
    """Brush strokes, or pieces of the picture; auto takes strokes for paintings, otherwise pieces."""
    hand: AskedHandName = "auto"
    """Technique of the strokes; auto finds oil, watercolour, dots, ink wash or print in the picture. Any other word
    asks for strokes."""
    strength: Annotated[float, Setting(metavar="F", panel="")] = 1.0
    """How strongly the style shows, above 0 and up to 1; can be edited afterwards."""
    go_on: Annotated[bool, Setting("--continue", panel="")] = False
    """Keep the scene's painting where no style is given for a region."""
    preset: PresetName = "balanced"
    """How to paint: draft for a first look; fast, balanced and best alike; paper matches features for hours, as
    StyleRF-VolVis does."""
    seed: Annotated[int, Setting(least=0, advanced=True)] = 0
    """The same seed gives the same result."""
    features: Annotated[str, Setting(metavar="auto|embedded|vgg16|FILE", advanced=True)] = "auto"
    """Features that the preset paper matches; auto uses VGG-16 if its weights are there. Other presets match none."""
    variant: Annotated[str | None, Setting(metavar="NAME", panel="")] = None
    """Add a painting under this name and keep the others."""
    change: Changes = ()
    """Change one setting of the preset, such as stylize.style_views=30."""


@dataclass(frozen=True)
class DeviceOptions:
    """Where work on a scene runs."""

    device: Annotated[DeviceName, Setting(advanced=True, result=False)] = "auto"
    """Where to run; auto takes a GPU that passes a check (25 s on its first use), otherwise the CPU."""


@dataclass(frozen=True)
class OrbitOptions:
    """The camera path around a scene, which shows it from all sides."""

    orbit: Annotated[int, Setting(least=2)] = 61
    """Frames of the orbit."""
    orbit_size: Annotated[int, Setting(least=16)] = 400
    """Width and height of the orbit's frames in pixels."""


@dataclass(frozen=True)
class RenderOptions:
    """What is rendered of a scene, and over which background."""

    size: Annotated[tuple[int, int] | None, Setting(metavar="N|WxH", syntax="size", panel="")] = None
    """Size in pixels; 800 by default."""
    network: Annotated[NetworkName | None, Setting(unset="last")] = None
    """Network of the colours: base (as learned), pcn (palette and edits) or styled (painting); by default the scene's
    last."""
    variant: Annotated[str | None, Setting(metavar="NAME", advanced=True)] = None
    """Painting to render; by default the one that the scene shows."""
    background: Annotated[tuple[float, float, float] | None, Setting(metavar="COLOUR", syntax="colour", panel="")] = (
        None
    )
    """white, black or '#rrggbb'; by default movies are over white, images are transparent."""
    what: Annotated[PictureName, Setting(panel="")] = "rgba"
    """What to write; doubt is the error to expect beside the volume rendering. A .vti always holds the first three, and
    the values that a scene keeps (--keep-values)."""
    supersample: Annotated[int | None, Setting(least=1, most=4, metavar="N", unset="as needed", panel="")] = None
    """Average N x N rays a pixel, for smooth edges; by default 2 for one view of brush strokes, otherwise 1."""
    fps: Annotated[float, Setting(least=1, panel="")] = 30.0
    """Frames per second of a movie."""
    device: Annotated[DeviceName, Setting(advanced=True, result=False)] = "auto"
    """Where to run; auto takes a GPU that passes a check (25 s on its first use), otherwise the CPU."""
