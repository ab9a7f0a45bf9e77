"""Images with several rays per pixel: averages of finer images, and what makes them the default."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from PIL import Image

from svv.core.colour.colour import over
from svv.errors import BadInput
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Rendering, Scene
from svv.render.frames import RenderSettings, orbit, write_view
from svv.render.supersampled import averaged, samples_for, supersampled
from tests.test_brushing import painted

UNIT = st.floats(0.0, 1.0, width=32)


@given(rgba=npst.arrays(np.float32, (6, 4, 4), elements=UNIT), n=st.sampled_from([1, 2]))
def test_over_any_background_the_average_is_that_of_the_finer_image(rgba: np.ndarray, n: int) -> None:
    seen = rgba[..., 3] > 0
    fine = Rendering(rgba, np.where(seen, 2.0, np.nan).astype(np.float32), np.where(seen, 0, -1).astype(np.int16))
    found = averaged(fine, n)
    for background in ((0.0, 0.0, 0.0), (1.0, 0.5, 0.0)):
        expected = over(rgba, background).reshape(6 // n, n, 4 // n, n, 3).mean((1, 3))
        assert over(found.rgba, background) == pytest.approx(expected, abs=1e-5)
    there = found.region == 0
    assert np.array_equal(there, ~np.isnan(found.depth))
    assert np.allclose(found.depth[there & (found.rgba[..., 3] > 1e-6)], 2.0)
    assert np.array_equal(there, seen.reshape(6 // n, n, 4 // n, n).any((1, 3)))


def test_a_pixel_belongs_to_the_region_with_the_most_opacity_and_has_the_depth_of_its_most_opaque_ray() -> None:
    rgba = np.ones((2, 2, 4), np.float32)
    rgba[..., 3] = [[0.5, 0.2], [0.3, 0.6]]
    depth = np.array([[1.0, 5.0], [6.0, 7.0]], np.float32)
    found = averaged(Rendering(rgba, depth, np.array([[0, 2], [2, 0]], np.int16)), 2)
    assert (found.region.item(), found.depth.item()) == (0, 7.0)
    found = averaged(Rendering(rgba, depth, np.array([[0, 2], [2, 2]], np.int16)), 2)
    assert (found.region.item(), found.depth.item()) == (2, 7.0)
    rgba[0, 0, 3] = 1.0
    found = averaged(Rendering(rgba, depth, np.array([[0, 2], [2, 1]], np.int16)), 2)
    assert (found.region.item(), found.depth.item()) == (0, 1.0), "of one ray, not of a place between"
    nothing = Rendering(
        np.zeros((2, 2, 4), np.float32), np.full((2, 2), np.nan, np.float32), np.full((2, 2), -1, np.int16)
    )
    assert averaged(nothing, 2).region.item() == -1 and np.isnan(averaged(nothing, 2).depth.item())


def test_images_of_strokes_have_four_rays_a_pixel_and_others_one(balls: Scene, tmp_path: Path) -> None:
    camera = orbit(balls, 8, 60, 40)[0]
    assert samples_for(balls, camera) == 1
    strokes, _ = painted(balls)
    pieces, _ = painted(balls, manner="pieces")
    assert samples_for(strokes, camera) == 2
    assert samples_for(strokes, camera, "pcn") == samples_for(pieces, camera) == 1
    assert samples_for(joined([balls, strokes]), camera) == 2 and samples_for(joined([balls, pieces]), camera) == 1
    assert samples_for(strokes.while_moving(), camera) == 1
    assert samples_for(strokes, camera.resized(3000, 3000)) == 1, "a pixel is a small part of a stroke"
    fine, background = strokes.render(camera.resized(120, 80)), (0.2, 0.4, 0.6)
    found = supersampled(strokes, camera)
    assert found.rgba.shape == (40, 60, 4) and found.depth.shape == found.region.shape == (40, 60)
    shown = over(found.rgba, background)
    assert shown == pytest.approx(over(fine.rgba, background).reshape(40, 2, 60, 2, 3).mean((1, 3)), abs=1e-5)
    behind = supersampled(strokes, camera, None, background).rgba
    assert np.all(behind[..., 3] == 1.0) and behind[..., :3] == pytest.approx(shown, abs=1e-6)
    write_view(tmp_path / "strokes.png", strokes, camera, RenderSettings(background=background))
    assert (
        np.abs(np.asarray(Image.open(tmp_path / "strokes.png").convert("RGB"), np.float32) / 255 - shown).max() < 0.01
    )
    plain = supersampled(strokes, camera, samples=1)
    assert np.array_equal(plain.rgba, strokes.render(camera).rgba)


@pytest.mark.parametrize("samples", [0, -1, 5])
def test_other_numbers_of_rays_are_refused(balls: Scene, samples: int) -> None:
    with pytest.raises(BadInput, match="--supersample must lie between 1 and 4"):
        supersampled(balls, orbit(balls, 8, 30, 20)[0], samples=samples)
