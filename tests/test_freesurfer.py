"""Volumes of FreeSurfer, as nibabel writes them: values, places, time points, and damage."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import nibabel
import numpy as np
import pytest

from svv.bricks.opened import open_bricks
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput
from tests.ell_volume import assert_shown, ell

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
    assert_shown(file, TURNED[:3, :3], TURNED[:3, 3])
    assert (open_bricks(file) is not None) == (ending == ".mgh"), "what is not compressed can be mapped"


def test_a_time_point_is_chosen(tmp_path: Path) -> None:
    file = written(tmp_path / "a.mgh", np.stack([ell(), 2 * ell()]))
    with pytest.raises(BadInput, match="--time"):
        open_bricks(file)
    assert_shown(file, TURNED[:3, :3], TURNED[:3, 3], factor=2.0, time=1)


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
