"""Generated paintings: every seed gives one, always the same, with colours in range and enough variation."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest

from svv.styles.gallery.textures import STYLE_PICTURES, rank, spectrum_noise, style_picture
from tests.nightly import nightly


@pytest.mark.parametrize("name", nightly(STYLE_PICTURES, "brush strokes"))
def test_style_pictures_are_colourful_and_full_of_strokes(name: str) -> None:
    picture = style_picture(name, 160)
    assert picture.shape == (160, 160, 3) and picture.dtype == np.float32
    assert picture.min() >= 0 and picture.max() <= 1
    hues = [colorsys.rgb_to_hsv(*p)[0] for p in picture[::8, ::8].reshape(-1, 3) if max(p) - min(p) > 0.2]
    assert len(set((np.array(hues) * 6).astype(int))) >= 4  # of six sectors of the colour wheel
    assert np.abs(np.diff(picture, axis=0)).mean() > 0.02
    np.testing.assert_array_equal(picture, style_picture(name, 160))
    assert np.abs(picture - style_picture(name, 160, seed=1)).mean() > 0.02


def test_noise_falls_with_its_exponent_and_ranks_are_even() -> None:
    noise = spectrum_noise(np.random.default_rng(0), 128, 2.0)
    assert noise.mean() == pytest.approx(0, abs=1e-3) and noise.std() == pytest.approx(1, abs=1e-3)
    amplitude = np.abs(np.fft.fft2(noise))
    low, high = amplitude[0, 4:8].mean(), amplitude[0, 32:56].mean()
    assert 10 < low / high < 200  # (44 / 6)^2 = 54
    ranks = rank(noise)
    np.testing.assert_allclose(np.quantile(ranks, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=1e-3)
