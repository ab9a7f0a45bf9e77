"""The Triton kernels and the reference compared with numba and `svv.core`, in value and gradient.

The Triton kernels run on a GPU if there is one, otherwise in Triton's interpreter; the inputs are then small, because
each operation there takes about a millisecond.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera
from svv.core.rays.marching import uniform as reference_uniform
from svv.fields.devices import kernel_checks
from svv.fields.devices.kernel_checks import march_rays, random_lattice, rays_through
from svv.fields.radiance.networks import FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, RayCaster
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.kernels import dispatch, reference
from svv.kernels.dispatch import CPU
from svv.kernels.numba import kernels as numba_kernels
from svv.kernels.numba.marching import uniform as numba_uniform
from svv.kernels.types import Kernels, Limits
from svv.train.base.first_extinction import Beginning
from svv.train.base.reconstruct import Reconstruction
from svv.train.palette.recolour import recolour
from svv.train.run import batches
from svv.train.run.config import RecolourSettings, ReconstructSettings
from svv.train.run.loop import Running
from tests.interpreted import GPU, triton_kernels, triton_rays

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


@FEW
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 150))
@pytest.mark.parametrize("kernels", OTHERS)
def test_lattice_is_the_reference_in_value_and_gradient(kernels: Kernels, seed: int, features: int, count: int) -> None:
    kernel_checks.check_lattice(kernels, there(kernels), seed, features, count)


@FEW
@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 150))
@pytest.mark.parametrize("kernels", OTHERS)
def test_hash_grid_is_the_reference_in_value_and_gradient(
    kernels: Kernels, seed: int, features: int, count: int
) -> None:
    kernel_checks.check_hash_grid(kernels, there(kernels), seed, features, count)


@FEW
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 300), st.sampled_from([0.0, 0.5]))
@pytest.mark.parametrize("kernels", OTHERS)
def test_adam_is_the_reference(kernels: Kernels, seed: int, features: int, rows: int, pull: float) -> None:
    kernel_checks.check_adam(kernels, there(kernels), seed, features, rows, pull)


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


HOW = list(kernel_checks.MARCHES.values())


@pytest.mark.parametrize(("how", "jitter"), HOW, ids=list(kernel_checks.MARCHES))
@pytest.mark.parametrize("kernels", OTHERS)
def test_marches_find_the_same_samples(kernels: Kernels, how: Limits, jitter: int) -> None:
    kernel_checks.check_march(kernels, there(kernels), 5, how, jitter, against=numba_kernels)


@pytest.mark.parametrize("pieces", [0, 2])
@pytest.mark.parametrize("kernels", OTHERS)
def test_marches_of_what_is_left_find_the_same_samples(kernels: Kernels, pieces: int) -> None:
    how, _ = kernel_checks.MARCHES["image of fainter regions"]
    kernel_checks.check_march(kernels, there(kernels), 5, how, 0, against=numba_kernels, pieces=pieces)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.integers(0, 100), st.sampled_from(HOW[:2]))
def test_plain_march_of_any_scene(seed: int, jitter: int, how: tuple[Limits, int]) -> None:
    """As above, for scenes and rays that were not chosen."""
    expected, got = (march_rays(k, CPU, how[0], jitter, seed, 20) for k in (numba_kernels, reference))
    same = got.count == expected.count
    assert int((~same).sum()) <= 2
    torch.testing.assert_close(got.tail[same], expected.tail[same], atol=1e-4, rtol=1e-4)


@pytest.mark.skipif(GPU, reason="a GPU's launches are asynchronous, and their results cannot be changed in between")
def test_a_second_march_that_disagrees_writes_what_was_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both passes are compiled apart: too many samples are left out, missing ones have no extinction."""
    how, jitter = kernel_checks.MARCHES["training"]
    expected = march_rays(triton_kernels, CPU, how, jitter, 5, 12)
    long, short = (int(k) for k in expected.count.argsort()[-2:])
    march = triton_rays.march

    class Disagrees:
        def __getitem__(self, grid: Any) -> Any:
            def launch(*arguments: Any, **options: Any) -> None:
                march[grid](*arguments, **options)
                count = arguments[list(march.arg_names).index("count")]
                if not arguments[list(march.arg_names).index("WRITES")]:
                    count[long] += 2
                    count[short] -= 1

            return launch

    monkeypatch.setattr(triton_rays, "march", Disagrees())
    got = march_rays(triton_kernels, CPU, how, jitter, 5, 12)
    assert len(got) == len(expected) + 1
    assert torch.equal(got.ray.long(), torch.arange(12).repeat_interleave(got.count))
    for ray in range(12):
        mine, theirs = (
            tuple(v[s.start[ray] : s.start[ray] + s.count[ray]] for v in (s.position, s.sigma, s.skipped))
            for s in (got, expected)
        )
        same = min(len(mine[1]), len(theirs[1]))
        assert all(torch.equal(a[:same], b[:same]) for a, b in zip(mine, theirs, strict=True))
        assert not any(a[same:].any() for a in mine)


@pytest.mark.parametrize("kernels", OTHERS)
def test_rays_that_see_nothing(kernels: Kernels) -> None:
    lattice, occupied = random_lattice(0, 1)
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
    assert kernels.lattice_encode(samples.position, lattice.layout, lattice.table).shape == (0, 2)


@FEW
@given(st.integers(0, 10**6), st.lists(st.integers(0, 7), min_size=1, max_size=70), st.integers(1, 9))
@pytest.mark.parametrize("kernels", OTHERS)
def test_compositing_is_the_reference(kernels: Kernels, seed: int, counts: list[int], channels: int) -> None:
    kernel_checks.check_composite(kernels, there(kernels), seed, counts, channels)


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
    from svv.core.geometry.cameras import sphere_cameras

    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 3.0, np.radians(20), 24)
    return ViewSet(tuple(cameras), np.stack([ball(c) for c in cameras]), tuple(map(str, range(12))))


def reconstruction(kernels: Kernels | ModuleType, rays: int, monkeypatch: pytest.MonkeyPatch) -> Reconstruction:
    """Stage 1 of a ball, with refinement and pruning in four steps."""
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: kernels)
    monkeypatch.setattr(batches, "views_on", lambda views, device: None)  # the CPU draws the same pixels for all
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
    scene = Scene(field, pruned, marching, base, network, regions=regions)
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


@pytest.mark.slow
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
