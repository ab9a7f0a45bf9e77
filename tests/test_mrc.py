"""Maps of electron microscopy, as mrcfile writes them: values, axis words, places, and what is refused."""

from __future__ import annotations

import gzip
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.bricks.opened import open_bricks
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput
from tests.ell_volume import FIRST, STEP, assert_shown, ell

mrcfile = pytest.importorskip("mrcfile")


def written(file: Path, values: np.ndarray, order: tuple[int, ...] = (1, 2, 3), **head: Any) -> Path:
    """Write values by z, y, x with columns, rows and sections along these axes."""
    stored = values.transpose([3 - axis for axis in reversed(order)])
    with mrcfile.new(file, overwrite=True) as opened:
        opened.set_data(np.ascontiguousarray(stored))
        opened.voxel_size = tuple(STEP)
        opened.header.mapc, opened.header.mapr, opened.header.maps = order
        counts = values.shape[::-1]
        opened.header.mx, opened.header.my, opened.header.mz = counts
        opened.header.cella = tuple(STEP * counts)
        for name, value in head.items():
            opened.header[name] = value
    return file


@pytest.mark.parametrize("order", list(permutations((1, 2, 3))))
@pytest.mark.parametrize("kind", ["int8", "int16", "float32", "uint16", "float16"])
def test_values_are_in_their_places(tmp_path: Path, order: tuple[int, ...], kind: str) -> None:
    part = 0.5 if kind == "int8" else 1.0  # which does not hold 200
    file = written(tmp_path / "a.mrc", (part * ell()).astype(kind), order, origin=tuple(FIRST))
    assert_shown(file, factor=part)
    assert open_bricks(file) is not None, "it can be mapped"


def test_starts_count_where_there_is_no_origin(tmp_path: Path) -> None:
    """They are those of columns, rows and sections, here along z, x and y."""
    file = written(tmp_path / "a.map", ell(), (3, 1, 2), nxstart=-2, nystart=4, nzstart=5)
    assert_shown(file, first=STEP * (4, 5, -2))


def test_compressed_and_extended_files_are_read(tmp_path: Path) -> None:
    with mrcfile.new(tmp_path / "a.mrc") as opened:
        opened.set_data(ell())
        opened.voxel_size = 2.0
        opened.set_extended_header(np.zeros(160, "V1"))
    (tmp_path / "b.mrc.gz").write_bytes(gzip.compress((tmp_path / "a.mrc").read_bytes()))
    for name in ("a.mrc", "b.mrc.gz"):
        assert_shown(tmp_path / name, (2.0, 2.0, 2.0), (0.0, 0.0, 0.0))


def test_a_file_without_sizes_says_so(tmp_path: Path) -> None:
    with mrcfile.new(tmp_path / "a.rec") as opened:
        opened.set_data(ell())
    assert_shown(tmp_path / "a.rec", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), says="no voxel size")


def test_a_skewed_cell_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path / "a.ccp4", ell(), cellb=(90.0, 90.0, 60.0))
    with pytest.raises(BadInput, match="not perpendicular"):
        open_bricks(file)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda content: content[:700], "damaged"),
        (lambda content: content[:1100], "bytes"),
        (lambda content: content[:208] + b"PAM " + content[212:], "MAP"),
        (lambda content: content[:64] + b"\x01" + content[65:68] + b"\x01" + content[69:], "axes"),
        (lambda content: content[:12] + b"\x63" + content[13:], "damaged"),
        (lambda content: b"\xff" * 12 + content[12:], "damaged"),
        (lambda content: content[:92] + b"\xff\xff\xff\xff" + content[96:], "damaged"),
        (lambda content: b"\xff\xff\xff\x7f" * 3 + content[12:], "bytes|memory|large"),
    ],
)
def test_damaged_files_are_one_sentence(tmp_path: Path, damage: Any, says: str) -> None:
    content = written(tmp_path / "a.mrc", ell()).read_bytes()
    (tmp_path / "b.mrc").write_bytes(damage(content))
    with pytest.raises(BadInput, match=says) as caught:
        read_volume(tmp_path / "b.mrc")
    assert "\n" not in str(caught.value)


def test_complex_values_are_refused(tmp_path: Path) -> None:
    with mrcfile.new(tmp_path / "a.mrc") as opened:
        opened.set_data(ell().astype(np.complex64))
    with pytest.raises(BadInput, match="complex"):
        read_volume(tmp_path / "a.mrc")
