"""Writes a baked volume as OpenVDB, for Blender, Houdini and other programs that draw smoke and clouds.

The file holds two grids in world units: ``density`` is the extinction, in 1 / world unit, and ``Cd`` the colour, both
named as these programs expect. They draw with linear light, so colours are sRGB's, decoded. OpenVDB itself is not a
dependency: a Python that has its module writes the file (:mod:`svv.io.openvdb_script`).
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from svv._version import __version__
from svv.core.volumes.opacity_code import depths
from svv.errors import BadInput, Progress, silent
from svv.io import openvdb_script
from svv.io.files.atomic import atomic_path, write_json
from svv.render.baking.baked_volume import BakedVolume

PYTHON = "SVV_OPENVDB_PYTHON"
"""Environment variable that names a Python with OpenVDB's module."""

SYSTEM = "/usr/bin/python3"
"""The Python for which Linux distributions package the module."""

MISSING = (
    "Writing .vdb needs OpenVDB's Python module, which {} not have: install it (Debian, Ubuntu: sudo apt-get install "
    f"python3-openvdb), or let {PYTHON} name a Python that has it."
)


def python_with_openvdb() -> str:
    """Return the path of a Python that can write OpenVDB files.

    Raises:
        BadInput: There is none.
    """
    named = os.environ.get(PYTHON)
    candidates = [named] if named else list(dict.fromkeys([sys.executable, SYSTEM]))
    find = "import importlib.util as u, sys; sys.exit(not any(map(u.find_spec, ('openvdb', 'pyopenvdb'))))"
    for python in candidates:
        try:
            if subprocess.run([python, "-c", find], capture_output=True).returncode == 0:
                return python
        except OSError:
            continue  # there is no such program
    raise BadInput(MISSING.format(f"{' and '.join(candidates)} do{'es' * (len(candidates) == 1)}"))


def write_vdb(path: Path, volume: BakedVolume, progress: Progress = silent) -> None:
    """Write a volume as an OpenVDB file with the grids ``density`` and ``Cd``.

    Args:
        path: The file, by convention ``NAME.vdb``.
        volume: The volume.
        progress: Called while the file is written; writing stops when it raises.

    Raises:
        BadInput: Nothing is visible, no Python here has OpenVDB's module, or the file cannot be written.
    """
    if volume.empty:
        raise BadInput("Nothing in the scene is visible: show a region, or make it more opaque.")
    python = python_with_openvdb()
    with atomic_path(path) as temporary, TemporaryDirectory() as folder:
        progress(0.0, "converting")
        density, colour = grids_of(volume)
        np.save(Path(folder) / "density.npy", density)
        np.save(Path(folder) / "colour.npy", colour)
        write_json(Path(folder) / "told.json", {
            "origin": volume.grid.origin, "spacing": volume.grid.spacing, "creator": f"svv {__version__}",
        })  # fmt: skip
        del density, colour
        _run([python, openvdb_script.__file__, folder, str(temporary)], path, progress)
    progress(1.0, "writing")


def grids_of(volume: BakedVolume) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return extinction in 1 / world unit (X, Y, Z) and linear colour (X, Y, Z, 3) of a volume's points.

    Empty points beside visible ones have a colour, with which colours are interpolated; others are black.
    """
    codes = volume.rgba[..., 3].transpose(2, 1, 0)
    density = (depths(volume.most) / volume.grid.unit_distance).astype(np.float32)[codes]
    near = maximum_filter(codes > 0, 3)
    levels = np.arange(256) / 255.0
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4).astype(np.float32)
    colour = linear[volume.rgba[..., :3].transpose(2, 1, 0, 3)] * near[..., None]
    return np.ascontiguousarray(density), np.ascontiguousarray(colour)


def _run(command: list[str], path: Path, progress: Progress) -> None:
    """Run the program that writes the file, and end it if the user cancels."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as running:
        try:
            while running.poll() is None:
                progress(0.3, "writing")
                time.sleep(0.05)
        except BaseException:
            running.kill()
            raise
        said = "" if running.stderr is None else running.stderr.read()
    if running.returncode != 0:
        reason = said.strip().splitlines()[-1] if said.strip() else f"exit code {running.returncode}"
        raise BadInput(f"Cannot write {path}: OpenVDB in {command[0]} failed ({reason}).")
