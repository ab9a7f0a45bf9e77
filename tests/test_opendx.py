"""OpenDX files as APBS and GridDataFormats 1.2 write them: values, places, and damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from tests.damage import assert_cut_files_are_refused, assert_wrong_headers_are_refused
from tests.ell_volume import FIRST, STEP, assert_shown, ell


def dx(folder: Path, quoted: bool = True) -> Path:
    """Write an L, three values a line; APBS does not quote the type."""
    kind = '"double"' if quoted else "double"
    deltas = "\n".join("delta " + " ".join(f"{x:g}" for x in row) for row in np.diag(STEP))
    values = [f"{value:.3e}" for value in ell().transpose(2, 1, 0).ravel()]
    lines = "\n".join(" ".join(values[k : k + 3]) for k in range(0, len(values), 3))
    (folder / "l.dx").write_text(
        "# a comment\nobject 1 class gridpositions counts  22 18 14\n"
        f"origin {' '.join(f'{x:g}' for x in FIRST)}\n{deltas}\nobject 2 class gridconnections counts  22 18 14\n"
        f"object 3 class array type {kind} rank 0 items {len(values)} data follows\n{lines}\n"
        'attribute "dep" string "positions"\nobject "density" class field\ncomponent "positions" value 1\n'
    )
    return folder / "l.dx"


@pytest.mark.parametrize("quoted", [True, False])
def test_values_are_in_their_places(tmp_path: Path, quoted: bool) -> None:
    assert_shown(dx(tmp_path, quoted))


def test_damage_is_one_sentence(tmp_path: Path) -> None:
    file = dx(tmp_path)
    assert_cut_files_are_refused(file, places=9)  # what lies behind the values is needless
    wrong = {
        b"counts  22": b"counts  99", b"items 5544": b"items 55", b"delta 0 2 0": b"delta 0 0 0", b"rank 0": b"rank 1",
        b"origin 10": b"origin e", b"0.000e+00": b"zero", b"gridpositions": b"positions",
    }  # fmt: skip
    assert_wrong_headers_are_refused(file, wrong)
    (tmp_path / "other.dx").write_text("object 1 class array type float rank 1 shape 3 items 5 data follows\n")
    with pytest.raises(BadInput, match="no regular grid"):
        read_here(tmp_path / "other.dx")
