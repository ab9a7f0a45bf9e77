"""The numba kernels compared with the plain references, in value and gradient."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from functools import partial

import numba
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.geometry.box import Box
from svv.core.rays.encodings import hash_features, lattice_features, spherical_harmonics
from svv.core.rounding import KERNELS
from svv.fields.radiance.encodings import HashGrid, LatticeAdam, SparseLattice
from svv.fields.radiance.networks import BaseField, FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.phong import gradient_of
from svv.fields.radiance.rendering import Extinction, Marching, Rays, composite, march
from svv.kernels import reference
from svv.kernels.numba import kernels as numba_kernels
from svv.kernels.numba import lattice as numba_lattice
from svv.kernels.types import Kernels, Limits, Samples
from svv.train.base.first_extinction import largest_extinction, log_extinction
from tests.cube import cube_camera, cube_scene

pytestmark = pytest.mark.usefixtures("all_threads")

UNIT = Box((0.0, 0.0, 0.0), 1.0, (1.0, 1.0, 1.0))


def sparse_lattice(seed: int = 0, features: int = 3) -> SparseLattice:
    rng = np.random.default_rng(seed)
    occupied = (rng.random((8, 7, 6)) < 0.3).astype(np.uint8)
    lattice = SparseLattice(occupied, 8, (4, 8, 16), features)
    lattice.randomize(1.0, torch.Generator().manual_seed(seed))
    return lattice


def points_in(occupied: np.ndarray, cells: int, count: int, seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    where = np.argwhere(occupied)
    points = (where[rng.integers(0, len(where), count)] + rng.random((count, 3))) / cells
    return torch.from_numpy(points.astype(np.float32))


def test_lattice_matches_reference_in_value_and_gradient() -> None:
    lattice = sparse_lattice()
    rng = np.random.default_rng(0)
    occupied = (rng.random((8, 7, 6)) < 0.3).astype(np.uint8)
    x = points_in(occupied, 8, 500)
    table = lattice.table.detach().clone().requires_grad_()
    where = lattice.layout
    expected = lattice_features(x, where.shapes, where.scales, where.bases, where.index, table)
    got = lattice(x)
    torch.testing.assert_close(got, expected, atol=KERNELS["value"], rtol=0)
    upstream = torch.randn(expected.shape, generator=torch.Generator().manual_seed(1))
    expected.backward(upstream)
    got.backward(upstream)
    gradient, used = lattice.buffers_for_gradient()
    assert table.grad is not None
    torch.testing.assert_close(gradient, table.grad, atol=KERNELS["gradient"], rtol=1e-4)
    assert used[table.grad.abs().sum(1) > 0].all()


@pytest.mark.parametrize("levels", [(16,), (4, 8, 16)])
def test_lattice_backward_is_the_same_whatever_the_number_of_threads(levels: tuple[int, ...]) -> None:
    occupied = (np.random.default_rng(2).random((8, 7, 6)) < 0.5).astype(np.uint8)
    lattice = SparseLattice(occupied, 8, levels, 2)
    x = points_in(occupied, 8, 3000)
    upstream = torch.randn(3000, lattice.width, generator=torch.Generator().manual_seed(1))
    gradient, used = lattice.buffers_for_gradient()
    results, threads = [], numba.config.NUMBA_NUM_THREADS
    try:
        for number in sorted({1, threads}):
            numba.set_num_threads(number)
            gradient.zero_(), used.zero_()
            lattice.add_gradient(x, upstream)
            results.append((gradient.clone(), used.clone()))
    finally:
        numba.set_num_threads(threads)
    table = torch.zeros_like(gradient, requires_grad=True)
    where = lattice.layout
    lattice_features(x, where.shapes, where.scales, where.bases, where.index, table).backward(upstream)
    for got, marks in results:
        assert torch.equal(got, results[0][0])
        assert torch.equal(marks > 0, results[0][1] > 0)
        torch.testing.assert_close(got, table.grad, atol=KERNELS["gradient"], rtol=1e-4)


def test_lattice_reproduces_linear_functions() -> None:
    """Trilinear interpolation is exact for functions linear in x, y and z."""
    lattice = SparseLattice(np.ones((4, 4, 4), np.uint8), 4, (4,), 1)
    vertices = np.argwhere(np.ones((5, 5, 5))) / 4.0
    with torch.no_grad():
        lattice.table[:, 0] = torch.from_numpy(vertices @ [1.0, -2.0, 3.0] + 0.5)
    x = torch.rand(200, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(lattice(x)[:, 0], x @ torch.tensor([1.0, -2.0, 3.0]) + 0.5, atol=1e-5, rtol=0)


@pytest.mark.parametrize("finer", [(), (32,)])
def test_restricted_lattice_gives_the_same_features_where_it_still_is(finer: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    occupied = (rng.random((8, 8, 8)) < 0.4).astype(np.uint8)
    lattice = SparseLattice(occupied, 8, (4, 8, 16), 2)
    lattice.randomize(1.0, torch.Generator().manual_seed(3))
    fewer = occupied * (rng.random(occupied.shape) < 0.5)
    small = lattice.restricted(fewer, 8, finer)
    x = points_in(fewer, 8, 300)
    with torch.no_grad():
        assert torch.equal(small(x)[:, :6], lattice(x))
        assert not small(x)[:, 6:].any()
    assert len(small.table) < len(lattice.table) or finer


def test_summed_levels_are_one_level() -> None:
    """Nested trilinear levels sum to a trilinear function on the finest."""
    rng = np.random.default_rng(4)
    occupied = (rng.random((9, 7, 5)) < 0.4).astype(np.uint8)
    lattice = SparseLattice(occupied, 8, (2, 4, 8, 16), 1)
    lattice.randomize(1.0, torch.Generator().manual_seed(4))
    fewer = occupied * (rng.random(occupied.shape) < 0.7)
    x = points_in(fewer, 8, 500)
    with torch.no_grad():
        one = lattice.summed(fewer, 8)
        torch.testing.assert_close(one(x)[:, 0], lattice(x).sum(1), atol=2e-5, rtol=0)
    assert one.levels == 1
    assert torch.equal(one.summed(fewer, 8).table, one.table)  # a single level is its own sum


def test_hash_grid_matches_reference_in_value_and_gradient() -> None:
    grid = HashGrid(levels=5, features=2, log2_entries=8, coarsest=4, finest=64)
    grid.randomize(1.0, torch.Generator().manual_seed(0))
    x = torch.rand(400, 3, generator=torch.Generator().manual_seed(1))
    table = grid.table.detach().clone().requires_grad_()
    expected = hash_features(x, grid.resolutions, grid.offsets, table)
    got = grid(x)
    torch.testing.assert_close(got, expected, atol=KERNELS["value"], rtol=0)
    upstream = torch.randn(expected.shape, generator=torch.Generator().manual_seed(2))
    expected.backward(upstream)
    got.backward(upstream)
    torch.testing.assert_close(grid.buffers_for_gradient()[0], table.grad, atol=KERNELS["gradient"], rtol=1e-4)


@pytest.mark.parametrize("pull", [0.0, 0.5])
def test_lattice_adam_is_adam_on_the_rows_it_uses(pull: float) -> None:
    lattice = sparse_lattice(1)
    start = lattice.table.detach().clone()
    twin = start.clone().requires_grad_()
    theirs = torch.optim.Adam([twin], lr=0.01, betas=(0.9, 0.99), eps=1e-12)
    ours = LatticeAdam([lattice])
    finer = torch.arange(len(start))[:, None] >= lattice.rows_of_level(0).stop
    gradient = torch.randn(start.shape, generator=torch.Generator().manual_seed(0))
    rows = torch.arange(len(start)) % 3 > 0
    gradient[~rows] = 0.0
    for _ in range(5):
        buffer, used = lattice.buffers_for_gradient()
        buffer[:] = gradient
        used[:] = rows
        ours.step([0.01], [pull])
        twin.grad = gradient + pull * finer * rows[:, None] * twin.detach()
        theirs.step()
        assert not buffer.any()
        assert not used.any()
    torch.testing.assert_close(lattice.table.detach()[rows], twin.detach()[rows], atol=1e-5, rtol=0)
    assert torch.equal(lattice.table.detach()[~rows], start[~rows])


def test_bias_corrections_are_those_of_every_age() -> None:
    age = np.arange(1, numba_lattice.BIAS_CORRECTED_STEPS + 1)
    made = numba_lattice.bias_corrections(np.float32(0.9), np.float32(0.99))[1:]
    np.testing.assert_allclose(made, np.stack([1 - 0.9**age, 1 / (1 - 0.99**age)], axis=1), rtol=3e-5)


@given(st.integers(0, 10**6), st.sampled_from([(0.9, 0.99), (0.5, 0.999)]))
def test_adam_is_its_plain_reference_at_any_age(seed: int, betas: tuple[float, float]) -> None:
    random = torch.Generator().manual_seed(seed)
    age = torch.randint(0, 3 * numba_lattice.BIAS_CORRECTED_STEPS, (40,), generator=random, dtype=torch.int32)
    age[:5] = torch.arange(5)
    table, gradient, first = torch.randn(3, 40, 2, generator=random)
    used = (torch.rand(40, generator=random) < 0.7).byte()
    results = []
    for kernels in (numba_kernels, reference):
        moments = torch.stack([0.1 * first, first.square()])
        state = table.clone(), gradient.clone(), used.clone(), moments, age.clone()
        kernels.adam(*state, 0.01, (*betas, 1e-12), 0.1, 20)
        results.append(state)
    for got, expected in zip(*results, strict=True):
        torch.testing.assert_close(got, expected, rtol=1e-4, atol=1e-5)


def diagonal_rays(count: int, seed: int = 0) -> Rays:
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-1.0, 2.0, (count, 3))
    towards = rng.uniform(0.2, 0.8, (count, 3)) - origins
    directions = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    return Rays(torch.from_numpy(origins.astype(np.float32)), torch.from_numpy(directions.astype(np.float32)))


def brute_force_optical_depth(rays: Rays, occupancy: Occupancy, density: SparseLattice, step: float) -> np.ndarray:
    """Sums every half-step sample inside occupied cells, one by one."""
    depth = np.zeros(len(rays))
    for r, (o, d) in enumerate(zip(rays.origins.double().numpy(), rays.directions.double().numpy(), strict=True)):
        t = (np.arange(int(6 / step)) + 0.5) * step
        x = o + t[:, None] * d
        x = x[((x > 0) & (x < 1)).all(1)]
        cell = (x * occupancy.cells).astype(int)
        x = x[occupancy.occupied[tuple(cell.T)] > 0]
        if len(x):
            with torch.no_grad():
                raw = density(torch.from_numpy(x.astype(np.float32))).sum(1)
            depth[r] = float((torch.exp(raw.clamp(max=9.0)) * step).sum())
    return depth


@pytest.mark.parametrize("least_weight", [0.0, 0.02, 0.3])
def test_marching_conserves_optical_depth_whatever_it_leaves_out(least_weight: float) -> None:
    rng = np.random.default_rng(0)
    occupied = (rng.random((8, 8, 8)) < 0.4).astype(np.uint8)
    occupancy = Occupancy(UNIT, 8, occupied)
    density = SparseLattice(occupied, 8, (8,), 1)
    density.randomize(2.0, torch.Generator().manual_seed(0))
    rays, step = diagonal_rays(200), 1.0 / 64.0
    samples = march(rays, occupancy, density, Marching(step, least_weight, 0.0, 1e6))
    _, transmittance, weights = composite(samples, samples.sigma, samples.sigma[:, None])
    expected = brute_force_optical_depth(rays, occupancy, density, step)
    # A sample that rounding puts into the neighbouring cell may be counted or not.
    worst = np.exp(2.0) * step
    assert np.abs(-np.log(transmittance.numpy()) - expected).max() < 3 * worst
    assert np.median(np.abs(-np.log(transmittance.numpy()) - expected)) < 1e-4
    if least_weight == 0.0:
        total = np.bincount(samples.ray.numpy(), weights.numpy(), minlength=len(rays))
        np.testing.assert_allclose(total + transmittance.numpy(), 1.0, atol=1e-5)


def test_joined_samples_are_fewer_and_lose_nothing() -> None:
    occupancy = Occupancy(UNIT, 8, np.ones((8, 8, 8), np.uint8))
    density = SparseLattice(occupancy.occupied, 8, (8,), 1)
    density.randomize(1.5, torch.Generator().manual_seed(3))
    rays, exact = diagonal_rays(64), Marching(1 / 64, 0.0, 0.0, 30.0)
    joined = Marching(1 / 64, 0.05, 0.0, 30.0, merge=True)
    every, few = march(rays, occupancy, density, exact), march(rays, occupancy, density, joined)
    assert len(few) < 0.5 * len(every)
    x, whole, _ = composite(every, every.sigma, every.position)
    y, left, weights = composite(few, few.sigma, few.position)
    torch.testing.assert_close(left, whole, atol=1e-5, rtol=0)
    assert float(weights.min()) > 0.04
    # What is composited here is the position itself: a joined sample stands for its neighbours in front of it.
    assert float((x - y).abs().max()) < 0.05


@pytest.mark.parametrize("kernels", [numba_kernels, reference], ids=["numba", "reference"])
@pytest.mark.parametrize("shift", [-8.0, -5.0, 0.0])
def test_a_ray_that_keeps_nothing_shows_where_it_has_most(kernels: Kernels, shift: float) -> None:
    """A skin of less than a sample's weight has colour, depth and region, with its own opacity; fainter ones do not."""
    occupancy = Occupancy(UNIT, 8, np.ones((8, 8, 8), np.uint8))
    density = SparseLattice(occupancy.occupied, 8, (8,), 1)
    density.randomize(1.5, torch.Generator().manual_seed(3))
    with torch.no_grad():
        density.table.add_(shift)
    rays, distance = diagonal_rays(64), occupancy.distance_on(torch.device("cpu"))

    def marched(limits: Limits) -> Samples:
        given = rays.origins, rays.directions, distance, 8, UNIT.extent, density.layout, density.table
        return kernels.march(*given, 9.0, limits, 0, 16)[0]

    every = marched(Limits(1 / 64, 0.0, 0.0, 30.0, 1.0, False))
    few = marched(Limits(1 / 64, 1 / 16, 0.0, 30.0, 1.0, True))
    for ray in range(len(rays)):
        own, mine = ((s.ray == ray).nonzero()[:, 0] for s in (every, few))
        depth = float(every.sigma[own].sum()) / 64
        if -np.expm1(-depth) >= 1 / 16:
            assert len(mine) >= 1
        elif depth <= 1.0 / 4096.0:
            assert len(mine) == 0 and float(few.tail[ray]) == pytest.approx(depth, abs=1e-6)
        elif len(mine) == 1 and few.tail[ray] == 0.0:
            heaviest = own[every.sigma[own].argmax()]
            torch.testing.assert_close(few.position[mine[0]], every.position[heaviest])
            assert float(few.sigma[mine[0]]) / 64 == pytest.approx(depth, rel=1e-4)
        else:
            raise AssertionError(f"ray {ray} of optical depth {depth} has {len(mine)} samples")


def test_marching_without_stop_keeps_what_is_hidden() -> None:
    occupied = np.ones((4, 4, 4), np.uint8)
    occupancy = Occupancy(UNIT, 4, occupied)
    density = SparseLattice(occupied, 4, (4,), 1)
    with torch.no_grad():
        density.table.fill_(6.0)
    rays = Rays(torch.tensor([[-1.0, 0.5, 0.5]]), torch.tensor([[1.0, 0.0, 0.0]]))
    ended = march(rays, occupancy, density, Marching(1 / 32, 1e-3, 0.0, 7.0))
    through = march(rays, occupancy, density, Marching(1 / 32, 1e-3, 0.0, 7.0, fade=0.0))
    assert len(ended) < 8
    assert len(through) == 32


@pytest.mark.parametrize("fade", [1.0, 0.3, 0.05])
def test_rays_go_on_for_extinctions_that_will_be_scaled(fade: float) -> None:
    """Scaled by ``fade``, what a ray meets is the same as on a ray that never ends, for fewer samples."""
    occupied = np.ones((4, 4, 4), np.uint8)
    occupancy = Occupancy(UNIT, 4, occupied)
    density = SparseLattice(occupied, 4, (4,), 1)
    with torch.no_grad():
        density.table.fill_(6.0)
    rays, how = diagonal_rays(64), Marching(1 / 64, 1e-4, merge=True)
    endless, ended = (march(rays, occupancy, density, replace(how, fade=f)) for f in (0.0, fade))
    assert len(ended) < len(endless)
    x, left, _ = composite(endless, fade * endless.sigma, endless.position)
    y, also, _ = composite(ended, fade * ended.sigma, ended.position)
    assert float((left - also).abs().max()) < 1e-3
    assert float((x - y).abs().max()) < 2e-3


def test_a_step_of_training_leaves_no_samples_in_memory() -> None:
    occupancy = Occupancy(UNIT, 4, np.ones((4, 4, 4), np.uint8))
    samples = march(diagonal_rays(4), occupancy, None, Marching(1 / 8))
    sigma = torch.rand(len(samples), requires_grad=True)
    out, transmittance, _ = composite(samples, sigma, samples.position)
    (out.sum() + transmittance.sum()).backward()
    alive = weakref.ref(samples)
    del samples, out, transmittance, _
    gc.collect()
    assert alive() is None


@settings(deadline=None, max_examples=25)
@given(st.integers(1, 12), st.integers(1, 4), st.integers(0, 10**6))
def test_composite_matches_reference_in_value_and_gradient(count: int, channels: int, seed: int) -> None:
    """A ray of samples a step apart, compared with the reference by automatic differentiation."""
    occupied = np.ones((4, 4, 4), np.uint8)
    occupancy = Occupancy(UNIT, 4, occupied)
    density = SparseLattice(occupied, 4, (4,), 1)
    rays = Rays(torch.tensor([[-1.0, 0.3, 0.6]]), torch.tensor([[1.0, 0.0, 0.0]]))
    samples = march(rays, occupancy, density, Marching(1.0 / count, 0.0, 0.0, 1e6))
    generator = torch.Generator().manual_seed(seed)
    sigma = (3.0 * torch.rand(len(samples), generator=generator)).requires_grad_()
    values = torch.rand(len(samples), channels, generator=generator).requires_grad_()
    twins = [t.detach().clone().requires_grad_() for t in (sigma, values)]
    out, transmittance, weights = composite(samples, sigma, values)
    depth = torch.cumsum(twins[0] / count, dim=0)  # behind each sample
    expected_weights = torch.exp(-depth) * torch.expm1(twins[0] / count)  # Mildenhall et al. 2020, eq. 3
    expected_transmittance = torch.exp(-depth[-1])
    expected = expected_weights @ twins[1]
    torch.testing.assert_close(weights, expected_weights.detach(), atol=1e-5, rtol=0)
    torch.testing.assert_close(out[0], expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(transmittance[0], expected_transmittance, atol=1e-5, rtol=0)
    up = torch.randn(channels, generator=generator)
    ((out[0] * up).sum() + 2.0 * transmittance[0]).backward()
    ((expected * up).sum() + 2.0 * expected_transmittance).backward()
    for mine, twin in zip((sigma, values), twins, strict=True):
        torch.testing.assert_close(mine.grad, twin.grad, atol=KERNELS["gradient"], rtol=1e-3)


def test_extinction_gradient_reaches_the_density_lattice() -> None:
    """Finite differences of the transmittance with respect to one vertex of every level."""
    occupied = np.ones((4, 4, 4), np.uint8)
    occupancy = Occupancy(UNIT, 4, occupied)
    density = SparseLattice(occupied, 4, (2, 4), 1)
    density.randomize(1.0, torch.Generator().manual_seed(5))
    rays, how = diagonal_rays(20, 1), Marching(1 / 40, 0.0, 0.0, 1e6)

    def transmittance() -> float:
        s = march(rays, occupancy, density, how)
        return float(composite(s, s.sigma, s.sigma[:, None])[1].double().sum())

    samples = march(rays, occupancy, density, how)
    sigma = Extinction.apply(samples, density.table, density)
    composite(samples, sigma, torch.zeros(len(samples), 1))[1].sum().backward()
    gradient = density.buffers_for_gradient()[0][:, 0]
    for row in (int(gradient[:27].abs().argmax()), 27 + int(gradient[27:].abs().argmax())):
        step = 0.02
        with torch.no_grad():
            density.table[row] += step
            above = transmittance()
            density.table[row] -= 2 * step
            below = transmittance()
            density.table[row] += step
        assert float(gradient[row]) == pytest.approx((above - below) / (2 * step), rel=0.02)


def test_spherical_harmonics_are_orthonormal() -> None:
    """Monte-Carlo-free check: Fibonacci points integrate products of low bands almost exactly."""
    n = 20000
    k = np.arange(n) + 0.5
    z = 1 - 2 * k / n
    phi = np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    d = torch.from_numpy(np.stack([r * np.cos(phi), r * np.sin(phi), z], 1))
    basis = spherical_harmonics(d, 4)
    gram = basis.T @ basis * (4 * np.pi / n)
    torch.testing.assert_close(gram, torch.eye(16, dtype=torch.float64), atol=1e-3, rtol=0)


@given(st.integers(0, 2**31), st.sampled_from([(2, 4), (8,), (4, 16)]))
def test_nothing_is_read_behind_the_table(seed: int, levels: tuple[int, ...]) -> None:
    """A lattice may be asked at its own vertices, even the last; what lies behind its numbers does not count."""
    occupied = (np.random.default_rng(seed).random((8, 8, 8)) < 0.02).astype(np.uint8)
    occupied[3, 4, 5] = 1
    occupancy = Occupancy(Box((0.0, 0.0, 0.0), 1.0, (1.0, 1.0, 1.0)), 8, occupied)
    field = BaseField(FieldSettings(resolutions=levels, width=16), occupancy)
    density = field.density
    assert isinstance(density, SparseLattice)
    behind = torch.full((len(density.table) + 64, 1), torch.nan)
    behind[: len(density.table)] = torch.rand(len(density.table), 1)
    density.table = torch.nn.Parameter(behind[: len(density.table)])
    for level in range(len(density.resolutions)):
        places = torch.from_numpy(density.places_of_level(level, occupied, 8))
        found = density.look_up(places)[:, level]
        torch.testing.assert_close(found, density.table[density.rows_of_level(level), 0].detach(), rtol=0, atol=1e-4)
    assert largest_extinction(partial(log_extinction, field), occupancy, torch.device("cpu")).isfinite().all()
    assert gradient_of(density, occupancy, levels[-1]).isfinite().all()


@pytest.mark.parametrize("network", ["base", "pcn"])
def test_a_skin_of_one_percent_has_its_colour_depth_and_region(network: str) -> None:
    """What weighs less than a sample does is shown where most of it is, not in black at the camera."""
    scene, camera = cube_scene(), cube_camera()
    assert scene.base.density is not None
    with torch.no_grad():
        scene.base.density.table.sub_(2.3)  # of each of two levels
    skin = replace(scene, joined=1.0 / 16.0).render(camera, network)
    exact = replace(scene, joined=1e-6).render(camera, network)
    shown = skin.rgba[..., 3] > 0.0
    assert shown.any() and float(skin.rgba[..., 3].max()) < 1.0 / 16.0
    np.testing.assert_allclose(skin.rgba[..., 3], exact.rgba[..., 3], atol=1e-4)
    assert (skin.rgba[shown][:, :3].max(axis=1) > 0.05).all()
    assert np.abs(skin.rgba[shown] - exact.rgba[shown])[:, :3].mean() < 0.2
    assert (np.abs(skin.depth[shown] - 3.0) < 0.9).all(), "in the cube"
