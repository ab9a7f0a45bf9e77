"""The Triton kernels and the reference compared with numba and `svv.core`, in value and gradient.

The Triton kernels run on a GPU if there is one, otherwise in Triton's interpreter; the inputs are then small, because
each operation there takes about a millisecond.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.box import Box
from svv.core.cameras import Camera
from svv.core.encodings import hash_features, lattice_features
from svv.core.marching import uniform as reference_uniform
from svv.core.rounding import KERNELS
from svv.fields.encodings import HashGrid, SparseLattice
from svv.fields.networks import FieldSettings
from svv.fields.occupancy import Occupancy
from svv.fields.region import Region
from svv.fields.rendering import Marching, RayCaster
from svv.fields.scene import Scene
from svv.io.viewset import ViewSet
from svv.kernels import dispatch, numba_kernels, reference
from svv.kernels.dispatch import CPU
from svv.kernels.numba_marching import uniform as numba_uniform
from svv.kernels.types import Kernels, Limits, Samples
from svv.train.beginning import Beginning
from svv.train.config import RecolourSettings, ReconstructSettings
from svv.train.loop import Running
from svv.train.recolour import recolour
from svv.train.reconstruct import Reconstruction
from tests.interpreted import GPU, triton_kernels

pytestmark = pytest.mark.usefixtures("all_threads")

DEVICE = torch.device("cuda" if GPU else "cpu")
OTHERS = [reference, triton_kernels]
TOLERANCE = {"loss": 1e-4, "share": 0.01, "picture": 2e-3}
"""Of a short training: ``loss`` absolute; ``share``: half precision puts a few samples between two regions into the
other; ``picture`` the mean error in [0, 1]."""
FEW = settings(deadline=None, max_examples=3)
"""Examples where each runs in the interpreter."""


@pytest.fixture(autouse=True)
def large_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """The interpreter pays by the operation, not by the element."""
    if not GPU:
        monkeypatch.setattr(triton_kernels, "RAY_BLOCK", 64)


def there(kernels: object) -> torch.device:
    """Where kernels can be tried on this machine."""
    return DEVICE if kernels is triton_kernels else CPU


def lattice_of(seed: int, features: int, resolutions: tuple[int, ...] = (2, 4, 8)) -> tuple[SparseLattice, np.ndarray]:
    rng = np.random.default_rng(seed)
    occupied = (rng.random((4, 3, 4)) < 0.4).astype(np.uint8)
    occupied[1, 1, 1] = 1
    lattice = SparseLattice(occupied, 4, resolutions, features)
    lattice.randomize(1.0, torch.Generator().manual_seed(seed))
    return lattice, occupied


def points_in(occupied: np.ndarray, count: int, seed: int) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    where = np.argwhere(occupied)
    points = (where[rng.integers(0, len(where), count)] + rng.random((count, 3))) / 4
    return torch.from_numpy(points.astype(np.float32))


@FEW
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 150))
@pytest.mark.parametrize("kernels", OTHERS)
def test_lattice_is_the_reference_in_value_and_gradient(kernels: Kernels, seed: int, features: int, count: int) -> None:
    lattice, occupied = lattice_of(seed, features, (4, 8))
    x = points_in(occupied, count, seed)
    table = lattice.table.detach().clone().requires_grad_()
    where = lattice.layout
    expected = lattice_features(x, where.shapes, where.scales, where.bases, where.index, table)
    upstream = torch.randn(expected.shape, generator=torch.Generator().manual_seed(seed))
    expected.backward(upstream)
    marks = torch.zeros(len(table), dtype=torch.uint8)
    numba_kernels.lattice_backward(x, upstream, where, torch.zeros_like(table, requires_grad=False), marks)

    device = there(kernels)
    moved = lattice.to(device)
    got = kernels.lattice_encode(x.to(device), moved.layout, moved.table)
    gradient, used = moved.buffers_for_gradient()
    kernels.lattice_backward(x.to(device), upstream.to(device), moved.layout, gradient, used)
    torch.testing.assert_close(got.cpu(), expected.detach(), atol=KERNELS["value"], rtol=0)
    torch.testing.assert_close(gradient.cpu(), table.grad, atol=KERNELS["gradient"], rtol=1e-5)
    assert torch.equal(used.cpu(), marks)


@FEW
@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 150))
@pytest.mark.parametrize("kernels", OTHERS)
def test_hash_grid_is_the_reference_in_value_and_gradient(
    kernels: Kernels, seed: int, features: int, count: int
) -> None:
    """The coarse level is stored whole, the fine one is hashed."""
    grid = HashGrid(levels=2, features=features, log2_entries=8, coarsest=4, finest=100)
    grid.randomize(1.0, torch.Generator().manual_seed(seed))
    x = torch.rand(count, 3, generator=torch.Generator().manual_seed(seed))
    x[0] = torch.tensor([0.0, 1.0, 1.0])
    table = grid.table.detach().clone().requires_grad_()
    expected = hash_features(x, grid.resolutions, grid.offsets, table)
    upstream = torch.randn(expected.shape, generator=torch.Generator().manual_seed(seed))
    expected.backward(upstream)
    marks = torch.zeros(len(table), dtype=torch.uint8)
    where = grid.resolutions, grid.offsets
    numba_kernels.hash_backward(x, upstream, *where, torch.zeros_like(table, requires_grad=False), marks)

    device = there(kernels)
    grid.to(device)
    got = kernels.hash_encode(x.to(device), grid.resolutions, grid.offsets, grid.table)
    gradient, used = grid.buffers_for_gradient()
    kernels.hash_backward(x.to(device), upstream.to(device), grid.resolutions, grid.offsets, gradient, used)
    torch.testing.assert_close(got.cpu(), expected.detach(), atol=KERNELS["value"], rtol=0)
    torch.testing.assert_close(gradient.cpu(), table.grad, atol=KERNELS["gradient"], rtol=1e-5)
    assert torch.equal(used.cpu(), marks)


@FEW
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 300), st.sampled_from([0.0, 0.5]))
@pytest.mark.parametrize("kernels", OTHERS)
def test_adam_is_that_of_the_processor(kernels: Kernels, seed: int, features: int, rows: int, pull: float) -> None:
    """Rows join and leave from step to step; what is not marked stays as it is."""
    ends = []
    for k in (numba_kernels, kernels):
        device, generator = there(k), torch.Generator().manual_seed(seed)
        table = torch.randn(rows, features, generator=generator).to(device)
        moments = torch.zeros(2, rows, features, device=device)
        age = torch.zeros(rows, dtype=torch.int32, device=device)
        for _ in range(3):
            gradient = torch.randn(rows, features, generator=generator).to(device)
            used = (torch.rand(rows, generator=generator) < 0.6).to(torch.uint8).to(device)
            unmarked = torch.where(used[:, None] > 0, 0.0, gradient)
            k.adam(table, gradient, used, moments, age, 0.01, (0.9, 0.99, 1e-12), pull, rows // 2)
            assert not used.any()
            assert torch.equal(gradient, unmarked)
        ends.append((table.cpu(), moments.cpu(), age.cpu()))
    for mine, theirs in zip(*ends, strict=True):
        torch.testing.assert_close(mine, theirs, atol=KERNELS["value"], rtol=1e-5)


@pytest.mark.parametrize("kernels", OTHERS)
def test_pixel_rays_are_those_of_the_cameras(kernels: Kernels, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: kernels)
    generator = np.random.default_rng(0)
    poses = []
    for _ in range(3):
        pose = np.eye(4)
        pose[:3, :3] = np.linalg.qr(generator.normal(size=(3, 3)))[0]
        pose[:3, 2] *= np.linalg.det(pose[:3, :3])
        pose[:3, 3] = generator.normal(size=3)
        for span in (None, 2.5):
            poses += [Camera(pose, 0.6, 15, 10, span, centre) for centre in (None, (3.2, 11.0))]
    box = Box((-1.0, -2.0, -3.0), 4.0, (1.0, 1.0, 1.0))
    pixels = torch.from_numpy(generator.permutation(12 * 150)[:520])
    rays = RayCaster(poses, box, there(kernels)).rays(pixels)
    truth = [np.stack([c.rays()[k] for c in poses]).reshape(-1, 3)[pixels] for k in (0, 1)]
    np.testing.assert_allclose(rays.origins.cpu(), box.to_box(truth[0]), atol=1e-5)
    np.testing.assert_allclose(rays.directions.cpu(), truth[1], atol=1e-5)


@given(st.integers(1, 2**31), st.integers(0, 2**20), st.integers(0, 2**15))
def test_random_numbers_are_the_same_everywhere(seed: int, a: int, b: int) -> None:
    got = reference_uniform(seed, torch.tensor(a), torch.tensor(b))
    assert 0.0 <= float(got) < 1.0
    with np.errstate(over="ignore"):  # it counts modulo 2^64
        assert float(got) == numba_uniform.py_func(np.uint64(seed), np.uint64(a), np.uint64(b))


HOW = [
    (Limits(1 / 8, 1e-3, 0.1, 3.0, 1.0, False), 7),
    (Limits(1 / 8, 0.05, 0.0, 7.0, 1.0, True), 0),
    (Limits(1 / 8, 0.05, 0.0, 3.0, 0.4, True), 0),
    (Limits(1 / 8, 0.05, 0.0, 3.0, 0.0, True), 0),
    (Limits(1 / 8, -1.0, 0.0, 0.0, 0.0, False), 3),
]
"""Training, images, images of a scene with fainter and with hidden regions, and a march that keeps everything."""


def rays_through(count: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Rays from all around, some beside the box, the last three along the axes."""
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-1.0, 2.0, (count, 3))
    directions = rng.uniform(0.0, 1.0, (count, 3)) - origins
    directions[-3:] = np.eye(3) * [[1.0], [-1.0], [1.0]]
    origins[-3:] = [(-1.0, 0.4, 0.6), (0.3, 2.0, 0.2), (0.2, 0.7, -1.0)]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return torch.from_numpy(origins.astype(np.float32)), torch.from_numpy(directions.astype(np.float32))


def marched(kernels: Kernels, how: Limits, jitter: int, seed: int, count: int = 40) -> Samples:
    lattice, occupied = lattice_of(seed, 1, (4, 8))
    with torch.no_grad():
        lattice.table.mul_(2.0)
    device, extent = there(kernels), (1.0, 0.75, 1.0)
    lattice.to(device)
    occupancy = Occupancy(Box((0.0, 0.0, 0.0), 1.0, extent), 4, occupied)
    origins, directions = (a.to(device) for a in rays_through(count, seed))
    return kernels.march(
        origins, directions, occupancy.distance_on(device), 4, extent, lattice.layout, lattice.table, 9.0, how, jitter,
        16,
    )[0]  # fmt: skip


@pytest.mark.parametrize(("how", "jitter"), HOW)
@pytest.mark.parametrize("kernels", OTHERS)
def test_marches_find_the_same_samples(kernels: Kernels, how: Limits, jitter: int) -> None:
    expected, got = marched(numba_kernels, how, jitter, 5), marched(kernels, how, jitter, 5)
    assert len(expected) > 20
    # A sample that rounding puts into the neighbouring cell may be kept or not: such rays are few.
    same = got.count.cpu() == expected.count
    assert int((~same).sum()) <= 1
    assert torch.equal(got.start.cpu(), got.count.cpu().cumsum(0) - got.count.cpu())
    mine, theirs = (same[s.ray.long().cpu()] for s in (got, expected))
    for name, tolerance in (("position", (1e-6, 0.0)), ("sigma", (0.0, KERNELS["sigma"])), ("skipped", (1e-5, 1e-5))):
        torch.testing.assert_close(
            getattr(got, name).cpu()[mine], getattr(expected, name)[theirs], atol=tolerance[0], rtol=tolerance[1]
        )
    assert torch.equal(got.ray.cpu()[mine], expected.ray[theirs])
    torch.testing.assert_close(got.tail.cpu()[same], expected.tail[same], atol=1e-5, rtol=1e-5)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.integers(0, 100), st.sampled_from(HOW[:2]))
def test_plain_march_of_any_scene(seed: int, jitter: int, how: tuple[Limits, int]) -> None:
    """As above, for scenes and rays that were not chosen."""
    expected, got = (marched(k, how[0], jitter, seed, 20) for k in (numba_kernels, reference))
    same = got.count == expected.count
    assert int((~same).sum()) <= 2
    torch.testing.assert_close(got.tail[same], expected.tail[same], atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("kernels", OTHERS)
def test_rays_that_see_nothing(kernels: Kernels) -> None:
    lattice, occupied = lattice_of(0, 1)
    device = there(kernels)
    lattice.to(device)
    empty = torch.full((8, *occupied.shape), 255, dtype=torch.uint8, device=device)
    origins, directions = (a.to(device) for a in rays_through(5, 0))
    samples, _ = kernels.march(
        origins, directions, empty, 4, (1.0, 0.75, 1.0), lattice.layout, lattice.table, 9.0, HOW[0][0], 1, 16
    )
    assert len(samples) == 0
    assert samples.position.shape == (0, 3)
    values = torch.zeros(0, 2, device=device)
    out, transmittance, weights = kernels.composite(samples.sigma, values, samples)
    assert torch.equal(transmittance.cpu(), torch.ones(5))
    assert not out.any()
    assert len(weights) == 0
    assert kernels.lattice_encode(samples.position, lattice.layout, lattice.table).shape == (0, 3)


@FEW
@given(st.integers(0, 10**6), st.lists(st.integers(0, 7), min_size=1, max_size=70), st.integers(1, 9))
@pytest.mark.parametrize("kernels", OTHERS)
def test_compositing_is_that_of_the_processor(kernels: Kernels, seed: int, counts: list[int], channels: int) -> None:
    """Value and gradient, for rays of any number of samples, with and without optical depth between them."""
    generator = torch.Generator().manual_seed(seed)
    count, total = torch.tensor(counts), sum(counts)

    def random(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator)

    samples = Samples(
        random(total, 3), torch.ones(total), random(total).round(), torch.zeros(total, dtype=torch.int32),
        count.cumsum(0) - count, count, random(len(counts)), 0.1,
    )  # fmt: skip
    sigma, values = 20.0 * random(total), random(total, channels)
    g_out, g_transmittance = random(len(counts), channels) - 0.5, random(len(counts)) - 0.5
    ends = []
    for k in (numba_kernels, kernels):
        device = there(k)
        s, v, a, b = (t.to(device) for t in (sigma, values, g_out, g_transmittance))
        moved = Samples(**{n: t.to(device) if torch.is_tensor(t) else t for n, t in vars(samples).items()})
        out, transmittance, weights = k.composite(s, v, moved)
        gradients = k.composite_backward(s, v, weights, moved, out, transmittance, a, b)
        ends.append([t.cpu() for t in (out, transmittance, weights, *gradients)])
    for mine, theirs in zip(*ends, strict=True):
        torch.testing.assert_close(mine, theirs, atol=KERNELS["value"], rtol=1e-5)


# --- the whole way -------------------------------------------------------------------------------------------------


def ball(camera: Camera) -> np.ndarray:
    """An opaque ball, lit from the camera, one half red and one half green, straight alpha. (H, W, 4) uint8"""
    origins, directions = camera.rays()
    along = -(origins * directions).sum(-1)
    inside = 0.3**2 - ((origins + along[..., None] * directions) ** 2).sum(-1)
    depth = np.sqrt(np.maximum(inside, 0.0))
    left = (origins + (along - depth)[..., None] * directions)[..., :1] < 0
    image = np.where(left, (0.9, 0.1, 0.1, 1.0), (0.1, 0.9, 0.1, 1.0)) * (inside > 0)[..., None]
    image[..., :3] *= 0.3 + 0.7 * depth[..., None] / 0.3
    return (image * 255.0).round().astype(np.uint8)


def views_of_a_ball() -> ViewSet:
    from svv.core.cameras import sphere_cameras

    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 3.0, np.radians(20), 24)
    return ViewSet(tuple(cameras), np.stack([ball(c) for c in cameras]), tuple(map(str, range(12))))


def reconstruction(kernels: Kernels | ModuleType, rays: int, monkeypatch: pytest.MonkeyPatch) -> Reconstruction:
    """Stage 1 of a ball, with refinement and pruning in four steps."""
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: kernels)
    field = FieldSettings(resolutions=(2, 4), features=2, width=16)
    occupancy = Occupancy.full(Box.of_bounds((-0.35,) * 3, (0.35,) * 3), 4)
    how = ReconstructSettings(rays=rays, samples=512, prune_every=1, prune_least=1e-4, iterations=4)
    return Reconstruction(views_of_a_ball(), Beginning(occupancy), field, how, 3, there(kernels))


def history(
    kernels: Kernels | ModuleType, monkeypatch: pytest.MonkeyPatch
) -> tuple[list[float], np.ndarray, np.ndarray]:
    """Losses and colours of a few steps of stages 1 and 2, refinement and pruning included, shares, and an image."""
    work = reconstruction(kernels, 64, monkeypatch)
    views, field = views_of_a_ball(), FieldSettings(resolutions=(2, 4), features=2, width=16)
    losses = [float(work.step(k, k / 4)) for k in range(4)]
    base, pruned = work.finish()
    marching = Marching(work.marching.step)
    stage = RecolourSettings(iterations=2, rays=64, samples=512)
    palette = np.array([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1]])
    plain = Scene(field, pruned, marching, base)
    network, shares, _ = recolour(views, plain, palette, stage, Running(3))
    regions = tuple(Region(tuple(c), float(s)) for c, s in zip(network.colours.tolist(), shares, strict=True))
    scene = Scene(field, pruned, marching, base, network, None, regions)
    assert scene.device == base.encoding.table.device
    shown = scene.edited(0, opacity=0.5).render(views.cameras[3].resized(12, 12))
    return [*losses, *network.colours.flatten().tolist()], shares, shown.rgba


@pytest.mark.parametrize("kernels", OTHERS if GPU else [reference])
def test_training_takes_the_same_way_on_every_kernel(kernels: Kernels, monkeypatch: pytest.MonkeyPatch) -> None:
    expected, parts, picture = history(numba_kernels, monkeypatch)
    losses, shares, shown = history(kernels, monkeypatch)
    np.testing.assert_allclose(losses, expected, atol=TOLERANCE["loss"], rtol=0)
    np.testing.assert_allclose(shares, parts, atol=TOLERANCE["share"], rtol=0)
    assert np.abs(shown - picture).mean() < TOLERANCE["picture"]
    assert picture[..., 3].max() > 0.2


def test_training_begins_the_same_way_in_the_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    """One step on the Triton kernels, forward, backward and Adam, and the loss after it; the interpreter is slow."""
    ends = []
    for kernels in (numba_kernels, triton_kernels):
        work = reconstruction(kernels, 16, monkeypatch)
        losses = [float(work.step(k, 0.0)) for k in range(2)]
        density = work.field.density
        assert density is not None
        ends.append([*losses, *density.table.detach().cpu().flatten().tolist()])
    np.testing.assert_allclose(ends[0], ends[1], atol=TOLERANCE["loss"], rtol=0)
    assert ends[0][0] != ends[0][1]
