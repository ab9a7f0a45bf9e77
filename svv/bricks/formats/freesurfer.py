"""FreeSurfer's volumes (``.mgh``, ``.mgz``), whose headers nibabel reads; the values are mapped into memory.

Coordinates are the file's scanner coordinates in mm: x to the right, y to the front and z upwards.

Source: https://surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat.
"""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np

from svv.bricks.formats.chunked import package
from svv.bricks.formats.stored import Stored, bad_header
from svv.errors import BadInput


def mgh_header(file: Path) -> Stored:
    """Read the header of a volume of FreeSurfer, compressed or not.

    Raises BadInput if it is damaged, or nibabel is not installed.
    """
    nibabel = package("nibabel", file)
    with file.open("rb") as opened:
        packed = opened.read(2) == b"\x1f\x8b"
    try:
        with gzip.open(file) if packed else file.open("rb") as opened:  # nibabel itself leaves them open
            image = nibabel.MGHImage.from_file_map({"image": nibabel.FileHolder(fileobj=opened)})
        place, shape, kind = np.asarray(image.affine, np.float64), image.shape, image.header.get_data_dtype()
        start = int(image.dataobj.offset)
        if not np.isfinite(place).all():
            raise ValueError("its directions are no numbers")
    except Exception as error:  # a damaged file makes nibabel raise all kinds of errors
        raise bad_header(file, ValueError(" ".join(str(error).split()).strip(". "))) from error
    if kind.kind not in "iuf":
        raise BadInput(f"{file.name} contains values of the type {kind}; a volume needs one real number per voxel.")
    return Stored(
        file, (file,), kind.newbyteorder(">"), tuple(shape[::-1]), "tzyx"[-len(shape) :], place[:3, :3], place[:3, 3],
        file.name.partition(".")[0], "zlib" if packed else "raw", offset=start,
        is_sized=bool(image.header["goodRASFlag"]),
    )  # fmt: skip
