"""Kernels of pieces of pictures: nearest pieces by brute force, and the piece in front as the best of each alone."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from svv.core.colour.colour import AT_A_TIME, lab_to_rgb, rgb_to_lab
from svv.train.paint.grid_kernels import interpolate
from svv.train.paint.quilt_kernels import nearest, paint


def units(generator, count):
    vectors = generator.normal(size=(count, 3))
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize(("pieces", "reach"), [(1, 2.0), (9, 0.3), (60, 0.25), (60, 2.0)])
def test_nearest_pieces_are_those_of_a_search_through_all(pieces, reach):
    generator = np.random.default_rng(pieces)
    position = np.sort(generator.random((333, 3)).astype(np.float32), axis=0)
    middle = generator.random((pieces, 3)).astype(np.float32)
    near = np.empty((333, min(14, pieces)), np.int64)
    nearest(position, middle, reach, near)
    away = np.linalg.norm(position[:, None].astype(np.float64) - middle.astype(np.float64), axis=2)
    order = np.argsort(away, axis=1)[:, : near.shape[1]]
    expected = np.where(np.take_along_axis(away, order, 1) <= reach, order, -1)
    assert (near == expected).all()


@pytest.mark.parametrize("through", [False, True])
def test_the_piece_in_front_is_the_one_that_suits_best_alone(through):
    generator = np.random.default_rng(3)
    count, pieces, radius = 3000, 12, np.float32(0.4)
    position, normal = generator.random((count, 3)).astype(np.float32), units(generator, count)
    middle, outward = generator.random((pieces, 3)).astype(np.float32), units(generator, pieces)
    right = np.cross(outward, np.roll(outward, 1, axis=1)).astype(np.float32)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    upward = np.cross(outward, right).astype(np.float32)
    centre, turn = (40 * generator.random((pieces, 2))).astype(np.float32), generator.random(pieces).astype(np.float32)
    picture = generator.random((40, 50, 3)).astype(np.float32)
    mean = picture.reshape(-1, 3).mean(0)

    def painted(near):
        colours, suits = np.full((count, 3), np.float32(0.25)), np.empty(count, np.float32)
        paint(
            position, normal, near, middle, right, upward, outward, centre, turn, picture, mean, np.float32(0.3),
            radius, np.float32(30.0), np.float32(0.12), through, colours, suits,
        )  # fmt: skip
        return colours, suits

    colours, suits = painted(np.tile(np.arange(pieces), (count, 1)))
    alone = [painted(np.full((count, 1), k)) for k in range(pieces)]
    every = np.stack([one[1] for one in alone])
    best = every.argmax(0)
    assert 0.3 < (suits >= 0).mean() < 1.0
    assert ((every >= 0).sum(0) > 1).mean() > 0.1  # pieces do overlap
    assert np.array_equal(suits, every.max(0))
    assert np.array_equal(colours, np.stack([one[0] for one in alone])[best, np.arange(count)])


def test_grids_are_interpolated_as_scipy_does_also_beyond_their_borders():
    generator = np.random.default_rng(5)
    grids = generator.normal(size=(4, 5, 7, 1)).astype(np.float32)
    at = generator.uniform(-2.0, 9.0, (500, 3))
    out = np.empty((500, 4), np.float32)
    interpolate(grids, at, out)
    expected = [map_coordinates(grid, at.T, order=1, mode="nearest") for grid in grids]
    assert np.array_equal(out.T, expected)


def test_many_colours_are_converted_as_few_are():
    rgb = np.random.default_rng(7).random((3, AT_A_TIME // 2 + 1, 3)).astype(np.float32)
    lab = rgb_to_lab(rgb)
    assert lab.shape == rgb.shape and lab.dtype == rgb.dtype
    assert np.array_equal(lab, [rgb_to_lab(row) for row in rgb])
    back = lab_to_rgb(lab)
    assert back.shape == rgb.shape and np.abs(back - rgb).max() < 1e-4
    assert np.array_equal(back, [lab_to_rgb(row) for row in lab])
