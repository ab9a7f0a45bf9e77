"""The visual hull that the compiled kernels carve is what plain NumPy finds cell by cell and view by view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter

from svv.core.geometry.cameras import Camera, look_at, sphere_cameras
from svv.fields.radiance import occupancy
from svv.fields.radiance.hull_kernels import mark_unexplained, summed, visual_hull


def tables_of(masks: np.ndarray, side: int) -> np.ndarray:
    """Summed-area tables of masks whose pixels are squares of pixels."""
    n, h, w = masks.shape
    padded = np.pad(masks > 0, [(0, 0), (0, -h % side), (0, -w % side)])
    small = padded.reshape(n, padded.shape[1] // side, side, padded.shape[2] // side, side).any(axis=(2, 4))
    return np.pad(small.cumsum(1).cumsum(2), [(0, 0), (1, 0), (1, 0)])


def hull_of(
    tables: np.ndarray, rotations: np.ndarray, positions: np.ndarray, lenses: np.ndarray, shape: tuple[int, int, int],
    cells: float, reach: float,
) -> np.ndarray:  # fmt: skip
    """How many views contain a cell's square, 0 unless it meets the mask of each of them."""
    kept, seen = np.ones(shape, bool), np.zeros(shape, np.uint8)
    x, y, z = (np.indices(shape) + 0.5) / cells
    for t, m, p, (focal, column, row, parallel) in zip(tables, rotations, positions, lenses, strict=True):
        dx, dy, dz = x - p[0], y - p[1], z - p[2]
        across, up, along = (m[k, 0] * dx + m[k, 1] * dy + m[k, 2] * dz for k in range(3))
        ahead = -along > 2 * reach
        d = np.ones(shape) if parallel else np.where(ahead, -along, 1.0)
        u, v = across / d, up / d
        r = reach * focal / d * (1.0 if parallel else np.sqrt(1.0 + u * u + v * v)) + 0.5
        px, py = u * focal + column, row - v * focal
        x0, x1, y0, y1 = (
            f(c).astype(int) for f, c in ((np.floor, px - r), (np.ceil, px + r), (np.floor, py - r), (np.ceil, py + r))
        )
        whole = ahead & (x0 >= 0) & (y0 >= 0) & (x1 < t.shape[1]) & (y1 < t.shape[0])
        x0, x1, y0, y1 = (np.where(whole, c, 0) for c in (x0, x1, y0, y1))
        kept &= ~whole | (t[y1, x1] - t[y0, x1] - t[y1, x0] + t[y0, x0] > 0)
        seen += whole
    return np.where(kept, seen, 0)


def masks_of(random: np.random.Generator, views: int, height: int, width: int) -> np.ndarray:
    """Discs, noise, or everything: 0 where nothing is visible."""
    y, x = np.mgrid[:height, :width]
    masks = []
    for _ in range(views):
        a, b, c = random.uniform(0, height), random.uniform(0, width), random.uniform(1, max(height, width))
        disc = np.hypot(y - a, x - b) < c
        masks.append([disc, random.random((height, width)) < 0.1, np.ones_like(disc)][random.integers(3)])
    return np.array(masks, np.uint8) * np.uint8(random.integers(1, 256))


@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 40), st.integers(1, 40), st.integers(1, 5))
def test_tables_count_the_visible_squares(seed: int, views: int, height: int, width: int, side: int) -> None:
    masks = masks_of(np.random.default_rng(seed), views, height, width)
    expected = tables_of(masks, side)
    for given_as in (masks, np.stack([masks] * 4, axis=-1)[..., 3]):
        tables = np.zeros(expected.shape, np.int32)
        summed(given_as, side, tables)
        np.testing.assert_array_equal(tables, expected)


@given(st.integers(0, 10**6), st.integers(1, 6), st.tuples(*[st.integers(1, 11)] * 3))
def test_blocks_of_cells_are_carved_as_each_cell_is(seed: int, views: int, shape: tuple[int, int, int]) -> None:
    """With views from all sides, and also from within the box, and parallel ones."""
    random = np.random.default_rng(seed)
    tables = tables_of(masks_of(random, views, 40, 50), 1).astype(np.int32)
    rotations = np.linalg.qr(random.normal(size=(views, 3, 3)))[0]
    aim = np.array(shape) / 8.0 * random.uniform(0.2, 0.8, (views, 3))
    positions = aim + random.uniform(0.0, 4.0, (views, 1)) * rotations[:, 2]  # a camera looks along its -z
    parallel = random.random(views) < 0.3
    lenses = np.stack([random.uniform(10, 80, views), np.full(views, 25.0), np.full(views, 20.0), parallel], axis=1)
    occupied = np.zeros(shape, np.uint8)
    visual_hull(tables, rotations, positions, lenses, 8.0, np.sqrt(0.75) / 8, occupied)
    expected = hull_of(tables, rotations, positions, lenses, shape, 8.0, np.sqrt(0.75) / 8)
    np.testing.assert_array_equal(occupied, expected)


def test_the_hull_of_a_ball(all_threads: None) -> None:
    """One in whose inside whole blocks are visible in all views; with any number of threads, alpha or masks."""
    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 5.0, 0.5, 300)
    y, x = np.mgrid[:300, :300] - 149.5
    alpha = np.stack([np.where(np.hypot(x, y) < 110, 1 + n, 0) for n in range(12)]).astype(np.uint8)
    found = occupancy.carve(alpha, cameras, 32)
    small = occupancy._Masks.of(alpha)
    assert small.side == 1 and 0.1 < found.fraction < 0.6
    numba.set_num_threads(1)
    again = occupancy.carve(alpha > 0, cameras, 32)
    np.testing.assert_array_equal(again.occupied, found.occupied)
    np.testing.assert_array_equal(again.box.bounds, found.box.bounds)


@given(st.integers(0, 10**6), st.sampled_from([(1, 1), (1, 7), (5, 4)]))
def test_a_frame_cuts_off_what_its_border_shows(seed: int, size: tuple[int, int]) -> None:
    random = np.random.default_rng(seed)
    masks = random.random((2, *size)) < 0.1
    cut = masks[:, [0, -1]].any() or masks[:, :, [0, -1]].any()
    assert occupancy._Masks.of(masks).cut == cut


@pytest.mark.parametrize("width", [9, 1030])
def test_narrow_pictures_have_squares_as_large_as_wide_ones(width: int) -> None:
    """The lens is scaled by the sides of the squares, whatever the number of these along the picture's width."""
    camera = Camera(look_at((0, -5, 0), (0, 0, 0)), 0.5, width, 1030)
    masks = np.ones((1, 1030, width), bool)
    small = occupancy._Masks.of(masks)
    assert small.side == 4 and small.tables.shape == (1, 259, -(-width // 4) + 1)
    assert camera.width == width


def balls(cameras: list[Camera], each: list[tuple[tuple[float, float, float], float]]) -> np.ndarray:
    """Masks of balls, by the distance of each pixel's ray from their centres."""
    masks = []
    for camera in cameras:
        origins, directions = camera.rays()
        apart = [np.cross(np.array(centre) - origins, directions) for centre, _ in each]
        masks.append(np.any([np.linalg.norm(a, axis=-1) < r for a, (_, r) in zip(apart, each, strict=True)], axis=0))
    return np.array(masks)


def around(count: int, fov: Callable[[int], float]) -> list[Camera]:
    cameras = sphere_cameras(count, (0.0, 0.0, 0.0), 3.2, 0.5, 80)
    return [replace(camera, fov_x=fov(k)) for k, camera in enumerate(cameras)]


def test_what_few_frames_contain_is_not_filled() -> None:
    """The cones of frames that cut the balls off leave what no other frame contains: it is empty, and the box small."""
    each = [((-0.3, 0.0, 0.0), 0.6), ((0.55, 0.3, 0.3), 0.35)]
    whole, cut = around(24, lambda k: 0.9), around(24, lambda k: (0.75, 0.55, 0.43)[k % 3])
    right = occupancy.carve(balls(whole, each), whole, 64)
    masks = balls(cut, each)
    cut_off = masks[:, [0, -1]].any(axis=(1, 2)) | masks[:, :, [0, -1]].any(axis=(1, 2))
    assert cut_off.sum() >= 8
    found = occupancy.carve(masks, cut, 64)
    np.testing.assert_allclose(found.box.bounds, right.box.bounds, atol=0.15)
    volume = [o.occupied.sum() * (o.box.size / o.cells) ** 3 for o in (right, found)]
    assert 0.7 < volume[1] / volume[0] < 1.3
    points = found.box.to_world((np.argwhere(found.occupied) + 0.5) / found.cells)
    apart = np.min([np.linalg.norm(points - centre, axis=1) - r for centre, r in each], axis=0)
    assert apart.max() < 0.25


def test_what_only_few_frames_contain_and_show_is_kept() -> None:
    """A ball far from the others, in three frames that are wide; others neither confirm nor deny it."""
    each = [((0.0, 0.0, 0.0), 0.4), ((0.0, 1.5, 0.0), 0.2)]
    cameras = around(24, lambda k: 1.2 if k in (6, 12, 18) else 0.3)
    masks = balls(cameras, each)
    found = occupancy.carve(masks, cameras, 96)
    cells = found.box.to_box(np.array([centre for centre, _ in each])) * found.cells
    assert all(found.occupied[tuple(cell.astype(int))] for cell in cells)


@given(st.integers(0, 10**6), st.integers(2, 24), st.booleans())
def test_cells_that_few_views_contain_are_believed_only_on_rays_that_nothing_else_explains(
    seed: int, views: int, parallel: bool
) -> None:
    """Compared with rays that are followed in small steps by plain NumPy."""
    random, shape, cells = np.random.default_rng(seed), (7, 9, 8), 9.0
    counts = (random.random(shape) < 0.3).astype(np.uint8) * random.integers(1, 12, shape).astype(np.uint8)
    masks = random.random((views, 12, 14)) < 0.4
    tables = tables_of(masks, 1).astype(np.int32)
    rotations = np.linalg.qr(random.normal(size=(views, 3, 3)))[0]
    positions = random.uniform(0.3, 0.7, (views, 3)) + 2.0 * rotations[:, 2]
    lenses = np.stack(
        [np.full(views, 8.0 if parallel else 16.0), *np.full((2, views), 6.5), np.full(views, parallel)], 1
    )
    marked, enough = np.zeros(shape, np.uint8), 8
    mark_unexplained(tables, rotations, positions, lenses, cells, counts, enough, marked)
    expected, near = np.zeros(shape, bool), np.zeros(shape, bool)
    for mask, m, p in zip(masks, rotations, positions, strict=True):
        for y, x in np.argwhere(mask):
            u, v = (x + 0.5 - 6.5) / lenses[0, 0], (6.5 - y - 0.5) / lenses[0, 0]
            across = u * m[0] + v * m[1]
            origin, direction = (p + across, -m[2]) if parallel else (p, across - m[2])
            points = (origin + np.linspace(0.0, 6.0, 3000)[:, None] * direction) * cells
            own = points[((points >= 0.0) & (points < shape)).all(axis=1)].astype(int)
            seen = counts[tuple(own.T)]
            if len(own) and 0 < seen.max() < enough:
                expected[tuple(own[2 * seen >= seen.max()].T)] = True
            near[tuple(own.T)] = True
    assert not (marked.astype(bool) & ~near & ~maximum_filter(near, 3)).any()
    assert (marked.astype(bool) != expected).mean() < 0.08  # corners of cells that steps miss
