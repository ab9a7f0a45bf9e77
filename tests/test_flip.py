"""FLIP compared with the values of its authors' program."""

from __future__ import annotations

import numpy as np
import pytest

from svv.core.images.flip import REACH, _errors, error_map

Pair = tuple[np.ndarray, np.ndarray]


def grid(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of each pixel, integers (h, w, 1)."""
    y, x, _ = np.indices((height, width, 1))
    return y, x


def noise(height: int, width: int) -> Pair:
    """Two pictures without structure."""
    y, x = grid(height, width)
    channel = np.arange(3) * 101
    first, second = 31 * x * x + 17 * y * y + 7 * x * y + channel, 13 * x * x + 29 * y * y + 3 * x * y + 2 * channel
    return first % 256 / 255, second % 256 / 255


def saturated(height: int, width: int) -> Pair:
    """Blocks of 5 x 5 pixels whose channels are 0 or 1."""
    test, reference = (np.kron(np.round(p), np.ones((5, 5, 1))) for p in noise(height, width))
    return test[:height, :width], reference[:height, :width]


def smooth(height: int, width: int) -> Pair:
    """Slow changes of colour, and the same a little lighter in the middle."""
    y, x = grid(height, width)
    u, v = x / width, y / height
    picture = np.concatenate((u, v, 1 - u * v), 2)
    return np.clip(picture + 0.3 * u * (1 - u) * v * (1 - v), 0, 1), picture


def edges(height: int, width: int) -> Pair:
    """Stripes of green on magenta, moved by a pixel."""
    y, x = grid(height, width + 1)
    picture = np.where((x // 6 + y // 9) % 2 == 0, [0.1, 0.8, 0.2], [0.7, 0.1, 0.6])
    return picture[:, 1:], picture[:, :-1]


def ball(height: int, width: int) -> Pair:
    """A lit ball on white, as a renderer draws it, and the same coarser, darker and bluish."""
    y, x = grid(height, width)

    def render(y: np.ndarray, x: np.ndarray, light: list[float]) -> np.ndarray:
        u, v = 2.4 * (x + 0.5) / width - 1.2, 2.4 * (y + 0.5) / height - 1.2
        depth = np.sqrt(np.clip(1 - u * u - v * v, 0, None))
        lit = 0.15 + 0.85 * np.clip((depth - 0.6 * u - 0.5 * v) / 1.27, 0, 1)
        return np.where(depth > 0, lit * light, 1.0)

    return render(y // 2 * 2, x // 2 * 2, [0.84, 0.52, 0.3]), render(y, x, [0.9, 0.55, 0.3])


def step(height: int, width: int) -> Pair:
    """Black for white in the right half."""
    _, x = grid(height, width)
    reference = np.ones((height, width, 3))
    return np.where(x < width // 2, reference, 0), reference


def dark(height: int, width: int) -> Pair:
    """Below the knees of sRGB and of CIELAB."""
    test, reference = noise(height, width)
    return test * 0.03, reference * 0.03


PUBLISHED = [
    (noise, (11, 11), 0.5385258, 0.1916243, 0.9655948),
    (noise, (1, 1), 0.9630813, 0.0000000, 0.9630813),
    (noise, (3, 2), 0.8027320, 0.1329989, 0.9688922),
    (noise, (64, 97), 0.4443872, 0.1616209, 0.9774284),
    (noise, (200, 31), 0.4449590, 0.1637106, 0.9736518),
    (saturated, (60, 45), 0.8828840, 0.1527690, 0.9987214),
    (smooth, (48, 70), 0.0686104, 0.0330728, 0.1306970),
    (smooth, (300, 200), 0.0642669, 0.0313563, 0.1214256),
    (edges, (53, 71), 0.3822032, 0.2565126, 0.8285513),
    (ball, (96, 128), 0.1315286, 0.1405719, 0.7642271),
    (ball, (800, 800), 0.1010308, 0.1083588, 0.7757761),
    (step, (32, 33), 0.5573520, 0.4620743, 0.9904038),
    (dark, (50, 40), 0.0140035, 0.0077010, 0.0426131),
]
"""Picture, height and width; mean, standard deviation and largest value of the map that flip-evaluator 1.7 gives:
``flip_evaluator.evaluate(reference, test, "LDR", applyMagma=False)[0]`` of both pictures in float32, the three numbers
taken in float64."""

FEATURELESS = [(edges, (53, 71)), (step, (32, 33)), (noise, (1, 1))]
"""Areas of one colour that differ: no feature is there, but the published program sums in float32, which leaves about
1e-7 of one; the root in the feature error makes 3e-4 of that, and the map is off by up to 3e-4 E |ln E|."""


@pytest.mark.parametrize(("make", "size", "mean", "deviation", "largest"), PUBLISHED)
def test_the_map_has_the_published_program_s_values(make, size, mean, deviation, largest) -> None:
    errors = error_map(*make(*size))
    tolerance = 3e-5 if (make, size) in FEATURELESS else 1e-6
    assert errors.shape == size and errors.dtype == np.float32
    assert errors.mean(dtype=float) == pytest.approx(mean, abs=tolerance)
    assert errors.std(dtype=float) == pytest.approx(deviation, abs=tolerance)
    assert errors.max() == pytest.approx(largest, abs=max(tolerance, 2e-6))


@pytest.mark.parametrize("make", [noise, saturated, smooth, edges, ball, step, dark])
def test_the_error_is_symmetric_and_0_where_nothing_differs(make) -> None:
    test, reference = make(40, 60)
    np.testing.assert_allclose(error_map(test, reference), error_map(reference, test), atol=1e-7)
    np.testing.assert_array_equal(error_map(reference, reference), 0)
    half = np.where(np.arange(60)[:, None] < 20, reference, test)
    np.testing.assert_array_equal(error_map(half, reference)[:, :10], 0)  # the filters reach 10 pixels


def test_the_farthest_colours_differ_by_1_and_values_outside_are_clamped() -> None:
    green, blue = np.zeros((2, 12, 12, 3))
    green[..., 1] = blue[..., 2] = 1
    assert error_map(green, blue) == pytest.approx(1)
    np.testing.assert_array_equal(error_map(3 * green - 1, 3 * blue - 1), error_map(green, blue))


@pytest.mark.parametrize("rows", [1, 7, 64])
def test_bands_of_rows_change_nothing(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    test, reference = np.random.default_rng(3).random((2, 61, 40, 3))
    whole = error_map(test, reference)
    monkeypatch.setattr("svv.core.images.flip.ROWS_AT_A_TIME", rows)
    np.testing.assert_array_equal(error_map(test, reference), whole)


def test_what_is_far_from_any_difference_is_left_out_exactly() -> None:
    reference = np.random.default_rng(4).random((90, 120, 3))
    test = reference.copy()
    test[30:34, 100:103] = 1.0 - test[30:34, 100:103]
    found, exact = error_map(test, reference), _errors(test, reference)
    np.testing.assert_array_equal(found, exact.astype(np.float32))
    seen = np.argwhere(exact > 0)
    assert seen.min(0).tolist() == [30 - REACH, 100 - REACH] and seen[:, 0].max() == 33 + REACH
