"""The commands ``svv sheet`` and ``svv figures``; see :mod:`svv.cli`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from svv.options import Preset, Seed
from svv.progress import shown

SHEET = (
    "svv sheet foot.svv head.svv --style brush.jpg --style gallery:mosaic --out paintings",
    "svv sheet foot.svv --style gallery:woodcut --style gallery:impasto --preset draft --out paintings",
)
FIGURES = ("svv figures head.svv --style gallery:impasto --style gallery:mosaic --out figures",)

Styles = Annotated[
    list[str], typer.Option("--style", metavar="IMG|gallery:NAME", help="A picture; may be given several times.")
]
Folder = Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for pictures and painted scenes.")]
PaintPreset = Annotated[Preset, typer.Option(help="How long each painting is worked on.")]
Size = Annotated[int, typer.Option(min=16, help="Side of a picture in pixels.")]
Frame = Annotated[int, typer.Option(help="View of the path of 181, 0 to 180.")]


def sheet(
    scenes: Annotated[list[Path], typer.Argument(metavar="SCENE.svv ...", help="Scenes with a palette network.")],
    style: Styles,
    out: Folder,
    preset: PaintPreset = Preset.fast,
    size: Size = 320,
    frame: Frame = 76,
    seed: Seed = 0,
) -> None:
    """Paint every scene in every style, and show all on one sheet.

    The folder gets sheet.png and a scene file for each painting. Stopped with Ctrl-C, the same command goes on; what is
    painted is not painted again.
    """
    from svv.report.exhibits import Exhibit, paint_sheet

    print(paint_sheet(scenes, style, out, Exhibit(preset.value, size, frame, seed), shown))


def figures(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.svv", help="A scene of two regions at least.")],
    style: Styles,
    out: Folder,
    preset: PaintPreset = Preset.fast,
    size: Size = 320,
    frame: Frame = 76,
    seed: Seed = 0,
) -> None:
    """Show what painting can do with a scene, as the paper's figures do.

    several.png: each region painted alone, and several pictures for one scene; parts.png: three pairings of parts of
    one picture with the regions; edits.png: opacity and light edited after painting.
    """
    from svv.report.exhibits import Exhibit, paint_figures

    for path in paint_figures(scene, style, out, Exhibit(preset.value, size, frame, seed), shown):
        print(path)
