"""Style pictures and masks that the panel of StyleRF Stylize asks for: reading, showing and saving them.

A region's row names its picture, from a file or the gallery, or leaves the choice to the mapping.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput, Progress
from svv.io.pictures.mask_file import Mask, Selection
from svv.options.making import DRAWN, PREFIX
from svv.pv.panel.groups import AS_IT_IS, AUTOMATIC, NO_GALLERY, PICTURE, REGIONS
from svv.pv.panel_values import Values, points_in, region_row

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

Colours = NDArray[np.float32]

NO_PICTURE = "Choose at least one picture under Style Files, or one from the gallery."


def sources_of(values: Values) -> list[str]:
    """Return the pictures for regions whose rows name none: the files, then the one chosen from the gallery."""
    chosen = values.get("Gallery", NO_GALLERY)
    return [*values["StyleFiles"], *([] if chosen == NO_GALLERY else [_offered(chosen)])]


def source_of(values: Values, region: int) -> str | None:
    """Return the picture of a region's row, None if the mapping chooses it, '' to leave it unpainted; or BadInput."""
    word, files = region_row(values, region).get("Style", AUTOMATIC), values["StyleFiles"]
    if word == AUTOMATIC:
        return None
    if word == AS_IT_IS:
        return ""
    if not word.startswith(PICTURE):
        return _offered(word)
    number = int(word.removeprefix(PICTURE))
    if number >= len(files):
        there = f"there are {len(files)} under Style Files, counted from 0" if files else "Style Files is empty"
        raise BadInput(f"Region {region} asks for picture {number}, but {there}.")
    return str(files[number])


def _offered(word: str) -> str:
    """Return the source of an entry that the panel offers: an ink, or a picture from the gallery."""
    return word if word.startswith(DRAWN) else PREFIX + word


def asks_for_part(values: Values, region: int) -> bool:
    """Return whether a region's row asks for only a part of its picture."""
    row = region_row(values, region)
    return bool(row.get("Positive") or row.get("Negative") or row.get("Mask")) or row.get("Part", -1) >= 0


def mask_for(values: Values, region: int, source: str, picture: Colours) -> tuple[Mask | None, Selection | None]:
    """Return the part of a picture that a region's row asks for, and its points, both None for all; or BadInput."""
    from svv.styles.selecting import selected

    row = region_row(values, region)
    if not asks_for_part(values, region):
        return None, None
    positive = pixels_in(row["Positive"], f"Region {region} Positive")
    negative = pixels_in(row["Negative"], f"Region {region} Negative")
    number, file = row["Part"], row["Mask"]
    if number >= 0:
        if positive or negative or file:
            raise BadInput(
                f"Region {region} has both a part and a mask or points: set its part to -1, or clear mask and points."
            )
        labels = parts_of(values, picture)
        if number > labels.max():
            raise BadInput(
                f"Region {region} asks for part {number}, but the picture is divided into {labels.max() + 1} parts, "
                "counted from 0: choose another part, or increase Picture Parts."
            )
        return labels == number, None
    return selected(source, picture, positive, negative, Path(file) if file else None)


def parts_of(values: Values, picture: Colours) -> NDArray[np.int64]:
    """Divide a picture into the panel's number of parts, numbered by size from the largest; or BadInput. (h, w)"""
    from svv.styles.segmenters import style_regions

    if not values["PictureParts"]:
        raise BadInput("Set Picture Parts to the number of parts into which pictures are divided, 2 to 32.")
    return style_regions(picture, values["PictureParts"])


def pixels_in(text: str, name: str) -> list[tuple[float, float]]:
    """Parse '310,120; 40,300' as points; raise BadInput for anything else."""
    found = points_in(text, 2, f"{name} must be points in pixels of the picture, such as 310,120; 40,300")
    return [(x, y) for x, y in found]


def preview(
    values: Values, progress: Progress
) -> tuple[Colours, NDArray[np.uint8], NDArray[np.uint8], tuple[int, int]]:
    """Return the picture of the region whose mask is shown, its overlay, the part that is used, and the file's size.

    Picture (h, w, 3) in [0, 1]; overlay (h, w, 3) uint8, with rulers in pixels of the file; mask (h, w), the numbers of
    the parts if the picture is divided and no part is chosen, otherwise 1 and 0; width and height of the file. Raises
    BadInput if there is no picture, or as :func:`mask_for`.
    """
    from svv.io.pictures.mask_pictures import mask_overlay, regions_overlay, with_rulers
    from svv.io.pictures.output import to_bytes
    from svv.styles.selecting import source_size
    from svv.train.paint.ink import PAPER, Ink, picture_of, style_named

    region = values["ShownMask"]
    there = [source_of(values, region), *sources_of(values), *(source_of(values, k) for k in range(REGIONS))]
    source = next(filter(None, there), None)
    if source is None:
        raise BadInput(NO_PICTURE)
    _, style = style_named(source, progress)
    if isinstance(style, Ink) and not asks_for_part(values, region):  # ink starts from an empty sheet
        blank = np.full((64, 64, 3), PAPER, np.float32)
        return blank, to_bytes(blank), np.ones(blank.shape[:2], np.uint8), (64, 64)
    picture = picture_of(style).astype(np.float32, copy=False)
    mask, selection = mask_for(values, region, source, picture)
    if mask is None and values["PictureParts"]:
        parts = parts_of(values, picture)
        overlay, taken = regions_overlay(picture, parts), parts.astype(np.uint8)
    else:
        whole = np.ones(picture.shape[:2], bool) if mask is None else mask
        overlay, taken = mask_overlay(picture, whole, selection), whole.astype(np.uint8)
    size = source_size(source, picture.shape)
    return picture, with_rulers(overlay, size), taken, size


def write_masks(scene: Scene, values: Values, folder: Path, progress: Progress) -> int:
    """Write every region's mask, if it has one, to region-K.png, as ``svv style-mask`` does; return their number."""
    from svv.io.files.atomic import make_folder
    from svv.io.pictures.mask_file import overlay_file, write_mask, write_selection
    from svv.io.pictures.mask_pictures import mask_overlay
    from svv.io.pictures.output import write_png
    from svv.styles.gallery import open_style
    from svv.styles.selecting import source_size

    written = 0
    for region in range(len(scene.regions)):
        source = source_of(values, region) or next(iter(sources_of(values)), None)
        if source is None or not asks_for_part(values, region):
            continue
        picture = open_style(source, progress)[1]
        mask, selection = mask_for(values, region, source, picture)
        assert mask is not None
        make_folder(folder)
        path = folder / f"region-{region}.png"
        write_mask(path, mask)
        write_selection(path, selection or Selection(source_size(source, picture.shape), grown=True))
        write_png(overlay_file(path), mask_overlay(picture, mask, selection))
        written += 1
    return written
