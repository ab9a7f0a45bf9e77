"""The commands ``svv follow`` and ``svv opacities``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from svv.cli.files import load
from svv.cli.option_group import spread
from svv.cli.options import Out, SceneFile
from svv.errors import BadInput, part
from svv.options.making import VolumeOptions
from svv.progress import shown

if TYPE_CHECKING:
    from svv.job.series import Step

FOLLOW = (
    "svv follow scene.svv blob_*.vti --out series.svv",
    "svv follow scene.svv flow.pvd --array pressure --out series.svv",
    "svv follow scene.svv blob_01.vti blob_02.vti blob_03.vti --out steps",
)

OPACITIES = (
    "svv opacities scene.svv head.vti --tf fainter.json --out fainter.svv",
    "svv opacities series.svv --tf core-alone.json --out core.svv",
)


@spread
def follow(
    scene: SceneFile,
    volumes: Annotated[
        list[Path],
        typer.Argument(
            metavar="VOLUME...",
            help="The volume at all time steps, in their order, or a .pvd or .series file that lists them.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE.svv|DIR", help="One scene with all time steps, or a folder with one for each."
        ),
    ],
    reading: VolumeOptions = VolumeOptions(),
) -> None:
    """Add the other time steps of its volume to a scene, without views or training.

    The scene must have been trained with --encoding values, on one of the volumes. All steps have its palette, edits
    and paint, which moves with the matter. The transfer function is the scene's; --tf replaces it by an equal one.
    """
    from svv.dvr.functions.transfer_functions import TransferFunction
    from svv.fields.following.followed_scene import at_step
    from svv.io.files.atomic import check_writable, make_folder
    from svv.job.series import with_time_steps

    loaded, one = load(scene), out.suffix.lower() == ".svv"
    if one:
        check_writable(out)
    steps = _steps(volumes, reading)
    names = [f"{Path(step.name).stem}.svv" for step in steps]
    if not one and len(set(names)) < len(names):
        raise BadInput("Several volumes have the same name, so their scenes would overwrite each other: rename them.")
    tf = None if reading.only is None else TransferFunction.read(reading.only)
    with shown("Following") as progress:
        series, notes = with_time_steps(loaded, steps, tf, progress if one else part(progress, 0.0, 0.7))
        if one:
            series.save(out)
        for number, name in enumerate(() if one else names):
            part(progress, 0.7, 1.0)(number / len(names), name)
            at_step(series, number).save(make_folder(out) / name)
        progress(1.0, "done")
    for note in notes:
        print(f"svv: {note}", file=sys.stderr)
    print(
        f"{out}: {len(steps)} time steps, {out.stat().st_size / 1e6:.1f} MB" if one else f"{out}: {len(names)} scenes"
    )


@spread
def opacities(
    scene: SceneFile,
    out: Out,
    volume: Annotated[
        Path | None,
        typer.Argument(
            metavar="VOLUME", help="The volume that it was trained on; scenes of the encoding values need none."
        ),
    ] = None,
    reading: VolumeOptions = VolumeOptions(),
) -> None:
    """Show a scene with other opacities of its transfer function, without views or training.

    --tf names the function, with the scene's colours; svv edit changes those. A scene of the encoding values needs
    nothing else; another one must have been trained with its volume, which is then needed. What no training view showed
    is marked as approximate, or refused. Paint, edits and time steps stay.
    """
    from svv.dvr.functions.transfer_functions import TransferFunction
    from svv.dvr.read.appearance import without_interpolation
    from svv.io.files.atomic import check_writable
    from svv.job.opacities import with_opacities

    loaded = load(scene)
    check_writable(out)
    if reading.only is None:
        raise BadInput("Name the transfer function: --tf TF.json.")
    function, image = TransferFunction.read(reading.only), None
    if volume is not None:
        image = _reader(volume, reading)()
        if loaded.made.get("source", {}).get("nearest"):
            image = without_interpolation(image)
    result = with_opacities(loaded, function, image)
    result.save(out)
    for said in result.made.get("approximate", []):
        print(f"svv: {said}", file=sys.stderr)
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB")


def _steps(volumes: Sequence[Path], reading: VolumeOptions) -> list[Step]:
    """Return the time steps that are named; the times of files without any are their numbers."""
    from svv.io.series_file import EXTENSIONS, read_series
    from svv.job.series import Step

    listed = [volume for volume in volumes if volume.suffix.lower() in EXTENSIONS]
    if listed and len(volumes) > 1:
        raise BadInput(f"{listed[0]} lists time steps itself: name no other volumes.")
    told = read_series(listed[0]) if listed else [(float(number), path) for number, path in enumerate(volumes)]
    if len(told) < 2:
        raise BadInput("A series needs at least two time steps, one of them that of the scene.")
    return [Step(path.name, time, _reader(path, reading)) for time, path in told]


def _reader(path: Path, reading: VolumeOptions) -> Callable[[], Any]:
    """Return what reads a volume."""
    from svv.dvr.read.volumes import read_volume

    names = ("dims", "dtype", "spacing", "channel", "time", "resample_to")
    return partial(read_volume, path, array=reading.only_array, **{name: getattr(reading, name) for name in names})
