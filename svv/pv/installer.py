"""Calls pip, wherever there is one: environments made by pipx or uv have none of their own.

Needs nothing beyond Python's own library, as it runs before anything is installed.
"""

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
    """The words before the packages' names, to install into the Python that runs us.

    Nothing is compiled to byte code ahead of time: of 280 MB that would be, most is never imported.

    Raises:
        BadInput: there is no pip for this Python, and no uv.
    """
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
        f"There is no pip to install packages with: run `{sys.executable} -m ensurepip`, or put pip or uv on the PATH."
    )


def install(packages: Sequence[str], *options: str, quiet: bool = False) -> bool:
    """Install packages; what went wrong is on stderr unless ``quiet``.

    Args:
        packages: Requirements, as pip takes them.
        options: Further options that pip and uv share, such as ``--no-deps``.
        quiet: Say nothing, as another way follows.

    Returns:
        Whether it worked.
    """
    silence = subprocess.DEVNULL if quiet else None
    return not subprocess.run([*command(), *options, *packages], stdout=silence, stderr=silence).returncode


def pins(file: Path, python: tuple[int, int]) -> list[str]:
    """The lines of our constraints.txt that hold for a Python, without their markers.

    pip itself would ask the Python that it runs in, which need not be the one that is installed for.
    """
    kept = []
    for line in file.read_text().splitlines():
        pin, _, marker = line.partition(";")
        if not pin.strip() or pin.startswith("#"):
            continue
        match = re.fullmatch(r'\s*python_version (<|>=) "(\d+)\.(\d+)"\s*', marker or ' python_version >= "3.0"')
        if match is None:
            raise ValueError(f"{file}: {marker.strip()} is a marker that nobody here reads")
        sign, *version = match.groups()
        if (python < tuple(map(int, version))) == (sign == "<"):
            kept.append(pin.strip())
    return kept


def constraints_file() -> Path | None:
    """Our constraints.txt: that of a checkout, or as pip has installed it; None where there is neither."""
    root = Path(__file__).resolve().parents[2]
    places = [root / "constraints.txt", root / "../../../share/svv/constraints.txt"]
    return next((place for place in places if place.is_file()), None)


def size(folder: str | Path) -> int:
    """Bytes that a folder takes on the disk; links are not followed. A folder that is not there has none."""
    total = 0
    for above, _, names in os.walk(folder):
        total += sum(os.lstat(os.path.join(above, name)).st_blocks * 512 for name in names)
    return total
