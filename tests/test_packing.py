"""Scenes in bytes: 8-bit tables survive repeated saving, and files of earlier versions can still be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.box import Box
from svv.errors import BadInput
from svv.fields.encodings import SparseLattice
from svv.fields.networks import BaseField, FieldSettings
from svv.fields.occupancy import Occupancy
from svv.fields.rendering import Marching
from svv.fields.scene import Scene
from svv.io import scene_file

ALL = np.ones((4, 4, 4), np.uint8)


@given(st.integers(0, 2**31), st.floats(1e-6, 1e3), st.floats(-100.0, 100.0), st.integers(1, 4))
def test_tables_keep_a_255th_of_their_span(seed: int, scale: float, middle: float, features: int) -> None:
    lattice = SparseLattice(ALL, 4, (2, 4, 8), features)
    lattice.randomize(scale, torch.Generator().manual_seed(seed))
    with torch.no_grad():
        lattice.table.add_(middle)
        lattice.table[lattice.rows_of_level(1)].mul_(100.0)  # each level has a span of its own
    packed = lattice.packed()
    again = lattice.unpacked(packed)
    for level, (low, high) in enumerate(torch.from_numpy(packed[".ends"])):
        rows = lattice.rows_of_level(level)
        error = (again[rows] - lattice.table[rows].detach()).abs()
        assert (error <= 0.505 * (high - low) / 255.0 + 1e-6 * low.abs() + 1e-6 * high.abs()).all()


@given(st.integers(0, 2**31))
def test_what_was_packed_once_stays(seed: int) -> None:
    """An edited scene is written and read by every filter that it passes."""
    lattice = SparseLattice(ALL, 4, (2, 4), 3)
    lattice.randomize(1.0, torch.Generator().manual_seed(seed))
    packed = lattice.packed()
    with torch.no_grad():
        lattice.table.copy_(lattice.unpacked(packed))
    again = lattice.packed()
    assert again.keys() == packed.keys()
    for name, array in packed.items():
        np.testing.assert_array_equal(again[name], array)


def test_a_table_of_one_number_stays_that_number() -> None:
    lattice = SparseLattice(ALL, 4, (2, 4), 3)
    with torch.no_grad():
        lattice.table.fill_(0.3)
    np.testing.assert_allclose(lattice.unpacked(lattice.packed()), 0.3, rtol=1e-6)


def scene() -> Scene:
    settings = FieldSettings(resolutions=(4, 8), width=16)
    occupancy = Occupancy(Box((0.0,) * 3, 1.0, (1.0,) * 3), 4, ALL)
    base = BaseField(settings, occupancy).requires_grad_(False)
    for encoding in base.encodings:
        encoding.randomize(1.0, torch.Generator().manual_seed(3))
    return Scene(settings, occupancy, Marching(1 / 8), base)


def test_files_of_the_first_format_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their tables are half floats."""
    first = scene()
    header, arrays = first.to_arrays(packed=False)
    halves = {k: v.astype(np.float16) if k.endswith("table") else v for k, v in arrays.items()}
    with monkeypatch.context() as patch:
        patch.setattr(scene_file, "FORMAT_VERSION", 1)
        scene_file.write_scene_file(tmp_path / "old.svv", header, halves)
    again = Scene.load(tmp_path / "old.svv")
    for name, value in first.base.state_dict().items():
        torch.testing.assert_close(again.base.state_dict()[name], value, rtol=1e-3, atol=1e-4)


def test_unpacked_arrays_are_the_scene_itself() -> None:
    """A training that was stopped goes on from them."""
    first = scene()
    again = Scene.from_arrays(*first.to_arrays(packed=False))
    for name, value in first.base.state_dict().items():
        assert torch.equal(again.base.state_dict()[name], value)


def test_a_file_has_a_byte_a_number(tmp_path: Path) -> None:
    first = scene()
    first.save(tmp_path / "a.svv")
    numbers = sum(e.table.numel() for e in first.base.encodings)
    assert (tmp_path / "a.svv").stat().st_size < 1.05 * numbers + 20_000


@pytest.mark.parametrize("damage", ["shape", "missing"])
def test_a_table_of_another_shape_is_refused(tmp_path: Path, damage: str) -> None:
    header, arrays = scene().to_arrays()
    if damage == "shape":
        arrays["base.density.table"] = arrays["base.density.table"][:-1]
    else:
        del arrays["base.density.table.ends"]
    scene_file.write_scene_file(tmp_path / "a.svv", header, arrays)
    with pytest.raises(BadInput, match="damaged"):
        Scene.load(tmp_path / "a.svv")
