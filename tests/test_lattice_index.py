"""A lattice's index gives every stored vertex its row in raster order, wherever words of the index begin and end."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.rays.encodings import VERTICES_A_WORD, stored_rows
from svv.fields.radiance.encodings import SparseLattice
from svv.kernels.numba.trilinear import cell_at


def lattice_of(seed: int, length: int, share: float) -> tuple[SparseLattice, np.ndarray]:
    """Two levels over a narrow box of ``length`` cells along z, and its cells."""
    occupied = (np.random.default_rng(seed).random((3, 2, length)) < share).astype(np.uint8)
    occupied[1, 1, length // 2] = 1
    return SparseLattice(occupied, 8, (8, 16), 1), occupied


@given(st.integers(0, 10**6), st.integers(1, 80), st.sampled_from([0.05, 0.5, 1.0]))
def test_rows_are_numbered_in_raster_order(seed: int, length: int, share: float) -> None:
    lattice, occupied = lattice_of(seed, length, share)
    for level in range(2):
        vertices = torch.from_numpy(lattice.vertices_of_level(level, occupied, 8))
        rows = stored_rows(vertices, lattice.shapes[level], lattice.bases[level], lattice.index)
        own = lattice.rows_of_level(level)
        assert torch.equal(rows, torch.arange(own.start, own.stop))


@given(st.integers(0, 10**6), st.integers(1, 80))
def test_the_compiled_look_up_finds_the_same_rows(seed: int, length: int) -> None:
    lattice, occupied = lattice_of(seed, length, 0.3)
    layout = lattice.shapes.numpy(), lattice.scales.numpy(), lattice.bases.numpy(), lattice.index.numpy()
    cells = np.argwhere(occupied)
    for x, y, z in ((cells + 0.3) / 8).astype(np.float32):
        a, b, c, d, *_ = cell_at(x, y, z, 0, *layout)
        cell = torch.tensor([[int(v * 8) for v in (x, y, z)]])
        corners = torch.cat([cell + torch.tensor(k) for k in ((0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0))])
        expected = stored_rows(corners, lattice.shapes[0], lattice.bases[0], lattice.index)
        assert [a, b, c, d] == expected.tolist()


def test_the_index_takes_a_quarter_of_a_byte_for_each_vertex() -> None:
    occupied = np.zeros((64, 64, 63), np.uint8)
    occupied[5, 6, 7] = 1
    lattice = SparseLattice(occupied, 64, (64,), 1)
    assert lattice.index.element_size() * lattice.index.numel() == 65 * 65 * 64 * 8 // VERTICES_A_WORD
    assert len(lattice.table) == 8


@given(st.integers(0, 10**6), st.integers(1, 80), st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3))
def test_no_look_up_leaves_the_table(seed: int, length: int, part: list[float]) -> None:
    """Not even one in a cell that is not stored, into which rounding may move a position."""
    lattice, occupied = lattice_of(seed, length, 0.05)
    layout = lattice.shapes.numpy(), lattice.scales.numpy(), lattice.bases.numpy(), lattice.index.numpy()
    x, y, z = (np.array(part) * occupied.shape / 8).astype(np.float32)
    for level in range(2):
        *rows, _, _, _ = cell_at(x, y, z, level, *layout)
        assert max(rows) + 1 < len(lattice.table)
