"""Volumes of FreeSurfer, as nibabel writes them: values, places, time points, and damage."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import nibabel
import numpy as np
import pytest

from svv.bricks.formats.axes import Choice
from svv.bricks.opened import open_bricks
from svv.dvr.read.grids import index_to_world, to_array
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput
from tests.test_mrc import ell

TURNED = np.array([[0.0, 0.0, 3.0, 11.0], [-1.5, 0.0, 0.0, 7.0], [0.0, -2.0, 0.0, -5.0], [0.0, 0.0, 0.0, 1.0]])
"""A coronal volume of 1.5 x 2 x 3 mm, as FreeSurfer's conformed ones are stored."""


def written(file: Path, values: np.ndarray) -> Path:
    """Write values by z, y, x (and time points before them)."""
    content = nibabel.MGHImage(values.T.copy(), TURNED).to_bytes()
    file.write_bytes(gzip.compress(content) if file.suffix == ".mgz" else content)
    return file


@pytest.mark.parametrize("ending", [".mgz", ".mgh"])
@pytest.mark.parametrize("kind", ["uint8", "int16", "int32", "float32"])
def test_values_are_in_their_places(tmp_path: Path, ending: str, kind: str) -> None:
    file = written(tmp_path / f"a{ending}", ell(kind))
    with gzip.open(file) if ending == ".mgz" else file.open("rb") as opened:  # nibabel itself leaves them open
        reference = nibabel.MGHImage.from_bytes(opened.read())
    image = read_volume(file)
    assert np.array_equal(to_array(image), np.asarray(reference.dataobj).T)
    assert np.allclose(index_to_world(image), reference.affine, atol=1e-4)
    if ending == ".mgh":
        source = open_bricks(file)
        assert source is not None and source.assumed is None
        assert np.allclose(source.levels[0].spacing, (1.5, 2.0, 3.0), atol=1e-5)


def test_a_time_point_is_chosen(tmp_path: Path) -> None:
    file = written(tmp_path / "a.mgh", np.stack([ell(), 2 * ell()]))
    with pytest.raises(BadInput, match="--time"):
        open_bricks(file)
    source = open_bricks(file, choice=Choice(time=1))
    assert source is not None
    assert np.array_equal(to_array(read_volume(file, time=1)), 2 * ell())


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda content: content[:100], "damaged"),
        (lambda content: content[:400], "bytes"),
        (lambda content: b"\x07" + content[1:], "damaged|version|Version"),
        (lambda content: content[:4] + b"\xff" * 12 + content[16:], "damaged"),
        (lambda content: content[:20] + b"\x00\x00\x00\x63" + content[24:], "damaged"),
        (lambda content: content[:30] + b"\x7f\xc0\x00\x00" * 3 + content[42:], "damaged|no numbers|finite"),
    ],
)
def test_damaged_files_are_one_sentence(tmp_path: Path, damage: Callable[[bytes], bytes], says: str) -> None:
    (tmp_path / "b.mgh").write_bytes(damage(written(tmp_path / "a.mgh", ell()).read_bytes()))
    with pytest.raises(BadInput, match=says) as caught:
        read_volume(tmp_path / "b.mgh")
    assert "\n" not in str(caught.value)
