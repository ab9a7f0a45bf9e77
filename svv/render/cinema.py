"""A scene as a Cinema database (Spec D): images by phi and theta, depth, and a layer for each region."""

from __future__ import annotations

import csv
import io
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from svv.core.geometry.cameras import Camera
from svv.core.geometry.phi_theta import paraview_rotations
from svv.core.json_values import parsed
from svv.core.sharing import ALONE, Sharing
from svv.errors import BadInput, Progress, part, silent
from svv.io.cinema.shot import BESIDE, view_angle
from svv.io.cinema.table import TABLE
from svv.io.files.atomic import atomic_path, cannot_write, make_folder, sync_folder, write_json
from svv.io.files.keyed_results import digest
from svv.io.pictures.output import to_bytes, write_depth_png, write_png
from svv.options.cinema import ExportOptions
from svv.options.described import chosen

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

KEY = ".key.json"
"""File in an unfinished database that tells which scene and options it belongs to."""


def write_database(
    path: Path, scene: Scene, options: ExportOptions, progress: Progress = silent, sharing: Sharing = ALONE
) -> int:
    """Write a database, ``NAME.cdb``, which replaces one of the same name once complete; return how many views it has.

    Everything is written to a hidden folder beside ``path``, which a repeated call with the same scene and options
    continues, and which all processes that share the work see. Raises BadInput if the path is something else than a
    database, or cannot be written, or the scene has no cameras or does not have that network.
    """
    if path.exists() and not (path.is_dir() and _only_ours(path)):
        raise BadInput(
            f"{path} exists and is not a Cinema database that svv wrote, or has other files; choose another name."
        )
    if options.network is not None and options.network not in scene.networks:
        raise BadInput(f"The scene has no network '{options.network}', only {', '.join(scene.networks)}.")
    staging = path.with_name(f".{path.name}.partial")
    sharing.once(lambda: _begin(staging, scene, options))
    views = list(_views(scene, options))
    mine = sharing.mine(len(views))
    for done, index in enumerate(mine):
        each = part(progress, done / len(mine), (done + 1) / len(mine))
        _write_view(staging, scene, views[index][2], index, options, each)
        progress((done + 1) / len(mine), f"view {done + 1} of {len(mine)}")
    sharing.wait()
    if not sharing.is_first:
        return len(views)
    rows = [
        {"phi": f"{phi:g}", "theta": f"{theta:g}", **_write_view(staging, scene, camera, index, options, progress)}
        for index, (phi, theta, camera) in enumerate(views)
    ]
    write_json(staging / BESIDE, _shot_of(scene, views[0][2]))
    _write_table(staging / TABLE, rows)
    _move_in(staging, path)
    return len(views)


def _only_ours(folder: Path) -> bool:
    """Return whether a folder holds nothing but a database of :func:`write_database`: others' names differ."""
    there = {file.name for file in folder.iterdir()}
    ours = re.compile(r"\d{5}(_depth|_region_\d+)?\.png")
    return not there or (
        {TABLE, BESIDE} <= there and all(ours.fullmatch(name) for name in there - {TABLE, BESIDE, KEY})
    )


def _begin(staging: Path, scene: Scene, options: ExportOptions) -> None:
    """Make the folder of the files that are being written, empty unless it has some of this database."""
    key = {"scene": digest(scene.to_bytes(whole=False)), "options": chosen(options)}
    if _key_of(staging) != key:
        shutil.rmtree(staging, ignore_errors=True)
        make_folder(staging)
        write_json(staging / KEY, key)


def _views(scene: Scene, options: ExportOptions) -> Iterator[tuple[float, float, Camera]]:
    """Yield phi and theta in degrees, and the camera."""
    rig = scene.rig
    for phi in 360.0 * np.arange(options.phi) / options.phi:
        for theta in -90.0 + 180.0 * (np.arange(options.theta) + 0.5) / options.theta:
            matrix = np.eye(4)
            matrix[:3, :3] = paraview_rotations(phi, theta)
            matrix[:3, 3] = np.asarray(rig.centre) + rig.radius * matrix[:3, 2]
            yield float(phi), float(theta), Camera(matrix, rig.fov_x, options.size, options.size, rig.span_x)


def _shot_of(scene: Scene, camera: Camera) -> dict[str, object]:
    """Return the content of ``camera.json``, from which the images' cameras are restored."""
    height = (camera.span_x or scene.rig.view_width) * camera.height / camera.width
    return {
        "focal_point": list(scene.rig.centre),
        "distance": scene.rig.radius,
        "view_angle": view_angle(camera.fov_x, camera.width, camera.height),
        "parallel_projection": camera.is_orthographic,
        "parallel_scale": 0.5 * height,
    }


def _write_view(
    folder: Path, scene: Scene, camera: Camera, index: int, options: ExportOptions, progress: Progress
) -> dict[str, str]:
    """Write the files of a view that are not there yet, and return their names by column, the picture last."""
    network = options.network or scene.networks[-1]
    regions = len(scene.regions) if network != "base" else 0
    files: dict[str, str] = {}
    if options.layers:
        files["FILE_depth"] = f"{index:05d}_depth.png"
        files |= {f"FILE_region_{k}": f"{index:05d}_region_{k}.png" for k in range(regions)}
    files["FILE"] = f"{index:05d}.png"  # last, as pycinema shows the last column of files
    if (folder / files["FILE"]).is_file():
        return files  # written after its layers
    view = scene.render(camera, network, None, progress)
    if options.layers:
        write_depth_png(folder / files["FILE_depth"], view.depth)
        for k in range(regions):
            # A layer has the pixels to which its region contributes most; all add up to the picture.
            layer = np.where((view.region == k)[..., None], to_bytes(view.rgba), 0).astype(np.uint8)
            write_png(folder / files[f"FILE_region_{k}"], layer)
    write_png(folder / files["FILE"], view.rgba)
    return files


def _write_table(path: Path, rows: list[dict[str, str]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    with atomic_path(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")


def _move_in(staging: Path, path: Path) -> None:
    old = path.with_name(f".{path.name}.old")
    try:
        if path.exists():
            shutil.rmtree(old, ignore_errors=True)
            path.rename(old)
        try:
            staging.rename(path)
        except OSError:
            if old.exists():
                old.rename(path)
            raise
        sync_folder(path.parent)
        (path / KEY).unlink()  # not before: if the process is killed, the next one goes on with what is here
    except OSError as error:
        raise cannot_write(path, error) from error
    shutil.rmtree(old, ignore_errors=True)


def _key_of(folder: Path) -> object:
    try:
        return parsed((folder / KEY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
