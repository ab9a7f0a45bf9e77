"""Prepares the environment in which a ParaView finds the packages that svv works with: once for each Python.

It is a folder that pip fills (``--target``) rather than a virtual environment, so that no interpreter of ParaView's
version is needed: ParaView brings its own.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from svv.errors import BadInput
from svv.pv.start import SECOND_VTK, STAMP, ParaView, environment_folder, find, python_path

TOO_NEW = "numpy<2.4"
"""From 2.4 on numpy breaks ParaView's Calculator and Programmable Filter (tried with 5.11)."""

PINNED_FROM = (3, 11)
"""The oldest Python that the versions in constraints.txt are made for; an older one gets the newest that fit it."""


def prepare(folder: str | Path | None = None) -> str:
    """Fill the environment of a ParaView, unless that is done already.

    Args:
        folder: Where ParaView is unpacked; see :func:`svv.pv.start.find`.

    Returns:
        One line that says what there is now.

    Raises:
        BadInput: no ParaView, or the packages cannot be had or do not work in it.
    """
    paraview = find(folder)
    target = environment_folder(paraview)
    packages, pins = requirements(paraview)
    stamp = {
        "python": ".".join(map(str, paraview.python)),
        "packages": hashlib.sha256("\n".join([*packages, *pins]).encode()).hexdigest(),
    }
    line = f"ParaView {'.'.join(map(str, paraview.version))} in {paraview.bin}: its environment is {target}"
    if _read_stamp(target) == stamp:
        return line
    partial = target.with_name(f"{target.name}.partial")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        print(f"Installing into {target}: a few minutes, once.", file=sys.stderr, flush=True)
        _install(paraview, partial, packages, pins)
        _check(paraview, partial)
        (partial / STAMP).write_text(json.dumps(stamp))
        shutil.rmtree(target, ignore_errors=True)
        partial.replace(target)
    except OSError as error:
        raise BadInput(f"Cannot write the environment {target}: {error.strerror or error}.") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return line


def requirements(paraview: ParaView) -> tuple[list[str], list[str]]:
    """What pip is asked for: svv's own dependencies without its extras, torch first, and exact versions of all."""
    packages = [*sorted(_dependencies(), key=lambda package: not package.startswith("torch")), TOO_NEW]
    try:
        pins = (_root() / "constraints.txt").read_text().splitlines()
    except OSError:
        pins = []  # no checkout: the newest that fit
    return packages, pins if paraview.python >= PINNED_FROM else [pin for pin in pins if pin.startswith("torch==")]


def _dependencies() -> list[str]:
    """svv's dependencies without its extras: of the checkout, or as installed."""
    try:
        import tomllib

        with (_root() / "pyproject.toml").open("rb") as file:
            return list(tomllib.load(file)["project"]["dependencies"])
    except (ImportError, OSError):
        pass
    try:
        found = importlib.metadata.requires("svv") or []
    except importlib.metadata.PackageNotFoundError as error:
        raise BadInput("svv does not know what it depends on: install it with pip, or use a checkout.") from error
    return [line for line in found if "extra ==" not in line]


def _install(paraview: ParaView, folder: Path, packages: list[str], pins: list[str]) -> None:
    """Let pip fill the folder.

    In one call: pip does not see what an earlier one put into a ``--target``, and would take torch twice.
    """
    constraints = folder / "constraints.txt"
    constraints.write_text("\n".join(pins))
    command = [sys.executable, "-m", "pip", "install", "-qq", "--disable-pip-version-check", "--no-input"]
    command += ["--target", str(folder), "-c", str(constraints)]
    if paraview.python != sys.version_info[:2]:
        command += ["--python-version", ".".join(map(str, paraview.python)), "--only-binary=:all:"]
    if subprocess.run([*command, *packages]).returncode:
        raise BadInput("pip could not install what svv needs for ParaView; what it said stands above.")


def _check(paraview: ParaView, folder: Path) -> None:
    """Find out in ParaView itself whether the packages work, and that no second VTK came with them."""
    clash = [name for name in SECOND_VTK if (folder / name).exists()]
    if clash:
        raise BadInput(f"The environment would bring ParaView a second VTK ({', '.join(clash)}): report this, please.")
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join(python_path(paraview, folder, {}))}
    environ.pop("PV_PLUGIN_PATH", None)
    script = "import vtkmodules, numpy, svv, torch, numba, skimage, scipy; print('svv: all there', svv.__file__)"
    done = subprocess.run([paraview.program("pvpython"), "-c", script], env=environ, capture_output=True, text=True)
    if "svv: all there" not in done.stdout:
        last = (done.stderr.strip().splitlines() or ["it ended without a word"])[-1]
        raise BadInput(f"The packages are installed, but ParaView's Python does not load them: {last}.")


def _read_stamp(target: Path) -> object:
    try:
        return json.loads((target / STAMP).read_text())
    except (OSError, ValueError):
        return None


def _root() -> Path:
    return Path(__file__).resolve().parents[2]
