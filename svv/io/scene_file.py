"""The container of a scene: named arrays and a JSON header in one safetensors file (``.svv``).

Nothing is pickled, so opening a scene from someone else never runs code. Any safetensors reader opens the file; the
header is the JSON under the metadata key ``svv``. In files (not in memory, where it would only cost time), tables of
bytes are deflated: the differences between successive rows, column by column. It is lossless and saves a sixth.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load

from svv._version import __version__
from svv.core.json_values import each_in, list_in, object_in, parsed, vector_in, whole_in
from svv.errors import BadInput
from svv.io.files.atomic import atomic_path, to_json
from svv.io.files.declared_sizes import MOST_INFLATED, check_fits

FORMAT_VERSION = 3
"""Incremented whenever an older program can no longer read a newer file, or the other way round."""

WITH_PARTS = 4
"""Format of scenes with parts of regions, which programs for format 3 cannot read."""

WITH_STEPS = 5
"""Format of scenes that keep their volume's values instead of tables, or several transfer functions."""

WITH_STROKES = 6
"""Format of scenes that keep brush strokes instead of the paint that follows from them."""

READABLE = (1, 2)
"""Older formats that can also be read: without variants and a history of edits; the tables of format 1 are half floats
instead of bytes."""

MOST_HEADER, MOST_ARRAYS = 8 << 20, 20_000
"""Largest header in bytes, and largest number of arrays, which a scene of thousands of time steps does not reach."""

TYPES = {
    "uint64": "U64", "int64": "I64", "float64": "F64", "float32": "F32", "uint32": "U32", "int32": "I32",
    "float16": "F16", "uint16": "U16", "int16": "I16", "int8": "I8", "uint8": "U8", "bool": "BOOL",
}  # fmt: skip
"""Name in a safetensors file of each of NumPy's types, in the order in which arrays lie there: all are aligned."""

_KEY, _TOLD = "svv", "told"
_REMEDY = "copy it again, or train the scene again"
_OUR_START = b'{"__metadata__":{"svv":'
_START = 8 + len(_OUR_START)
"""Length of the start of our files, which distinguishes a truncated scene from a foreign file."""


def checkpoint_of(scene: Path) -> Path:
    """Return the path where interrupted work on a scene file is kept until the same work resumes."""
    return scene.with_name(scene.name + ".checkpoint")


def sketch_of(scene: Path) -> Path:
    """Return the path of the sketch that is shown until a scene file is there."""
    return scene.with_name(scene.name + ".sketch")


def checkpoint_of_layer(checkpoint: Path, number: int) -> Path:
    """Return the path of the checkpoint of one of the scenes that a scene is joined from."""
    return checkpoint.with_name(f"{checkpoint.stem}.{number}{checkpoint.suffix}")


def remove_checkpoints(checkpoint: Path, layers: int = 0) -> None:
    """Delete the checkpoint of finished work, and those of the ``layers`` scenes that a scene is joined from."""
    for path in (checkpoint, *(checkpoint_of_layer(checkpoint, number) for number in range(layers))):
        path.unlink(missing_ok=True)


def write_scene_file(path: str | Path, header: Mapping[str, object], tensors: Mapping[str, np.ndarray]) -> None:
    """Write a scene, by convention ``NAME.svv``, whole or not at all.

    NumPy numbers and arrays of the header become plain values, and NaN becomes null; tensors are of bool, integer or
    float type (including float16). Raises BadInput if the file cannot be written.
    """
    pieces = _pieces(header, tensors, deflate=True)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        for piece in pieces:
            file.write(piece)


def scene_bytes(header: Mapping[str, object], tensors: Mapping[str, np.ndarray], deflate: bool = False) -> bytes:
    """Return the content of a scene file; :func:`write_scene_file` writes it with deflated tables."""
    return b"".join(_pieces(header, tensors, deflate))


def _pieces(
    header: Mapping[str, object], tensors: Mapping[str, np.ndarray], deflate: bool
) -> Iterator[bytes | memoryview]:
    """Yield a scene file's content by arrays, without a copy of all: the safetensors package would make two."""
    # safetensors ignores the strides of arrays, so the values would be read back in another order.
    arrays = {name: np.asarray(array, order="C") for name, array in tensors.items()}
    tables = {name: a.shape for name, a in arrays.items() if deflate and a.dtype == np.uint8 and a.ndim == 2 and a.size}
    arrays |= {name: _deflated(arrays[name]) for name in tables}
    told: dict[str, object] = {}
    end = 0
    names = sorted(arrays, key=lambda name: (list(TYPES).index(arrays[name].dtype.name), name))
    for name in names:
        array = arrays[name] = arrays[name].astype(arrays[name].dtype.newbyteorder("<"), copy=False)
        begin, end = end, end + array.nbytes
        told[name] = {"dtype": TYPES[array.dtype.name], "shape": array.shape, "data_offsets": [begin, end]}
    yield _start(header, tables, told)
    for name in names:
        yield arrays[name].reshape(-1).view(np.uint8).data


def _start(header: Mapping[str, object], tables: Mapping[str, object], arrays: Mapping[str, object]) -> bytes:
    """Return what lies before the arrays: the header, the shapes of the deflated tables, and where each array lies."""
    version = WITH_PARTS if "parts" in header else FORMAT_VERSION
    version = WITH_STEPS if "steps" in header or "layers" in header else version
    version = WITH_STROKES if "brushed" in header else version
    text = to_json({"version": version, "header": header, "deflated": tables})
    start = json.dumps({"__metadata__": {_KEY: text}, **arrays}, separators=(",", ":"), ensure_ascii=False).encode()
    start += b" " * (-len(start) % 8)
    return len(start).to_bytes(8, "little") + start


def write_with_header(path: str | Path, header: Mapping[str, object], content: bytes) -> None:
    """Write a scene with the arrays of another one's file, as they lie there, and a header that describes them.

    ``content``: that of the other file (:func:`scene_content`). Raises BadInput as :func:`write_scene_file`.
    """
    end = 8 + _length(content, str(path))
    told = parsed(content[8:end])
    tables = parsed(told.pop("__metadata__")[_KEY]).get("deflated", {})
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(_start(header, tables, told))
        file.write(memoryview(content)[end:])


def read_scene_file(path: str | Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read a scene's header and arrays; raises BadInput if the file is missing, damaged, or of another format."""
    return parse_scene(scene_content(Path(path)), str(Path(path)))


def read_scene_header(path: str | Path) -> dict[str, Any]:
    """Read a scene's header alone, which takes no time however large its arrays are; raises BadInput if that fails."""
    return header_in(scene_content(Path(path), whole=False), str(path))


def told_of(info: Mapping[str, object]) -> dict[str, object]:
    """Return what a scene file's header says of a scene in words and numbers, for :func:`read_scene_info`."""
    return {_TOLD: {"svv": __version__, "info": info}}


def read_scene_info(path: str | Path) -> dict[str, Any] | None:
    """Return what this version of svv wrote into a scene file of the scene (:meth:`svv.Scene.info`).

    It takes neither the arrays nor the libraries that they need. None if the file does not say it, or is not whole;
    raises BadInput as :func:`read_scene_header`.
    """
    return info_in(scene_content(Path(path), whole=False), str(path), Path(path).stat().st_size)


def info_in(content: bytes, name: str, size: int) -> dict[str, Any] | None:
    """Return what :func:`read_scene_info` does, from (the beginning of) a scene file's content of ``size`` bytes."""
    told, arrays = header_in(content, name).get(_TOLD), parsed(content[8 : 8 + _length(content, name)])
    try:
        ends = (array["data_offsets"][1] for name, array in arrays.items() if name != "__metadata__")
        whole = size == 8 + _length(content, name) + max(ends, default=0)
        told = object_in(told, "what is told")
        info = dict(object_in(told["info"], "the information"))
        for region in each_in(info["regions"], object_in, "regions"):
            for colour in ("colour", "edited_colour"):
                if region.get(colour) is not None:
                    vector_in(region[colour], "a colour")
    except (BadInput, KeyError, TypeError, ValueError, IndexError):  # of an older version, or damaged
        return None
    return info if whole and told["svv"] == __version__ else None


def header_in(content: bytes, name: str) -> dict[str, Any]:
    """Return the header from (the beginning of) a scene file's content; raises BadInput as :func:`parse_scene`."""
    return _validate_header(name, content[8 : _length(content, name) + 8])[0]


def scene_content(file: Path, whole: bool = True) -> bytes:
    """Return the content of a scene file, or only the part before its arrays; raises BadInput if it cannot be read."""
    try:
        with file.open("rb") as stream:
            content = stream.read(_START)
            if content[8:] == _OUR_START:  # a foreign file, which may be huge, is not read
                length = int.from_bytes(content[:8], "little")
                content += stream.read() if whole else stream.read(min(length, MOST_HEADER) + 8 - _START)
    except FileNotFoundError as error:
        raise BadInput(f"There is no scene file {file}; check the path.") from error
    except IsADirectoryError as error:
        raise BadInput(f"{file} is a folder; give the scene file (.svv) inside it.") from error
    except OSError as error:
        raise BadInput(f"The scene file {file} cannot be read: {error.strerror}.") from error
    return content


def _length(content: bytes, name: str) -> int:
    """Return the length of the header; raises BadInput if this is no scene, or it is not a length of a header."""
    if content[8:_START] != _OUR_START:
        raise BadInput(f"{name} is not a scene file of svv; make one with `svv train`.")
    length = int.from_bytes(content[:8], "little")
    if length > MOST_HEADER or content.count(b'"dtype"', 8, 8 + length) > MOST_ARRAYS:
        raise BadInput(f"The header of the scene file {name} is damaged; {_REMEDY}.")
    return length


def parse_scene(content: bytes, name: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return header and arrays from a scene file's content.

    Raises BadInput, with its name, if it is no such content.
    """
    length = _length(content, name)
    try:
        tensors = load(content)
    except (SafetensorError, KeyError, TypeError, ValueError, OverflowError) as error:  # all for types of numbers
        raise BadInput(f"The scene file {name} is truncated or damaged; {_REMEDY}.") from error
    # load() has checked the length and the JSON of the safetensors header, but returns only the arrays.
    header, tables = _validate_header(name, content[8 : 8 + length])
    try:
        shapes = {table: tuple(whole_in(n, "size") for n in list_in(s, 2, "sizes")) for table, s in tables.items()}
        check_fits(sum(rows * columns for rows, columns in shapes.values()), f"The scene file {name}")
        tensors |= {table: _inflated(tensors[table], shape) for table, shape in shapes.items()}
    except (zlib.error, KeyError, TypeError, ValueError, OverflowError) as error:
        raise BadInput(f"The tables of the scene file {name} are damaged; {_REMEDY}.") from error
    return header, tensors


def _deflated(table: np.ndarray) -> np.ndarray:
    """Return a table of bytes (V, F), compressed. (N,)"""
    columns = table.T.copy()
    columns[:, 1:] -= columns[:, :-1].copy()  # modulo 256
    # The differences are noise with many small numbers: Huffman coding with run lengths only makes a painted table 6 %
    # smaller than string matching does, and any deflate decoder can read it.
    stream = zlib.compressobj(memLevel=9, strategy=zlib.Z_RLE)
    return np.frombuffer(stream.compress(columns.tobytes()) + stream.flush(), np.uint8)


def _inflated(content: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Invert :func:`_deflated`; raises ValueError or zlib.error if the content is not from it."""
    rows, columns = shape
    if not 1 <= rows * columns <= MOST_INFLATED * len(content):
        raise ValueError("a table without numbers, or with more than its bytes can hold, is not deflated")
    stream = zlib.decompressobj()
    table = np.frombuffer(stream.decompress(content.tobytes(), rows * columns), np.uint8).reshape(columns, rows)
    if stream.unconsumed_tail or not stream.eof:
        raise ValueError("the table is longer or shorter than it says")
    return np.ascontiguousarray(np.cumsum(table, axis=1, dtype=np.uint8).T)


def _validate_header(file: str, outer: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the header and the shapes of the deflated tables, from the header of the safetensors file."""
    try:
        content = parsed(parsed(outer)["__metadata__"][_KEY])
        version, header, tables = content["version"], content["header"], content.get("deflated", {})
    except (ValueError, TypeError, KeyError) as error:
        raise BadInput(f"The header of the scene file {file} is damaged; {_REMEDY}.") from error
    if version not in (FORMAT_VERSION, WITH_PARTS, WITH_STEPS, WITH_STROKES, *READABLE):
        raise BadInput(
            f"{file} is a scene file of format {version}, but this program reads format {FORMAT_VERSION}; "
            "use the version of svv that made it, or train the scene again."
        )
    if not (isinstance(header, dict) and isinstance(tables, dict)):
        raise BadInput(f"The header of the scene file {file} is damaged; {_REMEDY}.")
    return header, tables
