"""Bricks of a density: images marched through them are the same, and they follow every change of the table."""

from __future__ import annotations

from collections.abc import Callable
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


def with_no_bricks(march_: Callable[[], Samples]) -> Samples:
    """What is marched without bricks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba_bricks, "bricks_for", lambda *_: NO_BRICKS)
        return march_()


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
        without = with_no_bricks(lambda: march(rays, occupancy, lattice, IMAGE))
        assert_same(march(rays, occupancy, lattice, IMAGE), without)
        bricks = numba_bricks.bricks_for(lattice.layout, lattice.table, Limits(0.02, 1e-3, 0.0, 7.0, 1.0, True))
    assert bricks is not NO_BRICKS


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    stop=st.sampled_from([0.5, 7.0]),
    fade=st.sampled_from([0.0, 0.3, 1.0]),
    along=st.booleans(),
    inside=st.booleans(),
)
def test_rays_of_an_image_begin_leap_and_end_as_others_do(
    seed: int, stop: float, fade: float, along: bool, inside: bool
) -> None:
    """Rays along axes and from inside the box, too, and with less room for samples than they need."""
    lattice, occupancy = density(seed, (9, 14, 6), 2, 0.2)
    rays = rays_through(occupancy, seed, 300)
    if along:
        nearest = rays.directions.abs().argmax(dim=1, keepdim=True)
        directions = torch.zeros_like(rays.directions).scatter_(1, nearest, rays.directions.gather(1, nearest).sign())
        rays = replace(rays, directions=directions)
    if along or inside:
        rays = replace(rays, origins=torch.rand(300, 3, generator=torch.Generator().manual_seed(seed)) * 0.6)
    how = replace(IMAGE, stop=stop, fade=fade)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba_bricks, "MOST_ROOM", 10**6)
        without = with_no_bricks(lambda: march(rays, occupancy, lattice, how))
        occupancy.samples_a_ray = 1
        got = march(rays, occupancy, lattice, how)
    assert_same(got, without)
    assert got.ray.tolist() == np.repeat(np.arange(300), got.count.numpy()).tolist()
    assert got.start.tolist() == (got.count.cumsum(0) - got.count).tolist()


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    shape=st.tuples(*[st.integers(1, 19)] * 3),
    finer=st.sampled_from([1, 2, 3]),
)
def test_images_are_marched_through_bytes_as_through_the_table_of_a_file(
    seed: int, shape: tuple[int, int, int], finer: int
) -> None:
    lattice, occupancy = density(seed, shape, finer, 0.5)
    lattice.table.copy_(lattice.unpacked(lattice.packed()))
    rays, how = rays_through(occupancy, seed), replace(IMAGE, stop=20.0)
    without = alpha_of(with_no_bricks(lambda: march(rays, occupancy, lattice, how)))
    bricks = numba_bricks.keep_bricks(lattice.layout, lattice.table, np.inf)
    assert bricks.codes.dtype == np.uint8
    torch.testing.assert_close(alpha_of(march(rays, occupancy, lattice, how)), without, rtol=0.0, atol=2e-5)


def alpha_of(samples: Samples) -> torch.Tensor:
    depths = (samples.sigma * samples.step + samples.skipped).double()
    return 1.0 - torch.exp(-samples.tail.double().index_add(0, samples.ray.long(), depths))


@settings(max_examples=50, deadline=None)
@given(
    codes=st.lists(st.integers(0, 255), max_size=40),
    low=st.floats(-20.0, 20.0, width=32),
    length=st.floats(0.125, 40.0, width=32),
)
def test_values_at_256_levels_become_bytes(codes: list[int], low: float, length: float) -> None:
    table = (low + np.float64(length) / 255.0 * np.array([0, 255, *codes])).astype(np.float32)
    got, first, level = numba_bricks.coded(table)
    assert got.dtype == np.uint8
    assert got.tolist() == [0, 255, *codes]
    np.testing.assert_allclose(first + level * got.astype(np.float64), table, rtol=0.0, atol=4e-6 * (40.0 + abs(low)))


@given(off=st.floats(0.01, 0.99), code=st.integers(0, 254))
@settings(max_examples=50, deadline=None)
def test_a_value_between_the_levels_keeps_the_table_as_it_is(off: float, code: int) -> None:
    table = np.array([-6.0, 9.0, -6.0 + (code + off) * 15.0 / 255.0], np.float32)
    got, low, level = numba_bricks.coded(table)
    assert got is table
    assert (float(low), float(level)) == (0.0, 1.0)


def test_values_that_are_all_the_same_have_no_levels() -> None:
    table = np.full(9, 2.5, np.float32)
    assert numba_bricks.coded(table)[0] is table


def test_the_reference_marches_as_bricks_do(monkeypatch: pytest.MonkeyPatch) -> None:
    lattice, occupancy = density(3, (9, 17, 5), 2, 0.4)
    rays = rays_through(occupancy, 4)
    monkeypatch.setattr(numba_bricks, "MOST_ROOM", 10**6)
    got = march(rays, occupancy, lattice, IMAGE)
    monkeypatch.setattr("svv.fields.radiance.rendering.kernels_for", lambda tensor: reference)
    assert_same(got, march(rays, occupancy, lattice, IMAGE))


def test_bricks_follow_a_change_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    lattice, occupancy = density(5, (8, 8, 8), 2, 0.5)
    rays = rays_through(occupancy, 6)
    monkeypatch.setattr(numba_bricks, "MOST_ROOM", 10**6)
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

    def bricks(table: torch.Tensor, limits: Limits) -> object:
        return numba_bricks.bricks_for(lattice.layout, table, limits)

    table = lattice.table.detach().clone()
    assert bricks(table, image) is not NO_BRICKS
    assert bricks(table, replace(image, merge=False)) is NO_BRICKS, "training leaves samples out"
    learning = table.clone().requires_grad_()
    assert bricks(learning, image) is NO_BRICKS, "the table is about to change"
    monkeypatch.setattr(numba_bricks, "MOST_ROOM", 0.5)
    assert bricks(table.clone(), image) is NO_BRICKS, "they would take too much memory"


def test_an_image_does_not_depend_on_what_was_drawn_before() -> None:
    """Bit by bit: its last bits are others with bricks than without."""
    lattice, occupancy = density(9, (16, 16, 16), 2, 0.9)
    lattice.table.copy_(lattice.unpacked(lattice.packed()))
    first, again = (march(rays_through(occupancy, 1), occupancy, lattice, IMAGE) for _ in range(2))
    for _ in range(200):
        march(rays_through(occupancy, 2), occupancy, lattice, IMAGE)
    last = march(rays_through(occupancy, 1), occupancy, lattice, IMAGE)
    assert torch.equal(first.sigma, again.sigma) and torch.equal(first.sigma, last.sigma)
