"""LDR-FLIP: the difference that a viewer sees when two pictures alternate.

Source: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator for
Alternating Images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), 2020. Section numbers below refer to this paper.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from svv.core.colour.srgb import linear

Array = NDArray[np.float64]

PIXELS_PER_DEGREE = 0.7 * (3840 / 0.7) * math.pi / 180
"""The paper's viewer: 0.7 m from a screen 0.7 m wide with 3840 columns, which is 67.02 pixels per degree."""

RGB_TO_XYZ = np.array([[10135552, 8788810, 4435075], [2613072, 8788810, 887015], [1425312, 8788810, 70074185]]) / [
    [24577794],
    [12288897],
    [73733382],
]
"""Linear sRGB to CIE XYZ under D65."""

WHITE = RGB_TO_XYZ.sum(1)
XYZ_TO_RGB = np.linalg.inv(RGB_TO_XYZ)

LUMINANCE_CSF = ((1.0, 0.0047),)
RED_GREEN_CSF = ((1.0, 0.0053),)
BLUE_YELLOW_CSF = ((34.1, 0.04), (13.5, 0.025))
"""Amplitudes a and spreads b (degrees^2) of the Gaussians that approximate the contrast sensitivity functions."""

COLOUR_EXPONENT = 0.7  # q_c
KNEE, KNEE_ERROR = 0.4, 0.95  # p_c, p_t: this fraction of the largest colour difference gives this error
FEATURE_WIDTH = 0.082  # w, degrees
FEATURE_EXPONENT = 0.5  # q_f
FEATURE_DEVIATION = FEATURE_WIDTH / 2 * PIXELS_PER_DEGREE
"""Standard deviation of the Gaussian that detects features, in pixels."""

BLUR_RADIUS = math.ceil(3 * math.sqrt(max(b for _, b in BLUE_YELLOW_CSF) / (2 * math.pi**2)) * PIXELS_PER_DEGREE)
FEATURE_RADIUS = math.ceil(3 * FEATURE_DEVIATION)
REACH = max(BLUR_RADIUS, FEATURE_RADIUS)
"""How far the filters reach, in pixels: three standard deviations of the widest Gaussian (sections 4.1 and 4.2)."""

ROWS_AT_A_TIME = 160
"""Rows of a picture that are compared together, which bounds the memory."""


def error_map(test: NDArray[np.floating], reference: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the FLIP error per pixel, Delta E = Delta E_c ^ (1 - Delta E_f) in [0, 1] (section 4.3). (h, w)

    A degree has 67 pixels. Both pictures (h, w, 3) are gamma-encoded sRGB; values outside [0, 1] are clamped.
    """
    # Farther from any difference than the filters reach, there is no error: often so on the background.
    errors, differs = np.zeros(reference.shape[:2], np.float32), (test != reference).any(axis=2)
    (top, bottom), (left, right) = (_reached(differs.any(axis=axis)) for axis in (1, 0))
    across = slice(max(left - REACH, 0), right + REACH)
    # Rows are compared in bands, with the rows around them that the filters reach.
    for first in range(top, bottom, ROWS_AT_A_TIME):
        last = min(first + ROWS_AT_A_TIME, bottom)
        low, high = max(first - REACH, 0), last + REACH
        band = _errors(test[low:high, across], reference[low:high, across])
        errors[first:last, left:right] = band[first - low : last - low, left - across.start : right - across.start]
    return errors


def _reached(differs: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the first of the lines (n,) that filters reach from lines with a difference, and the end of them."""
    lines = np.flatnonzero(differs)
    return (max(int(lines[0]) - REACH, 0), min(int(lines[-1]) + REACH + 1, len(differs))) if len(lines) else (0, 0)


def _errors(test: NDArray[np.floating], reference: NDArray[np.floating]) -> Array:
    opponents = [_opponents(picture) for picture in (test, reference)]
    colour = _colour_error(*(_seen(picture) for picture in opponents))
    luminance = [(picture[0] + 16) / 116 for picture in opponents]
    return np.power(colour, 1 - _feature_error(*luminance))


def _opponents(srgb: NDArray[np.floating]) -> Array:
    """Convert to YyCxCz: Y = 116 Y/Yn - 16, Cx = 500 (X/Xn - Y/Yn), Cz = 200 (Y/Yn - Z/Zn). (h, w, 3) -> (3, h, w)."""
    srgb = np.moveaxis(np.clip(srgb.astype(np.float64), 0, 1), 2, 0)
    return _of_ratios(_ratios(linear(srgb)))


def _ratios(light: Array) -> Array:
    """Return X/Xn, Y/Yn and Z/Zn of linear sRGB. (3, ...)"""
    return np.tensordot(RGB_TO_XYZ / WHITE[:, None], light, 1)


def _of_ratios(ratios: Array) -> Array:
    """Return 116 y - 16, 500 (x - y) and 200 (y - z), the form that YyCxCz and CIELAB share. (3, ...)"""
    x, y, z = ratios
    return np.stack((116 * y - 16, 500 * (x - y), 200 * (y - z)))


def _seen(opponents: Array) -> Array:
    """Return CIELAB of what the eye resolves, a* and b* multiplied by 0.01 L* after Hunt (section 4.1). (3, h, w)

    The contrast sensitivity filters can leave the gamut, so their result is clamped to it.
    """
    luminance, red_green, blue_yellow = (
        _blurred(channel, gaussians)
        for channel, gaussians in zip(opponents, (LUMINANCE_CSF, RED_GREEN_CSF, BLUE_YELLOW_CSF))
    )
    y = (luminance + 16) / 116
    ratios = np.stack((y + red_green / 500, y, y - blue_yellow / 200))
    return _hunt(np.clip(np.tensordot(XYZ_TO_RGB * WHITE, ratios, 1), 0, 1))


def _hunt(linear: Array) -> Array:
    """Return CIELAB of linear sRGB with a* and b* multiplied by 0.01 L*. (3, ...)"""
    ratios = _ratios(linear)
    edge = 6 / 29
    lab = _of_ratios(np.where(ratios > edge**3, np.cbrt(ratios), ratios / (3 * edge**2) + 4 / 29))
    lab[1:] *= 0.01 * lab[0]
    return lab


def _blurred(channel: Array, gaussians: tuple[tuple[float, float], ...]) -> Array:
    """Convolve (h, w) with g(r) = sum_i a_i sqrt(pi / b_i) exp(-pi^2 r^2 / b_i), r in degrees (section 4.1).

    Each Gaussian is separable, so each dimension has the root of its amplitude. The radius is 3 standard deviations of
    the widest Gaussian of all channels, the weights sum to 1, and border pixels are repeated outside.
    """
    squares = (np.arange(-BLUR_RADIUS, BLUR_RADIUS + 1) / PIXELS_PER_DEGREE) ** 2
    taps = [math.sqrt(a * math.sqrt(math.pi / b)) * np.exp(-(math.pi**2) * squares / b) for a, b in gaussians]
    total = sum(weights.sum() ** 2 for weights in taps)
    return np.sum([_filtered(channel, weights, weights) for weights in taps], 0) / total


def _filtered(channel: Array, down: Array, across: Array) -> Array:
    """Correlate (h, w) with the outer product of two 1-D filters; border pixels are repeated outside."""
    return correlate1d(correlate1d(channel, across, 1, mode="nearest"), down, 0, mode="nearest")


def _hyab(some: Array, other: Array) -> Array:
    """Return |Delta L*| + sqrt(Delta a*^2 + Delta b*^2), the distance for large differences. (3, ...) -> (...)"""
    lightness, a, b = some - other
    return np.abs(lightness) + np.hypot(a, b)


GREEN_TO_BLUE = float(_hyab(_hunt(np.array([0.0, 1.0, 0.0])), _hunt(np.array([0.0, 0.0, 1.0])))) ** COLOUR_EXPONENT
"""The largest colour difference in the sRGB gamut, c_max."""


def _colour_error(test: Array, reference: Array) -> Array:
    """Return Delta E_c in [0, 1]: HyAB^0.7, remapped linearly on both sides of a knee (section 4.1). (h, w)"""
    difference = _hyab(test, reference) ** COLOUR_EXPONENT / GREEN_TO_BLUE
    return np.interp(difference, (0, KNEE, 1), (0, KNEE_ERROR, 1))


def _feature_error(test: Array, reference: Array) -> Array:
    """Return Delta E_f = (max(|edge difference|, |point difference|) / sqrt(2))^0.5 in [0, 1] (section 4.2). (h, w)

    Edges and points are the lengths of the first and second derivatives of the luminance along x and y, taken with a
    Gaussian whose standard deviation is half the feature width.
    """
    x = np.arange(-FEATURE_RADIUS, FEATURE_RADIUS + 1, dtype=np.float64)
    gaussian = np.exp(-(x**2) / (2 * FEATURE_DEVIATION**2))
    first, second = (_balanced(weights * gaussian) for weights in (-x, x**2 / FEATURE_DEVIATION**2 - 1))
    gaussian /= gaussian.sum()

    def change(derivative: Array) -> Array:
        strengths = [
            np.hypot(_filtered(picture, gaussian, derivative), _filtered(picture, derivative, gaussian))
            for picture in (test, reference)
        ]
        return np.abs(strengths[0] - strengths[1])

    return (np.maximum(change(first), change(second)) / math.sqrt(2)) ** FEATURE_EXPONENT


def _balanced(weights: Array) -> Array:
    """Scale weights so that the positive ones sum to 1 and the negative ones to -1."""
    return np.where(weights > 0, weights / weights[weights > 0].sum(), weights / -weights[weights < 0].sum())
