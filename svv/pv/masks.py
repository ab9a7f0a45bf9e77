"""Pictures and their parts as the panel of StyleRF Stylize asks for them: what a region learns from, shown and saved.

A region's row names its picture, or leaves it to the mapping. Pictures are files or of the gallery.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput, Progress
from svv.io.mask_file import Mask, Selection
from svv.pv.panels import AS_IT_IS, AUTOMATIC, NO_GALLERY, PICTURE, REGIONS

if TYPE_CHECKING:
    from svv.fields.scene import Scene

Values = Mapping[str, Any]
Colours = NDArray[np.float32]

NO_PICTURE = "Choose at least one picture under Style Files, or one of the gallery."


def sources_of(values: Values) -> list[str]:
    """The pictures that regions without one of their own get: the files, and the one of the gallery."""
    chosen = values.get("Gallery", NO_GALLERY)
    return [*values["StyleFiles"], *([] if chosen == NO_GALLERY else [_offered(chosen)])]


def source_of(values: Values, region: int) -> str | None:
    """The picture of a region's row; None where the row leaves it to the mapping, '' where it stays as it is.

    Raises:
        BadInput: the row names a picture that is not among Style Files.
    """
    word, files = values.get(f"Region{region}Style", AUTOMATIC), values["StyleFiles"]
    if word == AUTOMATIC:
        return None
    if word == AS_IT_IS:
        return ""
    if not word.startswith(PICTURE):
        return _offered(word)
    number = int(word.removeprefix(PICTURE))
    if number >= len(files):
        there = f"there are {len(files)} under Style Files, counted from 0" if files else "there is none"
        raise BadInput(f"Region {region} is to have picture {number}, but {there}.")
    return str(files[number])


def _offered(word: str) -> str:
    """The source of what the panel itself offers: an ink or a picture of the gallery."""
    from svv.options.making import DRAWN, PREFIX

    return word if word.startswith(DRAWN) else PREFIX + word


def asks_for_part(values: Values, region: int) -> bool:
    """Whether a region's row asks for less than all of its picture."""
    row = f"Region{region}"
    return any(values.get(row + name) for name in ("Positive", "Negative", "Mask")) or values.get(f"{row}Part", -1) >= 0


def mask_for(values: Values, region: int, source: str, picture: Colours) -> tuple[Mask | None, Selection | None]:
    """The part of a picture that a region's row asks for, and its points; None where it asks for all of it.

    Raises:
        BadInput: points or a mask that cannot be (:func:`svv.styles.selecting.selected`), or a part that there is not.
    """
    from svv.styles.selecting import selected

    row = f"Region{region}"
    if not asks_for_part(values, region):
        return None, None
    positive, negative = (points_in(values[row + kind], f"Region {region} {kind}") for kind in ("Positive", "Negative"))
    number, file = values[f"{row}Part"], values[f"{row}Mask"]
    if number >= 0:
        if positive or negative or file:
            raise BadInput(f"Region {region} has a part and a mask or points: set its part to -1, or clear the others.")
        labels = parts_of(values, picture)
        if number > labels.max():
            raise BadInput(
                f"Region {region} is to have part {number}, but the picture is cut into {labels.max() + 1}, counted "
                "from 0: choose another, or raise Picture Parts."
            )
        return labels == number, None
    return selected(source, picture, positive, negative, Path(file) if file else None)


def parts_of(values: Values, picture: Colours) -> NDArray[np.int64]:
    """A picture cut into as many parts as the panel says; numbers by size, the largest 0. (h, w)

    Raises:
        BadInput: no number of parts, or one out of range.
    """
    from svv.styles.segmenters import style_regions

    if not values["PictureParts"]:
        raise BadInput("Say under Picture Parts into how many the pictures are to be cut, 2 to 32.")
    return style_regions(picture, values["PictureParts"])


def points_in(text: str, name: str) -> list[tuple[float, float]]:
    """'310,120; 40,300' as points; raises BadInput for anything else."""
    points = []
    for place in filter(None, (p.strip() for p in text.split(";"))):
        try:
            x, y = (float(word) for word in place.split(","))
        except ValueError:
            raise BadInput(
                f"{name} must be places such as 310,120; 40,300 in pixels of the picture, not '{text}'."
            ) from None
        points.append((x, y))
    return points


def preview(values: Values, progress: Progress) -> tuple[Colours, NDArray[np.uint8], NDArray[Any], tuple[int, int]]:
    """The picture of the region whose mask is shown, how it is shown, and what of it is taken.

    Args:
        values: The panel's.
        progress: Called while a picture of the gallery is painted.

    Returns:
        Picture (h, w, 3) in [0, 1]; overlay (h, w, 3) levels, with rulers in pixels of the file; taken (h, w), the
        numbers of parts where the picture is cut and no part is chosen, else 1 and 0; width and height of the file.

    Raises:
        BadInput: there is no picture to show, or any reason of :func:`mask_for`.
    """
    from svv.io.mask_pictures import mask_overlay, regions_overlay, with_rulers
    from svv.io.output import to_bytes
    from svv.styles.selecting import source_size
    from svv.train.ink import PAPER, Ink, picture_of, style_named

    region = values["ShownMask"]
    there = [source_of(values, region), *sources_of(values), *(source_of(values, k) for k in range(REGIONS))]
    source = next(filter(None, there), None)
    if source is None:
        raise BadInput(NO_PICTURE)
    _, style = style_named(source, progress)
    if isinstance(style, Ink) and not asks_for_part(values, region):  # an empty sheet is what it begins with
        blank = np.full((64, 64, 3), PAPER, np.float32)
        return blank, to_bytes(blank), np.ones(blank.shape[:2], np.uint8), (64, 64)
    picture = picture_of(style).astype(np.float32, copy=False)
    mask, selection = mask_for(values, region, source, picture)
    if mask is None and values["PictureParts"]:
        taken: NDArray[Any] = parts_of(values, picture)
        overlay = regions_overlay(picture, taken)
    else:
        taken = np.ones(picture.shape[:2], bool) if mask is None else mask
        overlay = mask_overlay(picture, taken, selection)
    size = source_size(source, picture.shape)
    return picture, with_rulers(overlay, size), taken.astype(np.uint8), size


def write_masks(scene: Scene, values: Values, folder: Path, progress: Progress) -> int:
    """Write the masks of all regions that have one, as ``svv style-mask`` does: region-K.png; returns how many."""
    from svv.io.atomic import make_folder
    from svv.io.mask_file import overlay_file, write_mask, write_selection
    from svv.io.mask_pictures import mask_overlay
    from svv.io.output import write_png
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
