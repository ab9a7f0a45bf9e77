"""AFNI's datasets (``.HEAD`` with ``.BRIK`` or ``.BRIK.gz``), whose headers nibabel reads.

Coordinates are those of nibabel, in mm: x to the right, y to the front and z upwards; AFNI's own point to the left and
to the back.

Source: https://afni.nimh.nih.gov/pub/dist/doc/program_help/README.attributes.html.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from svv.bricks.formats.chunked import package
from svv.bricks.formats.stored import Stored, bad_header
from svv.errors import BadInput


def afni_header(file: Path) -> Stored:
    """Read the header of a dataset of AFNI, of which either file may be named.

    Raises:
        BadInput: It is damaged or lacks one of its files, its values are no real numbers, or nibabel is not installed.
    """
    brikhead = package("nibabel.brikhead", file)
    stem = file.name.removesuffix(".gz").removesuffix(".BRIK").removesuffix(".HEAD")
    head = file.with_name(f"{stem}.HEAD")
    if not head.is_file():
        raise BadInput(f"{file} needs its header {head.name} beside it.")
    values = next((one for end in ("BRIK", "BRIK.gz") if (one := file.with_name(f"{stem}.{end}")).is_file()), None)
    if values is None:
        raise BadInput(f"{file} needs its values, {stem}.BRIK or {stem}.BRIK.gz, beside it.")
    try:
        with head.open() as opened:
            header = brikhead.AFNIHeader.from_fileobj(opened)
        place, shape = np.asarray(header.get_affine(), np.float64), header.get_data_shape()
        kind, gains = header.get_data_dtype(), header.get_data_scaling()
        labels = header.get_volume_labels() or []
        if min(shape) < 1 or not np.isfinite(place).all():
            raise ValueError("its sizes or directions are no numbers")
    except Exception as error:  # a damaged header makes nibabel raise all kinds of errors
        raise bad_header(head, ValueError(" ".join(str(error).split()).strip(". "))) from error
    if kind.kind not in "iuf":
        raise BadInput(f"{file.name} contains values of the type {kind}; a volume needs one real number per voxel.")
    is_series = len(shape) > 3 and "TAXIS_NUMS" in header.info
    return Stored(
        file, (values,), kind, tuple(shape[::-1]), ("t" if is_series else "c")[: len(shape) - 3] + "zyx",
        place[:3, :3], place[:3, 3], stem, "zlib" if values.suffix == ".gz" else "raw",
        gains=() if gains is None else tuple(np.ravel(gains).tolist()), channels=() if is_series else tuple(labels),
    )  # fmt: skip
