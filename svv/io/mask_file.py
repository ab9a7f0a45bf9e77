"""Masks of style pictures on disk: a black and white PNG, and its points in a small JSON beside it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from svv.errors import BadInput
from svv.io.atomic import atomic_path, write_json

Mask = NDArray[np.bool_]
Point = tuple[float, float]

ASPECT = 0.03
"""Difference in the ratio of width to height above which a mask is of another picture."""

CLOSEST = 2.0
"""Pixels of the picture within which a positive and a negative point are the same place."""


@dataclass(frozen=True)
class Selection:
    """The points that a mask was made with: what is kept beside it, so that it can be refined."""

    size: tuple[int, int]
    """Width and height in pixels of the picture that the points were set in."""
    positive: tuple[Point, ...] = ()
    """(x, y) in pixels of the picture: x from the left, y from the top. What is wanted."""
    negative: tuple[Point, ...] = ()
    """What is not."""
    segmenter: str = "scikit-image"
    """What made the mask of them."""
    grown: bool = False
    """Whether the mask began as another one (a region, a drawing): then it says more than its points."""

    def with_points(self, positive: Sequence[Point], negative: Sequence[Point]) -> Selection:
        """This selection with more points; those that it has already are not doubled.

        Raises:
            BadInput: a point outside of the picture, or one that is wanted and not wanted.
        """
        width, height = self.size
        for x, y in [*positive, *negative]:
            if not (0 <= x < width and 0 <= y < height):
                raise BadInput(
                    f"The point {x:g},{y:g} lies outside of the picture: x goes from 0 to {width - 1}, y from 0 to "
                    f"{height - 1}."
                )
        wanted = tuple(dict.fromkeys([*self.positive, *positive]))
        unwanted = tuple(dict.fromkeys([*self.negative, *negative]))
        for a in wanted:
            for b in unwanted:
                if np.hypot(a[0] - b[0], a[1] - b[1]) < CLOSEST:
                    raise BadInput(
                        f"The place {a[0]:g},{a[1]:g} is asked for and ruled out at once: leave one of the two points "
                        "out, or begin anew."
                    )
        return replace(self, positive=wanted, negative=unwanted)

    def scaled(self, shape: Sequence[int]) -> tuple[list[Point], list[Point]]:
        """Positive and negative points in pixels of a picture of another size, (height, width, ...)."""
        x, y = shape[1] / self.size[0], shape[0] / self.size[1]
        return [(a * x, b * y) for a, b in self.positive], [(a * x, b * y) for a, b in self.negative]


def points_file(mask: Path) -> Path:
    """Where the points of a mask are kept."""
    return mask.with_suffix(".json")


def overlay_file(mask: Path) -> Path:
    """Where the picture that shows a mask is kept."""
    return mask.with_name(f"{mask.stem}-overlay.png")


def write_selection(mask: Path, selection: Selection) -> None:
    """Write the points of a mask beside it; raises BadInput where that fails."""
    write_json(points_file(mask), {"svv": "selection", **vars(selection)})


def read_selection(mask: Path) -> Selection | None:
    """The points kept beside a mask, None if there are none.

    Raises:
        BadInput: the file holds something else.
    """
    path = points_file(mask)
    if not path.is_file():
        return None
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        if values.pop("svv") != "selection":
            raise ValueError
        width, height = (int(v) for v in values.pop("size"))
        pairs = {name: tuple((float(x), float(y)) for x, y in values.pop(name)) for name in ("positive", "negative")}
        return Selection((width, height), **pairs, segmenter=str(values["segmenter"]), grown=bool(values["grown"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise BadInput(f"{path} does not hold the points of a mask: delete it, or name another mask.") from error


def write_mask(path: str | Path, mask: Mask) -> None:
    """Write a mask (h, w) as PNG: white is in it, black is not."""
    with atomic_path(path) as temporary:
        Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(temporary, format="PNG", optimize=True)


def read_mask(path: str | Path, shape: Sequence[int] | None = None) -> Mask:
    """Read a mask: any picture; what is light and not transparent is in it.

    Args:
        path: The file; of the style picture's proportions.
        shape: Height and width (and more) of the style picture; the mask is brought to its size. None leaves it.

    Returns:
        (h, w), true where the mask is; at least at one place.

    Raises:
        BadInput: the file is missing, no picture, of other proportions, or nothing is in it.
    """
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"There is no mask at {path}; make one with svv style-mask.")
    try:
        with Image.open(path) as image:
            size = image.size
            ratio = None if shape is None else size[0] / size[1] / (shape[1] / shape[0])
            if ratio is not None and shape is not None and abs(np.log(ratio)) > ASPECT:
                raise BadInput(
                    f"The mask {path} has {size[0]} x {size[1]} pixels and the picture {shape[1]} x {shape[0]}: it "
                    "belongs to another picture."
                )
            flat = Image.alpha_composite(Image.new("RGBA", size, "black"), image.convert("RGBA")).convert("L")
    except UnidentifiedImageError as error:
        raise BadInput(f"{path} is not a picture that can be read: save the mask as PNG.") from error
    except (OSError, SyntaxError, EOFError) as error:
        raise BadInput(f"The mask {path} is damaged ({error}): make it again.") from error
    if not np.any(np.asarray(flat) > 127):
        raise BadInput(f"The mask {path} is empty: nothing in it is white; make another one with svv style-mask.")
    if shape is not None and size != (shape[1], shape[0]):
        small = np.asarray(flat.resize((shape[1], shape[0]), Image.Resampling.BOX))
        # A thin line of a large mask would vanish; what is left of it is its brightest part.
        return np.asarray(small >= min(128, int(small.max())))
    return np.asarray(np.asarray(flat) > 127)


def picture_size(path: str | Path) -> tuple[int, int]:
    """Width and height in pixels of a picture as it is shown, a camera's rotation undone."""
    with Image.open(path) as image:
        turned = image.getexif().get(0x0112, 1) in (5, 6, 7, 8)
        return (image.height, image.width) if turned else image.size
