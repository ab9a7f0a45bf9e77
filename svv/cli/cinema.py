"""The commands for other programs: ``svv import``, ``svv export`` and ``svv view``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import os
import sys
import time
import webbrowser
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.files import check_targets, load
from svv.cli.option_group import spread
from svv.cli.options import Out, SceneFile
from svv.errors import BadInput, Progress, part
from svv.options.baking import BakeOptions
from svv.options.cinema import DatabaseOptions, ExportOptions
from svv.options.pages import PageOptions
from svv.options.splats import SplatOptions
from svv.progress import collect_again, shown

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

IMPORT = (
    "svv import head.cdb --out views",
    "svv import head.cdb --cameras head.pvsm --select time=0.5 --out views",
    "svv import head.cdb --select producer=white --black black --view-angle 30 --out views",
)
EXPORT = (
    "svv export scene.svv --out scene.html",
    "svv export head.svv --values --value-unit HU --out head.html",
    "svv export scene.svv --out scene.cdb",
    "svv export scene.svv --out scene.cdb --phi 24 --theta 12 --size 400 --no-layers",
    "torchrun --nproc-per-node 4 -m svv export scene.svv --out scene.cdb",
    "svv export scene.svv --out scene.vti",
    "svv export scene.svv --out scene.vti --resolution 128 --light baked --regions 0,2",
    "svv export scene.svv --out scene.vdb --light baked",
    "svv export scene.svv --out scene.ply",
    "svv export scene.svv --out scene.spz --splats 200000 --degree 2 --time-limit 300",
)
VIEW = ("svv view scene.svv", "svv view --follow scene.svv")

POLITE = 10
"""Added to the niceness of `svv view --follow`."""


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


@dataclass(frozen=True)
class Asked:
    """The options of `svv export`."""

    options: ExportOptions
    baking: BakeOptions = BakeOptions()
    page: PageOptions = PageOptions()
    splatting: SplatOptions = SplatOptions()


@spread
def export(
    scene: SceneFile,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE.html|NAME.cdb|NAME.vti|NAME.vdb|NAME.ply|NAME.spz|NAME.glb|NAME.usdz",
            help="What to write.",
        ),
    ],
    options: ExportOptions = ExportOptions(),
    baking: BakeOptions = BakeOptions(),
    page: PageOptions = PageOptions(),
    splatting: SplatOptions = SplatOptions(),
) -> None:
    """Write a scene for other programs: a page for browsers, images, a volume, or Gaussian splats.

    FILE.html shows the scene from all sides and edits it, without svv, a server or a network. NAME.cdb holds images by
    phi and theta, with depth and a layer for each region; `svv train` learns from it; after Ctrl-C, the same command
    resumes, and processes that torchrun starts share the images. NAME.vti holds colours and extinction for ParaView's
    3D view, beside a .json with the opacity function. NAME.vdb holds them as OpenVDB grids, density and Cd, for Blender
    and Houdini. NAME.ply, NAME.spz, NAME.glb and NAME.usdz hold 3D Gaussian splats, fitted to the scene's own
    pictures, for viewers of splats and game engines.
    """
    from svv.render.emptiness import HIDDEN, SHOW, hides_all
    from svv.train.run import ranks

    write = WRITERS.get(out.suffix.lower())
    if write is None:
        raise BadInput(
            f"Cannot tell what to write to {out}: name a page FILE.html, a Cinema database NAME.cdb, a volume NAME.vti "
            "or NAME.vdb, or splats NAME.ply, NAME.spz, NAME.glb or NAME.usdz."
        )
    if write is not _page and page != PageOptions():
        raise BadInput(
            f"--values, --unit and --value-unit are options of pages: leave them out, or write {out.stem}.html."
        )
    shared = write is _database  # others are written by the first of the processes that torchrun starts
    if not shared:
        check_targets(out)
        if ranks.place().rank:
            return
    if splatting != SplatOptions() and write is not _splats:
        raise BadInput(
            f"{out} takes no options of splats, such as --splats: they are of NAME.ply, .spz, .glb and .usdz."
        )
    with ranks.joined(options.device) if shared else nullcontext():
        loaded = load(scene, options.device)
        if hides_all(loaded) and options.network != "base" and ranks.is_first():
            print(f"svv: {out} will be empty, because {HIDDEN}: {SHOW}.", file=sys.stderr)
        with shown("Exporting", quiet=not ranks.is_first()) as progress:
            said = write(out, loaded, Asked(options, baking, page, splatting), progress)
        if ranks.is_first():
            print(f"{out}: {said}")


def _database(out: Path, scene: Scene, asked: Asked, progress: Progress) -> str:
    from svv.render.cinema import write_database
    from svv.train.run import ranks

    return f"{write_database(out, scene, asked.options, progress, ranks.sharing())} views"


def _page(out: Path, scene: Scene, asked: Asked, progress: Progress) -> str:
    from svv.render.web.page import write_html

    if (asked.options, asked.baking) != (ExportOptions(device=asked.options.device), BakeOptions()):
        raise BadInput(
            "A page has only the options --values, --unit and --value-unit: the others of svv export are of Cinema "
            "databases, volumes and splats."
        )
    said: list[str] = []
    size = write_html(out, scene, out.stem, progress=progress, options=asked.page, tell=said.append)
    return "; ".join([f"{size / 1e6:.1f} MB", *said])


def _volume(out: Path, scene: Scene, asked: Asked, progress: Progress) -> str:
    from svv.render.baking.baked import bake
    from svv.render.baking.baked_volume import write_baked

    volume = bake(scene, replace(asked.baking, network=asked.options.network), part(progress, 0.0, 0.8))
    preset = write_baked(out, volume, part(progress, 0.8, 1.0))
    return f"{volume.describe()}; its opacity function is {preset}"


def _openvdb(out: Path, scene: Scene, asked: Asked, progress: Progress) -> str:
    from svv.io.openvdb_python import python_with_openvdb
    from svv.render.baking.baked import bake
    from svv.render.baking.openvdb import write_vdb

    python_with_openvdb()  # before minutes of work
    volume = bake(scene, replace(asked.baking, network=asked.options.network), part(progress, 0.0, 0.7))
    notes = write_vdb(out, volume, part(progress, 0.7, 1.0))
    said = f"{' x '.join(map(str, volume.grid.shape))} points, {out.stat().st_size / 1e6:.1f} MB"
    return " ".join([f"{said}.", *notes]) if notes else said


def _splats(out: Path, scene: Scene, asked: Asked, progress: Progress) -> str:
    from svv.job.splats import export_splats

    shared = ExportOptions(network=asked.options.network, device=asked.options.device)
    if asked != Asked(shared, splatting=asked.splatting):
        raise BadInput("Splats have the options --splats, --degree, --steps, --time-limit, --seed and --network only.")
    return export_splats(out, scene, replace(asked.splatting, network=asked.options.network), progress)


WRITERS = {
    ".html": _page, ".cdb": _database, ".vti": _volume, ".vdb": _openvdb,
    ".ply": _splats, ".spz": _splats, ".glb": _splats, ".usdz": _splats,
}  # fmt: skip
"""Suffix of what to write -> what writes it, and returns what it wrote in a few words."""


def view(
    scene: SceneFile,
    follow: Annotated[
        bool, typer.Option("--follow", help="Show newer scenes in the file as they come, until Ctrl-C is pressed.")
    ] = False,
) -> None:
    """Show a scene in the browser: from all sides, with its palette, opacities, paintings and light to edit.

    The page is a temporary file; `svv export` writes one to keep. With --follow, the scene need not be there yet: while
    `svv train --sketch` trains it in another terminal, its sketches are shown, and then the scene.
    """
    from svv.io.files.temporary import view_folder
    from svv.render.web.page import write_html

    if follow:
        _follow(scene)
        return

    loaded = load(scene)
    out = view_folder() / f"{scene.stem}.html"
    with shown("Preparing") as progress:
        write_html(out, loaded, scene.stem, progress=progress, options=PageOptions(values=True))  # nobody sends it
    opened = webbrowser.open(out.as_uri())
    print(out if opened else f"{out}: no browser could be started; open this file in one.")


def _follow(scene: Path) -> None:
    """Serve the page of the newest scene in a file until Ctrl-C is pressed; whoever trains it comes first."""
    from svv.render.web.following import Follower

    if hasattr(os, "nice"):
        os.nice(POLITE)
    follower = Follower(scene)
    collect_again()
    opened = webbrowser.open(follower.address)
    print(follower.address if opened else f"{follower.address}: no browser could be started; open this address in one.")
    try:
        while True:
            follower.look()
            time.sleep(1.0)
    except KeyboardInterrupt:
        return
    finally:
        follower.close()
