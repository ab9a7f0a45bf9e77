"""The command ``svv cache``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.options import Json

if TYPE_CHECKING:
    from svv.job.cached_files import Kind

CACHE = (
    "svv cache",
    "svv cache --clear",
    "svv cache --clear unfinished kernels",
    "svv cache --clear --dry-run",
    "svv cache --json cache.json",
    "SVV_CACHE=/data/scenes SVV_CACHE_SIZE=10G svv paraview",
)


class KindName(str, Enum):
    """Kinds of files."""

    results = "results"
    unfinished = "unfinished"
    pyramids = "pyramids"
    pictures = "pictures"
    weights = "weights"
    kernels = "kernels"
    checks = "checks"
    temporary = "temporary"


def cache(
    kinds: Annotated[
        list[KindName] | None, typer.Argument(metavar="KIND", help="Kinds to show or clear; by default all.")
    ] = None,
    clear: Annotated[
        bool, typer.Option("--clear", help="Remove them; saved states that need a result will say so.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="With --clear: only say what would be removed, and what stays.")
    ] = False,
    json: Json = None,
) -> None:
    """Show or clear all that svv writes by itself, by kind: number, size, limit and folder.

    Kinds are results (views, scenes and paintings of ParaView's filters), unfinished (checkpoints of trainings there),
    pyramids (coarser levels of large volumes), pictures (of the gallery), weights, kernels, checks (what ParaView and
    the GPU are) and temporary. SVV_CACHE_SIZE limits results and unfinished together (2G), SVV_PYRAMIDS_SIZE the
    pyramids (50G); above it, the least recently used are removed. What a running process works on stays.
    """
    from svv.errors import BadInput
    from svv.io.files.atomic import check_writable, write_json
    from svv.io.files.cache import cleared
    from svv.job.cached_files import list_cached_files

    if dry_run and not clear:
        raise BadInput("--dry-run says what --clear would remove: give both.")
    if json is not None:
        check_writable(json)
    there = [kind for kind in list_cached_files() if not kinds or kind.name in kinds]
    if clear:
        for kind in there:
            if not dry_run:
                cleared(kind.entries)
            left = [e for e in kind.entries if e.held or (not dry_run and e.path.exists())]
            _tell_cleared(kind, replace(kind, entries=left), "would be removed" if dry_run else "removed")
            kind.entries[:] = kind.entries if dry_run else left
    else:
        for kind in there:
            print(f"{kind.name:<10} {len(kind.entries):>5} {_megabytes(kind.bytes)}  {kind.about}{_where(kind)}")
        print(f"{'all':<10} {sum(len(k.entries) for k in there):>5} {_megabytes(sum(k.bytes for k in there))}")
    if json is not None:
        write_json(json, {"bytes": sum(kind.bytes for kind in there), "kinds": [_kind_to_json(kind) for kind in there]})


def _tell_cleared(kind: Kind, left: Kind, done: str) -> None:
    """Say how much of a kind is removed, and why the rest is not."""
    print(f"{kind.name:<10} {len(kind.entries) - len(left.entries):>5} {_megabytes(kind.bytes - left.bytes)}  {done}")
    held = [entry for entry in left.entries if entry.held]
    if held:
        print(f"  {len(held)} in use by a running process stay, {sum(e.bytes for e in held) / 1e6:.1f} MB.")
    for entry in left.entries:
        if not entry.held:
            print(f"  {entry.path} cannot be removed: it belongs to another user, or its folder cannot be written to.")


def _where(kind: Kind) -> str:
    """Return where a kind is and what limits it."""
    said = ""
    if kind.bound is not None:
        shared = " with unfinished" if kind.name == "results" else " with results" if kind.name == "unfinished" else ""
        by = f" ({kind.bound_variable})" if kind.bound_variable else ""
        said = f", at most {kind.bound / 1e6:.0f} MB{shared}{by}"
    if kind.folder is not None:
        by = f" ({kind.folder_variable})" if kind.folder_variable else ""
        said += f", in {kind.folder}{by}"
    return said


def _kind_to_json(kind: Kind) -> dict[str, object]:
    """Return what the JSON file says of a kind."""
    entries = [
        {"path": e.path, "bytes": e.bytes, "used": e.used, "in_use": e.held}
        for e in sorted(kind.entries, key=lambda entry: entry.used)
    ]
    return {
        "kind": kind.name, "folder": kind.folder, "bytes": kind.bytes, "bound": kind.bound,
        "bound_variable": kind.bound_variable, "folder_variable": kind.folder_variable, "entries": entries,
    }  # fmt: skip


def _megabytes(count: int) -> str:
    return f"{count / 1e6:>9.1f} MB"
