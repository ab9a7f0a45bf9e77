"""Unmixing pixels into a palette made by hand: pure colours belong to one entry, and mixtures return their shares."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.train.palette.unmix import Unmixing

ORANGE, AMBER, BLUE = (0.95, 0.45, 0.1), (0.95, 0.64, 0.1), (0.1, 0.35, 0.95)
PALETTE = np.array([ORANGE, AMBER, BLUE])


def shares(colour: np.ndarray, palette: np.ndarray = PALETTE) -> np.ndarray:
    pixels = torch.as_tensor(np.atleast_2d(colour), dtype=torch.float32)
    return Unmixing(palette, torch.device("cpu")).shares(pixels).numpy()


@given(st.integers(0, 2), st.floats(0.2, 1.0), st.floats(0.0, 0.05))
def test_a_shade_of_one_colour_is_its_own(number: int, shade: float, light: float) -> None:
    """In 8 bits, with a little light, and though another hue is 0.037 away."""
    pixel = np.rint(255 * np.minimum(shade * PALETTE[number] + light * shade, 1.0)) / 255
    assert shares(pixel)[0, number] > 0.75


@given(st.floats(0.25, 0.75), st.floats(0.5, 1.0))
def test_a_mixture_is_shared(part: float, shade: float) -> None:
    found = shares(shade * (part * PALETTE[0] + (1.0 - part) * PALETTE[2]))[0]
    np.testing.assert_allclose(found, [part, 0.0, 1.0 - part], atol=0.02)


@given(st.lists(st.tuples(*[st.floats(0.0, 1.0)] * 3), min_size=1, max_size=8), st.integers(0, 2**31))
def test_shares_are_parts_of_one(palette: list[tuple[float, float, float]], seed: int) -> None:
    """For palettes of one to eight colours, black and equal ones too; a pixel without colour has no shares."""
    pixels = np.random.default_rng(seed).random((50, 3))
    found = shares(pixels, np.array(palette))
    assert np.isfinite(found).all() and (found >= 0.0).all()
    total = found.sum(axis=1)
    assert (np.isclose(total, 1.0, atol=1e-4) | (total < 1e-4)).all()


def test_nothing_is_nobodys() -> None:
    assert shares(np.zeros(3)).max() == pytest.approx(0.0, abs=1e-6)
