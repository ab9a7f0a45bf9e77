"""The command ``svv follow``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from svv.cli.files import load
from svv.cli.option_group import spread
from svv.cli.options import Out, SceneFile
from svv.errors import BadInput, part
from svv.options.making import VolumeOptions
from svv.progress import shown

FOLLOW = (
    "svv follow scene.svv blob_01.vti blob_02.vti --out steps",
    "svv follow scene.svv flow_*.vti --array pressure --out steps",
)
"""Examples in the help."""


@spread
def follow(
    scene: SceneFile,
    volumes: Annotated[list[Path], typer.Argument(metavar="VOLUME...", help="The volume at other time steps.")],
    out: Out,
    reading: VolumeOptions = VolumeOptions(),
) -> None:
    """Make the scenes of other time steps without views or training: FOLDER/VOLUME.svv for each volume.

    The scene must have been trained with --encoding values. The other scenes have its palette, edits and paint. By
    default, the transfer function is the scene's; --tf replaces it by an equal one for values of another unit.
    """
    from svv.dvr.classify import classified_as
    from svv.dvr.transfer_functions import TransferFunction
    from svv.dvr.volumes import read_volume
    from svv.io.atomic import make_folder
    from svv.train.following import at_volume, check_follows

    loaded = load(scene)
    check_follows(loaded)
    names = [volume.with_suffix(".svv").name for volume in volumes]
    if len(set(names)) < len(names):
        raise BadInput("Several volumes have the same name, so their scenes would overwrite each other: rename them.")
    told = loaded.made.get("source", {}).get("tf")
    if reading.tf is None and told is None:
        raise BadInput("The scene does not record its transfer function: give it with --tf.")
    tf = TransferFunction.read(reading.tf) if reading.tf is not None else TransferFunction.from_dict(told)
    folder = make_folder(out)
    with shown("Following") as progress:
        for number, (volume, name) in enumerate(zip(volumes, names, strict=True)):
            own = part(progress, number / len(volumes), (number + 1) / len(volumes))
            own(0.0, volume.name)
            image = read_volume(volume, reading.dims, reading.dtype, reading.spacing, array=reading.array)
            at_volume(loaded, classified_as(image, tf)).save(folder / name)
        progress(1.0, "done")
    print(f"{folder}: {len(volumes)} scenes")
