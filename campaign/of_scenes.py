"""Scene files, what is packed in them, and checkpoints."""

from __future__ import annotations

import json
import struct
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import torch

from campaign.mutate import changed, deflated, json_like, near, some_bytes, value
from campaign.running import Parser
from svv.core.geometry.box import Box
from svv.core.volumes.packing import packed, unpacked
from svv.errors import BadInput
from svv.fields.radiance.encodings import LatticeAdam
from svv.fields.radiance.networks import BaseField, FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.of_values import SLOPES, TABLES, VALUES
from svv.fields.radiance.rendering import Marching
from svv.fields.radiance.time_steps import TimeSteps, packed_codes, packed_moves
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.io.scene_file import parse_scene, scene_bytes
from svv.train.run.checkpoint import Checkpoint
from tests.cube import cube_paint, cube_scene, lit_cube_scene

TYPES = ("BOOL", "U8", "I8", "F8_E5M2", "F8_E4M3", "I16", "U16", "F16", "BF16", "I32", "U32", "F32", "F64", "I64",
         "U64", "F4", "C64", "", "f32", 7, None)  # fmt: skip


@cache
def scenes() -> tuple[bytes, ...]:
    """Return files of scenes: plain, lit, painted, with parts, and with time steps."""
    cube = cube_scene()
    painted = cube.painted(cube_paint(cube, 1), {0: "a"}, {"paint": 1}).painted(cube_paint(cube, 2), {1: "b"}, {})
    every = [cube, lit_cube_scene(), painted]
    files = [scene_bytes(*scene.to_arrays(), deflate=k != 1) for k, scene in enumerate(every)]
    return (*files, _with_parts(files[0]), _with_steps())


def _with_parts(content: bytes) -> bytes:
    header, tensors = parse_scene(content, "s")
    part = {**header["regions"][0], "part_of": 0}
    header["regions"] = [*header["regions"], part]
    header["parts"] = {"cells": 4}
    tensors["parts.zone"] = np.zeros((64, 1), np.uint8)
    tensors["parts.inside"] = np.array([[1], [0]], np.uint8)
    Scene.from_bytes(made := scene_bytes(header, tensors, deflate=True))
    return made


def _with_steps() -> bytes:
    """Return a scene that keeps its volume's values, at two times, instead of its tables."""
    cells, box = 4, Box((-0.5,) * 3, 1.0, (1.0,) * 3)
    field = FieldSettings(resolutions=(8,), width=16, lighting="none")
    occupancy = Occupancy(box, cells, np.ones((cells,) * 3, np.uint8))
    bare = Scene(field, occupancy, Marching(1 / 16), BaseField(field, occupancy).requires_grad_(False))
    header, tensors = bare.to_arrays()
    codes = np.arange(5**3, dtype=np.uint16).reshape(5, 5, 5) * 64
    moves = packed_moves(np.zeros((3, 5, 5, 5)))
    steps = TimeSteps(box, cells, (0.0, 1.0), (0.0, 1.0), (packed_codes(codes),) * 2, (None, moves))
    header["steps"] = steps.to_json()
    header["values"] = {"interval": (0.0, 1.0), "visible": (0.1, 0.9), "size": 1.0}
    tensors |= {**steps.to_arrays(), "extinction_table": np.zeros(VALUES * SLOPES, np.float32)}
    made = scene_bytes(header, {name: a for name, a in tensors.items() if name not in TABLES}, deflate=True)
    Scene.from_bytes(made)
    return made


def taken_apart(content: bytes) -> tuple[dict[str, Any], dict[str, Any], bytes]:
    """Return the safetensors header, our header in it, and the data."""
    end = 8 + int.from_bytes(content[:8], "little")
    outer = json.loads(content[8:end])
    return outer, json.loads(outer["__metadata__"]["svv"]), content[end:]


def put_together(outer: dict[str, Any], own: Any, data: bytes) -> bytes:
    """Invert :func:`taken_apart`."""
    text = own if isinstance(own, str) else json.dumps(own)
    rest = {name: told for name, told in outer.items() if name != "__metadata__"}
    header = json.dumps({"__metadata__": {"svv": text}, **rest}, separators=(",", ":")).encode()
    return struct.pack("<Q", len(header)) + header + data


def small() -> bytes:
    """Return a container that is not a scene, but small."""
    tensors = {"a": np.arange(6, dtype=np.float32), "b": np.zeros((4, 2), np.uint8), "c": np.ones(1, np.float16)}
    return scene_bytes({"box": {"low": [0, 0, 0]}, "regions": [{"a": 1}], "parts": 1}, tensors, deflate=True)


SMALL = small()


def container_like(random: Random) -> bytes:
    """Return a small container with changed headers, tensors or bytes."""
    return altered(SMALL, random)


def scene_like(random: Random) -> bytes:
    """Return a scene with changed headers, tensors or bytes."""
    return altered(random.choice(scenes()), random)


def altered(content: bytes, random: Random) -> bytes:
    """Return a container with changed headers, tensors or bytes."""
    kind = random.random()
    if kind < 0.15:
        return some_bytes(content, random)
    own: Any
    outer, own, data = taken_apart(content)
    if kind < 0.6:
        own = changed(own, random)
    elif kind < 0.85:
        outer = _other_tensors(outer, random)
    elif kind < 0.9:
        data = some_bytes(data, random)
    elif kind < 0.9005:
        outer, data = _bomb(own, random)
    elif kind < 0.93:
        own = json.dumps(own)[:-1] + ', "version": 3, ' + json.dumps(own)[1:]
    elif kind < 0.9301:
        own = "[" * 100_000
    elif kind < 0.9302:
        names = {f"t{k}": {"dtype": "U8", "shape": [0], "data_offsets": [0, 0]} for k in range(100_000)}
        return put_together(names, own, b"")
    else:
        made = put_together(outer, changed(own, random), data)
        length = random.choice((0, 1, 2**31, 2**63, 100_000_001, len(made) - 8, len(made) - 9))
        return struct.pack("<Q", length) + made[8:]
    return put_together(outer, own, data)


def _other_tensors(outer: dict[str, Any], random: Random) -> dict[str, Any]:
    """Return a header in which types, shapes or offsets of tensors lie, or tensors overlap or change places."""
    outer = json.loads(json.dumps(outer))
    names = [name for name in outer if name != "__metadata__"]
    one, other = outer[random.choice(names)], outer[random.choice(names)]
    kind = random.randrange(7)
    if kind == 0:
        one["dtype"] = random.choice(TYPES)
    elif kind == 1:
        one["shape"] = value(random)
    elif kind == 2 and one["shape"]:
        one["shape"][random.randrange(len(one["shape"]))] = value(random)
    elif kind == 3:
        one["data_offsets"] = [value(random), value(random)]
    elif kind == 4:
        one["data_offsets"], other["data_offsets"] = other["data_offsets"], one["data_offsets"]
    elif kind == 5:
        one |= other
    else:
        outer[random.choice(("x", "", "__metadata__", "base.density.table", "occupied"))] = dict(other)
        one["shape"] = [near(n, random) for n in one["shape"]]
    return outer


@cache
def _bombs() -> tuple[bytes, ...]:
    return tuple(deflated(count) for count in (1 << 20, 1 << 25))


def _bomb(own: dict[str, Any], random: Random) -> tuple[dict[str, Any], bytes]:
    """Return tensors that inflate to much more than the scene needs."""
    bomb = random.choice(_bombs())
    own["deflated"] = {"t": [random.choice((1 << 10, 1 << 16, 1 << 30)), random.choice((1, 1 << 4, 1 << 10))]}
    return {"t": {"dtype": "U8", "shape": [len(bomb)], "data_offsets": [0, len(bomb)]}}, bomb


def declared_by_scene(content: bytes) -> int:
    """Return three times the size of a scene's tables (inflating takes so many copies), and that of its content."""
    try:
        _, own, _ = taken_apart(content)
        tables = sum(max(0, rows * columns) for rows, columns in own.get("deflated", {}).values())
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError, MemoryError):
        tables = 0
    return 60 * len(content) + 3 * min(tables, 1032 * len(content))


def packing(folder: Path) -> Parser:
    """Packed grids: six bytes of shape, then the content."""
    shapes = [(3, 4, 5), (3, 4, 2, 2), (7,), (12, 8, 2)]
    grids = [packed(np.arange(int(np.prod(s)), dtype=np.uint16).reshape(s)).tobytes() for s in shapes]
    bomb = deflated(1 << 22)

    def make(random: Random) -> bytes:
        number = random.randrange(len(shapes))
        content = bomb if random.random() < 0.01 else grids[number]
        return bytes([number]) + (some_bytes(content, random) if random.random() < 0.8 else content)

    def read(content: bytes) -> None:
        try:
            unpacked(np.frombuffer(content, np.uint8, offset=1), shapes[content[0] % len(shapes)])
        except ValueError as error:
            raise BadInput(str(error)) from error  # what scenes make of it

    return Parser("packed grids", read, make)


def checkpoints(folder: Path) -> Parser:
    """Checkpoints of the same run, restored into a network of the expected shape."""
    cube = cube_scene()
    path = folder / "s.svv.checkpoint"
    key = {"views": "a"}

    def stage(held: Checkpoint, network: BaseField) -> Any:
        mlp = torch.optim.Adam(network.colour_mlp.parameters())
        return held.stage("base", network, mlp, LatticeAdam(network.encodings))

    network = BaseField(cube.settings, cube.occupancy).requires_grad_(True)
    begun = Checkpoint(path, key)
    begun.finish("carve", {"seconds": 1.0}, {"occupied": np.ones(4, np.uint8)})
    state = stage(begun, network)
    state.optimiser.zero_grad()
    torch.stack([p.square().sum() for p in network.colour_mlp.parameters()]).sum().backward()
    state.optimiser.step()
    state.save(3, 1.0, {"age": np.zeros(2)})
    whole = path.read_bytes()

    def make(random: Random) -> bytes:
        outer, own, data = taken_apart(whole)
        if random.random() < 0.5:
            own["header"]["progress"] = changed(own["header"]["progress"], random)
            own["header"]["finished"] = changed(own["header"]["finished"], random)
        elif random.random() < 0.5:
            outer = _other_tensors(outer, random)
        else:
            return some_bytes(whole, random)
        return put_together(outer, own, data)

    def read(content: bytes) -> None:
        path.write_bytes(content)
        held = Checkpoint(path, key)
        stage(held, network)
        held.extra("base")

    return Parser("checkpoints", read, make, declared_by_scene)


def container(folder: Path) -> Parser:
    """The container alone: fast, so that it gets most inputs."""
    return Parser("scene container", lambda content: parse_scene(content, "s.svv"), container_like, declared_by_scene)


def whole(folder: Path) -> Parser:
    """Scenes with all their networks, described and, if they are valid, cast one ray into."""

    def read(content: bytes) -> None:
        Scene.from_bytes(content, "s.svv").info()

    return Parser("scenes", read, scene_like, declared_by_scene)


def headers(folder: Path) -> Parser:
    """Regions and history, which edits and undo read."""
    header, _ = Scene.from_bytes(scenes()[2]).edited(0, opacity=0.5).to_arrays()
    from svv.fields.scene.history import History

    seed = json.loads(json.dumps({"history": header["history"], "region": header["regions"][0]}))
    own = tuple(Region(tuple(r["colour"]), r["share"]) for r in json.loads(json.dumps(header["regions"])))

    def read(content: bytes) -> None:
        from svv.core.json_values import parsed

        try:
            History.from_json(parsed(content.decode())["history"], own)  # type: ignore[index]
        except (KeyError, TypeError, ValueError, ArithmeticError, RuntimeError) as error:
            raise BadInput(str(error) or type(error).__name__) from error  # as scenes do

    return Parser("edit histories", read, json_like(seed))


ALL = {"container": container, "scenes": whole, "packing": packing, "checkpoints": checkpoints, "history": headers}
