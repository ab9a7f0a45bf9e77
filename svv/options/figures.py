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
    """Journal whose column widths and text size are used."""
    columns: ColumnsName = "single"
    """Whether the figure is as wide as one column or as two."""
    width: Annotated[float | None, Setting(metavar="MM", advanced=True, unset=0.0, unset_says="0: the column's.")] = (
        None
    )
    """Width in mm instead, from 20 to 1000."""
    dpi: Annotated[int, Setting(advanced=True)] = 300
    """Pixels per inch, from 50 to 1200; journals ask for 300, or 600 with fine lines."""
    across: Annotated[int | None, Setting(metavar="N", least=1, panel="")] = None
    """Panels in a row; by default up to three, otherwise a grid as square as possible."""
    frame: Annotated[FrameName, Setting(panel="Frame")] = "content"
    """content trims all panels alike to what is visible; camera keeps the cameras' frames."""
    title: Annotated[tuple[str, ...], Setting(panel="")] = ()
    """Title of the next panel."""
    letters: Annotated[LettersName, Setting(panel="")] = "auto"
    """How panels are numbered; auto writes a, b, c if there are several."""
    legend: LegendName = "auto"
    """Where the regions' names stand, each with a small painted sphere and its values."""
    unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's lengths for the scale bar, such as mm or µm."""
    value_unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's values for the legend, such as HU."""
    hatch_doubt: Annotated[
        float | None,
        Setting(metavar="ERROR", least=0, most=1, advanced=True, unset=0.0, unset_says="0: nothing."),
    ] = None
    """Hatch where colours are expected to be further off than this, from 0 to 1 (`svv render --what doubt`)."""
    scale_bar: bool = True
    """Draw a scale bar; under perspective, it holds in the plane through the volume's middle."""
    axes: Annotated[str | None, Setting(metavar="X,Y,Z|none")] = "x,y,z"
    """Names of the volume's axes, shown in a corner; none leaves them out."""
    parallel: Annotated[bool, Setting(advanced=True)] = False
    """Look along parallel rays, so that the scale bar holds everywhere."""
    background: Annotated[tuple[float, float, float] | None, Setting(metavar="COLOUR", syntax="colour", panel="")] = (
        None
    )
    """white, black or '#rrggbb', behind the whole figure; white by default."""
    transparent: Annotated[bool, Setting(advanced=True)] = False
    """Leave the background out."""
    font: Annotated[str | None, Setting(metavar="NAME", advanced=True)] = None
    """An installed font, such as Arial; by default DejaVu Sans."""
    font_size: Annotated[
        float | None, Setting(metavar="PT", advanced=True, unset=0.0, unset_says="0: the journal's.")
    ] = None
    """Size of the text in points, from 4 to 40; by default the journal's."""
    network: Annotated[NetworkName | None, Setting(unset="last", advanced=True)] = None
    """Network of the colours, as in `svv render`; by default the scene's last."""
    device: Annotated[DeviceName, Setting(advanced=True, result=False)] = "auto"
    """Where to run; auto takes a GPU that passes a check (25 s on its first use), otherwise the CPU."""

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
