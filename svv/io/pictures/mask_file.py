"""Masks of style pictures on disk: a black and white PNG, and a small JSON file with its points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from svv.core.json_values import parsed
from svv.errors import BadInput
from svv.io.files.atomic import atomic_path, write_json
from svv.io.files.declared_sizes import check_pixels

Mask = NDArray[np.bool_]
Point = tuple[float, float]

ASPECT = 0.03
"""Largest difference between the logarithms of the aspect ratios of a mask and its picture."""

CLOSEST = 2.0
"""Distance in pixels of the picture below which a positive and a negative point contradict each other."""


@dataclass(frozen=True)
class Selection:
    """The points from which a mask was made, stored next to it so that it can be refined."""

    size: tuple[int, int]
    """Width and height in pixels of the picture in which the points were set."""
    positive: tuple[Point, ...] = ()
    """Points inside the part, (x, y) in pixels of the picture: x from the left, y from the top."""
    negative: tuple[Point, ...] = ()
    """Points outside the part, likewise."""
    segmenter: str = "scikit-image"
    """Name of the segmenter that made the mask from the points."""
    grown: bool = False
    """Whether the mask was refined from another one (a region, a drawing), so the points alone do not determine it."""

    def with_points(self, positive: Sequence[Point], negative: Sequence[Point]) -> Selection:
        """Return this selection with more points, each once.

        Raises BadInput if one is outside, or positive and negative.
        """
        width, height = self.size
        for x, y in [*positive, *negative]:
            if not (0 <= x < width and 0 <= y < height):
                raise BadInput(
                    f"The point {x:g},{y:g} is outside the picture: x goes from 0 to {width - 1}, y from 0 to "
                    f"{height - 1}."
                )
        wanted = tuple(dict.fromkeys([*self.positive, *positive]))
        unwanted = tuple(dict.fromkeys([*self.negative, *negative]))
        for a in wanted:
            for b in unwanted:
                if np.hypot(a[0] - b[0], a[1] - b[1]) < CLOSEST:
                    raise BadInput(
                        f"The point {a[0]:g},{a[1]:g} is both positive and negative: leave one of them out, or start a "
                        "new mask."
                    )
        return replace(self, positive=wanted, negative=unwanted)

    def scaled(self, shape: Sequence[int]) -> tuple[list[Point], list[Point]]:
        """Return the positive and negative points in pixels of a picture of shape (height, width, ...)."""
        x, y = shape[1] / self.size[0], shape[0] / self.size[1]
        return [(a * x, b * y) for a, b in self.positive], [(a * x, b * y) for a, b in self.negative]


def points_file(mask: Path) -> Path:
    """Return the path of the file with the points of a mask."""
    return mask.with_suffix(".json")


def overlay_file(mask: Path) -> Path:
    """Return the path of the picture that shows a mask."""
    return mask.with_name(f"{mask.stem}-overlay.png")


def write_selection(mask: Path, selection: Selection) -> None:
    """Write the points of a mask next to it; raises BadInput if that fails."""
    write_json(points_file(mask), {"svv": "selection", **vars(selection)})


def read_selection(mask: Path) -> Selection | None:
    """Return the points stored next to a mask, if any; raises BadInput if the file contains something else."""
    path = points_file(mask)
    if not path.is_file():
        return None
    try:
        values = parsed(path.read_bytes())
        if values.pop("svv") != "selection":
            raise ValueError
        width, height = (int(v) for v in values.pop("size"))
        if min(width, height) < 1:
            raise ValueError
        pairs = {name: tuple((float(x), float(y)) for x, y in values.pop(name)) for name in ("positive", "negative")}
        return Selection((width, height), **pairs, segmenter=str(values["segmenter"]), grown=bool(values["grown"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise BadInput(f"{path} does not contain the points of a mask: delete it, or give another mask.") from error


def write_mask(path: str | Path, mask: Mask) -> None:
    """Write a mask (h, w) as PNG, white inside and black outside."""
    with atomic_path(path) as temporary:
        Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(temporary, format="PNG", optimize=True)


def read_mask(path: str | Path, shape: Sequence[int] | None = None) -> Mask:
    """Read a mask from any picture: true inside, where it is light and opaque, for at least one pixel. (h, w)

    It has the proportions of the style picture, to whose ``shape`` (height, width, ...) it is scaled; None keeps its
    size. Raises BadInput if the file is missing, is not a picture, has other proportions, or the mask is empty.
    """
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"There is no mask at {path}; make one with svv style-mask.")
    try:
        with Image.open(path) as image:
            size = image.size
            check_pixels(path, *size)
            ratio = None if shape is None else size[0] / size[1] / (shape[1] / shape[0])
            if ratio is not None and shape is not None and abs(np.log(ratio)) > ASPECT:
                raise BadInput(
                    f"The mask {path} has {size[0]} x {size[1]} pixels and the picture {shape[1]} x {shape[0]}: it "
                    "belongs to another picture."
                )
            flat = Image.alpha_composite(Image.new("RGBA", size, "black"), image.convert("RGBA")).convert("L")
    except BadInput:
        raise
    except UnidentifiedImageError as error:
        raise BadInput(f"{path} is not a picture that can be read: save the mask as PNG.") from error
    except Exception as error:  # damaged files make Pillow raise all kinds of errors
        raise BadInput(f"The mask {path} is damaged ({error}): make it again.") from error
    if not np.any(np.asarray(flat) > 127):
        raise BadInput(f"The mask {path} is empty: no pixel is white; make another one with svv style-mask.")
    if shape is not None and size != (shape[1], shape[0]):
        small = np.asarray(flat.resize((shape[1], shape[0]), Image.Resampling.BOX))
        # A thin line in a large mask would disappear, so its brightest remaining pixels are kept.
        return np.asarray(small >= min(128, int(small.max())))
    return np.asarray(np.asarray(flat) > 127)


def picture_size(path: str | Path) -> tuple[int, int]:
    """Return width and height in pixels of a picture as displayed, upright; raises BadInput if it cannot be read."""
    try:
        with Path(path).open("rb") as file, Image.open(file) as image:
            if image.format == "TIFF":  # new versions of Pillow turn it while loading, and some its size before
                image.load()
            turned = image.getexif().get(0x0112, 1) in (5, 6, 7, 8)
            return (image.height, image.width) if turned else image.size
    except Exception as error:  # damaged files make Pillow raise all kinds of errors
        raise BadInput(f"The picture {path} cannot be read ({error}): save it again as PNG.") from error
