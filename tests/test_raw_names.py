"""Raw files: what their names tell, and text files that have their endings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from svv.bricks.opened import open_bricks
from svv.dvr.read.grids import to_array
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from tests.letter import letter

BYTES = {">": ("be", "BE", "bigendian", "msb"), "<": ("le", "LittleEndian", "lsb")}


@pytest.mark.parametrize(("order", "word"), [(order, word) for order, words in BYTES.items() for word in words])
@pytest.mark.parametrize(
    "name",
    ["l_22x18x14_uint16_{}.raw", "l_uint16{}_22x18x14.raw", "l-{}-22x18x14-ushort.bin", "be22x18x14_{}.uint16.dat"],
)
def test_the_order_of_bytes_in_the_name_counts(name: str, order: str, word: str, tmp_path: Path) -> None:
    path = tmp_path / name.format(word)
    path.write_bytes(letter().astype(f"{order}u2").tobytes())
    np.testing.assert_array_equal(to_array(read_here(path)), letter())
    source = open_bricks(path)
    assert source is not None
    np.testing.assert_array_equal(source.read(0, (0, 0, 0), (14, 18, 22)), letter())
    np.testing.assert_array_equal(to_array(read_here(path, dtype="uint16")), letter())
    other = "<" if order == ">" else ">"
    np.testing.assert_array_equal(to_array(read_here(path, dtype=f"{other}u2")), letter().astype("u2").byteswap())


def test_headers_are_not_taken_for_raw_data(tmp_path: Path) -> None:
    (tmp_path / "l.dat").write_text("TIME: 0\nDATA_FILE: l.raw\nDATA_SIZE: 22 18 14\nDATA_FORMAT: SHORT\n")
    for read in (read_here, open_bricks):
        with pytest.raises(BadInput, match=r"is a BOV header, not raw data: give it a name that ends in \.bov"):
            read(tmp_path / "l.dat")
    (tmp_path / "l.dat").write_text("x y z value\n1 2 3 4\n")
    with pytest.raises(BadInput, match="is text, not raw data: if it is the header of a file with the values, na"):
        read_here(tmp_path / "l.dat")


def test_printable_values_are_raw_data_if_the_size_is_told(tmp_path: Path) -> None:
    values = np.where(letter() > 0, 65, 10).astype(np.uint8)
    (tmp_path / "l_22x18x14_uint8.raw").write_bytes(values.tobytes())
    np.testing.assert_array_equal(to_array(read_here(tmp_path / "l_22x18x14_uint8.raw")), values)


def test_text_of_tecplot_is_read_by_vtk(tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    z, y, x = (axis.ravel() for axis in np.indices((4, 5, 6)))
    rows = "\n".join(f"{a} {b} {c} {a + 10 * b + 100 * c}" for a, b, c in zip(x, y, z))
    (tmp_path / "t.dat").write_text(
        f'TITLE = "t"\nVARIABLES = "X" "Y" "Z" "rho"\nZONE T="a", I=6, J=5, K=4, F=POINT\n{rows}\n'
    )
    volume = read_here(tmp_path / "t.dat", array="rho")
    assert to_array(volume).max() == pytest.approx(5 + 40 + 300, abs=1)
    np.testing.assert_allclose(volume.GetBounds(), (0, 5, 0, 4, 0, 3), atol=1e-4)


def test_other_files_that_end_in_hdr_are_named(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.AnalyzeImage(letter().T.astype("i2"), np.eye(4)), tmp_path / "a.hdr")
    with pytest.raises(BadInput, match=r"a.hdr is an Analyze 7.5 file, which does not say which of its sides is left"):
        read_here(tmp_path / "a.hdr")
    (tmp_path / "e.hdr").write_text("ENVI\nsamples = 22\nlines = 18\nbands = 14\ndata type = 2\n" + "; more\n" * 50)
    with pytest.raises(BadInput, match=r"e.hdr is a header of ENVI: name the file with the values, with --dims"):
        read_here(tmp_path / "e.hdr")
