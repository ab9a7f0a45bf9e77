"""Scenes and views for and from other programs: ``svv import`` and ``svv export``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.files import check_targets, load
from svv.cli.option_group import spread
from svv.cli.options import Out, SceneFile
from svv.errors import BadInput, part
from svv.options.baking import BakeOptions
from svv.options.cinema import DatabaseOptions, ExportOptions
from svv.progress import shown

if TYPE_CHECKING:
    from svv.fields.scene import Scene

IMPORT = (
    "svv import head.cdb --out views",
    "svv import head.cdb --cameras head.pvsm --select time=0.5 --out views",
    "svv import head.cdb --select producer=white --black black --view-angle 30 --out views",
)
"""Examples in the help."""
EXPORT = (
    "svv export scene.svv --out scene.cdb",
    "svv export scene.svv --out scene.cdb --phi 24 --theta 12 --size 400 --no-layers",
    "torchrun --nproc-per-node 4 -m svv export scene.svv --out scene.cdb",
    "svv export scene.svv --out scene.vti",
    "svv export scene.svv --out scene.vti --resolution 128 --light baked --regions 0,2",
)
"""Examples in the help."""


@spread
def import_(
    database: Annotated[Path, typer.Argument(metavar="DATABASE", help="Folder with data.csv or Ascent's info.json.")],
    out: Out,
    options: DatabaseOptions = DatabaseOptions(),
) -> None:
    """Make a folder of views from a Cinema database: ParaView's, Ascent's or pycinema's.

    Cameras come from the options, a file that they name, camera.json in the database, or the images' metadata. An
    unknown view angle is estimated from the silhouettes; cameras that contradict them are refused.
    """
    from svv.io.cinema.views import read_database

    with shown("Reading") as progress:
        imported = read_database(database, options, progress)
    with shown("Writing") as progress:
        imported.write(out, progress)
    for note in imported.notes:
        print(note, file=sys.stderr)
    unseen = 0 if imported.test is None else len(imported.test)
    print(f"{out}: {len(imported.train)} + {unseen} views")


@spread
def export(
    scene: SceneFile,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="NAME.cdb|NAME.vti", help="What to write.")],
    options: ExportOptions = ExportOptions(),
    baking: BakeOptions = BakeOptions(),
) -> None:
    """Write a scene for other programs: as a Cinema database (.cdb), or as a volume for ParaView's 3D view (.vti).

    A database holds images by phi and theta, with depth and a layer for each region; `svv train` learns from it. After
    Ctrl-C, the same command resumes, and processes that torchrun starts share the images. A volume holds colours and
    extinction; its opacity function is in a .json beside it.
    """
    from svv.train import ranks

    writers = {".cdb": _database, ".vti": _volume}
    write = writers.get(out.suffix.lower())
    if write is None:
        raise BadInput(f"Cannot tell what to write to {out}: name a Cinema database NAME.cdb or a volume NAME.vti.")
    check_targets(*([] if write is _database else [out]))
    if ranks.place().rank and write is not _database:
        return
    with ranks.joined(options.device) if write is _database else nullcontext():
        said = write(load(scene, options.device), out, options, baking)
        if ranks.is_first():
            print(said)


def _database(scene: Scene, out: Path, options: ExportOptions, baking: BakeOptions) -> str:
    from svv.render.cinema import write_database
    from svv.train import ranks

    with shown("Rendering", quiet=not ranks.is_first()) as progress:
        count = write_database(out, scene, options, progress, ranks.sharing())
    return f"{out}: {count} views"


def _volume(scene: Scene, out: Path, options: ExportOptions, baking: BakeOptions) -> str:
    from svv.render.baked import bake, write_baked

    with shown("Baking") as progress:
        volume = bake(scene, replace(baking, network=options.network), part(progress, 0.0, 0.8))
        preset = write_baked(out, volume, part(progress, 0.8, 1.0))
    return f"{out}: {volume.told()}; its opacity function is {preset}"
