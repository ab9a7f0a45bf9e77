"""Let a ParaView use packages that are installed already, through a folder of links to them and to nothing else.

The folder contains only svv's direct and indirect dependencies: ParaView must not see an environment's VTK or pyvista.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable, Collection, Iterable
from importlib.metadata import Distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import NormalizedName, canonicalize_name

Accept = Callable[[Distribution], bool]
"""Returns whether an installed package is suitable, apart from its version."""


def search(requirements: Iterable[str], path: list[str], accept: Accept) -> tuple[list[Distribution], list[str]]:
    """Search folders, the first one first, for packages that requirements name, and all their dependencies.

    Returns those whose version fits and which ``accept`` takes, and the requirements for which there are none.
    """
    installed = _installed(path)
    asked: dict[NormalizedName, set[str]] = {}
    extras: dict[NormalizedName, set[str]] = {}
    waiting = [Requirement(line) for line in requirements]
    while waiting:
        one = waiting.pop()
        name = canonicalize_name(one.name)
        first = name not in asked
        asked.setdefault(name, set()).add(f"{one.name}{one.specifier}")
        new = one.extras - extras.setdefault(name, set())
        extras[name] |= new
        if name not in installed or not (first or new):
            continue
        for line in installed[name].requires or []:
            other = Requirement(line)
            if other.marker is None or any(other.marker.evaluate({"extra": extra}) for extra in ("", *extras[name])):
                waiting.append(other)
    fitting, missing = [], []
    for name, lines in asked.items():
        found = installed.get(name)
        # A package without a list of its files (such as Debian's packages) cannot be linked separately.
        if found is not None and found.files and _satisfies(found, lines) and accept(found):
            fitting.append(found)
        else:
            missing += sorted(lines)
    return fitting, missing


def link(packages: Iterable[Distribution], folder: Path, never: Collection[str]) -> None:
    """Add links to packages, but for modules never to link, to a folder; raises OSError if one cannot be created."""
    for package in packages:
        for name in sorted({file.parts[0] for file in package.files or []} - {"..", "__pycache__", *never}):
            _link(Path(str(package.locate_file(name))), folder / name)


def _installed(path: list[str]) -> dict[NormalizedName, Distribution]:
    found: dict[NormalizedName, Distribution] = {}
    for package in importlib.metadata.distributions(path=path):
        if "Name" in package.metadata:  # a partly removed package has none
            found.setdefault(canonicalize_name(package.metadata["Name"]), package)
    return found


def _satisfies(package: Distribution, requirements: Iterable[str]) -> bool:
    return all(Requirement(line).specifier.contains(package.version, prereleases=True) for line in requirements)


def _link(source: Path, goal: Path) -> None:
    """Link ``goal`` to ``source``; if several packages share a folder (``nvidia``), link the entries of each."""
    if not source.exists() or (goal.exists() and not (source.is_dir() and goal.is_dir())):
        return
    if not goal.exists():
        goal.symlink_to(source.absolute(), target_is_directory=source.is_dir())
    elif goal.resolve() != source.resolve():
        if goal.is_symlink():
            other = goal.resolve()
            goal.unlink()
            goal.mkdir()
            for entry in other.iterdir():
                _link(entry, goal / entry.name)
        for entry in source.iterdir():
            _link(entry, goal / entry.name)
