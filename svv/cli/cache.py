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
    """Show or clear the results that ParaView's filters keep so that saved states need not train or paint again.

    The folder is SVV_CACHE if it is set, otherwise svv/scenes in the user's cache. SVV_CACHE_SIZE limits its size,
    by default to 2G; above the limit, the least recently used results are removed.
    """
    from svv.io.atomic import check_writable, write_json
    from svv.io.cache import Cache

    if json is not None:
        check_writable(json)
    place = Cache.of_user()
    entries = place.entries()
    freed = place.clear() if clear else None
    left = place.entries() if clear else entries
    held = sum(entry.bytes for entry in left)
    if json is not None:
        listed = [{"name": e.path.name, "bytes": e.bytes, "used": e.used} for e in left]
        write_json(json, {"folder": place.folder, "entries": listed, "bytes": held, "bound": place.bound})
    if freed is not None:
        print(f"{place.folder}: {_counted(len(entries) - len(left))} removed, {freed / 1e6:.1f} MB.")
        return
    for entry in entries:
        print(f"{datetime.fromtimestamp(entry.used):%Y-%m-%d %H:%M}  {entry.bytes / 1e6:8.1f} MB  {entry.path.name}")
    print(f"{place.folder}: {_counted(len(left))}, {held / 1e6:.1f} MB of {place.bound / 1e6:.0f} MB at most.")


def _counted(results: int) -> str:
    return f"{results} result{'' if results == 1 else 's'}"
