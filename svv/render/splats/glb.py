"""Splats as .glb: binary glTF 2.0 with the extension KHR_gaussian_splatting (release candidate of 2026).

Scales and opacities are linear, quaternions x, y, z, w, colours sRGB. Programs without the extension draw points.
https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos/KHR_gaussian_splatting
"""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np

from svv._version import __version__
from svv.core.colour.srgb import linear
from svv.errors import Progress, silent
from svv.fields.splats.splats import Splats
from svv.io.files.atomic import atomic_path
from svv.render.splats.placing import Place

EXTENSION = "KHR_gaussian_splatting"
FLOAT, SHORT = 5126, 5123
KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
Y0 = 0.28209479177387814
"""The constant real spherical harmonic."""


def write_glb(path: Path, splats: Splats, place: Place, progress: Progress = silent) -> None:
    """Write splats, whose positions are those of ``place``, whole or not at all; raises BadInput as `atomic_path`."""
    views: list[dict[str, object]] = []
    accessors: list[dict[str, object]] = []
    blocks: list[bytes] = []
    meshes = []
    for region, name in enumerate(splats.names):
        chosen = splats.regions == region
        if chosen.any():
            attributes = {}
            for key, values in _attributes(splats, chosen).items():
                attributes[key] = len(accessors)
                accessors.append(_accessor(key, values, len(views)))
                start = sum(map(len, blocks))
                blocks.append(values.tobytes())
                views.append({"buffer": 0, "byteOffset": start, "byteLength": len(blocks[-1]), "target": 34962})
            meshes.append(_mesh(name, attributes))
    size = sum(map(len, blocks))
    told = json.dumps({
        "asset": {"version": "2.0", "generator": f"svv {__version__}"}, "extensionsUsed": [EXTENSION],
        "scene": 0, "scenes": [{"nodes": list(range(len(meshes))), "extras": {"background": splats.background}}],
        "nodes": [_node(mesh, number, place) for number, mesh in enumerate(meshes)], "meshes": meshes,
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": size}],
    }).encode()  # fmt: skip
    told += b" " * (-len(told) % 4)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(told) + size) + struct.pack("<I4s", len(told), b"JSON"))
        file.write(told + struct.pack("<I4s", size, b"BIN\0"))
        for number, block in enumerate(blocks):
            progress(number / len(blocks), "writing")
            file.write(block)
    progress(1.0, "writing")


def _attributes(splats: Splats, chosen: np.ndarray) -> dict[str, np.ndarray]:
    """A region's vertex attributes, each a multiple of 4 bytes a splat. (n, 1, 3 or 4)"""
    harmonics = splats.harmonics[chosen]
    diffuse = linear(np.clip(0.5 + Y0 * harmonics[:, 0].astype(float), 0.0, 1.0))
    shown = np.concatenate([diffuse, splats.opacities[chosen][:, None]], axis=1)
    found = {
        "POSITION": splats.centres[chosen],
        "COLOR_0": np.rint(65535.0 * shown).astype("<u2"),
        f"{EXTENSION}:ROTATION": np.roll(splats.rotations[chosen], -1, axis=1),
        f"{EXTENSION}:SCALE": splats.scales[chosen],
        f"{EXTENSION}:OPACITY": splats.opacities[chosen][:, None],
    }
    for degree in range(int(np.sqrt(harmonics.shape[1]))):
        for k in range(2 * degree + 1):
            found[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{k}"] = harmonics[:, degree**2 + k]
    return {key: values if values.dtype == "<u2" else values.astype("<f4") for key, values in found.items()}


def _accessor(key: str, values: np.ndarray, view: int) -> dict[str, object]:
    accessor: dict[str, object] = {
        "bufferView": view, "componentType": SHORT if values.dtype == "<u2" else FLOAT, "count": len(values),
        "type": KINDS[values.shape[1]],
    }  # fmt: skip
    if values.dtype == "<u2":
        accessor["normalized"] = True
    if key == "POSITION":
        accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
    return accessor


def _mesh(name: str, attributes: dict[str, int]) -> dict[str, object]:
    extension = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    return {"name": name, "primitives": [{"mode": 0, "attributes": attributes, "extensions": {EXTENSION: extension}}]}


def _node(mesh: dict[str, object], number: int, place: Place) -> dict[str, object]:
    node = {"name": mesh["name"], "mesh": number}
    return node if place == Place() else node | {"translation": place.origin, "scale": [place.unit] * 3}
