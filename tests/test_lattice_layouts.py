"""Layouts of lattices: what kernels write over the words of the index is what plain NumPy finds among the vertices."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.fields.radiance.encodings import VERTICES_AT_A_TIME, SparseLattice, places_of, vertices_of

shapes = st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 40))
shares = st.sampled_from([0.0, 0.02, 0.3, 1.0])
resolutions = st.sampled_from([(12, (4, 12, 24)), (8, (1, 2, 8, 64)), (6, (2, 6)), (1, (1, 3))])
"""Cells per box unit of what is occupied, and of nested levels."""


def occupied_of(seed: int, shape: tuple[int, int, int], share: float) -> np.ndarray:
    """Cells of which any number above 0 says that they are occupied; one is, in any case."""
    random = np.random.default_rng(seed)
    occupied = np.where(random.random(shape) < share, random.integers(1, 256, shape), 0).astype(np.uint8)
    occupied[tuple(random.integers(shape))] = 2
    return occupied


def cells_at(occupied: np.ndarray, cells: int, resolution: int) -> np.ndarray:
    """Which cells of a resolution are occupied: the parts of one that is, or one of whose parts is."""
    if resolution >= cells:
        return np.kron(occupied > 0, np.ones((resolution // cells,) * 3, bool))
    k = cells // resolution
    out = np.zeros([-(-n // k) for n in occupied.shape], bool)
    for place in np.argwhere(occupied):
        out[tuple(place // k)] = True
    return out


def corners_of(filled: np.ndarray) -> np.ndarray:
    """Which vertices are corners of occupied cells."""
    padded = np.pad(filled, 1)
    slices = [[slice(bit, n + 1 + bit) for n in filled.shape] for bit in (0, 1)]
    return np.any([padded[slices[i][0], slices[j][1], slices[k][2]] for i, j, k in itertools.product((0, 1), repeat=3)],
                  axis=0)  # fmt: skip


def index_of(stored: np.ndarray, first: int) -> np.ndarray:
    """The words of a level's index, one by one."""
    words, row = [], first
    for line in stored.reshape(-1, stored.shape[2]):
        for start in range(0, len(line), 32):
            part = line[start : start + 32]
            words.append(row << 32 | sum(1 << int(k) for k in np.flatnonzero(part)))
            row += int(part.sum())
    return np.array(words)


@given(st.integers(0, 10**6), shapes, shares, resolutions)
def test_a_layout_holds_the_corners_of_the_occupied_cells(
    seed: int, shape: tuple[int, int, int], share: float, levels: tuple[int, tuple[int, ...]]
) -> None:
    occupied, (cells, finer) = occupied_of(seed, shape, share), levels
    lattice, first = SparseLattice(occupied, cells, finer, 2), 0
    words: list[np.ndarray] = []
    for level, resolution in enumerate(finer):
        stored = corners_of(cells_at(occupied, cells, resolution))
        assert lattice.shapes[level].tolist() == [*stored.shape]
        assert lattice.bases[level] == sum(len(part) for part in words)
        words.append(index_of(stored, first))
        assert lattice.rows_of_level(level) == slice(first, first + int(stored.sum()))
        first += int(stored.sum())
        np.testing.assert_array_equal(lattice.vertices_of_level(level, occupied, cells), np.argwhere(stored))
    np.testing.assert_array_equal(lattice.index.numpy(), np.concatenate(words))
    assert lattice.table.shape == (first, 2) and lattice.bases[-1] == first - 2


@given(st.integers(0, 10**6), shapes, shares, resolutions)
def test_each_vertex_is_moved_into_the_first_occupied_cell_around_it(
    seed: int, shape: tuple[int, int, int], share: float, levels: tuple[int, tuple[int, ...]]
) -> None:
    occupied, (cells, finer) = occupied_of(seed, shape, share), levels
    for resolution in finer:
        filled = np.pad(cells_at(occupied, cells, resolution), 1)
        vertices, expected = vertices_of(occupied, cells, resolution), []
        for vertex in vertices:
            away = next(c for c in itertools.product((0, 1), repeat=3) if filled[tuple(vertex - c + 1)])
            place = (vertex / resolution).astype(np.float32)
            middle = ((vertex + 0.5 - np.array(away)) / resolution).astype(np.float32)
            expected.append(np.nextafter(place, middle))
        places = places_of(occupied, cells, resolution)
        np.testing.assert_array_equal(places, np.array(expected))
        some = np.random.default_rng(seed).permutation(len(vertices))[: len(vertices) // 2]
        np.testing.assert_array_equal(places_of(occupied, cells, resolution, vertices[some]), places[some])


def test_pieces_are_the_vertices_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert VERTICES_AT_A_TIME > 100
    monkeypatch.setattr("svv.fields.radiance.encodings.VERTICES_AT_A_TIME", 100)
    occupied = occupied_of(0, (7, 6, 40), 0.3)
    lattice = SparseLattice(occupied, 8, (4, 8), 1)
    for level in (0, 1):
        rows, pieces = zip(*lattice.pieces_of_level(level, occupied, 8), strict=True)
        own = lattice.rows_of_level(level)
        assert [one.start for one in rows] == [*range(own.start, own.stop, 100)] and rows[-1].stop == own.stop
        assert all(one.stop - one.start == len(piece) for one, piece in zip(rows, pieces, strict=True))
        np.testing.assert_array_equal(np.concatenate(pieces), lattice.vertices_of_level(level, occupied, 8))


@given(st.integers(0, 10**6), shapes, shares, resolutions)
def test_fewer_cells_keep_their_vertices_features(
    seed: int, shape: tuple[int, int, int], share: float, levels: tuple[int, tuple[int, ...]]
) -> None:
    occupied, (cells, finer) = occupied_of(seed, shape, share), levels
    lattice = SparseLattice(occupied, cells, finer, 2)
    lattice.randomize(1.0, torch.Generator().manual_seed(seed))
    fewer = occupied * (np.random.default_rng(seed).random(shape) < 0.5)
    small = lattice.restricted(fewer.astype(np.uint8), cells, (2 * finer[-1],))
    assert small.resolutions == (*finer, 2 * finer[-1])
    for level, resolution in enumerate(finer):
        left = corners_of(cells_at(fewer, cells, resolution))[corners_of(cells_at(occupied, cells, resolution))]
        assert torch.equal(small.table[small.rows_of_level(level)], lattice.table[lattice.rows_of_level(level)][left])
    assert not small.table[small.rows_of_level(len(finer))].any()


def test_other_cells_are_refused() -> None:
    occupied = np.zeros((4, 4, 4), np.uint8)
    occupied[0, 0, 0] = 1
    with pytest.raises(ValueError, match="not those of this lattice"):
        SparseLattice(occupied, 4, (4,), 1).restricted(occupied[::-1], 4)


@given(st.integers(0, 10**6), shapes, shares, st.sampled_from([(8, (2, 4, 8, 16)), (6, (2, 6)), (4, (4, 12))]))
def test_the_finest_level_holds_the_sum(
    seed: int, shape: tuple[int, int, int], share: float, levels: tuple[int, tuple[int, ...]]
) -> None:
    occupied, (cells, finer) = occupied_of(seed, shape, share), levels
    lattice = SparseLattice(occupied, cells, finer, 2)
    lattice.randomize(1.0, torch.Generator().manual_seed(seed))
    vertices, expected = lattice.vertices_of_level(len(finer) - 1, occupied, cells), 0.0
    for level, resolution in enumerate(finer):
        dense = np.zeros((*lattice.shapes[level].tolist(), 2), np.float32)
        dense[tuple(lattice.vertices_of_level(level, occupied, cells).T)] = (
            lattice.table[lattice.rows_of_level(level)].detach().numpy()
        )
        low, rest = np.divmod(vertices, finer[-1] // resolution)
        part = (rest * (resolution / finer[-1])).astype(np.float32)
        for corner in itertools.product((0, 1), repeat=3):
            weight = np.where(corner, part, 1.0 - part).prod(axis=1, dtype=np.float32)
            at = np.minimum(low + corner, np.array(dense.shape[:3]) - 1)
            expected = expected + weight[:, None] * dense[tuple(at.T)]
    np.testing.assert_array_equal(lattice.summed(occupied, cells).table.detach().numpy(), expected)


@pytest.mark.parametrize(("cells", "resolution"), [(4, 6), (4, 3)])
def test_levels_that_are_not_nested_are_refused(cells: int, resolution: int) -> None:
    with pytest.raises(ValueError, match=f"resolution {resolution}"):
        SparseLattice(np.ones((2, 2, 2), np.uint8), cells, (resolution,), 1)
