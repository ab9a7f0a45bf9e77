"""LPIPS and the statistics of styles with the published weights, and the laws of both."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter

from svv.core.rounding import sums_apart
from svv.errors import BadInput
from svv.styles.gallery.textures import style_picture
from svv.styles.networks import NETWORKS
from svv.styles.weight_files import State, content_sha256
from svv.train.lpips import Lpips, lpips
from svv_bench.styles.statistics import (
    Statistics,
    neighbours_distance,
    statistics_distance,
    style_activations,
    style_statistics,
)

Published = Callable[[str], State]


@pytest.fixture(scope="module")
def network(published: Published) -> Lpips:
    network = Lpips()
    network.load_state_dict(published("alexnet"))
    return network.eval()


@pytest.fixture(scope="module")
def untrained() -> Lpips:
    torch.manual_seed(0)
    return Lpips().eval()


def statistics(network: Lpips, picture: np.ndarray, mask: np.ndarray | None = None) -> Statistics:
    return style_statistics(style_activations(network, picture, mask))


@pytest.mark.parametrize("name", ["vgg16", "alexnet"])
def test_the_weights_are_the_published_ones_wherever_they_come_from(name: str, published: Published) -> None:
    assert content_sha256(published(name)) == NETWORKS[name].content


def test_vgg16_is_torchvision_s(published: Published) -> None:
    """Values as torch prints them for ``torchvision.models.vgg16(weights="IMAGENET1K_V1")``."""
    state = published("vgg16")
    first = [0.4034, 0.3778, 0.4644, -0.3228, 0.3940, -0.3953, 0.3951, -0.5496, 0.2693, -0.7602, -0.3508, 0.2334]
    np.testing.assert_allclose(state["features.0.bias"][:12], first, atol=5.1e-5)
    last = [[0.4603, 0.4340, 0.2835], [0.1634, -0.0582, -0.1920], [-0.1952, -0.4563, -0.4273]]
    np.testing.assert_allclose(state["features.0.weight"][-1, -1], last, atol=5.1e-5)
    second = [[-3.0606e-02, -9.8520e-02, -1.3260e-01], [6.8208e-03, -8.3483e-02, -1.6697e-01]]
    np.testing.assert_allclose(state["features.2.weight"][0, 0, :2], second, atol=6e-6)
    np.testing.assert_allclose(state["features.2.bias"][:4], [0.0020, -0.0902, 0.6164, -0.0818], atol=5.1e-5)


# --- LPIPS -----------------------------------------------------------------------------------------------------------


def by_the_paper(state: State, a: np.ndarray, b: np.ndarray) -> float:
    """Zhang et al. 2018, eq. 1, on AlexNet as Krizhevsky 2014 has it, in NumPy and in double precision."""

    def windowed(x: np.ndarray, side: int) -> np.ndarray:
        shape, axis = (side, side), (1, 2)
        return np.asarray(sliding_window_view(x, shape, axis))  # type: ignore[call-overload]

    def convolved(x: np.ndarray, layer: int, stride: int, padding: int) -> np.ndarray:
        kernel = state[f"features.{layer}.weight"].numpy().astype(float)
        padded = np.pad(x, ((0, 0), (padding,) * 2, (padding,) * 2))
        windows = windowed(padded, kernel.shape[2])[:, ::stride, ::stride]
        product = np.tensordot(kernel, windows, ((1, 2, 3), (0, 3, 4)))
        return np.maximum(product + state[f"features.{layer}.bias"].numpy()[:, None, None], 0)

    def pooled(x: np.ndarray) -> np.ndarray:
        return windowed(x, 3)[:, ::2, ::2].max((3, 4))

    def layers(picture: np.ndarray) -> list[np.ndarray]:
        x = ((picture - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225]).transpose(2, 0, 1)
        found = [convolved(x, 0, 4, 2)]
        found.append(convolved(pooled(found[0]), 3, 1, 2))
        found.append(convolved(pooled(found[1]), 6, 1, 1))
        found.append(convolved(found[2], 8, 1, 1))
        found.append(convolved(found[3], 10, 1, 1))
        return [y / np.sqrt((y**2).sum(0) + 1e-20) for y in found]

    pairs = zip(layers(a), layers(b))
    return sum(float(((x - y) ** 2 * state[f"heads.{k}"].numpy()[0]).sum(0).mean()) for k, (x, y) in enumerate(pairs))


def pictures(size: int = 96) -> list[np.ndarray]:
    random = np.random.default_rng(0).random((size, size, 3))
    return [style_picture("brush strokes", size), style_picture("stippling", size), random, gaussian_filter(random, 2)]


def test_lpips_is_the_paper_s_formula(network: Lpips, published: Published) -> None:
    state, drawn = published("alexnet"), pictures()
    for a, b in ((0, 1), (0, 2), (2, 3), (1, 3)):
        expected = by_the_paper(state, drawn[a], drawn[b])
        assert lpips(network, drawn[a], drawn[b]) == pytest.approx(expected, rel=1e-5)


def test_lpips_is_0_for_equal_pictures_and_the_same_both_ways(network: Lpips) -> None:
    a, b, *_ = pictures()
    assert lpips(network, a, a) == 0
    assert lpips(network, a, b) == pytest.approx(lpips(network, b, a), rel=1e-6)
    assert 0.3 < lpips(network, a, b) < 1.5  # pictures that have nothing in common


def test_lpips_grows_with_blur_and_with_noise(network: Lpips) -> None:
    truth = style_picture("brush strokes", 128)
    noise = np.random.default_rng(0).normal(0, 1, truth.shape)
    blurred = [lpips(network, gaussian_filter(truth, (s, s, 0)), truth) for s in (0.5, 1, 2, 4)]
    noisy = [lpips(network, truth + s * noise, truth) for s in (0.01, 0.03, 0.1, 0.3)]
    for scores in (blurred, noisy):
        assert scores == sorted(scores) and scores[0] < 0.1 < scores[-1]


def test_its_heads_are_not_negative(published: Published) -> None:
    """Else it were no distance; the authors clamp them so."""
    state = published("alexnet")
    assert all(float(state[f"heads.{k}"].min()) >= 0 for k in range(5))


# --- statistics ------------------------------------------------------------------------------------------------------


def test_without_a_mask_they_are_plain_means_and_deviations(untrained: Lpips) -> None:
    picture = pictures()[0]
    found = statistics(untrained, picture)
    x = torch.from_numpy(picture.astype(np.float32)).permute(2, 0, 1)[None] * 2 - 1
    for layer, mean, deviation in zip(untrained.activations(x), found.means, found.deviations, strict=True):
        torch.testing.assert_close(mean, layer[0].mean((1, 2)), rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(deviation, layer[0].std((1, 2), unbiased=False), rtol=1e-3, atol=1e-4)
    whole = statistics(untrained, picture, np.ones(picture.shape[:2]))
    assert statistics_distance(found, whole) == 0


@settings(max_examples=10)
@given(st.integers(0, 2**31), st.integers(31, 80), st.integers(31, 80))
def test_what_lies_outside_the_mask_does_not_count(untrained: Lpips, seed: int, height: int, width: int) -> None:
    random = np.random.default_rng(seed)
    picture, mask = random.random((height, width, 3)), random.random((height, width)) < 0.3
    mask[height // 2, width // 2] = True
    other = np.where(mask[..., None], picture, random.random((height, width, 3)))
    a, b = (statistics(untrained, p, mask) for p in (picture, other))
    assert statistics_distance(a, b) == 0
    inverted = np.where(mask[..., None], 1 - picture, picture)
    assert statistics_distance(a, statistics(untrained, inverted, mask)) > 0


def test_the_distance_is_a_distance(untrained: Lpips) -> None:
    a, b, c = (statistics(untrained, picture) for picture in pictures()[:3])
    assert statistics_distance(a, a) == 0
    assert statistics_distance(a, b) == statistics_distance(b, a) > 0
    around = statistics_distance(a, b) + statistics_distance(b, c)
    assert statistics_distance(a, c) <= around * (1 + sums_apart(10))


@pytest.mark.slow
def test_a_style_is_nearest_to_itself(network: Lpips) -> None:
    """Halves of a picture are alike in manner, however little their pixels have in common."""
    drawn = [style_picture(name, 192) for name in ("brush strokes", "stippling")]
    left, right = ([statistics(network, p[:, half]) for p in drawn] for half in (slice(96), slice(96, None)))
    for own in (0, 1):
        assert statistics_distance(left[own], right[own]) < 0.7 * statistics_distance(left[own], right[1 - own])


def test_pictures_and_masks_without_statistics_are_refused(untrained: Lpips) -> None:
    picture = np.zeros((40, 40, 3))
    for bad in (np.zeros((30, 40, 3)), np.zeros((40, 40)), np.zeros((40, 40, 4))):
        with pytest.raises(BadInput, match="31 x 31"):
            statistics(untrained, bad)
    for mask in (np.zeros((40, 40)), np.ones((40, 39))):
        with pytest.raises(BadInput, match="mask"):
            statistics(untrained, picture, mask)


# --- neighbours ------------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**31), st.integers(2, 30), st.integers(2, 8))
@settings(deadline=None)
def test_neighbours_know_no_order_and_no_repeats(seed: int, count: int, channels: int) -> None:
    style = torch.randn(count, channels, generator=torch.Generator().manual_seed(seed))
    shuffled = torch.cat([style, style])[torch.randperm(2 * count, generator=torch.Generator().manual_seed(seed))]
    rounding = sums_apart(channels) * 8
    assert neighbours_distance(shuffled, style) == pytest.approx(0.0, abs=rounding)
    half = style[: (count + 1) // 2]
    assert -rounding <= neighbours_distance(half, style) <= 4.0 + rounding


def test_neighbours_miss_what_is_not_there_and_what_is_too_much() -> None:
    """Half of a style lacks the other half; the whole and something else has too much."""
    style = torch.eye(8)
    assert neighbours_distance(style[:4], style) > 0.3
    assert neighbours_distance(torch.cat([style, -style]), style) > 0.3
