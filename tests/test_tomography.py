"""Extinction from the alpha of views: its two operators, what it recovers, and that training starts from it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, look_at, sphere_cameras
from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION
from svv.core.volumes.classified import grid_shape
from svv.errors import Cancelled, silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import FieldSettings
from svv.fields.radiance.occupancy import Occupancy, carve
from svv.fields.radiance.rendering import RayCaster
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU
from svv.kernels.numba.bricks import made
from svv.train.base.first_extinction import begin, largest_extinction
from svv.train.base.tomography import VIEWS_A_STEP, Tomography, opaque_part, pixels_a_cell, reduced, smaller
from svv.train.base.tomography_kernels import back_project, beside_visible, optical_depths
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS, ReconstructSettings
from tests.nightly import nightly

BOX = Box.of_bounds((-1, -1, -1), (1, 1, 1))
SIZE = 64


def depths(cameras: list[Camera], sigma: Callable[[np.ndarray], np.ndarray], steps: int = 160) -> np.ndarray:
    """Integrate an extinction in 1 / world unit along the rays of cameras: (N, H, W), in plain numpy."""
    out = []
    for camera in cameras:
        origins, directions = camera.rays()
        away = float(np.linalg.norm(camera.position))
        t = away - 1.8 + 3.6 * (np.arange(steps) + 0.5) / steps
        points = origins[..., None, :] + t[:, None] * directions[..., None, :]
        out.append(sigma(points).sum(axis=-1) * 3.6 / steps)
    return np.stack(out)


def blobs(points: np.ndarray) -> np.ndarray:
    """A shell that can be seen through, with two clouds in it, one of them dense."""
    r = np.linalg.norm(points, axis=-1)
    shell = 0.6 * np.exp(-np.square((r - 0.7) / 0.08))
    clouds = [(4.0, (0.25, 0.1, 0.0), 0.18), (1.5, (-0.25, -0.15, 0.2), 0.15)]
    inside = (s * np.exp(-np.square(points - np.array(c)).sum(axis=-1) / w**2) for s, c, w in clouds)
    return (shell + sum(inside)) * (r < 0.95)


def views_of(cameras: list[Camera], sigma: Callable[[np.ndarray], np.ndarray] = blobs) -> ViewSet:
    """Views of one flat colour, as an 8-bit file holds them."""
    alpha = 1.0 - np.exp(-depths(cameras, sigma))
    images = np.zeros((*alpha.shape, 4), np.uint8)
    images[..., :3] = (200, 120, 40)
    images[..., 3] = np.round(255 * alpha)
    return ViewSet(tuple(cameras), images, tuple(f"view{k}" for k in range(len(cameras))))


def orbit(n: int, parallel: bool = False) -> list[Camera]:
    cameras = sphere_cameras(n, (0.0, 0.0, 0.0), 5.0, 0.45, SIZE)
    return [Camera.orthographic(c.camera_to_world, 2.2, SIZE, SIZE) for c in cameras] if parallel else cameras


def lattice_of(exponent: np.ndarray, resolution: int) -> SparseLattice:
    """A dense lattice over the box."""
    lattice = SparseLattice(np.ones(grid_shape(BOX, resolution), np.uint8), resolution, (resolution,), 1)
    with torch.no_grad():
        lattice.table[:, 0] = torch.from_numpy(exponent.astype(np.float32).ravel())
    return lattice.requires_grad_(False)


def project(
    lattice: SparseLattice, rays: tuple[np.ndarray, np.ndarray], step: float = 1 / 256, room: float = 0.0
) -> np.ndarray:
    """Optical depths, from bricks if they may take ``room`` values per value of the table."""
    bricks = made(lattice.layout, lattice.table[:, 0].numpy(), room)
    assert (bricks[0].size > 0) == (room > 0.0)
    occupancy, layout, out = Occupancy.full(BOX, 16), lattice.layout, np.empty(len(rays[0]), np.float32)
    optical_depths(
        *rays, occupancy.distance_on(CPU).numpy(), np.float32(16), np.asarray(BOX.extent, np.float32), np.float32(step),
        np.float32(0.5), layout.shapes.numpy(), layout.scales.numpy(), layout.bases.numpy(), layout.index.numpy(),
        lattice.table[:, 0].numpy(), np.float32(1e9), out, bricks,
    )  # fmt: skip
    return out


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6), st.floats(-4, 3))
def test_the_depth_of_a_uniform_box_is_the_length_of_the_chord(seed: int, exponent: float) -> None:
    lattice = lattice_of(np.full((9, 9, 9), exponent), 8)
    random = np.random.default_rng(seed)
    direction = random.normal(size=(20, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    inside = random.uniform(0.1, 0.9, (20, 3))
    origin = inside - 3 * direction
    ends = np.sort(np.stack([-origin / direction, (1 - origin) / direction]), axis=0)
    chord = ends[1].min(axis=1) - ends[0].max(axis=1)
    found = project(lattice, (origin.astype(np.float32), direction.astype(np.float32)))
    np.testing.assert_allclose(found, chord * np.exp(exponent), atol=np.exp(exponent) / 200)


def test_depths_from_bricks_are_those_from_the_table() -> None:
    random = np.random.default_rng(1)
    lattice = lattice_of(random.normal(size=(33, 33, 33)), 32)
    direction = random.normal(size=(500, 3)).astype(np.float32)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rays = (random.random((500, 3)).astype(np.float32) - 2 * direction, direction)
    found = project(lattice, rays)
    assert (found > 0).all()
    np.testing.assert_allclose(project(lattice, rays, room=np.inf), found, rtol=1e-5)


@given(st.integers(0, 10**6), st.floats(0.1, 1.0), st.integers(1, 2))
def test_depths_are_sums_over_the_samples_in_occupied_cells(seed: int, share: float, finer: int) -> None:
    """Whether rays share a packet with shorter ones, begin in the box, miss it, or leap through it."""
    random = np.random.default_rng(seed)
    occupied = (random.random((6, 5, 7)) < share).astype(np.uint8)
    occupied[3, 2, 4] = 1
    where, scale = Occupancy(Box.of_bounds((0, 0, 0), (6 / 7, 5 / 7, 1.0)), 7, occupied), 7 * finer
    lattice = SparseLattice(occupied, 7, (scale,), 1).requires_grad_(False)
    lattice.table[:, 0] = torch.from_numpy(random.normal(size=len(lattice.table)).astype(np.float32))
    origin = random.uniform(-0.5, 1.5, (300, 3)).astype(np.float32)
    direction = random.uniform(0.2, 0.8, (300, 3)).astype(np.float32) - origin
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    step, layout, stop = 1 / 32, lattice.layout, 4.0
    out, extent = np.empty(300, np.float32), np.asarray(where.box.extent, np.float32)
    optical_depths(
        origin, direction, where.distance_on(CPU).numpy(), np.float32(7), extent, np.float32(step), np.float32(0.3),
        layout.shapes.numpy(), layout.scales.numpy(), layout.bases.numpy(), layout.index.numpy(),
        lattice.table[:, 0].numpy(), np.float32(stop), out,
    )  # fmt: skip
    t = ((np.arange(128) + np.float32(0.3)) * np.float32(step)).astype(np.float32)
    points = origin[:, None] + t[:, None] * direction[:, None]
    inside = ((points >= 0) & (points <= extent)).all(axis=-1)
    cell = np.minimum((points.clip(0, extent) * 7).astype(int), np.array(occupied.shape) - 1)
    inside &= occupied[tuple(np.moveaxis(cell, -1, 0))] > 0
    part = np.zeros(inside.shape)
    part[inside] = np.exp(lattice(torch.from_numpy(points[inside]))[:, 0].numpy()) * step
    expected, largest = part.sum(axis=1), part.max(axis=1)
    ended = expected > stop
    np.testing.assert_array_less(np.abs(out - expected)[~ended], 1e-4 + largest[~ended])  # one may lie on a face
    assert (np.abs(out - expected) > 1e-4)[~ended].mean() < 0.02
    assert (out[ended] > stop).all() and (out <= stop + largest + 1e-4).all()


@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 30), st.integers(1, 30), st.integers(1, 4))
def test_images_are_reduced_to_means(seed: int, n: int, height: int, width: int, factor: int) -> None:
    height, width = max(height, factor), max(width, factor)
    images = np.random.default_rng(seed).integers(0, 256, (n, height, width, 4), dtype=np.uint8)
    whole = images[:, : height // factor * factor, : width // factor * factor, 3]
    squares = whole.reshape(n, height // factor, factor, width // factor, factor)
    expected = squares.mean(axis=(2, 4), dtype=np.float32) / np.float32(255.0)
    np.testing.assert_array_equal(reduced(images[..., 3], factor), expected)


@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 12), st.integers(1, 12), st.sampled_from([-1, 0, 1]))
def test_pixels_beside_visible_ones_are_cast(seed: int, n: int, height: int, width: int, odd: int) -> None:
    random = np.random.default_rng(seed)
    alpha = (random.random((n, height, width)) * (random.random((n, height, width)) < 0.1)).astype(np.float32)
    expected, out = maximum_filter(alpha > 0, (1, 3, 3)), np.empty(alpha.shape, np.uint8)
    row, column = np.indices((height, width))
    beside_visible(alpha, odd, out)
    np.testing.assert_array_equal(out, expected & ((odd < 0) | ((row + column) % 2 == odd)))


def test_a_step_needs_only_half_the_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other pixels are not cast, and count neither for nor against a vertex."""
    cast: list[int] = []
    views, whole = views_of(orbit(8)), Tomography._optical_depths

    def count(work: Tomography, caster: RayCaster, pixels: torch.Tensor) -> np.ndarray:
        cast.append(len(pixels))
        return whole(work, caster, pixels)

    monkeypatch.setattr(Tomography, "_optical_depths", count)
    work = Tomography(views, carve(views.images[..., 3] > 0, views.cameras, 32), 0)
    work.rounds(1, lambda: True)
    factor = pixels_a_cell(views.cameras, work.occupancy, 32)
    seen = int((reduced(views.images[..., 3], factor) > 0).sum())
    assert len(cast) == 8 // VIEWS_A_STEP and 0.4 * seen < sum(cast) < 0.75 * seen  # with those beside the outline


def test_corners_are_enough_where_cells_are_no_finer() -> None:
    lattice = lattice_of(np.random.default_rng(2).normal(size=(17, 17, 17)), 16)
    where = Occupancy.full(BOX, 16)
    found = [largest_extinction(lambda p: lattice(p)[:, 0], where, CPU, corners=corners) for corners in (True, False)]
    torch.testing.assert_close(*found)


@given(st.integers(0, 2**31), st.sampled_from([1, 2, 3]), st.integers(1, 40))
def test_vertices_tell_the_largest_extinction_in_cells(seed: int, parts: int, high: int) -> None:
    """As many points as cells have vertices of the lattice, at the vertices, by interpolation."""
    random = np.random.default_rng(seed)
    occupied = (random.random((3, 4, high)) < 0.3).astype(np.uint8)
    occupied[2, 3, high - 1] = 1
    occupancy = Occupancy(Box((0.0, 0.0, 0.0), 1.0, (3 / high, 4 / high, 1.0)), high, occupied)
    lattice = SparseLattice(occupied, high, (parts * high,), 1)
    lattice.randomize(8.0, torch.Generator().manual_seed(seed))
    found = largest_extinction(lambda _: torch.zeros(0), occupancy, CPU, lattice=lattice)
    vertices = lattice.vertices_of_level(0, occupied, high)
    cells = np.argwhere(occupied)
    inside = ((vertices >= parts * cells[:, None]) & (vertices <= parts * (cells[:, None] + 1))).all(axis=2)
    values = np.where(inside, lattice.table[:, 0].detach().numpy(), -np.inf)
    torch.testing.assert_close(found, torch.from_numpy(np.exp(values.max(axis=1))))


@pytest.mark.parametrize("parallel", [False, True])
def test_a_pixel_is_found_again_from_the_points_on_its_ray(parallel: bool) -> None:
    """Points on the rays of pixels collect what the images hold there, and nothing from views behind which they lie."""
    cameras = orbit(12, parallel)
    caster = RayCaster(cameras, BOX, CPU)
    random = np.random.default_rng(0)
    images = random.random((12, SIZE, SIZE, 2)).astype(np.float32)
    column, row, n = 20, 37, 5
    rays = caster.rays(torch.tensor([(n * SIZE + row) * SIZE + column]))
    aim = 0.5 if parallel else float(torch.linalg.norm(rays.origins[0] - 0.5))
    point = (rays.origins + aim * rays.directions).double().numpy()
    one = [t[n : n + 1].numpy() for t in caster.cameras]
    sums = np.empty((1, 2), np.float32)
    scale = 10**6
    vertices = np.round(point * scale).astype(np.int32)
    back_project(vertices, np.float32(scale), *one, images[n : n + 1], sums)
    np.testing.assert_allclose(sums[0], images[n, row, column], atol=1e-3)
    behind = np.round((rays.origins - 2 * rays.directions).double().numpy() * scale).astype(np.int32)
    back_project(behind, np.float32(scale), *one, images[n : n + 1], sums)
    assert (sums == 0).all()


@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 9), st.integers(1, 9), st.integers(1, 40))
def test_vertices_collect_what_images_hold_around_them(seed: int, n: int, height: int, width: int, v: int) -> None:
    """Within the frame, on its edge, where one pixel counts, beyond it, and behind the camera."""
    random = np.random.default_rng(seed)
    vertices, scale = random.integers(0, 9, (v, 3)).astype(np.int32), 8
    rotations = np.linalg.qr(random.normal(size=(n, 3, 3)))[0].astype(np.float32)
    positions = (0.5 + random.uniform(0.2, 3.0, (n, 1)) * rotations[:, :, 2]).astype(np.float32)
    parallel = random.random(n) < 0.3
    lens = np.stack([random.uniform(3, 20, n), 0.5 - 0.5 * random.uniform(0, 2, n) * width,
                     0.5 - 0.5 * random.uniform(0, 2, n) * height, parallel], axis=1).astype(np.float32)  # fmt: skip
    images, sums = random.random((n, height, width, 2)).astype(np.float32), np.empty((v, 2), np.float32)
    back_project(vertices, np.float32(scale), rotations, positions, lens, images, sums)
    expected = np.zeros((v, 2))
    for p, k in itertools.product(range(v), range(n)):
        right, up, back = (vertices[p] / scale - positions[k]) @ rotations[k]
        if back < 0:
            zoom = lens[k, 0] if parallel[k] else -lens[k, 0] / back
            row, column = -up * zoom - lens[k, 2], right * zoom - lens[k, 1]
            rows, columns = (np.maximum(1 - abs(np.arange(m) - c), 0) for m, c in ((height, row), (width, column)))
            expected[p] += np.einsum("i,j,ijc->c", rows, columns, images[k])
    np.testing.assert_allclose(sums, expected, atol=2e-3)


def begun(views: ViewSet, resolution: int = 32) -> tuple[SparseLattice, Occupancy, str]:
    how = ReconstructSettings(cells=32)
    hull = carve(views.images[..., 3] > 0, views.cameras, 32)
    field = FieldSettings(resolutions=(16, resolution // 2))
    beginning, reason = begin(views, hull, field, how, 0, silent)
    assert beginning.density is not None and reason is not None
    return beginning.density, beginning.occupancy, reason


@pytest.mark.parametrize(
    ("n", "parallel", "least"),
    nightly([(42, False, 36.0), (42, True, 36.0), (12, False, 27.0)], (42, True, 36.0), (12, False, 27.0)),
)
def test_unseen_views_have_the_same_alpha(n: int, parallel: bool, least: float) -> None:
    views = views_of(orbit(n, parallel))
    density, occupancy, reason = begun(views)
    test = views_of([c for k, c in enumerate(orbit(32, parallel)) if k % 5 == 2])
    caster = RayCaster(test.cameras, occupancy.box, CPU)
    rays = caster.rays(torch.arange(len(test) * SIZE * SIZE))
    layout, out = density.layout, np.empty(len(rays), np.float32)
    optical_depths(
        rays.origins.numpy(), rays.directions.numpy(), occupancy.distance_on(CPU).numpy(), np.float32(occupancy.cells),
        np.asarray(occupancy.box.extent, np.float32), np.float32(1 / 64), np.float32(0.5), layout.shapes.numpy(),
        layout.scales.numpy(), layout.bases.numpy(), layout.index.numpy(), density.table[:, 0].numpy(),
        np.float32(9.0), out,
    )  # fmt: skip
    error = np.square(1 - np.exp(-out) - test.images[..., 3].ravel() / 255.0).mean()
    assert -10 * np.log10(error) > least
    assert "tomography" in reason


@pytest.mark.slow
def test_the_extinction_itself_is_recovered() -> None:
    density, occupancy, _ = begun(views_of(orbit(92)))
    vertices = density.vertices_of_level(0, occupancy.occupied, occupancy.cells)
    places = occupancy.box.to_world(vertices / density.resolutions[0])
    true = np.maximum(blobs(places) * occupancy.box.size, np.exp(EMPTY_LOG_EXTINCTION))
    found = density.table[:, 0].exp().numpy()
    assert np.corrcoef(true, found)[0, 1] > 0.97
    assert abs(found.sum() / true.sum() - 1) < 0.05


def test_the_number_of_threads_changes_nothing(all_threads: None) -> None:
    views, tables = views_of(orbit(12)), []
    for count in (1, numba.config.NUMBA_NUM_THREADS):
        numba.set_num_threads(count)
        tables.append(begun(views)[0].table.numpy().copy())
    np.testing.assert_array_equal(*tables)


def test_smaller_pictures_show_the_same() -> None:
    """The rays of a pixel of a reduced view pass through the middle of the pixels that it averages."""
    camera = Camera(look_at((1, 2, 3), (0, 0, 0)), 0.6, 50, 40, centre=(21.0, 23.5))
    small = smaller(camera, 4)
    assert (small.width, small.height) == (12, 10)
    _, fine = camera.rays()
    _, coarse = small.rays()
    corners = fine[1:40:4, 1:48:4] + fine[2:40:4, 2:48:4]
    np.testing.assert_allclose(coarse, corners / np.linalg.norm(corners, axis=-1, keepdims=True), atol=1e-4)
    images = np.random.default_rng(0).integers(0, 256, (2, 40, 50), dtype=np.uint8)
    assert reduced(images, 4).shape == (2, 10, 12)
    np.testing.assert_allclose(reduced(images, 4)[1, 3, 5], images[1, 12:16, 20:24].mean() / 255, rtol=1e-6)
    pixel = 5.0 * np.tan(0.225) / (SIZE / 2) / BOX.size
    assert pixels_a_cell(orbit(12), Occupancy.full(BOX, 16), 16) == round(1 / (16 * pixel)) == 3


SHORT = replace(
    PRESETS["draft"], reconstruct=ReconstructSettings(iterations=60, rays=512, samples=8192, cells=32),
    recolour=replace(PRESETS["draft"].recolour, iterations=1),
)  # fmt: skip


@pytest.mark.slow
def test_it_helps() -> None:
    train, test = views_of(orbit(42)), views_of(orbit(12))
    fog = replace(SHORT, reconstruct=replace(SHORT.reconstruct, tomography=False))
    scores = [evaluate_scene(train_scene(train, how)[0], test, "base").psnr for how in (SHORT, fog)]
    assert scores[0] > scores[1] + 2.0


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every_step: None
) -> None:
    """The extinction is kept: a time limit would otherwise find another one, with another layout."""
    train, file = views_of(orbit(12)), tmp_path / "run"
    whole, _ = train_scene(train, SHORT)

    def stop(fraction: float, label: str) -> None:
        if "base" in label and fraction > 0.3:
            raise Cancelled

    with pytest.raises(Cancelled):
        train_scene(train, SHORT, progress=stop, checkpoint=file)
    monkeypatch.setattr("svv.train.training.begin", None)  # not called again
    again, report = train_scene(train, SHORT, checkpoint=file)
    assert report["seconds"]["extinction"] > 0
    for name, value in whole.base.state_dict().items():
        torch.testing.assert_close(again.base.state_dict()[name], value, msg=name)


def test_a_skin_of_one_per_cent_has_no_holes() -> None:
    """Its cells lie near what pruning drops; where a cell is gone, it does not come back."""

    def skin(points: np.ndarray) -> np.ndarray:
        r = np.linalg.norm(points, axis=-1)
        return 0.03 * np.exp(-np.square((r - 0.7) / 0.08)) + 6.0 * (r < 0.25)

    train = views_of(orbit(24), skin)
    short = replace(
        PRESETS["draft"], reconstruct=ReconstructSettings(iterations=300, rays=1024, cells=32, prune_every=25),
        recolour=replace(PRESETS["draft"].recolour, iterations=1),
    )  # fmt: skip
    scene, _ = train_scene(train, short)
    for camera in orbit(5)[1:3]:
        truth = 1.0 - np.exp(-depths([camera], skin)[0])
        faint = (truth > 0.004) & (truth < 0.1)
        assert faint.sum() > 500
        assert (scene.render(camera, "base").rgba[..., 3][faint] > 0.5 * truth[faint]).mean() > 0.99


def test_opaque_views_take_fewer_steps_and_their_finest_lattice_is_interpolated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What opaque pixels say, the hull and a coarse lattice say, too."""
    steps, step = list[int](), Tomography._step

    def counted(work: Tomography, *arguments: Any) -> None:
        steps.append(work.lattice.resolutions[0])
        step(work, *arguments)

    monkeypatch.setattr(Tomography, "_step", counted)
    begun(views_of(orbit(24)), 64)
    a_round = 24 // VIEWS_A_STEP
    assert {r: steps.count(r) for r in steps} == {32: 3 * a_round, 64: 3 * a_round}
    steps.clear()
    density, _, _ = begun(views_of(orbit(24), lambda points: 80.0 * (np.linalg.norm(points, axis=-1) < 0.5)), 64)
    assert density.resolutions == (64,) and {r: steps.count(r) for r in steps} == {32: 6}


def test_opaque_pixels_are_counted_among_the_visible() -> None:
    alpha = np.array([[[0, 0, 100], [254, 255, 253]]], np.uint8)
    assert opaque_part(alpha) == 0.5
    assert opaque_part(np.zeros((1, 2, 2), np.uint8)) == 0.0
