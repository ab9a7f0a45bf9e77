"""Lattices of Amira and Avizo: values, places, packings, and damage."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest

from svv.bricks.opened import open_bricks
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from tests.damage import assert_cut_files_are_refused, assert_wrong_headers_are_refused
from tests.ell_volume import FIRST, STEP, assert_shown, ell

HEAD = """# AmiraMesh {order} 2.1


define Lattice 22 18 14

Parameters {{
    Materials {{
        Exterior {{ Id 1 }}
    }}
    Content "22x18x14 {word}, uniform coordinates",
    BoundingBox {box},{more}
    CoordType "uniform"
}}

Lattice {{ {word} Data }} @1{packing}

# Data section follows
@1
"""

BOX = " ".join(f"{low:g} {low + step * (side - 1):g}" for low, step, side in zip(FIRST, STEP, (22, 18, 14)))

TYPES = {"byte": "u1", "short": "i2", "ushort": "u2", "int": "i4", "float": "f4", "double": "f8"}


def runs(content: bytes) -> bytes:
    """Pack bytes as Amira does: single runs, and every fifth one as bytes that follow."""
    out, at = bytearray(), 0
    while at < len(content):
        count = 1
        while at + count < len(content) and content[at + count] == content[at] and count < 127:
            count += 1
        if at % 5 == 0:
            part = content[at : at + 100]
            out += bytes([128 + len(part)]) + part
            at += len(part)
        else:
            out += bytes([count, content[at]])
            at += count
    return bytes(out)


def am(folder: Path, word: str, order: str = "BINARY-LITTLE-ENDIAN", packing: str = "", more: str = "") -> Path:
    """Write an L as Amira does."""
    values = ell(("<" if order.endswith("LITTLE-ENDIAN") else ">") + TYPES[word])
    content = values.tobytes()
    if order == "ASCII":
        content = "\n".join(f"{value:g}" for value in values.ravel()).encode()
    content = zlib.compress(content) if packing == "HxZip" else runs(content) if packing == "HxByteRLE" else content
    told = f"({packing},{len(content)})" if packing else ""
    file = folder / "l.am"
    file.write_bytes(HEAD.format(order=order, word=word, packing=told, box=BOX, more=more).encode() + content + b"\n")
    return file


@pytest.mark.parametrize("word", TYPES)
@pytest.mark.parametrize("order", ["BINARY-LITTLE-ENDIAN", "BINARY", "ASCII"])
@pytest.mark.parametrize("packing", ["", "HxZip"])
def test_values_are_in_their_places(tmp_path: Path, word: str, order: str, packing: str) -> None:
    if order == "ASCII" and packing:
        packing = ""  # text is never packed
    file = am(tmp_path, word, order, packing)
    assert_shown(file)
    assert (open_bricks(file) is not None) == (order != "ASCII" and not packing)


def test_runs_of_bytes(tmp_path: Path) -> None:
    assert_shown(am(tmp_path, "byte", packing="HxByteRLE"))
    with pytest.raises(BadInput, match="save it uncompressed"):
        read_here(am(tmp_path, "short", packing="HxByteRLE"))


def test_the_matrix_moves_the_lattice(tmp_path: Path) -> None:
    # columns: the third row of numbers is where z goes, the last the shift
    matrix = "\n    TransformationMatrix 0 1 0 0 -1 0 0 0 0 0 1 0 5 6 7 1,"
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert_shown(am(tmp_path, "float", more=matrix), turn * STEP, turn @ FIRST + [5, 6, 7])


def test_what_is_no_even_lattice_is_refused(tmp_path: Path) -> None:
    file = am(tmp_path, "float")
    whole = file.read_bytes()
    for there, other, says in (
        (b'"uniform"', b'"rectilinear"', "rectilinear coordinates"), (b"define Lattice", b"define Nodes", "no lattice"),
        (b"# AmiraMesh", b"# HyperMesh", "no lattice"), (b"HxZ", b"HxZ", ""),
    ):  # fmt: skip
        if says:
            file.write_bytes(whole.replace(there, other))
            with pytest.raises(BadInput, match=says):
                read_here(file)


def test_damaged_files_are_one_sentence(tmp_path: Path) -> None:
    for word, packing in (("float", ""), ("float", "HxZip"), ("byte", "HxByteRLE")):
        assert_cut_files_are_refused(am(tmp_path, word, packing=packing))
    wrong = {
        b"Lattice 22 18": b"Lattice 99 18", b"Lattice 22": b"Lattice 0", b"Lattice 2": b"Lattice 9999999999",
        b"float Data": b"words Data", b"BoundingBox 10": b"BoundingBox e", b"\n@1\n": b"\n@7\n",
    }  # fmt: skip
    assert_wrong_headers_are_refused(am(tmp_path, "float"), wrong)
