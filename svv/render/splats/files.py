"""Files of splats for other programs: written by their suffix, and read back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from svv.errors import BadInput, Progress, silent
from svv.fields.splats.splats import Splats
from svv.render.splats.glb import read_glb, write_glb
from svv.render.splats.placing import check_splats, in_world, place_of, placed
from svv.render.splats.ply import read_ply, write_ply
from svv.render.splats.spz import SIDES, read_spz, write_spz
from svv.render.splats.usdz import usd, write_usdz

SUFFIXES = (".ply", ".spz", ".glb", ".usdz")
"""Of files that are written."""


def write_splats(path: str | Path, splats: Splats, progress: Progress = silent) -> list[str]:
    """Write splats as .ply, .spz, .glb or .usdz; return sentences on what the file has otherwise than the splats.

    Axes are the world's. A .ply holds all; a .spz is a tenth as large, with 8 bits for most values and no regions; a
    .glb is glTF with KHR_gaussian_splatting; a .usdz is OpenUSD, and needs the package usd-core. Raises BadInput for
    another suffix, arrays that do not belong together, or a file that cannot be written.

    >>> splats = svv.Splats(
    ...     centres=np.zeros((1, 3), "f4"), scales=np.ones((1, 3), "f4"), rotations=np.eye(4, dtype="f4")[:1],
    ...     opacities=np.ones(1, "f4"), harmonics=np.zeros((1, 1, 3), "f4"), regions=np.zeros(1, "i2"),
    ...     names=("bone",), background=(1.0, 1.0, 1.0))
    >>> svv.write_splats("grey.ply", splats)
    []
    >>> svv.read_splats("grey.ply").names
    ('bone',)
    """
    path = Path(path)
    suffix = check_name(path)
    check_splats(splats)
    place = place_of(splats, SIDES) if suffix == ".spz" else place_of(splats)
    here = placed(splats, place)
    if suffix in (".glb", ".usdz"):
        write = write_glb if suffix == ".glb" else write_usdz
        write(path, here, place, progress)
        place = replace(place, origin=(0.0, 0.0, 0.0))  # in the file, too
    elif suffix == ".ply":
        write_ply(path, here, place, progress)
    lost = write_spz(path, here, progress) if suffix == ".spz" else []
    return [place.describe(), *lost] if place.describe() else lost


def check_name(path: Path) -> str:
    """Return the suffix of a file of splats that can be written here, in small letters; raises BadInput otherwise."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise BadInput(
            f"Cannot tell what to write to {path}: splats are written as NAME.ply, NAME.spz, NAME.glb or NAME.usdz."
        )
    if suffix == ".usdz":
        usd()
    return suffix


def read_splats(path: str | Path) -> Splats:
    """Read splats from a .ply, ours or another program's, from our .glb, or from a .spz of version 2 or 3.

    Positions are the world's, except those of a .spz that was written from another place; a .spz has one region.
    Raises BadInput for another suffix, or a file that is missing, truncated or does not hold splats.

    >>> try:
    ...     svv.read_splats("ball.usdz")
    ... except svv.BadInput as error:
    ...     print(error)
    Cannot read ball.usdz: splats are read from .ply, .glb and .spz files.
    """
    path = Path(path)
    readers = {
        ".ply": lambda: in_world(*read_ply(path)), ".glb": lambda: in_world(*read_glb(path)),
        ".spz": lambda: read_spz(path),
    }  # fmt: skip
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise BadInput(f"Cannot read {path}: splats are read from .ply, .glb and .spz files.")
    try:
        splats = reader()
    except OSError as error:
        raise BadInput(f"Cannot read {path}: {error.strerror or error}.") from error
    try:
        check_splats(splats)
    except BadInput as error:
        raise BadInput(f"{path} holds no splats that can be drawn: {error}") from error
    return splats
