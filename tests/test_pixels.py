"""Pixels of training rays: which they are, how often each is drawn, and that a weighted mean stays the mean."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import sphere_cameras
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU
from svv.train.run import views_there
from svv.train.run.batches import RayPool
from svv.train.run.pixels import MARGIN, Pixels, contrast, pixels_of, steps_to_draw

SIZE = 40


def views_of(images: np.ndarray) -> ViewSet:
    cameras = sphere_cameras(len(images), (0.0, 0.0, 0.0), 4.0, np.radians(30), SIZE)
    return ViewSet(tuple(cameras), images, tuple(map(str, range(len(images)))))


def discs() -> ViewSet:
    """Views of discs, half of each brighter than the other; the last view is empty."""
    y, x = np.mgrid[:SIZE, :SIZE]
    images = np.zeros((4, SIZE, SIZE, 4), np.uint8)
    for k in range(3):
        inside = (x - 15 - k) ** 2 + (y - 18) ** 2 < (5 + k) ** 2
        images[k, inside] = (120, 90, 60, 255)
        images[k, inside & (x > 15)] = (160, 120, 80, 200)
    return views_of(images)


def test_flat_is_0_and_an_opaque_white_edge_on_both_sides_is_1() -> None:
    image = np.zeros((9, 9, 4), np.uint8)
    assert not contrast(image).any()
    image[:, 5:] = 255
    expected = np.zeros((9, 9))
    expected[:, 4:6] = 1.0
    np.testing.assert_allclose(contrast(image), expected, atol=1e-6)
    np.testing.assert_allclose(contrast(image.transpose(1, 0, 2)), expected.T, atol=1e-6)


def test_a_grey_edge_has_the_root_of_its_distance() -> None:
    image = np.full((6, 6, 4), 255, np.uint8)
    image[:3, :, :3] = 128
    assert contrast(image)[2, 3] == pytest.approx(np.sqrt(127 * np.sqrt(3) / 510), rel=1e-6)


def test_colour_that_is_not_seen_does_not_count() -> None:
    image = np.random.default_rng(0).integers(0, 256, (8, 8, 4), np.uint8)
    image[..., 3] = 0
    assert not contrast(image).any()


def one_hole() -> np.ndarray:
    """Spreads of 37, 37, 37 and 98: squares that are scaled before they are summed give two sums in two orders."""
    image = np.full((7, 5, 4), 98, np.uint8)
    image[0, 4, 3] = 0
    return image


@given(arrays.arrays(np.uint8, (7, 5, 4)))
@example(one_hole())
def test_contrast_knows_no_direction(image: np.ndarray) -> None:
    found = contrast(image)
    assert found.shape == (7, 5) and (found >= 0).all() and (found <= 1 + 1e-6).all()
    np.testing.assert_array_equal(contrast(image[::-1])[::-1], found)
    np.testing.assert_array_equal(contrast(image.transpose(1, 0, 2)).T, found)


def test_the_pixels_are_what_is_visible_and_its_surroundings_once_each() -> None:
    views = discs()
    visible = np.pad(views.images[..., 3] > 0, [(0, 0), (MARGIN // 2,) * 2, (MARGIN // 2,) * 2])
    near = [visible[:, i : i + SIZE, j : j + SIZE] for i in range(MARGIN) for j in range(MARGIN)]
    expected = np.flatnonzero(np.any(near, axis=0))
    np.testing.assert_array_equal(np.sort(Pixels(views).index), expected)


@given(arrays.arrays(np.uint8, (3, 14, 14, 4), elements=st.sampled_from([0, 0, 0, 1, 127, 128, 254, 255])))
def test_torch_finds_the_same_pixels_in_the_same_order(images: np.ndarray) -> None:
    """What is near nothing is left out of both; a GPU takes a few views at a time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(views_there, "AT_A_TIME", 2 * 14 * 14)
        index, counts = views_there.sorted_by_contrast(torch.from_numpy(images))
    expected = Pixels(ViewSet(tuple(sphere_cameras(3, (0.0, 0.0, 0.0), 4.0, 0.5, 14)), images, tuple("abc")))
    np.testing.assert_array_equal(index, expected.index)
    np.testing.assert_array_equal(counts, expected.counts)
    assert index.dtype == torch.int32


def test_pixels_of_large_views_are_in_the_same_order_and_drawn_as_from_a_list() -> None:
    """Places beyond 65,535 do not fit into the two bytes that are kept of each."""
    images = np.random.default_rng(0).integers(0, 256, (3, 301, 301, 4), np.uint8)
    images[:, :, :100] = images[1, 50:] = images[2, :, :, 3] = 0
    images[2, -1, -1, 3] = 255
    pixels = Pixels(ViewSet(tuple(sphere_cameras(3, (0.0, 0.0, 0.0), 4.0, 0.5, 301)), images, tuple("abc")))
    expected = views_there.sorted_by_contrast(torch.from_numpy(images))[0].numpy()
    np.testing.assert_array_equal(pixels.index, expected)
    ranks = np.random.default_rng(1).integers(0, len(pixels), 1000)
    np.testing.assert_array_equal(pixels.ranked(ranks), expected[ranks])
    share, ends, first = steps_to_draw(pixels.counts, 0.75)
    where = np.random.default_rng(2).random(5000) * ends[-1]
    step = np.searchsorted(ends[1:-1], where, side="right")
    place = np.minimum(first[step] + (where - ends[step]) / share[step], first[step + 1] - 1.0)
    drawn, weight = pixels.drawn(np.random.default_rng(2), 5000, 0.75)
    np.testing.assert_array_equal(drawn, expected[place.astype(np.int64)])
    np.testing.assert_array_equal(weight, (1.0 / share[step]).astype(np.float32))


@pytest.mark.parametrize("by_contrast", [0.0, 0.75, 1.0])
def test_a_weighted_mean_is_the_mean(by_contrast: float) -> None:
    """Of any figure of the pixels; here, of random ones that are larger where the contrast is."""
    views = discs()
    pixels, count = Pixels(views), 400_000
    value = np.random.default_rng(1).random(views.images.size // 4) * (
        0.1 + np.concatenate([contrast(image).ravel() for image in views.images])
    )
    drawn, weight = pixels.drawn(np.random.default_rng(2), count, by_contrast)
    seen = weight * value[drawn]
    assert seen.mean() == pytest.approx(value[pixels.index].mean(), abs=5 * seen.std() / np.sqrt(count))
    assert weight.mean(dtype=np.float64) == pytest.approx(1.0, abs=max(1e-6, 5 * weight.std() / np.sqrt(count)))
    assert set(drawn) == set(pixels.index)


def test_evenly_drawn_pixels_all_count_1() -> None:
    pixels = Pixels(discs())
    drawn, weight = pixels.drawn(np.random.default_rng(0), 100 * len(pixels.index))
    assert (weight == 1.0).all()
    often = np.bincount(drawn)[pixels.index]
    assert abs(often - 100).max() < 6 * np.sqrt(100)


def test_edges_are_drawn_more_often_and_nothing_less_than_its_even_part() -> None:
    views = discs()
    pixels = Pixels(views)
    drawn, weight = pixels.drawn(np.random.default_rng(0), 100_000, 0.75)
    of_drawn = np.concatenate([contrast(image).ravel() for image in views.images])[drawn]
    assert weight[of_drawn > 0.7].max() < weight[of_drawn == 0.0].min() <= 4.0
    assert weight.max() <= 4.0


@given(st.floats(0.0, 1.0), st.integers(0, 2**32 - 1))
def test_views_without_any_edge_are_drawn_evenly(by_contrast: float, seed: int) -> None:
    """Also at the last pixel, and whatever the rounding."""
    pixels = Pixels(views_of(np.full((3, SIZE, SIZE, 4), 255, np.uint8)))
    drawn, weight = pixels.drawn(np.random.default_rng(seed), 1000, by_contrast)
    np.testing.assert_allclose(weight, 1.0, rtol=1e-6)
    assert drawn.min() >= 0 and drawn.max() < 3 * SIZE * SIZE


def test_they_are_found_once_for_a_view_set() -> None:
    views = discs()
    assert pixels_of(views) is pixels_of(views)
    assert pixels_of(discs()) is not pixels_of(views)


def test_images_in_any_order_of_memory_give_the_same_batches() -> None:
    """Images of other libraries often have their channels turned round, or one plane for each channel."""
    views, box = discs(), Box.of_bounds((-1.0,) * 3, (1.0,) * 3)
    planes = np.ascontiguousarray(np.moveaxis(views.images, -1, 0))
    expected = RayPool(views, box, 0, CPU).batch(1, 50)
    for images in (np.moveaxis(planes, 0, -1), views.images[..., ::-1].copy()[..., ::-1]):
        found = RayPool(views_of(images), box, 0, CPU).batch(1, 50)
        assert torch.equal(found.shown, expected.shown) and torch.equal(found.weight, expected.weight)


def test_visible_colours_are_drawn_evenly_and_hardly_one_twice() -> None:
    """Each of 4,800 pixels, told apart by their colours, is as likely as any other, wherever it is in the list."""
    images = np.full((3, SIZE, SIZE, 4), 255, np.uint8)
    images[..., :3] = np.moveaxis(np.indices((3, SIZE, SIZE)), 0, -1)
    views, box, draws, most = views_of(images), Box.of_bounds((-1.0,) * 3, (1.0,) * 3), 200, 300
    times = np.zeros(images[..., 0].size, np.int64)
    for seed in range(draws):
        place = np.rint(255.0 * RayPool(views, box, seed, CPU).visible_colours(most)[0]).astype(np.int64)
        drawn = np.ravel_multi_index(tuple(place.T), images.shape[:3])
        assert len(drawn) == most and len(set(drawn)) >= 0.95 * most
        times += np.bincount(drawn, minlength=len(times))
    mean = draws * most / len(times)
    assert abs(times - mean).max() < 5.0 * np.sqrt(mean)
    assert len(RayPool(views, box, 0, CPU).visible_colours(len(times))[0]) == len(times)
