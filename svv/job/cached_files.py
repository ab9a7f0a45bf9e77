"""All that svv writes without being asked where to, by kind: how large it is, what limits it, and how it is removed.

Results that a command names (``--out``), what lies beside them, and packages installed for ParaView are not in here.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from svv.bricks.pyramid import pyramids
from svv.io.files.cache import Cache, Entry, cache_folder, entries_of
from svv.io.files.temporary import temporary_folders
from svv.styles.gallery import pictures
from svv.styles.networks import FAILED_FILE, FOLDER_VARIABLE, NETWORKS, weights_folder

PACKAGES = ("svv", "svv_bench")
"""Packages whose kernels numba compiles."""


@dataclass(frozen=True)
class Kind:
    """A kind of files."""

    name: str
    about: str
    """What they are, for the user."""
    entries: list[Entry]
    """The files and folders of this kind that are there."""
    folder: Path | None = None
    """Where they are; None if that is in several places."""
    folder_variable: str = ""
    """Environment variable that names another folder."""
    bound: int | None = None
    """Maximum size in bytes that svv keeps to; None if there is no need for any, because they do not accumulate."""
    bound_variable: str = ""
    """Environment variable that sets another maximum size."""

    @property
    def bytes(self) -> int:
        """Size of all of them."""
        return sum(entry.bytes for entry in self.entries)


def list_cached_files() -> list[Kind]:
    """Return all kinds of files, with what there is of each; raises BadInput if a variable's maximum size is none.

    >>> [kind.name for kind in list_cached_files()][:3]
    ['results', 'unfinished', 'pyramids']
    """
    results, coarse, gallery = Cache.of_user(), pyramids(), pictures()
    weights, names = weights_folder(), [network.file for network in NETWORKS.values()]
    # Others may share that folder.
    networks = _found(weights, *names, FAILED_FILE, *(f".{Path(name).stem}-*" for name in names))
    kernels = [file for folder in _numba_folders() for file in _found(folder, "*.nbi*", "*.nbc*")]
    kernels += _found(cache_folder() / "compiled", "*", ".*")  # marks of versions that were compiled ahead
    checks = [*_found(cache_folder(), "paraview.json*"), *_found(cache_folder() / "gpu", "*", ".*")]
    scenes = results.folder, "SVV_CACHE", results.bound, "SVV_CACHE_SIZE"
    return [
        Kind("results", "views, scenes and paintings of ParaView's filters", results.entries(), *scenes),
        Kind("unfinished", "checkpoints of trainings in ParaView", results.unfinished(), *scenes),
        Kind(
            "pyramids", "coarser levels of large volumes", [*coarse.entries(), *coarse.unfinished()], coarse.folder,
            "SVV_PYRAMIDS", coarse.bound, "SVV_PYRAMIDS_SIZE",
        ),
        Kind(
            "pictures", "style pictures of the gallery", [*gallery.entries(), *gallery.unfinished()], gallery.folder,
            bound=gallery.bound,
        ),
        Kind("weights", "networks for the preset paper and LPIPS", entries_of(networks), weights, FOLDER_VARIABLE),
        Kind("kernels", "compiled by numba", entries_of(kernels)),
        Kind("checks", "what ParaView and the GPU are", entries_of(checks), cache_folder()),
        Kind("temporary", "work in progress, and pages of svv view", entries_of(temporary_folders())),
    ]  # fmt: skip


def _numba_folders() -> Iterator[Path]:
    """Yield the folders in which numba may keep kernels: beside their sources, and those that replace these."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    elsewhere = [cache_folder().parent / "numba", *([Path(named)] if named else [])]
    for package in PACKAGES:
        spec = find_spec(package)
        for root in (spec.submodule_search_locations or ()) if spec else ():
            yield from sorted(Path(root).rglob("__pycache__"))  # also of modules that an upgrade has removed
            for folder in sorted({file.parent for file in Path(root).rglob("*.py")}):
                at = os.path.abspath(folder)
                name = f"{folder.name}_{hashlib.sha1(at.encode(), usedforsecurity=False).hexdigest()}"
                yield from (place / name for place in elsewhere)


def _found(folder: Path, *patterns: str) -> list[Path]:
    found = {path for pattern in patterns for path in folder.glob(pattern)}
    return sorted(path for path in found if path.is_file())
