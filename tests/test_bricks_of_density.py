"""Bricks of a density: images marched through them are the same, and they follow every change of the table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.geometry.box import Box
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, Rays, march
from svv.kernels import reference
from svv.kernels.numba import bricks as numba_bricks
from svv.kernels.numba.bricks import CELLS, NO_BRICKS, VERTICES
from svv.kernels.types import Limits, Samples

IMAGE = Marching(step=0.02, least_weight=1e-3, merge=True)


def density(seed: int, shape: tuple[int, int, int], finer: int, share: float) -> tuple[SparseLattice, Occupancy]:
    rng = np.random.default_rng(seed)
    occupied = (rng.random(shape) < share).astype(np.uint8)
    occupied[tuple(rng.integers(0, n) for n in shape)] = 1
    cells = max(shape)
    lattice = SparseLattice(occupied, cells, (finer * cells,), 1)
    lattice.table.requires_grad_(False).copy_(torch.from_numpy(rng.normal(1.0, 2.0, (len(lattice.table), 1))))
    extent = tuple(n / cells for n in shape)
    return lattice, Occupancy(Box((0.0, 0.0, 0.0), 1.0, extent), cells, occupied)


def rays_through(occupancy: Occupancy, seed: int, count: int = 200) -> Rays:
    rng = np.random.default_rng(seed)
    to = rng.random((count, 3)) * occupancy.box.extent
    origins = to + rng.normal(size=(count, 3)) * 2.0
    directions = to - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Rays(*(torch.from_numpy(a.astype(np.float32)) for a in (origins, directions)))


def assert_same(one: Samples, other: Samples) -> None:
    assert one.count.tolist() == other.count.tolist()
    for name in ("position", "sigma", "skipped", "tail"):
        torch.testing.assert_close(getattr(one, name), getattr(other, name), rtol=1e-4, atol=1e-4)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    shape=st.tuples(*[st.integers(1, 19)] * 3),
    finer=st.sampled_from([1, 2, 3]),
    share=st.sampled_from([0.05, 0.5, 1.0]),
)
def test_images_are_marched_through_bricks_as_through_the_table(
    seed: int, shape: tuple[int, int, int], finer: int, share: float
) -> None:
    lattice, occupancy = density(seed, shape, finer, share)
    rays = rays_through(occupancy, seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba_bricks, "MOST_ROOM", 10**6)
        patch.setattr(numba_bricks, "RAYS_FIRST", 10**9)
        without = march(rays, occupancy, lattice, IMAGE)
        patch.setattr(numba_bricks, "RAYS_FIRST", 0)
        assert_same(march(rays, occupancy, lattice, IMAGE), without)
        bricks = numba_bricks.bricks_for(lattice.layout, lattice.table, Limits(0.02, 1e-3, 0.0, 7.0, 1.0, True), 1)
    assert bricks is not NO_BRICKS


def test_the_reference_marches_as_bricks_do(monkeypatch: pytest.MonkeyPatch) -> None:
    lattice, occupancy = density(3, (9, 17, 5), 2, 0.4)
    rays = rays_through(occupancy, 4)
    monkeypatch.setattr(numba_bricks, "MOST_ROOM", 10**6)
    monkeypatch.setattr(numba_bricks, "RAYS_FIRST", 0)
    got = march(rays, occupancy, lattice, IMAGE)
    monkeypatch.setattr("svv.fields.radiance.rendering.kernels_for", lambda tensor: reference)
    assert_same(got, march(rays, occupancy, lattice, IMAGE))


def test_bricks_follow_a_change_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    lattice, occupancy = density(5, (8, 8, 8), 2, 0.5)
    rays = rays_through(occupancy, 6)
    monkeypatch.setattr(numba_bricks, "MOST_ROOM", 10**6)
    monkeypatch.setattr(numba_bricks, "RAYS_FIRST", 0)
    before = march(rays, occupancy, lattice, IMAGE)
    lattice.table.add_(1.0)
    after = march(rays, occupancy, lattice, IMAGE)
    assert after.sigma.mean() > before.sigma.mean()
    monkeypatch.setattr(numba_bricks, "bricks_for", lambda *_: NO_BRICKS)
    assert_same(after, march(rays, occupancy, lattice, IMAGE))


def test_a_brick_holds_the_values_of_its_vertices() -> None:
    lattice, occupancy = density(7, (10, 9, 11), 1, 0.7)
    where = lattice.layout
    slots, values = numba_bricks.made(where, lattice.table[:, 0].numpy(), np.inf)
    vertices = lattice.vertices_of_level(0, occupancy.occupied, occupancy.cells)
    brick, inside = np.divmod(vertices, CELLS)
    # A vertex on the last face of the lattice may begin no brick of its own: it is in the one before.
    past = brick >= slots.shape
    brick, inside = np.where(past, brick - 1, brick), np.where(past, CELLS, inside)
    at = slots[tuple(brick.T)] * VERTICES + inside @ [(CELLS + 1) ** 2, CELLS + 1, 1]
    np.testing.assert_array_equal(values[at], lattice.table[:, 0].numpy())


def test_there_are_no_bricks_where_they_are_of_no_use(monkeypatch: pytest.MonkeyPatch) -> None:
    lattice, _ = density(8, (16, 16, 16), 2, 0.9)
    image = Limits(0.02, 1e-3, 0.0, 7.0, 1.0, True)

    def bricks(table: torch.Tensor, limits: Limits, rays: int) -> object:
        return numba_bricks.bricks_for(lattice.layout, table, limits, rays)

    few, many = 100, numba_bricks.RAYS_FIRST
    table = lattice.table.detach().clone()
    assert bricks(table, image, few) is NO_BRICKS
    assert bricks(table, image, many) is not NO_BRICKS
    assert bricks(table, image, few) is not NO_BRICKS
    assert bricks(table, replace(image, merge=False), many + 1) is NO_BRICKS, "training leaves samples out"
    learning = table.clone().requires_grad_()
    assert bricks(learning, image, many + 1) is NO_BRICKS, "the table is about to change"
    monkeypatch.setattr(numba_bricks, "MOST_ROOM", 0.5)
    assert bricks(table.clone(), image, many + 1) is NO_BRICKS, "they would take too much memory"
