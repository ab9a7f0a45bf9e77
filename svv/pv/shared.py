"""Lets a ParaView use packages that are installed already: a folder of links to them, and to nothing else.

ParaView must not see the whole of an environment that holds VTK, pyvista or matplotlib. Of what is installed, the
folder therefore shows the packages that svv depends on, directly or through others.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable, Collection, Iterable
from importlib.metadata import Distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import NormalizedName, canonicalize_name

Accept = Callable[[Distribution], bool]
"""Whether an installed package will do, apart from its version."""


def search(requirements: Iterable[str], path: list[str], accept: Accept) -> tuple[list[Distribution], list[str]]:
    """Look for packages and all that they depend on.

    Args:
        requirements: Such as ``numpy>=1.24``; those whose markers do not hold for this Python are left out.
        path: Folders with packages, the first one wins.
        accept: Asked about each package.

    Returns:
        The packages that fit, and requirements on those that are not there or do not fit.
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
        # A package that was installed without a list of its files (Debian's are) cannot be shown by itself.
        if found is not None and found.files and _satisfies(found, lines) and accept(found):
            fitting.append(found)
        else:
            missing += sorted(lines)
    return fitting, missing


def link(packages: Iterable[Distribution], folder: Path, never: Collection[str]) -> None:
    """Put links to packages into a folder, beside what it holds.

    Args:
        packages: What to show.
        folder: Where; what is there already stays.
        never: Names of modules that are left out.

    Raises:
        OSError: a link cannot be made.
    """
    for package in packages:
        for name in sorted({file.parts[0] for file in package.files or []} - {"..", "__pycache__", *never}):
            _link(Path(str(package.locate_file(name))), folder / name)


def _installed(path: list[str]) -> dict[NormalizedName, Distribution]:
    found: dict[NormalizedName, Distribution] = {}
    for package in importlib.metadata.distributions(path=path):
        name = package.metadata["Name"]
        if name:  # half removed, otherwise
            found.setdefault(canonicalize_name(name), package)
    return found


def _satisfies(package: Distribution, requirements: Iterable[str]) -> bool:
    return all(Requirement(line).specifier.contains(package.version, prereleases=True) for line in requirements)


def _link(source: Path, goal: Path) -> None:
    """Make ``goal`` show ``source``; where folders of several packages have one name (``nvidia``), what is in each."""
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
