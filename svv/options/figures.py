"""Options of a figure for a paper, a talk or a page (:mod:`svv.render.figures`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from svv.options.described import Setting
from svv.options.making import DeviceName, NetworkName

JournalName = Literal["nature", "science", "ieee", "elsevier", "springer"]
ColumnsName = Literal["single", "double"]
LegendName = Literal["auto", "right", "below", "none"]
LettersName = Literal["auto", "a", "A", "(a)", "none"]
FrameName = Literal["content", "camera"]
VisionName = Literal["normal", "protanopia", "deuteranopia", "tritanopia", "grey print"]
VISIONS: tuple[VisionName, ...] = get_args(VisionName)
"""Ways to see: normal, without the cones for long, middle or short waves, and without colour."""

JOURNALS: dict[str, tuple[float, float, float]] = {
    "nature": (89.0, 183.0, 7.0),
    "science": (57.0, 121.0, 7.0),
    "ieee": (88.9, 181.9, 8.0),
    "elsevier": (90.0, 190.0, 7.0),
    "springer": (84.0, 174.0, 8.0),
}
"""Width of one and of two columns in mm, and size of the text in points, as the journals' guides for authors ask."""


@dataclass(frozen=True)
class FigureOptions:
    """How a figure is laid out, and what is drawn beside its pictures.

    >>> options = svv.FigureOptions(width=89.0, dpi=300)  # millimetres: one column
    >>> options.width, options.dpi
    (89.0, 300)
    """

    journal: JournalName = "nature"
    """Journal whose column widths and size of text are used."""
    columns: ColumnsName = "single"
    """Whether the figure is as wide as one column or as two."""
    width: Annotated[float | None, Setting(metavar="MM", advanced=True, unset=0.0, unset_says="0: the column's.")] = (
        None
    )
    """Width in mm instead, from 20 to 1000."""
    dpi: Annotated[int, Setting(advanced=True)] = 300
    """Pixels per inch of the pictures, from 50 to 1200; journals ask for 300, or for 600 with fine lines."""
    across: Annotated[int | None, Setting(metavar="N", least=1, panel="")] = None
    """Panels beside each other; by default all of up to three, and otherwise as square a grid as possible."""
    frame: Annotated[FrameName, Setting(panel="Frame")] = "content"
    """What panels show: content trims all alike to what is visible, at one scale; camera keeps the cameras' frames."""
    title: Annotated[tuple[str, ...], Setting(panel="")] = ()
    """Title of the next panel."""
    letters: Annotated[LettersName, Setting(panel="")] = "auto"
    """How panels are numbered; auto writes a, b, c if there are several."""
    legend: LegendName = "auto"
    """Where the names of the regions stand, each with a small sphere in its paint and light, and its values."""
    unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's lengths for the scale bar, such as mm or µm."""
    value_unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's values for the legend, such as HU."""
    scale_bar: bool = True
    """Draw a scale bar; under perspective, it holds in the plane through the middle of the volume."""
    axes: Annotated[str | None, Setting(metavar="X,Y,Z|none")] = "x,y,z"
    """Names of the volume's axes in the corner that shows how they lie; none leaves them out."""
    parallel: Annotated[bool, Setting(advanced=True)] = False
    """Look along parallel rays, so that the scale bar holds everywhere."""
    background: Annotated[tuple[float, float, float] | None, Setting(metavar="COLOUR", syntax="colour", panel="")] = (
        None
    )
    """white, black or '#rrggbb', behind the whole figure; white by default."""
    transparent: Annotated[bool, Setting(advanced=True)] = False
    """Leave the background out: transparent PNG and TIFF, and no rectangle behind SVG and PDF."""
    font: Annotated[str | None, Setting(metavar="NAME", advanced=True)] = None
    """An installed font, such as Arial; by default DejaVu Sans, which comes with matplotlib."""
    font_size: Annotated[
        float | None, Setting(metavar="PT", advanced=True, unset=0.0, unset_says="0: the journal's.")
    ] = None
    """Size of the text in points, from 4 to 40; by default the journal's."""
    network: Annotated[NetworkName | None, Setting(unset="last", advanced=True)] = None
    """Which network gives the colours, as in `svv render`; by default the last that the scene has."""
    device: Annotated[DeviceName, Setting(advanced=True, result=False)] = "auto"
    """Where to run; auto takes a GPU whose kernels pass a check, 25 s on its first use, otherwise the CPU."""

    @property
    def mm(self) -> float:
        """Width of the figure in mm."""
        return JOURNALS[self.journal][self.columns == "double"] if self.width is None else self.width

    @property
    def behind(self) -> tuple[float, float, float]:
        """The background, RGB in [0, 1]."""
        return (1.0, 1.0, 1.0) if self.background is None else self.background

    @property
    def points(self) -> float:
        """Size of the text in points."""
        return JOURNALS[self.journal][2] if self.font_size is None else self.font_size
