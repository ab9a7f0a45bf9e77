"""The commands for other programs: ``svv import``, ``svv export`` and ``svv view``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
import tempfile
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.files import load
from svv.cli.option_group import spread
from svv.cli.options import Out, SceneFile
from svv.errors import BadInput, Progress
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
    "svv export scene.svv --out scene.html",
    "svv export scene.svv --out scene.cdb",
    "svv export scene.svv --out scene.cdb --phi 24 --theta 12 --size 400 --no-layers",
)
"""Examples in the help."""


VIEW = ("svv view scene.svv",)
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
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE.html|NAME.cdb", help="What to write.")],
    options: ExportOptions = ExportOptions(),
) -> None:
    """Write a scene for other programs: as a page for browsers, or as a Cinema database.

    FILE.html shows the scene from all sides and edits it, without svv, a server or a network. NAME.cdb contains images
    by phi and theta, with depth and a layer for each region; the options describe these. Cinema's viewers show it, and
    `svv train` learns from it. After Ctrl-C, the same command resumes.
    """
    writer = WRITERS.get(out.suffix.lower())
    if writer is None:
        raise BadInput(f"Cannot tell what to write to {out}: name a page FILE.html or a Cinema database NAME.cdb.")
    loaded = load(scene, options.device)
    with shown("Exporting") as progress:
        said = writer(out, loaded, options, progress)
    print(f"{out}: {said}")


def _database(out: Path, scene: Scene, options: ExportOptions, progress: Progress) -> str:
    from svv.render.cinema import write_database

    return f"{write_database(out, scene, options, progress)} views"


def _page(out: Path, scene: Scene, options: ExportOptions, progress: Progress) -> str:
    from svv.render.web.page import write_html

    if options != ExportOptions(device=options.device):
        raise BadInput("The options --phi, --theta, --size, --layers and --network are those of a Cinema database.")
    return f"{write_html(out, scene, out.stem, progress=progress) / 1e6:.1f} MB"


WRITERS: dict[str, Callable[[Path, Scene, ExportOptions, Progress], str]] = {".html": _page, ".cdb": _database}
"""Suffix of what to write -> its writer, which returns what it wrote in a few words."""


def view(scene: SceneFile) -> None:
    """Show a scene in the browser: from all sides, with its palette, opacities, paintings and light to edit.

    The page is one file in the system's folder for temporary files; `svv export` writes it elsewhere, to be kept.
    """
    from svv.render.web.page import write_html

    loaded = load(scene)
    out = Path(tempfile.mkdtemp(prefix="svv-")) / f"{scene.stem}.html"
    with shown("Preparing") as progress:
        write_html(out, loaded, scene.stem, progress=progress)
    opened = webbrowser.open(out.as_uri())
    print(out if opened else f"{out}: no browser could be started; open this file in one.")
