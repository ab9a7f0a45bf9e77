"""A training holds each large array once, where something is in it, and frees it when it is done with it."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as drawn
from torch import nn

from svv.core.geometry.box import Box
from svv.core.images.blank import blank, draw_into
from svv.fields.radiance import encodings, occupancy
from svv.fields.radiance.encodings import LatticeAdam, SparseLattice
from svv.fields.radiance.occupancy import Occupancy, largest_in
from svv.train.run import loop
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.loop import LastGood


@given(drawn.arrays(np.uint8, drawn.array_shapes(min_dims=4, max_dims=4), elements=st.integers(0, 1)))
def test_pictures_are_drawn_whole(pictures: np.ndarray) -> None:
    found = blank(pictures.shape)
    assert not found.any()
    for place, picture in zip(found, pictures, strict=True):
        draw_into(place, picture)
    assert np.array_equal(found, pictures)


def test_pictures_without_room_are_a_lack_of_memory() -> None:
    with pytest.raises(MemoryError):
        blank((1 << 40, 1 << 10, 4))


RESIDENT = """
from pathlib import Path
import numpy as np
from svv.core.images.blank import blank, draw_into

def resident():
    lines = Path("/proc/self/smaps_rollup").read_text().splitlines()
    return 1024 * int(next(line for line in lines if line.startswith("Anonymous:")).split()[1])

before, pictures, picture = resident(), blank((40, 512, 512, 4)), np.zeros((512, 512, 4), np.uint8)
picture[128:256] = 255
for place in pictures:
    draw_into(place, picture)
print(int(pictures[..., 3].sum(dtype=np.int64)), pictures.nbytes, resident() - before)
"""
"""Tells what pictures take: in a process of its own, in which nothing else comes and goes."""


@pytest.mark.skipif(sys.platform != "linux", reason="reads what Linux says of a process")
def test_empty_rows_of_pictures_take_no_memory() -> None:
    told = subprocess.run([sys.executable, "-c", RESIDENT], capture_output=True, text=True, check=True).stdout
    drawn, size, taken = map(int, told.split())
    assert drawn == 40 * 128 * 512 * 255  # reading takes none, either
    assert 0.25 * size <= taken + (1 << 20) <= 0.3 * size


def lattice() -> SparseLattice:
    occupied = np.random.default_rng(0).integers(0, 2, (8, 8, 8)).astype(np.uint8)
    return SparseLattice(occupied, 8, (8, 16), 3)


def test_random_features_are_the_same_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    whole, parts = lattice(), lattice()
    whole.randomize(0.5, torch.Generator().manual_seed(1))
    monkeypatch.setattr(encodings, "ROWS_AT_A_TIME", 100)
    parts.randomize(0.5, torch.Generator().manual_seed(1))
    assert len(parts.table) > 1000
    assert torch.equal(whole.table, parts.table)


def test_largest_extinctions_are_the_same_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    where = Occupancy.full(Box.of_bounds((0.0,) * 3, (1.0,) * 3), 6)
    corner = torch.from_numpy(np.argwhere(where.occupied))

    def exponent(points: torch.Tensor) -> torch.Tensor:
        return (9.0 * points).sin().sum(dim=1)

    whole = largest_in(exponent, corner, where)
    monkeypatch.setattr(occupancy, "CELLS_AT_A_TIME", 50)
    assert torch.equal(largest_in(exponent, corner, where), whole)


def test_distances_that_were_freed_are_found_again() -> None:
    where = Occupancy.full(Box.of_bounds((0.0,) * 3, (1.0,) * 3), 8)
    first = where.distance_on(torch.device("cpu")).clone()
    where.forget_distances()
    assert torch.equal(where.distance_on(torch.device("cpu")), first)


def test_the_last_good_state_is_kept_once_and_apart_from_the_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "SUMMED", 4)
    network = nn.Linear(5, 3)
    good = LastGood(network)
    assert good.keep(1)
    first = {name: value.data_ptr() for name, value in good._state.items()}
    with torch.no_grad():
        network.weight.fill_(2.0)
    assert good.keep(2)
    assert first == {name: value.data_ptr() for name, value in good._state.items()}
    with torch.no_grad():
        network.weight[2, 4] = torch.nan
    assert not good.keep(3)
    assert good.restore() == 2
    assert (network.weight == 2.0).all()
    network.weight = nn.Parameter(torch.ones(3, 7))
    assert good.restore() is None
    assert good.keep(4)
    with torch.no_grad():
        network.weight.zero_()
    assert good.restore() == 4
    assert (network.weight == 1.0).all()


def test_optimisers_free_the_state_of_tables_that_are_replaced() -> None:
    old = lattice()
    adam = LatticeAdam([old])
    old.buffers_for_gradient()
    states = [weakref.ref(each) for each in (*adam.moments, *adam.age, old.gradient, old.used)]
    adam.forget()
    assert all(state() is None for state in states)
    adam.restart([new := lattice()])
    assert adam.moments[0].shape == (2, *new.table.shape)
    assert not adam.moments[0].any()


def test_a_checkpoint_does_not_hold_what_it_has_written(tmp_path: Path) -> None:
    table, network = lattice(), nn.Linear(2, 2)
    tables, networks = LatticeAdam([table]), loop.network_adam(list(network.parameters()))
    checkpoint, extra = Checkpoint(tmp_path / "c", {}), np.arange(3)
    held = weakref.ref(extra)
    checkpoint.stage("base", network, networks, tables).save(3, 1.5, {"rays": extra})
    del extra
    gc.collect()
    assert held() is None
    read = Checkpoint(tmp_path / "c", {})
    assert (read.extra("base") or {})["rays"].tolist() == [0, 1, 2]
    assert read.stage("base", network, networks, tables).restored == (3, 1.5)
