"""Files of splats for other programs: written by their suffix, and read back."""

from __future__ import annotations

from pathlib import Path

from svv.errors import BadInput, Progress, silent
from svv.fields.splats.splats import Splats
from svv.render.splats.glb import write_glb
from svv.render.splats.placing import check_splats, in_world, place_of, placed
from svv.render.splats.ply import read_ply, write_ply
from svv.render.splats.spz import SIDES, read_spz, write_spz


def write_splats(path: str | Path, splats: Splats, progress: Progress = silent) -> list[str]:
    """Write splats as NAME.ply, NAME.spz or NAME.glb; return sentences on what the file has otherwise than the splats.

    Axes are the world's. A .ply holds all, a .spz a tenth of the bytes, with 8 bits a value, and no regions; a .glb is
    glTF with KHR_gaussian_splatting, a mesh for each region. Raises BadInput for another suffix, arrays that do not
    belong together, or a file that cannot be written.

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
    suffix = path.suffix.lower()
    if suffix not in (".ply", ".spz", ".glb"):
        raise BadInput(f"Cannot tell what to write to {path}: splats are written as NAME.ply, NAME.spz or NAME.glb.")
    check_splats(splats)
    place = place_of(splats, SIDES) if suffix == ".spz" else place_of(splats)
    here = placed(splats, place)
    if suffix == ".glb":  # whose nodes put everything into its place
        write_glb(path, here, place, progress)
        return []
    notes = [place.describe()] if place.describe() else []
    if suffix == ".ply":
        write_ply(path, here, place, progress)
        return notes
    return notes + write_spz(path, here, progress)


def read_splats(path: str | Path) -> Splats:
    """Read splats from a .ply, ours or another program's, or from a .spz of version 2 or 3.

    Positions are the world's, except those of a .spz that was written from another place; a .spz has one region.
    Raises BadInput for another suffix, or a file that is missing, truncated or does not hold splats.
    """
    path = Path(path)
    try:
        if path.suffix.lower() == ".ply":
            return in_world(*read_ply(path))
        if path.suffix.lower() == ".spz":
            return read_spz(path)
    except OSError as error:
        raise BadInput(f"Cannot read {path}: {error.strerror or error}.") from error
    raise BadInput(f"Cannot read {path}: splats are read from .ply and .spz files.")
