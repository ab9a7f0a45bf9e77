"""The visual hull that the compiled kernels carve is what plain NumPy finds cell by cell and view by view."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.core.geometry.cameras import Camera, look_at, sphere_cameras
from svv.fields.radiance import occupancy
from svv.fields.radiance.hull_kernels import summed, visual_hull


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
    """Cells whose squares meet the mask of each view that contains these, and that a view contains."""
    kept, seen = np.ones(shape, bool), np.zeros(shape, bool)
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
        seen |= whole
    return kept & seen


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
