"""Splats as .glb: binary glTF 2.0 with the extension KHR_gaussian_splatting (release candidate of 2026).

Scales and opacities are linear, quaternions x, y, z, w, colours sRGB. Programs without the extension draw points.
All splats are one mesh, and their regions an attribute: three.js (r187) sorts the splats of each mesh by themselves, so
meshes of nested regions would be drawn over each other.
https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos/KHR_gaussian_splatting
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from svv._version import __version__
from svv.core.colour.srgb import linear
from svv.core.json_values import number_in, parsed, vector_in
from svv.errors import BadInput, Progress, silent
from svv.fields.splats.splats import Splats
from svv.io.files.atomic import atomic_path
from svv.render.splats.placing import Place, regions_of

EXTENSION = "KHR_gaussian_splatting"
FLOAT, SHORT = 5126, 5123
KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
Y0 = 0.28209479177387814
"""The constant real spherical harmonic."""


def write_glb(path: Path, splats: Splats, place: Place, progress: Progress = silent) -> None:
    """Write splats, whose positions are those of ``place``, whole or not at all; raises BadInput as `atomic_path`.

    A node puts them where they are in the world, in the place's unit: three.js and PlayCanvas draw nothing if it scales
    them to 1e-9.
    """
    attributes = _attributes(splats)
    blocks = [values.tobytes() for values in attributes.values()]
    starts = np.cumsum([0, *map(len, blocks)]).tolist()
    told = json.dumps({
        "asset": {"version": "2.0", "generator": f"svv {__version__}"}, "extensionsUsed": [EXTENSION],
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [_node(place)],
        "meshes": [{
            "name": "splats", "extras": {"regions": splats.names, "background": splats.background, "unit": place.unit},
            "primitives": [{
                "mode": 0, "attributes": {key: number for number, key in enumerate(attributes)},
                "extensions": {EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}},
            }],
        }],
        "accessors": [_accessor(key, values, number) for number, (key, values) in enumerate(attributes.items())],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(block), "target": 34962}
            for start, block in zip(starts, blocks, strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }).encode()  # fmt: skip
    told += b" " * (-len(told) % 4)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(
            struct.pack("<4sII", b"glTF", 2, 28 + len(told) + starts[-1]) + struct.pack("<I4s", len(told), b"JSON")
        )
        file.write(told + struct.pack("<I4s", starts[-1], b"BIN\0"))
        for number, block in enumerate(blocks):
            progress(number / len(blocks), "writing")
            file.write(block)
    progress(1.0, "writing")


def read_glb(path: Path) -> tuple[Splats, Place]:
    """Return the splats of a file in its own place, and the place; raises BadInput if it has no one mesh of them."""
    content = path.read_bytes()
    try:
        told, body = _chunks(content)
        (node,) = told["nodes"]
        mesh = told["meshes"][node["mesh"]]
        (primitive,) = mesh["primitives"]
        if EXTENSION not in primitive["extensions"] or node.keys() & {"rotation", "scale", "matrix", "children"}:
            raise ValueError("other meshes")
        numbers = primitive["attributes"]

        def values(key: str, width: int) -> np.ndarray:
            return _floats(told, body, numbers[key], width)

        degrees = [n for n in range(4) if f"{EXTENSION}:SH_DEGREE_{n}_COEF_0" in numbers]
        harmonics = [values(f"{EXTENSION}:SH_DEGREE_{n}_COEF_{k}", 3) for n in degrees for k in range(2 * n + 1)]
        centres, opacities = values("POSITION", 3), values(f"{EXTENSION}:OPACITY", 1)[:, 0]
        scales, turns = values(f"{EXTENSION}:SCALE", 3), values(f"{EXTENSION}:ROTATION", 4)
        region = values("_REGION", 1)[:, 0] if "_REGION" in numbers else np.zeros(len(centres))
        extras = mesh.get("extras") or {}
        regions, names = regions_of(region, dict(enumerate(extras.get("regions", ()))))
        splats = Splats(
            centres=centres, scales=scales, rotations=np.roll(turns, 1, axis=1), opacities=opacities,
            harmonics=np.stack(harmonics, axis=1), regions=regions, names=names,
            background=vector_in(extras.get("background", [1, 1, 1]), "background"),
        )  # fmt: skip
        unit = number_in(extras.get("unit", 1.0), "unit")
        x, y, z = vector_in(node.get("translation", [0, 0, 0]), "translation")
    except (struct.error, LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        raise BadInput(
            f"{path} is no whole .glb file with one mesh of splats, as svv writes it: copy it again, or convert it to "
            ".ply."
        ) from error
    return splats, Place((x * unit, y * unit, z * unit), unit)


def _chunks(content: bytes) -> tuple[Any, bytes]:
    """The JSON of a file, and its numbers; raises ValueError or struct.error."""
    magic, version, length, size, kind = struct.unpack_from("<4sIII4s", content)
    told = parsed(content[20 : 20 + size])
    (long, own) = struct.unpack_from("<I4s", content, 20 + size)
    body = content[28 + size : 28 + size + long]
    if (magic, version, kind, own) != (b"glTF", 2, b"JSON", b"BIN\0") or length > len(content) or len(body) != long:
        raise ValueError("no .glb")
    return told, body


def _floats(told: Any, body: bytes, number: int, width: int) -> np.ndarray:
    """The numbers of an accessor. (N, width)"""
    accessor = told["accessors"][number]
    view = told["bufferViews"][accessor["bufferView"]]
    if (accessor["componentType"], accessor["type"]) != (FLOAT, KINDS[width]) or "byteStride" in view:
        raise ValueError("other numbers")
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    return np.frombuffer(body, "<f4", accessor["count"] * width, start).reshape(-1, width)


def _attributes(splats: Splats) -> dict[str, np.ndarray]:
    """The vertices' attributes, each a multiple of 4 bytes a splat. (N, 1, 3 or 4)"""
    harmonics, alpha = splats.harmonics, splats.opacities[:, None]
    diffuse = linear(np.clip(0.5 + Y0 * harmonics[:, 0].astype(float), 0.0, 1.0))
    shown = np.concatenate([diffuse, alpha], axis=1)
    found = {
        "POSITION": splats.centres,
        "COLOR_0": np.rint(65535.0 * shown).astype("<u2"),
        f"{EXTENSION}:ROTATION": np.roll(splats.rotations, -1, axis=1),
        f"{EXTENSION}:SCALE": splats.scales,
        f"{EXTENSION}:OPACITY": alpha,
    }
    found["_REGION"] = splats.regions[:, None]
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


def _node(place: Place) -> dict[str, object]:
    node: dict[str, object] = {"name": "splats", "mesh": 0}
    return node | ({"translation": [x / place.unit for x in place.origin]} if any(place.origin) else {})
