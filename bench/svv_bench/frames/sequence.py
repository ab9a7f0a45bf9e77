"""A folder of frames: the pictures in it, in order and checked, and which of their pixels show something."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.errors import BadInput, Progress, silent
from svv.io.views.view_images import CORNER_SPREAD, decode
from svv.render.pictures import Picture
from svv_bench.styles.path import LEAST_ALPHA

PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp")
"""Suffixes of frames."""
MOVIES = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".gif")
"""Suffixes of movies, which have to be taken apart first."""
SMALLEST = 16
"""Minimum side of a frame in pixels."""
PLAIN = 2
"""Levels by which a pixel may differ from the background's colour."""
WHITE = (255, 255, 255)
NAMED = 3
"""Number of files that a sentence names."""

MIXED = "{file} has {found} pixels and {first} {wanted}: give frames of one size."


@dataclass(frozen=True, eq=False)
class FrameFolder:
    """The frames in a folder, in order of time."""

    folder: Path
    files: tuple[Path, ...]
    numbers: tuple[int, ...]
    """Number of each frame, from its name; 0, 1, 2 ... if the names do not differ in one number alone."""
    step: int
    """Smallest difference of successive numbers, which is what "1 frame apart" means."""
    size: tuple[int, int]
    """Width and height in pixels."""
    background: tuple[int, int, int] | None
    """Colour of the background, which all corners of all frames show; None if frames have alpha or no such colour."""
    tolerance: int
    """Levels by which a pixel of the background may differ from it."""
    behind: tuple[int, int, int]
    """Colour over which whole frames are seen: the background's, or white."""
    notes: tuple[str, ...]
    """What was assumed or left out, in sentences."""

    def rgba(self, number: int) -> Picture:
        """Return a frame as levels with straight alpha (h, w, 4), which is 0 where it shows the background."""
        image = decode(self.files[self.numbers.index(number)])
        if image.shape[-1] == 4 and self.background is None:
            return image
        image = image[..., :3]
        if self.background is None:
            return np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])
        apart = np.abs(image.astype(np.int16) - np.array(self.background, np.int16)).max(axis=-1)
        return np.dstack([image, np.where(apart <= self.tolerance, 0, 255).astype(np.uint8)])

    def straight(self, number: int) -> NDArray[np.uint8]:
        """Return a frame's colour levels without its alpha. (h, w, 3)"""
        return self.rgba(number)[..., :3]

    def visible(self, number: int) -> NDArray[np.bool_]:
        """Return which pixels show something. (h, w)"""
        return np.asarray(self.rgba(number)[..., 3] >= LEAST_ALPHA * 255)

    def whole(self, number: int) -> NDArray[np.float64]:
        """Return a frame over its own background, or over white if it has none. (h, w, 3)"""
        levels = self.rgba(number).astype(np.float64) / 255.0
        return np.asarray(levels[..., :3] * levels[..., 3:] + np.array(self.behind) / 255.0 * (1.0 - levels[..., 3:]))

    def painted(self, folder: Path, numbers: Sequence[int]) -> FrameFolder:
        """Return stylized frames ``0000.png`` and so on with the alpha of these, seen over the same background."""
        files = tuple(folder / f"{number:04d}.png" for number in numbers)
        return replace(self, folder=folder, files=files, numbers=tuple(numbers), background=None, notes=())

    def pairs(self, intervals: Sequence[int], every: int = 1) -> list[tuple[int, int, int]]:
        """Return interval, first and second number of all pairs of which both frames are there."""
        there = set(self.numbers)
        return [
            (n, a, a + n * self.step) for n in intervals for a in self.numbers[::every] if a + n * self.step in there
        ]


def read_folder(folder: Path, progress: Progress = silent) -> FrameFolder:
    """Read the frames in a folder; every picture is decoded once, so nothing is damaged that is measured later.

    Frames are ordered by the number in their names (``frame2.png`` before ``frame10.png``). Files that are not pictures
    are left out, as a sentence in ``notes`` says.

    Args:
        folder: A folder with PNG, JPEG, WebP, TIFF or BMP files.
        progress: Called after each picture.

    Raises:
        BadInput: The folder is missing or has fewer than two frames, a picture is damaged, sizes differ, two frames
            have the same number, or only some have alpha.
    """
    pictures, others = _listed(folder)
    if len(pictures) < 2:
        raise BadInput(f"{folder} holds one frame, {pictures[0].name}: consistency is measured between at least two.")
    numbers, named = _numbered(pictures)
    order = np.argsort(numbers, kind="stable")
    files, numbers = [pictures[k] for k in order], [numbers[k] for k in order]
    size, corners, transparent = _looked_through(files, progress)
    background, tolerance, notes = None, PLAIN, [*_left_out(others)]
    if not named:
        notes.append(
            "The names do not differ in one number alone, so the frames were taken in the order of their names."
        )
    if not transparent:
        background, tolerance = _background(corners)
        if background is not None:
            colour = ", ".join(map(str, background))
            notes.append(f"The frames have no alpha: pixels of the background's colour ({colour}) were not compared.")
        else:
            notes.append("The frames have neither alpha nor a plain background, so all pixels were compared.")
    step, gaps = _steps(files, numbers)
    notes += gaps
    behind = background or WHITE
    return FrameFolder(folder, tuple(files), tuple(numbers), step, size, background, tolerance, behind, tuple(notes))


def _listed(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return the pictures in a folder, and its other files; hidden files are neither."""
    if not folder.is_dir():
        raise BadInput(f"There is no folder {folder}: give a folder of frames.")
    try:
        there = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError as error:
        raise BadInput(f"Cannot read {folder}: {error.strerror or error}.") from error
    files = [path for path in there if path.is_file()]
    pictures = [path for path in files if path.suffix.lower() in PICTURES]
    others = [path for path in files if path.suffix.lower() not in PICTURES]
    if pictures:
        return pictures, others
    movies = [path for path in others if path.suffix.lower() in MOVIES]
    if movies:
        raise BadInput(
            f"{folder} holds a movie instead of frames: take it apart first, for instance with "
            f"ffmpeg -i {movies[0].name} frame%04d.png."
        )
    full = [path.name for path in there if path.is_dir() and any(p.suffix.lower() in PICTURES for p in path.iterdir())]
    if full:
        raise BadInput(f"{folder} itself holds no pictures: give one of its folders, {_some(full)}.")
    raise BadInput(f"{folder} holds no pictures ({', '.join(PICTURES)}): give a folder of frames.")


def _numbered(files: Sequence[Path]) -> tuple[list[int], bool]:
    """Return the number of each file, and whether it comes from the names.

    It does if all names are the same but for one number.

    Raises:
        BadInput: Two files have the same number.
    """
    parts = [re.split(r"(\d+)", path.stem) for path in files]
    words = {tuple(part[::2]) for part in parts}
    digits = np.array([part[1::2] for part in parts], dtype=object) if len(words) == 1 else np.empty((len(files), 0))
    values = [[int(text) for text in column] for column in digits.T]
    differing = [column for column in values if len(set(column)) > 1]
    if len(differing) == 1:
        found = differing[0]
    elif values and not differing:  # 7.png and 07.jpg
        found = values[-1]
    else:
        natural = [[int(w) if k % 2 else w.lower() for k, w in enumerate(part)] for part in parts]
        order = sorted(range(len(files)), key=lambda k: (natural[k], files[k].name))
        return [order.index(k) for k in range(len(files))], False
    number, times = Counter(found).most_common(1)[0]
    if times > 1:
        same = [path.name for path, n in zip(files, found) if n == number]
        raise BadInput(f"{' and '.join(same[:2])} have the same number: keep one file per frame.")
    return found, True


def _looked_through(files: Sequence[Path], progress: Progress) -> tuple[tuple[int, int], NDArray[np.int16], bool]:
    """Decode every file; return width and height, the colours of corners (N, 3), and whether there is transparency."""
    sizes = {}
    for file in files:
        sizes[file] = _size(file)
    wanted = Counter(sizes.values()).most_common(1)[0][0]
    usual = next(file for file in files if sizes[file] == wanted)
    for file, found in sizes.items():
        if found != wanted:
            texts = {"found": "{} x {}".format(*found), "wanted": "{} x {}".format(*wanted)}
            raise BadInput(MIXED.format(file=file, first=usual.name, **texts))
    if min(wanted) < SMALLEST:
        raise BadInput(f"{files[0]} has {wanted[0]} x {wanted[1]} pixels: at least {SMALLEST} x {SMALLEST} are needed.")
    corners, lowest = [], 255
    channels: dict[int, Path] = {}
    for index, file in enumerate(files):
        progress(index / len(files), f"reading {file.name}")
        image = decode(file)
        channels.setdefault(image.shape[-1], file)
        lowest = min(lowest, int(image[..., 3].min()) if image.shape[-1] == 4 else 255)
        edge = max(1, min(wanted) // 50)
        ends = slice(None, edge), slice(-edge, None)
        corners += [image[rows, columns, :3].reshape(-1, 3) for rows in ends for columns in ends]
    if len(channels) > 1 and lowest < 255:
        raise BadInput(f"{channels[4]} has alpha and {channels[3]} does not: save all frames alike.")
    return wanted, np.concatenate(corners).astype(np.int16), lowest < 255


def _size(file: Path) -> tuple[int, int]:
    """Return the width and height that a file states."""
    try:
        with Image.open(file) as image:
            if (count := getattr(image, "n_frames", 1)) > 1:
                raise BadInput(f"{file} holds {count} pictures: save each as a file of its own.")
            if image.mode.startswith(("I", "F")):
                raise BadInput(f"{file} has grey levels of more than 8 bits: save the frames with 8 bits.")
            return image.size
    except BadInput:
        raise
    except Exception as error:  # damaged files make Pillow raise all kinds of errors
        raise BadInput(f"Cannot read the frame {file} ({error}): it is damaged or not a picture; remove it.") from error


def _background(corners: NDArray[np.int16]) -> tuple[tuple[int, int, int] | None, int]:
    """Return the colour that all corners of all frames show, if there is one, and its tolerance in levels."""
    colour = np.median(corners, axis=0).astype(np.int16)
    spread = int(np.abs(corners - colour).max())
    if spread > CORNER_SPREAD:
        return None, PLAIN
    red, green, blue = (int(c) for c in colour)
    return (red, green, blue), max(PLAIN, spread)


def _steps(files: Sequence[Path], numbers: Sequence[int]) -> tuple[int, list[str]]:
    """Return the smallest difference of successive numbers, and a sentence about larger ones, if there are any."""
    steps = [b - a for a, b in pairwise(numbers)]
    gaps = [(a, b) for (a, b), apart in zip(pairwise(files), steps) if apart > min(steps)]
    if not gaps:
        return min(steps), []
    (before, after), *more = gaps
    return min(steps), [
        f"The numbers of the frames have {len(gaps)} {'gaps, the first' if more else 'gap,'} between {before.name} and "
        f"{after.name}; 1 frame apart means {min(steps)} in number."
    ]


def _left_out(others: Sequence[Path]) -> list[str]:
    """Return a sentence about files that are not pictures, if there are any."""
    if not others:
        return []
    one = len(others) == 1
    return [f"{len(others)} other {'file was' if one else 'files were'} left out: {_some([p.name for p in others])}."]


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:NAMED]) + (", ..." if len(names) > NAMED else "")
