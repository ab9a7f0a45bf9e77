"""Selection, display and saving of parts of style pictures, for ``svv style-mask`` and ParaView's panel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.core.images.segmentation import Points
from svv.errors import BadInput, Progress, silent
from svv.io.files.atomic import check_writable, make_folder
from svv.io.pictures.mask_file import (
    Mask,
    Selection,
    overlay_file,
    picture_size,
    read_mask,
    read_selection,
    write_mask,
    write_selection,
)
from svv.io.pictures.mask_pictures import mask_overlay, regions_overlay
from svv.io.pictures.output import write_small_png
from svv.options.making import PREFIX
from svv.styles.gallery import open_style
from svv.styles.segmenters import segmenter, style_regions


def write_regions(
    source: str, count: int, folder: Path, by: str = "scikit-image", progress: Progress = silent
) -> list[Path]:
    """Cut a style picture, a file or ``gallery:NAME``, into at most 2 to 32 regions; write masks and a picture of them.

    The folder, created if missing, gets ``overlay.png``, ``region-0.png`` (the largest) and so on, which are returned
    in this order; ``by`` is one of :data:`svv.styles.segmenters.SEGMENTERS`. Raises BadInput if the picture cannot be
    used, the count is out of range, SAM is not installed, or the folder cannot be written to.
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
        # Marked as grown: points added later do not describe the whole region.
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

    When a mask made only from points is refined, it is computed again from all points, so their order does not matter.
    Any other mask (a region, a drawing) is grown and cut around the points. Arguments are those of :func:`selected`;
    points and overlay are written next to the mask ``out``, a .png. Returns the fraction of the picture that is
    selected, in (0, 1].

    Raises BadInput if no points are given, points lie outside the picture or contradict each other, the picture or mask
    cannot be used, SAM is not installed, or a file cannot be written.
    """
    if out.suffix.lower() != ".png":
        raise BadInput(f"{out} is not a PNG: name the mask .png, or ask for several masks with --regions N.")
    if not positive and not negative:
        raise BadInput("Say what to select: --positive x,y for a place in it, or --regions N.")
    if refine is None and not positive:
        raise BadInput("All points are negative: set at least one --positive point as well.")
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
    """Return the mask and all points of the part of a style picture that points, (x, y) in pixels of its file, select.

    ``picture`` (h, w, 3) is that of the ``source``, a file or ``gallery:NAME``, as
    :func:`svv.styles.gallery.open_style` returns it; ``refine`` is a mask to start from with the points next to it,
    which without new points is returned unchanged; ``by`` is one of :data:`svv.styles.segmenters.SEGMENTERS`. Raises
    BadInput as :func:`write_selected`.
    """
    if refine is None and not positive:
        raise BadInput("All points are negative: set at least one positive point as well.")
    finder = segmenter(by)
    size = source_size(source, picture.shape)
    known, start = Selection(size, segmenter=by), None
    if refine is not None:
        mask = read_mask(refine, picture.shape)
        known = read_selection(refine) or Selection(size, segmenter=by, grown=True)
        if known.size != size:
            raise BadInput(
                f"The mask {refine} was made for a picture of {known.size[0]} x {known.size[1]} pixels, but this one "
                f"has {size[0]} x {size[1]}: name the picture that the mask belongs to."
            )
        if not positive and not negative:
            return mask, known
        start = mask if known.grown else None
    chosen = known.with_points(positive, negative)
    progress(0.3, "superpixels")
    mask = finder.select(picture, *chosen.scaled(picture.shape), start=start)
    if not mask.any():
        raise BadInput("The selection is empty: remove a negative point, or add a positive one.")
    return mask, chosen


def source_size(source: str, shape: Sequence[int]) -> tuple[int, int]:
    """Return the size that points in a picture refer to, that of its file: width and height in pixels."""
    if source.startswith(PREFIX):
        return int(shape[1]), int(shape[0])
    return picture_size(source)
