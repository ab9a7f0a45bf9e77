"""Vectors in compiled functions: each lane computes what NumPy computes of its number."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray

from svv.core import lanes
from svv.core.lanes import (
    LANES,
    as_floats,
    bits_of,
    first_of,
    gather,
    gather_halves,
    gather_pairs,
    lane_numbers,
    load,
    mask_of,
    maximum,
    minimum,
    number_of,
    ones_in_each,
    select,
    splat,
    store,
    to_front,
    total,
    truncated,
)

WHOLE = st.lists(st.integers(-(2**20), 2**20), min_size=LANES, max_size=LANES)
NUMBERS = st.lists(st.floats(-1e3, 1e3, width=32), min_size=LANES, max_size=LANES)


@njit
def arithmetic(a, b, i, j, out, whole):  # type: ignore[no-untyped-def]
    x, y, m, n = load(a, 0), load(b, 0), load(i, 0), load(j, 0)
    store(out, 0, (x + y) * np.float32(0.5) - np.float32(3.0) * y)
    store(out, LANES, minimum(x, y) / (maximum(x, y) * maximum(x, y) + np.float32(1.0)))
    store(out, 2 * LANES, as_floats(truncated(x)))
    store(whole, 0, m * 3 - n + 1)
    store(whole, LANES, (m & 255) | (n << 8))
    store(whole, 2 * LANES, (m >> 3) + lane_numbers())
    store(whole, 3 * LANES, select((m < n) & (x >= y) | (m == n), m, n))
    store(whole, 4 * LANES, ones_in_each(m))
    return bits_of(x > y), bits_of(m <= 5)


@njit
def total_of(a):  # type: ignore[no-untyped-def]
    return total(load(a, 0))


@settings(max_examples=20, deadline=None)
@given(NUMBERS)
def test_a_total_adds_halves_to_halves(numbers: list[float]) -> None:
    left = np.array(numbers, np.float32)
    found = total_of(left)
    while len(left) > 1:
        left = left[: len(left) // 2] + left[len(left) // 2 :]
    assert found == left[0]


@settings(max_examples=60, deadline=None)
@given(NUMBERS, NUMBERS, WHOLE, WHOLE)
def test_lanes_compute_what_numpy_does(one: list[float], other: list[float], i: list[int], j: list[int]) -> None:
    a, b = np.array(one, np.float32), np.array(other, np.float32)
    m, n = np.array(i, np.int32), np.array(j, np.int32)
    out, whole = np.zeros((3, LANES), np.float32), np.zeros((5, LANES), np.int32)
    more, few = arithmetic(a, b, m, n, out, whole)
    half, three = np.float32(0.5), np.float32(3.0)
    np.testing.assert_allclose(out[0], (a + b) * half - three * b, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(out[1], np.minimum(a, b) / (np.maximum(a, b) ** 2 + 1), rtol=1e-5)
    np.testing.assert_array_equal(out[2], np.trunc(a))
    np.testing.assert_array_equal(whole[0], m * 3 - n + 1)
    np.testing.assert_array_equal(whole[1], (m & 255) | (n << 8))
    np.testing.assert_array_equal(whole[2], (m >> 3) + np.arange(LANES))
    np.testing.assert_array_equal(whole[3], np.where((m < n) & (a >= b) | (m == n), m, n))
    np.testing.assert_array_equal(whole[4], [bin(v & 0xFFFFFFFF).count("1") for v in m.tolist()])
    assert [more >> k & 1 for k in range(LANES)] == (a > b).tolist()
    assert [few >> k & 1 for k in range(LANES)] == (m <= 5).tolist()


@njit
def chosen(bits, out):  # type: ignore[no-untyped-def]
    store(out, 0, select(mask_of(bits), splat(np.int32(1)), splat(np.int32(0))))
    return (first_of(bits) if bits else -1), number_of(bits)


@given(st.integers(0, 2**LANES - 1))
@settings(max_examples=60, deadline=None)
def test_masks_are_bits_the_first_lane_lowest(bits: int) -> None:
    out = np.zeros(LANES, np.int32)
    first, number = chosen(bits, out)
    assert out.tolist() == [bits >> k & 1 for k in range(LANES)]
    assert (first, number) == ((bits & -bits).bit_length() - 1, bin(bits).count("1"))


@pytest.mark.parametrize("since", [lanes.COMPRESSES, (99, 0, 0)], ids=["by LLVM", "lane by lane"])
def test_lanes_that_are_set_move_to_the_front_in_their_order(
    since: tuple[int, int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lanes, "COMPRESSES", since)

    @njit
    def move(numbers, bits, whole, real):  # type: ignore[no-untyped-def]
        vector = load(numbers, 0)
        store(whole, 0, to_front(vector, mask_of(bits)))
        store(real, 0, to_front(as_floats(vector), mask_of(bits)))

    numbers = np.arange(100, 100 + LANES, dtype=np.int32)
    whole, real = np.zeros(LANES, np.int32), np.zeros(LANES, np.float32)
    every = (1 << LANES) - 1
    for bits in [0, 1, 1 << (LANES - 1), every, *np.random.default_rng(0).integers(0, every + 1, 50).tolist()]:
        move(numbers, bits, whole, real)
        kept = [n for k, n in enumerate(numbers.tolist()) if bits >> k & 1]
        assert whole[: len(kept)].tolist() == kept
        assert real[: len(kept)].tolist() == kept


@njit
def looked_up(array, at, out):  # type: ignore[no-untyped-def]
    places = load(at, 0)
    one, other = gather_pairs(array, places, 3)
    for k, found in ((0, gather(array, places)), (1, one), (2, other)):
        store(out, k * LANES, as_floats(found))


@pytest.mark.parametrize("kind", ["u1", "u2", "f4"])
def test_look_ups_read_places_in_raster_order(kind: str) -> None:
    rng = np.random.default_rng(0)
    array = rng.integers(0, 256, (4, 5, 6)).astype(kind)
    at = rng.integers(0, array.size - 4, LANES).astype(np.int32)
    out = np.zeros((3, LANES), np.float32)
    looked_up(array, at, out)
    for found, offset in zip(out, (0, 3, 4), strict=True):
        np.testing.assert_array_equal(found, array.ravel()[at + offset])


@njit
def halved(array, at, out):  # type: ignore[no-untyped-def]
    lower, upper = gather_halves(array, load(at, 0))
    store(out, 0, lower)
    store(out, LANES, upper)


def test_words_are_read_in_halves() -> None:
    words = np.random.default_rng(1).integers(0, 2**63, 50, np.int64)
    at, out = np.arange(LANES, dtype=np.int32) * 3, np.zeros((2, LANES), np.int32)
    halved(words, at, out)
    np.testing.assert_array_equal(out.view(np.uint32).astype(np.int64), [words[at] & 0xFFFFFFFF, words[at] >> 32])


@njit
def exponential(x, out):  # type: ignore[no-untyped-def]
    store(out, 0, lanes.exp(load(x, 0)))


@njit
def soft(x, out):  # type: ignore[no-untyped-def]
    store(out, 0, lanes.softplus(load(x, 0)))


def of_doubles(function: Callable[..., None], x: NDArray[np.float32]) -> NDArray[np.float32]:
    out = np.zeros(LANES, np.float32)
    function(x, out)
    return out


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-85.0, 85.0, width=32), min_size=LANES, max_size=LANES))
def test_exponentials_and_softplus_are_as_exact_as_single_precision(numbers: list[float]) -> None:
    x = np.array(numbers, np.float32)
    wide = x.astype(np.float64)
    np.testing.assert_allclose(of_doubles(exponential, x), np.exp(wide), rtol=2e-7)
    np.testing.assert_allclose(of_doubles(soft, x), np.logaddexp(0.0, wide), rtol=5e-7)


def test_exponentials_of_what_is_out_of_range_stay_finite() -> None:
    x = np.resize(np.array([-1e30, -100.0, 100.0, 1e30], np.float32), LANES)
    found = of_doubles(exponential, x).reshape(-1, 4)
    assert np.isfinite(found).all()
    assert (found[:, :2] < 1e-37).all()
    assert (found[:, 2:] > 1e38).all()
