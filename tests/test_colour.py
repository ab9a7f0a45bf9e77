"""Laws of the colour functions."""

from __future__ import annotations

import colorsys
import importlib
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from skimage.color import rgb2lab

from svv.cli.options import parse_colour
from svv.core.colour.colour import (
    colour_differences,
    hsb_array,
    hsb_to_rgb,
    hue_distance,
    over,
    rgb_array,
    rgb_to_hsb,
    shift_colours,
)
from svv.core.colour.hex_codes import to_hex

TIGHT = 1e-12  # float64
unit = st.floats(0, 1)
colour = st.tuples(unit, unit, unit)


@given(colour)
def test_hsb_is_that_of_the_standard_library(rgb: tuple[float, float, float]) -> None:
    if max(rgb) - min(rgb) < 1e-6:  # a hue made of rounding errors
        rgb = (rgb[0],) * 3
    expected = np.array(colorsys.rgb_to_hsv(*rgb))
    found = hsb_array(np.array(rgb))
    assert hue_distance(found[0], expected[0]) < 1e-9
    np.testing.assert_allclose(found[1:], expected[1:], atol=TIGHT)
    np.testing.assert_allclose(rgb_array(expected), colorsys.hsv_to_rgb(*expected), atol=TIGHT)


@given(colour)
def test_hsb_round_trip(rgb: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(rgb_array(hsb_array(np.array(rgb))), rgb, atol=1e-9)
    assert 0 <= hsb_array(np.array(rgb))[0] < 1


def test_hsb_takes_any_leading_shape() -> None:
    rgb = torch.rand(4, 5, 3)
    assert rgb_to_hsb(rgb).shape == (4, 5, 3)
    torch.testing.assert_close(hsb_to_rgb(rgb_to_hsb(rgb))[2, 3], hsb_to_rgb(rgb_to_hsb(rgb[2, 3])))


def test_gradients_are_right_and_finite_at_grey_and_black() -> None:
    generator = torch.Generator().manual_seed(0)
    rgb = torch.rand(20, 3, dtype=torch.float64, generator=generator).requires_grad_()
    assert torch.autograd.gradcheck(rgb_to_hsb, (rgb,))
    assert torch.autograd.gradcheck(hsb_to_rgb, (rgb,))
    corners = torch.tensor([[0.0, 0, 0], [0.5, 0.5, 0.5], [1, 1, 1], [1, 0, 0]]).requires_grad_()
    hsb_to_rgb(rgb_to_hsb(corners)).sum().backward()
    assert corners.grad is not None
    assert corners.grad.isfinite().all()


@given(unit, unit)
def test_hue_distance_is_the_shorter_arc(a: float, b: float) -> None:
    distance = hue_distance(a, b)
    assert distance == pytest.approx(min(abs(a - b), 1 - abs(a - b)), abs=TIGHT)
    assert distance == pytest.approx(hue_distance(b, a), abs=TIGHT)


def test_hue_distance_wraps_for_arrays_and_tensors() -> None:
    found = hue_distance(np.array([0.98, 0.25]), np.array([0.03, 0.75]))
    assert abs(found - np.array([0.05, 0.5])).max() < TIGHT
    torch.testing.assert_close(hue_distance(torch.tensor([0.98]), torch.tensor([0.03])), torch.tensor([0.05]))


def test_editing_moves_the_palette_colour_onto_its_target() -> None:
    palette = torch.tensor([[0.9, 0.2, 0.1], [0.1, 0.3, 0.8]])
    target = torch.tensor([[0.2, 0.7, 0.9], [0.6, 0.1, 0.9]])
    torch.testing.assert_close(shift_colours(palette, palette, target), target)


def test_editing_adds_the_difference_in_hsb_with_wrapping_and_clamping() -> None:
    palette = hsb_to_rgb(torch.tensor([[0.9, 0.5, 0.5]]))
    target = hsb_to_rgb(torch.tensor([[0.1, 0.9, 0.8]]))
    samples = torch.tensor([[[0.95, 0.3, 0.4]], [[0.85, 0.8, 0.9]]])  # (S, P, hsb)
    expected = torch.tensor([[[0.15, 0.7, 0.7]], [[0.05, 1.0, 1.0]]])
    found = rgb_to_hsb(shift_colours(hsb_to_rgb(samples), palette, target))
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=0)


def test_unedited_colours_come_back_untouched_even_outside_the_gamut() -> None:
    palette = torch.tensor([[0.9, 0.2, 0.1], [0.1, 0.3, 0.8]])
    samples = torch.randn(50, 2, 3, generator=torch.Generator().manual_seed(0))
    target = palette.clone()
    target[1] = torch.tensor([1.0, 1.0, 0.0])
    found = shift_colours(samples, palette, target)
    assert torch.equal(found[:, 0], samples[:, 0])
    assert found[:, 1].min() >= 0
    assert found[:, 1].max() <= 1


def test_grey_takes_the_hue_of_its_target_and_gives_none() -> None:
    # a trace of blue in a grey sample must not decide what red it becomes
    grey, red = torch.tensor([[0.5, 0.5, 0.5]]), torch.tensor([[0.8, 0.1, 0.1]])
    found = rgb_to_hsb(shift_colours(torch.tensor([[[0.5, 0.5, 0.52]]]), grey, red))
    assert found[0, 0, 0] == 0
    assert found[0, 0, 1] > 0.8
    assert rgb_to_hsb(shift_colours(red[None], red, grey))[0, 0, 1] < 1e-6


def test_editing_can_be_differentiated() -> None:
    palette = torch.tensor([[0.9, 0.2, 0.1]], dtype=torch.float64)
    target = torch.tensor([[0.7, 0.4, 0.2]], dtype=torch.float64)
    samples = (palette + 0.05 * torch.rand(10, 1, 3, dtype=torch.float64)).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: shift_colours(x, palette, target), (samples,))


@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
def test_a_hex_code_is_the_colour_s_levels(red: int, green: int, blue: int) -> None:
    code = to_hex((red / 255, green / 255, blue / 255))
    assert code == f"#{red:02x}{green:02x}{blue:02x}"
    np.testing.assert_allclose(parse_colour(code), (red / 255, green / 255, blue / 255))


def test_hex_clamps() -> None:
    assert to_hex(np.array([1.2, -0.1, 0.5])) == "#ff0080"


def test_over_a_background() -> None:
    rgba = np.array([[1.0, 0.5, 0.0, 0.0], [1.0, 0.5, 0.0, 1.0], [1.0, 0.5, 0.0, 0.25]])
    expected = np.array([[1.0, 1.0, 1.0], [1.0, 0.5, 0.0], [1.0, 0.875, 0.75]])
    assert abs(over(rgba, (1, 1, 1)) - expected).max() < TIGHT
    assert over(rgba.astype(np.float32), (0, 0, 1)).dtype == np.float32


# --- against colour-science -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def science() -> Any:
    """The package colour-science, an implementation of its own of what we and scikit-image calculate."""
    return importlib.import_module("colour")


@given(rgb=colour)
def test_hsb_is_that_of_colour_science(science: Any, rgb: tuple[float, float, float]) -> None:
    if max(rgb) - min(rgb) < 1e-6:
        rgb = (rgb[0],) * 3
    found, expected = hsb_array(np.array(rgb)), science.RGB_to_HSV(np.array(rgb))
    assert hue_distance(found[0], expected[0]) < 1e-9
    np.testing.assert_allclose(found[1:], expected[1:], atol=TIGHT)


@given(a=st.lists(colour, min_size=1, max_size=4), b=st.lists(colour, min_size=1, max_size=4))
def test_colour_differences_are_those_of_colour_science(science: Any, a: list, b: list) -> None:
    """The same formula on the same CIELAB; the two matrices from sRGB differ in their last digits."""
    first, second = (rgb2lab(np.array(c)) for c in (a, b))
    expected = science.delta_E(first[:, None], second[None], method="CIE 2000")
    np.testing.assert_allclose(colour_differences(np.array(a), np.array(b)), expected, atol=1e-9)
    np.testing.assert_allclose(first, science.XYZ_to_Lab(science.sRGB_to_XYZ(np.array(a))), atol=0.03)


def test_colour_differences_are_those_of_the_paper() -> None:
    """Sharma, Wu and Dalal (2005), table 1, brought to sRGB; black and white are 100 apart."""
    from skimage.color import lab2rgb

    pairs = np.array([[[50, 2.5, 0], [50, 0, -2.5]], [[50, 2.5, 0], [61, -5, 29]],
                      [[2.0776, 0.0795, -1.135], [0.9033, -0.0636, -0.5514]]])  # fmt: skip
    rgb = lab2rgb(pairs)
    found = [colour_differences(rgb[k, :1], rgb[k, 1:])[0, 0] for k in range(3)]
    np.testing.assert_allclose(found, [4.3065, 22.8977, 0.9082], atol=0.02)
    black, white = np.zeros((1, 3)), np.ones((1, 3))
    np.testing.assert_allclose(colour_differences(black, np.concatenate([white, black])), [[100.0, 0.0]], atol=0.01)
