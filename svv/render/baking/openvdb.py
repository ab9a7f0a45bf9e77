"""Writes a baked volume as OpenVDB, for Blender, Houdini and other programs that draw smoke and clouds.

The grids are ``density``, the extinction in 1 / world unit, and ``Cd``, linear colours, as these programs expect. A
Python that has OpenVDB's module writes the file (:mod:`svv.io.openvdb_script`). OpenVDB refuses transforms of tiny
voxels (10.0.1 below 1.4e-5: it takes the determinant for 0), and programs hold transforms in single precision, so very
small or large voxels are written in another unit, a power of 1000 world units, the metadata's ``world_units``.
"""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from svv._version import __version__
from svv.core.colour.srgb import linear
from svv.core.volumes.opacity_code import depths
from svv.errors import BadInput, Progress, silent
from svv.io import openvdb_script
from svv.io.files.atomic import atomic_path, write_json
from svv.io.files.temporary import work_folder
from svv.io.openvdb_python import python_with_openvdb
from svv.render.baking.baked_volume import BakedVolume

SPACINGS = (1e-4, 1e4)
"""Distances between points, in world units, between which a file is in world units."""

FAR = 1e6
"""Distance from the origin in voxels above which single precision moves points by a tenth of a voxel."""


def unit_for(spacing: float) -> float:
    """Return the unit of a file in world units: 1, or a power of 1000 if the distance between points is extreme.

    >>> unit_for(0.5), unit_for(1e-9), unit_for(2e9)
    (1.0, 1e-09, 1000000000.0)
    """
    low, high = SPACINGS
    return 1.0 if low <= spacing <= high else 10.0 ** (3 * round(np.log10(spacing) / 3))


def write_vdb(path: Path, volume: BakedVolume, progress: Progress = silent) -> list[str]:
    """Write a volume as an OpenVDB file with the grids ``density`` and ``Cd``; return sentences on its unit and place.

    Raises BadInput if nothing is visible, no Python here has OpenVDB's module, or the file cannot be written.
    """
    if volume.empty:
        raise BadInput("Nothing in the scene is visible: show a region, or make it more opaque.")
    python, unit = python_with_openvdb(), unit_for(volume.grid.spacing)
    with atomic_path(path) as temporary, work_folder() as folder:
        progress(0.0, "converting")
        density, colour = grids_of(volume, unit)
        np.save(folder / "density.npy", density)
        np.save(folder / "colour.npy", colour)
        write_json(folder / "told.json", {
            "origin": [x / unit for x in volume.grid.origin], "spacing": volume.grid.spacing / unit,
            "metadata": {"creator": f"svv {__version__}", "world_units": unit},
        })  # fmt: skip
        del density, colour
        _run([python, openvdb_script.__file__, "write", str(folder), str(temporary)], path, progress)
    progress(1.0, "writing")
    notes = []
    if unit != 1.0:
        notes.append(
            f"A unit of the file is {unit:g} world units, because OpenVDB and Blender do not keep such voxels."
        )
    if max(map(abs, volume.grid.origin)) > FAR * volume.grid.spacing:
        notes.append(
            "It is so far from the origin that programs in single precision, such as Blender, move its voxels."
        )
    return notes


def grids_of(volume: BakedVolume, unit: float = 1.0) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return extinction in 1 / ``unit`` (world units) (X, Y, Z) and linear colour (X, Y, Z, 3) of a volume's points.

    Empty points beside visible ones have a colour, with which colours are interpolated; others are black.
    """
    codes = volume.rgba[..., 3].transpose(2, 1, 0)
    density = (depths(volume.most) / (volume.grid.unit_distance / unit)).astype(np.float32)[codes]
    near = maximum_filter(codes > 0, 3)
    levels = linear(np.arange(256) / 255.0).astype(np.float32)
    colour = levels[volume.rgba[..., :3].transpose(2, 1, 0, 3)] * near[..., None]
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
