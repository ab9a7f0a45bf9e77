"""Made-up packages for tests: as wheels, which pip installs, and as installed packages."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path


def files_of(name: str, version: str, requires: Sequence[str] = (), more: Mapping[str, str] | None = None) -> dict:
    """The files of a package: a module that knows its version, its metadata and what else there is to be."""
    module, info = name.replace("-", "_"), f"{name.replace('-', '_')}-{version}.dist-info"
    lines = [
        "Metadata-Version: 2.1",
        f"Name: {name}",
        f"Version: {version}",
        *(f"Requires-Dist: {r}" for r in requires),
    ]
    files = {f"{module}/__init__.py": f"__version__ = '{version}'\n"} if more is None else dict(more)
    files[f"{info}/METADATA"] = "\n".join([*lines, ""])
    files[f"{info}/WHEEL"] = "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    files[f"{info}/RECORD"] = "".join(f"{file},,\n" for file in [*files, f"{info}/RECORD"])
    return files


def make_wheel(folder: Path, name: str, version: str, *arguments, **options) -> Path:
    """A wheel in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name.replace('-', '_')}-{version}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for file, text in files_of(name, version, *arguments, **options).items():
            archive.writestr(file, text)
    return path


def make_installed(packages: Path, name: str, version: str, *arguments, **options) -> None:
    """A package in a made-up ``site-packages``."""
    for file, text in files_of(name, version, *arguments, **options).items():
        (packages / file).parent.mkdir(parents=True, exist_ok=True)
        (packages / file).write_text(text)


def make_torch(make, folder: Path, version: str, cuda: str | None, requires: Sequence[str] = ()) -> None:
    """A torch, as wheel or installed, that says what it was built with."""
    more = {
        "torch/__init__.py": "",
        "torch/version.py": f"from typing import Optional\ncuda: Optional[str] = {cuda!r}\n",
    }
    make(folder, "torch", version, requires, more=more)
