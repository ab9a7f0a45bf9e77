"""The commands about style pictures: ``svv styles`` and ``svv style-mask``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from svv.cli.option_group import spread
from svv.cli.options import Seed, parse_points, parse_style_masks
from svv.errors import BadInput
from svv.options.described import Setting
from svv.progress import shown

if TYPE_CHECKING:
    from svv.train.paint.ink import StyleInput

STYLES = ("svv styles", "svv styles --out gallery", "svv styles woodcut mosaic --size 800 --seed 3 --out gallery")
STYLE_MASK = (
    "svv style-mask painting.jpg --regions 4 --out parts",
    "svv style-mask painting.jpg --positive 310,120 --negative 40,300 --out sky.png",
    "svv style-mask painting.jpg --refine sky.png --negative 200,260 --out sky.png",
    "svv style-mask gallery:impasto --positive 250,260 --out flower.png",
)


@dataclass(frozen=True)
class Finder:
    """The segmenter that finds parts of pictures."""

    segmenter: Annotated[Literal["scikit-image", "sam"], Setting("--with")] = "scikit-image"
    """Segmenter that finds the part; sam is experimental and needs its package and weights."""


def styles(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME ...", help="Names of style pictures; by default all.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Write them to this folder as PNG files.")
    ] = None,
    size: Annotated[int, typer.Option(min=16, max=1024, help="Width and height in pixels.")] = 512,
    seed: Seed = 0,
) -> None:
    """List the gallery of style pictures, or write them to a folder with a contact sheet.

    Pass any of them to --style as gallery:NAME. They are generated on first use and kept in the user's cache.
    """
    from svv.options.making import PREFIX
    from svv.styles.gallery import gallery_name
    from svv.styles.gallery.offered import GALLERY

    chosen = list(dict.fromkeys(gallery_name(name) for name in names or GALLERY))
    if out is None:
        for name in chosen:
            print(f"{PREFIX}{name:<15} {GALLERY[name][1]}")
        return
    from svv.render.gallery import write_gallery

    with shown("Painting") as progress:
        sheet = write_gallery(out, chosen, size, seed, progress)
    print(sheet)


@spread
def style_mask(
    picture: Annotated[str, typer.Argument(metavar="PICTURE|gallery:NAME", help="A style picture.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="MASK.png|DIR",
            help="Where to write the mask; with --regions, the folder for the masks.",
        ),
    ],
    regions: Annotated[
        int | None, typer.Option(metavar="N", help="Divide the picture into 2 to 32 regions of similar appearance.")
    ] = None,
    positive: Annotated[
        list[str] | None, typer.Option(metavar="X,Y", help="A pixel that belongs to the part; may be repeated.")
    ] = None,
    negative: Annotated[
        list[str] | None, typer.Option(metavar="X,Y", help="A pixel that does not belong to the part; may be repeated.")
    ] = None,
    refine: Annotated[
        Path | None, typer.Option(metavar="MASK.png", help="Start from this mask and the points stored next to it.")
    ] = None,
    by: Finder = Finder(),
) -> None:
    """Select the part of a style picture that `svv stylize --style-mask` learns from.

    Points are pixels of the picture, x from the left, y from the top. Beside MASK.png, the command writes
    MASK-overlay.png, which shows the selection, and MASK.json, the points, to which --refine adds. With --regions, a
    mask for each region and overlay.png, with their numbers, go to the folder.
    """
    from svv.styles.selecting import write_regions, write_selected

    wanted = parse_points(positive or [], "--positive")
    unwanted = parse_points(negative or [], "--negative")
    if regions is not None:
        if wanted or unwanted or refine:
            raise BadInput("Give --regions or points, not both; a region can be refined afterwards with --refine.")
        with shown("Segmenting") as progress:
            paths = write_regions(picture, regions, out, by.segmenter, progress)
        for path in paths:
            print(path)
        return
    with shown("Selecting") as progress:
        share = write_selected(picture, wanted, unwanted, refine, out, by.segmenter, progress)
    if share == 1.0:
        print("The selection covers the whole picture; add --negative points outside the part.", file=sys.stderr)
    print(f"{out}: {share:.1%} of the picture")


def read_styles(sources: Sequence[str], masks: Sequence[str]) -> list[StyleInput]:
    """Read the styles and masks of ``--style`` and ``--style-mask``, named for both.

    Raises BadInput if one is of no use.
    """
    from svv.io.pictures.mask_file import read_mask
    from svv.train.paint.ink import StyleInput, picture_of, style_named

    files, found = parse_style_masks(masks, len(sources)), []
    with shown("Styles") as progress:
        for k, source in enumerate(sources):
            name, style = style_named(source, progress)
            mask = read_mask(files[k], picture_of(style).shape) if k in files else None
            found.append(StyleInput(style, f"{name} ({files[k].stem})" if k in files else name, mask))
    return found
