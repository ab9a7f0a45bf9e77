"""The commands that read and write Cinema databases: ``svv import`` and ``svv export``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.files import load
from svv.cli.option_group import spread
from svv.cli.options import Out, SceneFile
from svv.errors import BadInput
from svv.options.cinema import DatabaseOptions, ExportOptions
from svv.progress import shown

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
    out: Annotated[Path, typer.Option("--out", "-o", metavar="NAME.cdb", help="The database to write.")],
    options: ExportOptions = ExportOptions(),
) -> None:
    """Write a scene as a Cinema database: images by phi and theta, with depth and a layer for each region.

    Cinema's viewers show it, and `svv train` learns from it. After Ctrl-C, the same command resumes. Processes that
    torchrun starts share the views.
    """
    from svv.render.cinema import write_database
    from svv.train import ranks

    if out.suffix.lower() != ".cdb":
        raise BadInput(f"Cannot tell what to write to {out}: name a Cinema database NAME.cdb.")
    with ranks.joined(options.device):
        loaded = load(scene, options.device)
        with shown("Rendering", quiet=not ranks.is_first()) as progress:
            count = write_database(out, loaded, options, progress, ranks.sharing())
        if ranks.is_first():
            print(f"{out}: {count} views")
