"""Generated inputs: bytes and structures (JSON, CSV, XML, archives) that are nearly what a reader expects.

Every generator takes a ``random.Random``, so that a seed and a number give the same input again.
"""

from __future__ import annotations

import copy
import io
import json
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

Maker = Callable[[Random], bytes]

NUMBERS: tuple[object, ...] = (
    0, 1, -1, 2, 3, 7, 16, 255, 256, 65535, 65536, 2**31 - 1, 2**31, -(2**31), 2**32, 2**53, 2**63 - 1, 2**63, 2**64,
    10**18, 10**30, 10**400, -(10**400), 0.0, -0.0, 0.5, 1.5, -0.5, 1e-300, 5e-324, 1e-45, 1e308, -1e308, 1e39, 65504.0,
    1e5, 1e-5, float("nan"), float("inf"), float("-inf"),
)  # fmt: skip
TEXTS = (
    "", " ", "a", "ä", "0", "1", "nan", "inf", "1e999", "0x10", "1_000", "٣", "..", "../..", "/", "/dev/zero",
    "../../etc/passwd", "/etc/passwd", "file:///etc/passwd", "http://127.0.0.1:1/a.png", "C:\\a", "\\\\host\\a", "~",
    "x" * 300, "x" * 5000, "a\0b", "\ud800", "\u202e", "{phi}", "{0}", "{phi.__class__}", "{phi:>99999999}", "%s",
    "<b>", "'; --", "$(id)", "`id`", "__class__", "svv", "base", "pcn", "styled", "loop", "folder", "null", "[1, 2, 3]",
)  # fmt: skip
OTHERS: tuple[object, ...] = (None, True, False, [], {}, [[]], [None], {"": None}, [1, 2, 3], [[0.0] * 4] * 4)


def value(random: Random) -> Any:
    """Return any JSON value."""
    kind = random.random()
    if kind < 0.5:
        return random.choice(NUMBERS)
    if kind < 0.7:
        return random.choice(TEXTS)
    if kind < 0.85:
        return copy.deepcopy(random.choice(OTHERS))
    return random.uniform(-10, 10) if kind < 0.95 else random.randrange(-5, 300)


def near(old: Any, random: Random) -> Any:
    """Return a value of the same type as another."""
    if isinstance(old, bool) or not isinstance(old, int | float | str):
        return value(random)
    if isinstance(old, str):
        place = random.randrange(len(old) + 1)
        return random.choice((old[:place], old[place:], old[:place] + random.choice(TEXTS) + old[place:], old * 2))
    if isinstance(old, int) and abs(old) > 1 << 1000:  # more than a float holds
        return old + 1
    found = random.choice((old + 1, old - 1, -old, old * 2, old * 1000, old // 2, old * (1 + random.uniform(-1, 1))))
    return int(found) if isinstance(old, int) and random.random() < 0.8 and abs(found) < 1e15 else found


def places(tree: Any) -> list[tuple[Any, Any]]:
    """Return every container in a tree with each of its keys."""
    found, left = [], [tree]
    while left:
        node = left.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        for key in keys:
            found.append((node, key))
            left.append(node[key])
    return found


def changed(tree: Any, random: Random) -> Any:
    """Return a copy of a JSON tree, given as such or as text, with one to three changes."""
    tree = json.loads(tree) if isinstance(tree, str) else json.loads(json.dumps(tree))
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        there = places(tree)
        if not there or random.random() < 0.01:
            return value(random)
        node, key = random.choice(there)
        kind = random.random()
        if kind < 0.35:
            node[key] = value(random)
        elif kind < 0.65:
            node[key] = near(node[key], random)
        elif kind < 0.75:
            del node[key]
        elif kind < 0.85:
            _moved(node, key, there, random)
        elif isinstance(node, list):
            node[key:key] = node[key : key + 1] * random.choice((1, 1, 2, 50))
        else:
            node[random.choice(TEXTS)] = value(random)
    return tree


def _moved(node: Any, key: Any, there: list[tuple[Any, Any]], random: Random) -> None:
    """Put a copy of another part of the tree here."""
    other, name = random.choice(there)
    node[key] = json.loads(json.dumps(other[name]))


def as_json(tree: Any, random: Random) -> bytes:
    """Return a tree as text; sometimes with keys twice, deeply nested, or not quite JSON."""
    text = json.dumps(tree)
    kind = random.random()
    if kind < 0.9:
        return text.encode()
    if kind < 0.93 and text.startswith("{") and len(text) > 2:
        return f"{text[:-1]}, {text[1:]}".encode()  # every key twice
    if kind < 0.931:
        depth = random.choice((50, 990, 5000, 100_000))
        return b"[" * depth + text.encode() + b"]" * depth
    if kind < 0.932:
        return text.replace(": ", ': {"a":' * 3000, 1).encode()
    if kind < 0.94:
        return text.encode(random.choice(("utf-16", "utf-8-sig", "utf-32")))
    return some_bytes(text.encode(), random)


def json_like(*seeds: Any) -> Maker:
    """Return a generator of JSON texts that resemble the seeds."""
    texts = [json.dumps(seed) for seed in seeds]

    def make(random: Random) -> bytes:
        return as_json(changed(random.choice(texts), random), random)

    return make


def some_bytes(content: bytes, random: Random) -> bytes:
    """Return bytes with one to four changes: flips, cuts, copies, and numbers with a meaning."""
    data = bytearray(content)
    for _ in range(random.choice((1, 1, 2, 4))):
        size = len(data)
        place, kind = random.randrange(size + 1), random.randrange(9)
        if kind == 0:
            data[place:] = b""
        elif kind == 1:
            data[place : place + random.choice((1, 4, 64))] = b""
        elif kind == 2:
            data[place:place] = random.randbytes(random.choice((1, 2, 8)))
        elif kind == 3:
            start = random.randrange(size + 1)
            data[place:place] = data[start : start + random.choice((4, 16, 256))]
        elif kind == 4 and size:
            data[place % size] ^= 1 << random.randrange(8)
        elif kind == 5 and size:
            data[place % size] = random.choice((0, 1, 127, 128, 255, 34, 44, 45, 48, 60, 91, 123))
        elif kind == 6:
            number = random.choice((0, 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 10**6, 65_536))
            how = random.choice(("<I", ">I", "<Q", ">Q"))
            data[place : place + struct.calcsize(how)] = struct.pack(how, number)
        elif kind == 7:
            data[place : place + 2] = struct.pack(random.choice("<>") + "H", random.randrange(1 << 16))
        else:
            data[place:place] = str(random.choice(NUMBERS)).encode()[:40]
    return bytes(data)


def byte_like(*seeds: bytes) -> Maker:
    """Return a generator of bytes that resemble the seeds."""
    return lambda random: some_bytes(random.choice(seeds), random)


def text_like(*seeds: str) -> Maker:
    """Return a generator of texts in which words were exchanged, as in CSV, XML or headers of volumes."""
    split = [_words(seed) for seed in seeds]

    def make(random: Random) -> bytes:
        words = list(random.choice(split))
        for _ in range(random.choice((1, 1, 2, 3))):
            place = random.randrange(len(words))
            kind = random.randrange(5)
            if kind == 0:
                words[place] = str(value(random))[:6000]
            elif kind == 1:
                words[place] = words[random.randrange(len(words))]
            elif kind == 2:
                words[place] = words[place] * random.choice((0, 2, 40))
            elif kind == 3:
                words[place:place] = words[place : place + random.choice((1, 5, 20))]
            else:
                del words[place : place + random.choice((1, 2, 9))]
            if not words:
                break
        content = "".join(words).encode("utf-8", "surrogatepass")
        return content if random.random() < 0.8 else some_bytes(content, random)

    return make


def _words(text: str) -> list[str]:
    """Split a text into runs of letters and digits, and single other characters."""
    words: list[str] = []
    plain = False
    for letter in text:
        now = letter.isalnum() or letter in "._-"
        if now and plain:
            words[-1] += letter
        else:
            words.append(letter)
        plain = now
    return words


def archive(members: Sequence[tuple[str, bytes]], random: Random) -> bytes:
    """Return a ZIP archive (``.npz``); sometimes with names twice or missing, or sizes that lie."""
    members = list(members)
    kind = random.random()
    if kind < 0.1:
        members.pop(random.randrange(len(members)))
    elif kind < 0.2:
        members.append(random.choice(members))
    how = random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
    file = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(file, "w", how) as opened:
        warnings.simplefilter("ignore")  # about names that occur twice
        for name, content in members:
            opened.writestr(zipfile.ZipInfo(name), content, how)
    content = file.getvalue()
    return content if kind < 0.8 else some_bytes(content, random)


def npy_header(header: str, data: bytes = b"", version: int = 1) -> bytes:
    """Return a NumPy file with a header of any text."""
    text = header.encode("latin-1", "replace")
    length = struct.pack("<H" if version == 1 else "<I", len(text) & (0xFFFF if version == 1 else 0xFFFFFFFF))
    return b"\x93NUMPY" + bytes((version, 0)) + length + text + data


def deflated(count: int) -> bytes:
    """Return ``count`` zeros, deflated: a bomb."""
    stream = zlib.compressobj(9)
    block = bytes(1 << 16)
    return b"".join(stream.compress(block) for _ in range(count >> 16)) + stream.flush()
