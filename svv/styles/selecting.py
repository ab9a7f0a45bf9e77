"""Parts of style pictures chosen, shown and saved: what ``svv style-mask`` and ParaView's panel call."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.core.segmentation import Points
from svv.errors import BadInput, Progress, silent
from svv.io.atomic import check_writable, make_folder
from svv.io.mask_file import (
    Mask,
    Selection,
    overlay_file,
    picture_size,
    read_mask,
    read_selection,
    write_mask,
    write_selection,
)
from svv.io.mask_pictures import mask_overlay, regions_overlay
from svv.io.output import write_small_png
from svv.options.making import PREFIX
from svv.styles.gallery import open_style
from svv.styles.segmenters import segmenter, style_regions


def write_regions(
    source: str, count: int, folder: Path, by: str = "scikit-image", progress: Progress = silent
) -> list[Path]:
    """Cut a style picture into regions; write a mask for each, and a picture that shows them.

    Args:
        source: A file or ``gallery:NAME``.
        count: 2 to 32 regions.
        folder: Made where it is missing; gets ``region-0.png`` (the largest) and on, and ``overlay.png``.
        by: Of :data:`svv.styles.segmenters.SEGMENTERS`.
        progress: Called now and then.

    Returns:
        The overlay and the masks.

    Raises:
        BadInput: a picture that cannot be used, a count out of range, SAM where it is not installed, or a folder that
            cannot be written to.
    """
    if folder.suffix.lower() == ".png":
        raise BadInput("Regions are several masks: give --out as a folder.")
    finder = segmenter(by)
    _, picture = open_style(source, progress)
    progress(0.2, "superpixels")
    labels = style_regions(picture, count, finder)
    make_folder(folder)
    paths = [folder / "overlay.png"]
    write_small_png(paths[0], regions_overlay(picture, labels), bright=True)
    for number in range(int(labels.max()) + 1):
        path = folder / f"region-{number}.png"
        write_mask(path, labels == number)
        # As one that began as something else: its few points will not say all of it.
        write_selection(path, Selection(source_size(source, picture.shape), segmenter=by, grown=True))
        paths.append(path)
    progress(1.0, "")
    return paths


def write_selected(
    source: str,
    positive: Points,
    negative: Points,
    refine: Path | None,
    out: Path,
    by: str = "scikit-image",
    progress: Progress = silent,
) -> float:
    """Select a part of a style picture by points; write the mask, its points, and a picture that shows both.

    Refined, a mask that was made of points alone is made again of all of them: in what order they came does not
    matter. Any other (a region, a drawing) is grown and cut around the points.

    Args:
        source: A file or ``gallery:NAME``.
        positive: Places that are wanted, (x, y) in pixels of the picture.
        negative: Places that are not.
        refine: A mask to go on from, with the points kept beside it, if any.
        out: The mask, a .png; its points and overlay go beside it.
        by: Of :data:`svv.styles.segmenters.SEGMENTERS`.
        progress: Called now and then.

    Returns:
        The share of the picture that is selected, over 0 to 1.

    Raises:
        BadInput: no points, points outside of the picture or that contradict each other, a picture or mask that cannot
            be used, SAM where it is not installed, or a file that cannot be written.
    """
    if out.suffix.lower() != ".png":
        raise BadInput(f"Cannot tell how to write {out}: name the mask .png, or ask for --regions.")
    if not positive and not negative:
        raise BadInput("Say what to select: --positive x,y for a place in it, or --regions N.")
    if refine is None and not positive:
        raise BadInput("Only what is not wanted is given: set at least one --positive point, too.")
    for path in (out, overlay_file(out)):
        check_writable(path)
    _, picture = open_style(source, progress)
    mask, chosen = selected(source, picture, positive, negative, refine, by, progress)
    write_mask(out, mask)
    write_selection(out, chosen)
    write_small_png(overlay_file(out), mask_overlay(picture, mask, chosen), bright=True)
    progress(1.0, "")
    return float(mask.mean())


def selected(
    source: str,
    picture: NDArray[np.floating],
    positive: Points = (),
    negative: Points = (),
    refine: Path | None = None,
    by: str = "scikit-image",
    progress: Progress = silent,
) -> tuple[Mask, Selection]:
    """The part of a style picture that points and a mask ask for, and all its points; nothing is written.

    Args:
        source: A file or ``gallery:NAME``.
        picture: What it shows, (h, w, 3) as :func:`svv.styles.gallery.open_style` has it.
        positive: Places that are wanted, (x, y) in pixels of the file.
        negative: Places that are not.
        refine: A mask to go on from, as of :func:`write_selected`; without new points it is taken as it is.
        by: Of :data:`svv.styles.segmenters.SEGMENTERS`.
        progress: Called now and then.

    Raises:
        BadInput: as :func:`write_selected`.
    """
    if refine is None and not positive:
        raise BadInput("Only what is not wanted is given: set at least one positive point, too.")
    finder = segmenter(by)
    size = source_size(source, picture.shape)
    known, start = Selection(size, segmenter=by), None
    if refine is not None:
        mask = read_mask(refine, picture.shape)
        known = read_selection(refine) or Selection(size, segmenter=by, grown=True)
        if known.size != size:
            raise BadInput(
                f"The mask {refine} was made in a picture of {known.size[0]} x {known.size[1]} pixels, and this one "
                f"has {size[0]} x {size[1]}: name the picture it belongs to."
            )
        if not positive and not negative:
            return mask, known
        start = mask if known.grown else None
    chosen = known.with_points(positive, negative)
    progress(0.3, "superpixels")
    mask = finder.select(picture, *chosen.scaled(picture.shape), start=start)
    if not mask.any():
        raise BadInput("Nothing is left of the selection: take a negative point back, or add a positive one.")
    return mask, chosen


def source_size(source: str, shape: Sequence[int]) -> tuple[int, int]:
    """Width and height in which places in a picture are given: the file's own."""
    if source.startswith(PREFIX):
        return int(shape[1]), int(shape[0])
    return picture_size(source)
