"""Usual mistakes in the cameras of a set of pictures, each undone: which cameras would be meant.

Programs store camera-to-world or world-to-camera matrices, of cameras that look along -z with y up (OpenGL, Blender) or
along z with y down (OpenCV, COLMAP), in worlds of either hand, and in the order of frames or of file names.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

WORDS = (("right", "left"), ("up", "down"), ("back", "forward"))
"""Directions of a camera's axes in a camera-to-world matrix, and their opposites."""

COLUMNS = ("first", "second", "third")

OPENCV = np.diag((1.0, -1.0, -1.0))
FLIPS = tuple(np.diag(signs) for signs in ((-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0)))


@dataclass(frozen=True)
class Mistake:
    """What may be wrong with cameras."""

    said: str
    """What the cameras are, to follow "they agree if"."""
    mend: str
    """What to do, as a sentence's end."""
    matrices: Array
    """The cameras that are meant. They may be mirrored. (n, 4, 4)"""


def mistakes(matrices: Array, names: Sequence[str]) -> Iterator[Mistake]:
    """Yield the usual mistakes, likely ones first, of camera-to-world matrices (n, 4, 4) as a file gives them.

    ``names``: those of the pictures, in the same order.
    """
    axes = list(_axes())
    for base_said, base_mend, base in _bases(matrices):
        for turn in axes:
            if not base_said and np.array_equal(turn, np.eye(3)):
                continue
            said, mend = _of_axes(turn, not base_said)
            yield Mistake(" and ".join(filter(None, (base_said, said))), " and ".join(filter(None, (base_mend, mend))),
                          _turned(base, turn))  # fmt: skip
    yield from _orders(matrices, names)
    for world in axes:
        turns = (np.eye(3), OPENCV) if np.linalg.det(world) > 0 else (np.eye(3), *FLIPS)
        for turn in turns if not np.array_equal(world, np.eye(3)) else ():
            mixed = matrices.copy()
            mixed[:, :3, :3] = world @ matrices[:, :3, :3] @ turn
            yield Mistake(
                "the rotations are those of a world with other axes than that of the positions"
                + (", with the camera axes of OpenCV" if turn is OPENCV else ""),
                "convert both to the same world",
                mixed,
            )


def turned_by(matrices: Array, angles: Array) -> Array:
    """Return cameras that are turned about their own axes by a rotation vector in radians. (3,)"""
    return _turned(matrices, Rotation.from_rotvec(angles).as_matrix())


def _turned(matrices: Array, turn: Array) -> Array:
    turned = matrices.copy()
    turned[:, :3, :3] = matrices[:, :3, :3] @ turn
    return turned


def _axes() -> Iterator[Array]:
    """Yield all ways to name three axes: OpenCV's and turned pictures first, mirrored ones last. (3, 3)"""
    every = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[list(order), range(3)] = signs
            every.append(matrix)

    def rank(matrix: Array) -> tuple[bool, bool, bool]:
        likely = np.array_equal(matrix, np.eye(3)) or np.array_equal(matrix, OPENCV)
        return not likely, bool(np.linalg.det(matrix) < 0), matrix[2, 2] != 1.0

    return iter(sorted(every, key=rank))


def _bases(matrices: Array) -> Iterator[tuple[str, str, Array]]:
    rotation, position = matrices[:, :3, :3], matrices[:, :3, 3:]
    back = rotation.transpose(0, 2, 1)

    def joined(turn: Array, place: Array) -> Array:
        found = matrices.copy()
        found[:, :3, :3], found[:, :3, 3:] = turn, place
        return found

    yield "", "", matrices
    yield "the matrices are world-to-camera", "invert each transform_matrix", joined(back, -back @ position)
    yield (
        "the rotations are transposed",
        "transpose the 3x3 part of each transform_matrix",
        joined(back, position),
    )
    yield (
        "the last columns are those of world-to-camera matrices",
        "replace t by -R t in each transform_matrix",
        joined(rotation, -rotation @ position),
    )
    yield (
        "the last columns are those of world-to-camera matrices, with an inverse rotation",
        "replace t by -R^T t in each transform_matrix",
        joined(rotation, -back @ position),
    )
    own = rotation * np.where(np.linalg.det(rotation) < 0, -1.0, 1.0)[:, None, None]
    four = Rotation.from_matrix(own).as_quat()  # x, y, z, w
    for roll, one, other in ((1, "x, y, z, w", "w, x, y, z"), (-1, "w, x, y, z", "x, y, z, w")):
        yield (
            f"the rotations come from quaternions {one} that were taken for {other}",
            f"read them as {one}",
            joined(Rotation.from_quat(np.roll(four, roll, axis=1)).as_matrix(), position),
        )


def _of_axes(turn: Array, alone: bool) -> tuple[str, str]:
    """Return what is said of cameras whose matrices are the true ones times ``turn.T``."""
    if np.array_equal(turn, np.eye(3)):
        return "", ""
    if np.array_equal(turn, OPENCV):
        return (
            "the camera axes are those of OpenCV and COLMAP (y down, looking along z)",
            "multiply their second and third columns by -1",
        )
    if turn[2, 2] == 1.0 and alone:
        return _of_picture(turn)
    hand = ""
    if np.linalg.det(turn) < 0:
        hand = ", in a world of the other hand or with mirrored pictures"
    held = [WORDS[int(np.abs(row).argmax())][int(row.sum() < 0)] for row in turn]
    wanted = []
    for axis in range(3):
        at = int(np.abs(turn[:, axis]).argmax())
        wanted.append(("the " if turn[at, axis] > 0 else "minus the ") + COLUMNS[at])
    return (
        f"the columns of the matrices are {held[0]}, {held[1]} and {held[2]} of the camera instead of right, up and "
        f"back{hand}",
        f"make {wanted[0]}, {wanted[1]} and {wanted[2]} column the first three of each matrix"
        + (", and mirror the pictures" if hand else ""),
    )


def _of_picture(turn: Array) -> tuple[str, str]:
    """The same for those that look along the same axis: the pictures are turned or mirrored."""
    if np.linalg.det(turn) > 0:
        degrees = int(round(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])))) % 360
        way = {90: "by 90 degrees", 180: "upside down", 270: "by 90 degrees"}[degrees]
        to = {90: "counter-clockwise", 180: "by 180 degrees", 270: "clockwise"}[degrees]
        return (
            f"the pictures are turned {way} against their cameras, as cameras and telephones store them with an EXIF "
            "orientation",
            f"turn the pictures {to}, or the cameras the other way",
        )
    if turn[0, 0] != 0.0:
        which = "left to right" if turn[0, 0] < 0 else "upside down"
        return f"the pictures are mirrored {which}, or the world of the cameras is", f"mirror the pictures {which}"
    return "the pictures are transposed (rows for columns)", "transpose the pictures"


def _orders(matrices: Array, names: Sequence[str]) -> Iterator[Mistake]:
    count = len(matrices)
    by_text = sorted(range(count), key=lambda k: names[k])
    by_number = sorted(range(count), key=lambda k: _natural(names[k]))
    if by_text != by_number:
        for one, other in ((by_text, by_number), (by_number, by_text)):
            moved = np.empty_like(matrices)
            moved[one] = matrices[other]
            yield Mistake(
                f"the pictures are in the order of their names as text ({names[by_text[1]]} before "
                f"{names[by_text[2]]}) and the cameras in that of their numbers",
                "give each frame its own picture",
                moved,
            )
    yield Mistake("the frames are in the reverse order", "reverse the pictures or the cameras", matrices[::-1])
    for shift in sorted(range(1, count), key=lambda k: min(k, count - k)):
        by = shift if shift <= count // 2 else shift - count
        frames = f"{abs(by)} frame" + "s" * (abs(by) != 1)
        which = "later" if by > 0 else "earlier"
        yield Mistake(
            f"each picture belongs to the camera {frames} {which}",
            f"shift the cameras by {frames}",
            np.roll(matrices, -shift, axis=0),
        )


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]
