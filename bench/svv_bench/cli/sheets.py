"""The commands ``svv bench sheet`` and ``svv bench figures``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.option_group import spread
from svv.options.described import Setting
from svv.options.making import PresetName
from svv.progress import shown

if TYPE_CHECKING:
    from svv_bench.styles.exhibits import Exhibit

SHEET = (
    "svv bench sheet foot.svv head.svv --style brush.jpg --style gallery:mosaic --out paintings",
    "svv bench sheet foot.svv --style gallery:woodcut --style gallery:impasto --preset draft --out paintings",
)
"""Examples in the help."""
FIGURES = ("svv bench figures head.svv --style gallery:impasto --style gallery:mosaic --out figures",)
"""Examples in the help."""


@dataclass(frozen=True)
class Painting:
    """Styles, settings and output folder of paintings."""

    style: Annotated[
        list[str], typer.Option("--style", metavar="IMG|gallery:NAME", help="A style picture; may be repeated.")
    ]
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the pictures and the painted scenes.")
    ]
    preset: PresetName = "fast"
    """How long to work on each painting."""
    size: Annotated[int, Setting(least=16)] = 320
    """Width and height of a picture in pixels."""
    frame: int = 76
    """Number of the frame on the path of 181, from 0 to 180."""
    seed: Annotated[int, Setting(least=0)] = 0
    """The same seed gives the same result."""

    def exhibit(self) -> Exhibit:
        """Return the settings in the form that the layers below take."""
        from svv_bench.styles.exhibits import Exhibit

        return Exhibit(self.preset, self.size, self.frame, self.seed)


@spread
def sheet(
    scenes: Annotated[list[Path], typer.Argument(metavar="SCENE.svv ...", help="Scenes with a palette network.")],
    how: Painting,
) -> None:
    """Paint every scene in every style, and show all paintings on one sheet.

    The results are sheet.png and a scene file for each painting. After Ctrl-C, the same command resumes.
    """
    from svv_bench.styles.exhibits import paint_sheet

    print(paint_sheet(scenes, how.style, how.out, how.exhibit(), shown))


@spread
def figures(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.svv", help="A scene with at least two regions.")],
    how: Painting,
) -> None:
    """Reproduce the paper's figures with your own scene.

    several.png shows each region painted alone, and one scene painted after several pictures; parts.png shows three
    pairings of the parts of one picture with the regions; edits.png shows edits of opacity and light after painting.
    """
    from svv_bench.styles.exhibits import paint_figures

    for path in paint_figures(scene, how.style, how.out, how.exhibit(), shown):
        print(path)
