"""Splats as .ply, as the authors of 3D Gaussian splatting write them: binary, little endian, a row for each splat.

Scales are natural logarithms, opacities logits, quaternions w, x, y, z; ``f_rest`` has all coefficients of red, then
green, then blue. Rows also have the number of the region, and comments the regions' names, the background and the
place, which programs skip.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from svv.core.json_values import number_in, parsed, vector_in
from svv.errors import BadInput, Progress, silent
from svv.fields.splats.splats import Splats
from svv.io.files.atomic import atomic_path
from svv.render.splats.placing import Place, regions_of

LEAST_ALPHA = 1e-6
"""Opacities are at least this much from 0 and 1, whose logits are infinite."""

CHUNK = 1 << 16
"""Splats that are written at once."""

COMMENT = "comment svv"
"""Begins lines that other readers skip."""


def names_of(harmonics: int) -> list[str]:
    """Return the names of a row's numbers, for 1, 4, 9 or 16 harmonics.

    >>> names_of(1)[3:8]
    ['f_dc_0', 'f_dc_1', 'f_dc_2', 'opacity', 'scale_0']
    """
    rest = [f"f_rest_{k}" for k in range(3 * (harmonics - 1))]
    shape = ["opacity", *(f"scale_{k}" for k in range(3)), *(f"rot_{k}" for k in range(4))]
    return ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", *rest, *shape, "region"]


def write_ply(path: Path, splats: Splats, place: Place, progress: Progress = silent) -> None:
    """Write splats, whose positions are those of ``place``, whole or not at all; raises BadInput as `atomic_path`."""
    names = names_of(splats.harmonics.shape[1])
    header = [
        "ply", "format binary_little_endian 1.0",
        *(f"{COMMENT} {key} {json.dumps(value)}" for key, value in (
            ("origin", place.origin), ("unit", place.unit), ("background", splats.background),
        )),
        *(f"{COMMENT} region {number} {json.dumps(name)}" for number, name in enumerate(splats.names)),
        f"element vertex {len(splats)}", *(f"property float {name}" for name in names), "end_header", "",
    ]  # fmt: skip
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write("\n".join(header).encode("ascii"))
        for start in range(0, len(splats), CHUNK):
            progress(start / len(splats), "writing")
            file.write(_rows(splats, slice(start, start + CHUNK)).tobytes())
    progress(1.0, "writing")


def read_ply(path: Path) -> tuple[Splats, Place]:
    """Return a file's splats in its own place, and the place; raises BadInput if it is not a .ply of splats."""
    content = path.read_bytes()
    head, found, body = content.partition(b"end_header\n")
    lines = head.decode("ascii", "replace").splitlines()
    if lines[:2] != ["ply", "format binary_little_endian 1.0"] or not found:
        raise BadInput(f"{path} is no binary .ply file with the least byte first: save it as one.")
    stated = [line for line in lines if line.startswith(("element ", "property "))]
    names = [line.split()[2] for line in stated[1:] if re.fullmatch(r"property float \w+", line)]
    vertices = re.fullmatch(r"element vertex (\d{1,9})", stated[0]) if stated else None
    if vertices is None or len(stated) != 1 + len(names):
        raise BadInput(f"{path} must have vertices alone, all of whose properties are floats, as 3DGS writes them.")
    rest = sum(name.startswith("f_rest_") for name in names)
    wanted = names_of(1 + rest // 3)
    if rest not in (0, 9, 24, 45) or not set(wanted[:-1]) <= set(names):
        raise BadInput(f"{path} does not hold Gaussian splats: it has the properties {', '.join(names)}.")
    if len(body) != 4 * int(vertices[1]) * len(names):
        raise BadInput(f"{path} is truncated: copy it again.")
    rows = np.frombuffer(body, "<f4").reshape(-1, len(names))
    told = _told(path, lines)
    place = Place(vector_in(told.get("origin", [0, 0, 0]), "origin"), number_in(told.get("unit", 1.0), "unit"))
    return _splats_of({name: rows[:, k] for k, name in enumerate(names)}, wanted, told), place


def _rows(splats: Splats, chosen: slice) -> np.ndarray:
    """The numbers of some of the splats' rows. (n, P)"""
    alpha = np.clip(splats.opacities[chosen].astype(float), LEAST_ALPHA, 1.0 - LEAST_ALPHA)
    harmonics = splats.harmonics[chosen]
    return np.concatenate([
        splats.centres[chosen], harmonics[:, 0], harmonics[:, 1:].transpose(0, 2, 1).reshape(len(harmonics), -1),
        (np.log(alpha) - np.log1p(-alpha))[:, None], np.log(splats.scales[chosen]), splats.rotations[chosen],
        splats.regions[chosen][:, None],
    ], axis=1).astype("<f4")  # fmt: skip


def _told(path: Path, lines: list[str]) -> dict[str, object]:
    """What comments of svv say, by key."""
    told: dict[str, object] = {}
    for line in lines:
        if match := re.fullmatch(COMMENT + r" (origin|unit|background|region \d{1,5}) (.*)", line):
            try:
                told[match[1]] = parsed(match[2])
            except ValueError as error:
                raise BadInput(f"{path} has a damaged comment, '{line}': copy it again.") from error
    return told


def _splats_of(columns: dict[str, np.ndarray], wanted: list[str], told: dict[str, object]) -> Splats:
    def stacked(prefix: str) -> np.ndarray:
        return np.stack([columns[name] for name in wanted if name.startswith(prefix)], axis=1).astype(float)

    n = len(columns["x"])
    rest = stacked("f_rest_").reshape(n, 3, -1).transpose(0, 2, 1) if "f_rest_0" in wanted else np.zeros((n, 0, 3))
    named = {int(key.split()[1]): value for key, value in told.items() if key.startswith("region ")}
    regions, names = regions_of(columns.get("region", np.zeros(n)), named)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # who reads checks all values
        turns = stacked("rot_")
        turns /= np.linalg.norm(turns, axis=1, keepdims=True)
        values = (np.exp(stacked("scale_")), turns, 1.0 / (1.0 + np.exp(-columns["opacity"].astype(float))))
        scales, rotations, opacities = (array.astype(np.float32) for array in values)
    return Splats(
        centres=np.stack([columns[axis] for axis in "xyz"], axis=1), scales=scales, rotations=rotations,
        opacities=opacities, harmonics=np.concatenate([stacked("f_dc_")[:, None], rest], axis=1).astype(np.float32),
        regions=regions, names=names,
        background=vector_in(told.get("background", [1, 1, 1]), "background"),
    )  # fmt: skip
