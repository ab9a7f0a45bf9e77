"""Transfer functions by name: one of several in a file (``presets.xml:CT-Bone``), or a colour map (``viridis``)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TypeVar

from svv.errors import BadInput

MATPLOTLIB = "matplotlib:"
"""Prefix of the name of a colour map."""

LISTED = 40
"""Most names that a message lists."""

One = TypeVar("One")


def file_and_name(given: str | Path) -> tuple[Path | None, str | None]:
    """Return the file of a transfer function, and the name of one in it; for a colour map, None and its name.

    A file of exactly this name comes first, then a file with a name after a colon. What is left is a colour map if it
    begins with :data:`MATPLOTLIB`, or is a word that is no path and has no ending.

    >>> file_and_name("matplotlib:magma"), file_and_name("magma"), file_and_name("magma.json")
    ((None, 'magma'), (None, 'magma'), (PosixPath('magma.json'), None))
    """
    text, path = str(given), Path(given)
    if path.exists():
        return path, None
    file, colon, name = text.rpartition(":")
    if text.startswith(MATPLOTLIB):
        return None, text[len(MATPLOTLIB) :]
    if colon and name and Path(file).is_file():
        return Path(file), name
    return (None, text) if path.name == text and not path.suffix and not colon else (path, None)


def chosen(found: Sequence[tuple[str, One]], wanted: str | None, file: str, kind: str) -> One:
    """Return the one of a name among several of a kind in a file; without a name, the only one.

    Raises BadInput if there is none, none of the name, or several and no name.
    """
    names = [name for name, _ in found]
    if not found:
        raise BadInput(f"{file} has no {kind}.")
    if wanted is None and len(found) > 1:
        raise BadInput(f"{file} has {len(found)} of the kind '{kind}': name one, as {file}:{names[0]}. {listed(names)}")
    if wanted is None:
        return found[0][1]
    if wanted not in names:
        near = get_close_matches(wanted, names, 3, 0.5)
        close = f" Did you mean {' or '.join(near)}?" if near else ""
        raise BadInput(f"{file} has no {kind} named '{wanted}'.{close} {listed(names)}")
    return found[names.index(wanted)][1]


def listed(names: Iterable[str]) -> str:
    """Return a sentence that lists names.

    >>> listed(["b", "a"])
    'There are: a, b.'
    """
    ordered = sorted(set(names), key=str.casefold)
    more = f" and {len(ordered) - LISTED} more" if len(ordered) > LISTED else ""
    return f"There are: {', '.join(ordered[:LISTED])}{more}."
