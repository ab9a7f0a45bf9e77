"""The command ``svv cache``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

import typer

from svv.cli.options import Json

CACHE = (
    "svv cache",
    "svv cache --clear",
    "svv cache --json cache.json",
    "SVV_CACHE=/data/scenes SVV_CACHE_SIZE=10G svv paraview",
)
"""Examples in the help."""


def cache(
    clear: Annotated[
        bool,
        typer.Option("--clear", help="Remove everything; saved states that need a result will say so."),
    ] = False,
    json: Json = None,
) -> None:
    """Show or clear what is kept so that it need not be computed again: results of ParaView's filters, and pyramids.

    Results are trained and painted scenes of saved states; their folder is SVV_CACHE if it is set, otherwise svv/scenes
    in the user's cache. Pyramids are coarser levels of large volumes; their folder is SVV_PYRAMIDS, otherwise
    svv/pyramids. SVV_CACHE_SIZE and SVV_PYRAMIDS_SIZE limit the sizes, by default to 2G and 50G; above the limit, what
    was used least recently is removed.
    """
    from svv.bricks.pyramid import pyramids
    from svv.io.files.atomic import check_writable, write_json
    from svv.io.files.cache import Cache

    if json is not None:
        check_writable(json)
    about = []
    for place, kind in ((Cache.of_user(), "result"), (pyramids(), "pyramid")):
        entries = place.entries()
        freed = place.clear() if clear else None
        left = place.entries() if clear else entries
        held = sum(entry.bytes for entry in left)
        listed = [{"name": e.path.name, "bytes": e.bytes, "used": e.used} for e in left]
        about.append({"folder": place.folder, "entries": listed, "bytes": held, "bound": place.bound})
        if freed is not None:
            print(f"{place.folder}: {_counted(len(entries) - len(left), kind)} removed, {freed / 1e6:.1f} MB.")
            continue
        for e in entries:
            print(f"{datetime.fromtimestamp(e.used):%Y-%m-%d %H:%M}  {e.bytes / 1e6:8.1f} MB  {e.path.name}")
        most = f"{place.bound / 1e6:.0f} MB at most"
        print(f"{place.folder}: {_counted(len(entries), kind)}, {held / 1e6:.1f} MB of {most}.")
    if json is not None:
        write_json(json, {**about[0], "pyramids": about[1]})


def _counted(number: int, kind: str) -> str:
    return f"{number} {kind}{'' if number == 1 else 's'}"
