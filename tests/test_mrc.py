"""Maps of electron microscopy, as mrcfile writes them: values, axis words, places, and what is refused."""

from __future__ import annotations

import gzip
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.bricks.opened import open_bricks
from svv.dvr.read.grids import index_to_world, to_array
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput

mrcfile = pytest.importorskip("mrcfile")

SIZES = np.array([1.5, 2.0, 3.0])
"""Spacing along x, y, z."""


def ell(kind: str = "float32") -> np.ndarray:
    """An L of four values off the centre, by z, y, x."""
    values = np.zeros((5, 6, 7), kind)
    values[1, 2, 1:4] = [1, 2, 3]
    values[1, 4, 1] = 4
    return values


def written(file: Path, values: np.ndarray, order: tuple[int, ...] = (1, 2, 3), **head: Any) -> Path:
    """Write values by z, y, x with columns, rows and sections along these axes."""
    stored = values.transpose([3 - axis for axis in reversed(order)])
    with mrcfile.new(file, overwrite=True) as opened:
        opened.set_data(np.ascontiguousarray(stored))
        opened.voxel_size = tuple(SIZES)
        opened.header.mapc, opened.header.mapr, opened.header.maps = order
        counts = values.shape[::-1]
        opened.header.mx, opened.header.my, opened.header.mz = counts
        opened.header.cella = tuple(SIZES * counts)
        for name, value in head.items():
            opened.header[name] = value
    return file


@pytest.mark.parametrize("order", list(permutations((1, 2, 3))))
@pytest.mark.parametrize("kind", ["int8", "int16", "float32", "uint16", "float16"])
def test_values_are_in_their_places(tmp_path: Path, order: tuple[int, ...], kind: str) -> None:
    file = written(tmp_path / "a.mrc", ell(kind), order, origin=(10.0, 20.0, 30.0))
    image = read_volume(file)
    assert np.array_equal(to_array(image), ell().astype(np.float64))
    matrix = index_to_world(image)
    assert np.allclose(matrix[:3, :3], np.diag(SIZES)) and np.allclose(matrix[:3, 3], (10, 20, 30))
    source = open_bricks(file)
    assert source is not None and source.levels[0].shape == (5, 6, 7)
    assert np.allclose(source.levels[0].spacing, SIZES) and source.assumed is None


def test_starts_count_where_there_is_no_origin(tmp_path: Path) -> None:
    """They are those of columns, rows and sections, here along z, x and y."""
    file = written(tmp_path / "a.map", ell(), (3, 1, 2), nxstart=-2, nystart=4, nzstart=5)
    assert np.allclose(index_to_world(read_volume(file))[:3, 3], SIZES * (4, 5, -2))


def test_compressed_and_extended_files_are_read(tmp_path: Path) -> None:
    with mrcfile.new(tmp_path / "a.mrc") as opened:
        opened.set_data(ell())
        opened.voxel_size = 2.0
        opened.set_extended_header(np.zeros(160, "V1"))
    (tmp_path / "b.mrc.gz").write_bytes(gzip.compress((tmp_path / "a.mrc").read_bytes()))
    for name in ("a.mrc", "b.mrc.gz"):
        assert np.array_equal(to_array(read_volume(tmp_path / name)), ell())


def test_a_file_without_sizes_says_so(tmp_path: Path) -> None:
    with mrcfile.new(tmp_path / "a.rec") as opened:
        opened.set_data(ell())
    source = open_bricks(tmp_path / "a.rec")
    assert source is not None and "no voxel size" in str(source.assumed)
    assert np.allclose(source.levels[0].spacing, 1.0)


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
