"""Find and run pip or uv (environments made by pipx or uv contain no pip), with Python's standard library alone."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from svv.errors import BadInput


def command() -> list[str]:
    """Return the command, up to the packages' names, that installs without byte code (280 MB); or raise BadInput."""
    options = ["-qq", "--disable-pip-version-check", "--no-input", "--no-compile"]
    if importlib.util.find_spec("pip") is not None:
        return [sys.executable, "-m", "pip", "install", *options]
    for name in filter(None, map(shutil.which, ("pip", "pip3"))):
        elsewhere = [name, "--python", sys.executable]  # from pip 22.3 on
        if not subprocess.run([*elsewhere, "--version"], capture_output=True).returncode:
            return [*elsewhere, "install", *options]
    uv = shutil.which("uv")
    if uv is not None:
        return [uv, "pip", "install", "-q", "--python", sys.executable]
    raise BadInput(
        f"There is no pip to install packages: run `{sys.executable} -m ensurepip`, or put pip or uv on the PATH."
    )


def install(packages: Sequence[str], *options: str, quiet: bool = False) -> bool:
    """Install requirements, with options that pip and uv share; return whether it worked. Quiet hides all output."""
    silence = subprocess.DEVNULL if quiet else None
    return not subprocess.run([*command(), *options, *packages], stdout=silence, stderr=silence).returncode


def pins(file: Path, python: tuple[int, int]) -> list[str]:
    """Return the lines of constraints.txt for a version of Python, which may not be pip's, without their markers."""
    kept = []
    for line in file.read_text().splitlines():
        pin, _, marker = line.partition(";")
        if not pin.strip() or pin.startswith("#"):
            continue
        match = re.fullmatch(r'\s*python_version (<|>=) "(\d+)\.(\d+)"\s*', marker or ' python_version >= "3.0"')
        if match is None:
            raise ValueError(f"{file}: the marker {marker.strip()} is not supported")
        sign, *version = match.groups()
        if (python < tuple(map(int, version))) == (sign == "<"):
            kept.append(pin.strip())
    return kept


def constraints_file() -> Path | None:
    """Return svv's constraints.txt, from a checkout or as installed by pip; None if there is neither."""
    root = Path(__file__).resolve().parents[3]
    places = [root / "constraints.txt", root / "../../../share/svv/constraints.txt"]
    return next((place for place in places if place.is_file()), None)


def size(folder: str | Path) -> int:
    """Return the bytes that a folder takes on disk, without following links; 0 if it does not exist."""
    total = 0
    for above, _, names in os.walk(folder):
        total += sum(os.lstat(os.path.join(above, name)).st_blocks * 512 for name in names)
    return total
