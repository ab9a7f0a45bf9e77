"""Fog without surfaces is painted as a wash: as dark as it is dense, without flecks or holes, as clear as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from skimage.color import rgb2lab

from svv.fields.radiance.rendering import Marching
from svv.fields.scene.scene import Scene
from svv.styles.gallery import gallery_picture
from svv.styles.hand import measure_hand
from svv.train.paint.fog import sky_of
from svv.train.pipeline import stylize_scene
from svv.train.run.config import StylizeSettings
from svv.train.run.report import Report
from tests.balls import SHORT
from tests.solid_ball import CELLS, RADIUS, solid_ball

QUICK = replace(SHORT, stylize=StylizeSettings(style_views=5, style_size=64))
PLACES, SIZES, SHARES = ((0.40, 0.56, 0.5), (0.66, 0.40, 0.5)), (0.10, 0.07), (1.0, 0.5)
"""Two clouds in a haze: their middles, deviations, and shares of the densest extinction."""


def cloudy(densest: float = 8.0, haze: float = 0.06) -> Scene:
    """Fog in a ball; ``densest``: extinction in the middle of the denser cloud, ``haze``: that between, relative."""
    scene = replace(solid_ball(0.0), marching=Marching(1 / 128))
    density = scene.base.density
    assert density is not None
    place = density.places_of_level(1, scene.occupancy.occupied, CELLS)
    clouds = zip(PLACES, SIZES, SHARES, strict=True)
    amount = haze + sum(share * np.exp(-np.square(place - p).sum(1) / (2.0 * s**2)) for p, s, share in clouds)
    outside = np.maximum(np.linalg.norm(place - 0.5, axis=1) - RADIUS, 0.0)
    logarithm = np.log(densest * amount) - 4.0 * CELLS * outside
    with torch.no_grad():
        rows = density.rows_of_level(1)
        density.table[rows] = torch.from_numpy(logarithm.astype(np.float32))[:, None]
    return scene


def painted(scene: Scene, style: str) -> tuple[Scene, Report]:
    return stylize_scene(scene, [gallery_picture(style, 200)], QUICK, manner="strokes", stroke_size=1.5)


def seen(scene: Scene) -> np.ndarray:
    return np.asarray(scene.render(scene.rig.orbit(9, 96, [2])[0]).rgba, np.float64)


def thickness(image: np.ndarray) -> np.ndarray:
    return np.asarray(-np.log(1.0 - image[..., 3].clip(0.0, 0.999)))


@pytest.fixture(scope="module")
def fog() -> Scene:
    return cloudy()


@pytest.fixture(scope="module", params=["oil", pytest.param("woodcut", marks=pytest.mark.slow)])
def wash(request: pytest.FixtureRequest, fog: Scene) -> Scene:
    scene, report = painted(fog, request.param)
    assert (
        "Region 0 is a fog without surfaces: it gets a wash in the picture's sky, darker where it is denser."
        in (report["notes"])
    )
    return scene


def test_fog_is_darker_where_it_is_denser(fog: Scene, wash: Scene) -> None:
    """Along every ray, and as strongly as a picture's sky has tones: what was one colour now shows the clouds."""
    image = seen(wash)
    there = image[..., 3] > 0.1
    light = rgb2lab(image[..., :3])[..., 0][there]
    thick = thickness(image)[there]
    assert np.corrcoef(light, thick)[0, 1] < -0.8
    assert light[thick < np.quantile(thick, 0.3)].mean() > light[thick > np.quantile(thick, 0.97)].mean() + 20.0


def test_a_wash_is_as_clear_as_the_fog(fog: Scene, wash: Scene) -> None:
    np.testing.assert_array_equal(seen(wash)[..., 3], seen(fog)[..., 3])


def test_a_wash_has_neither_flecks_nor_holes(wash: Scene) -> None:
    """Lightness changes as smoothly as the density: hardly anywhere does a pixel differ from the four around it."""
    image = seen(wash)
    there = image[..., 3] > 0.1
    light = rgb2lab(image[..., :3])[..., 0]
    middle = there[1:-1, 1:-1] & there[2:, 1:-1] & there[:-2, 1:-1] & there[1:-1, 2:] & there[1:-1, :-2]
    rough = light[1:-1, 1:-1] - 0.25 * (light[2:, 1:-1] + light[:-2, 1:-1] + light[1:-1, 2:] + light[1:-1, :-2])
    assert np.quantile(np.abs(rough[middle]), 0.99) < 4.0 and np.abs(rough[middle]).max() < 10.0


def test_the_sky_is_the_upper_half_of_a_picture_and_a_part_is_what_it_is() -> None:
    picture = np.random.default_rng(0).uniform(0.0, 0.15, (120, 90, 3)).astype(np.float32)
    picture[:60] += (0.1, 0.3, 0.8)
    hand = measure_hand(picture)
    sky = sky_of(hand)
    assert 0.3 < len(sky.colours) / len(hand.colours) < 0.7
    assert sky.colours[:, 2].max() < hand.colours[:, 2].mean()  # all of it is blue
    ground = hand.within(np.arange(120)[:, None].repeat(90, 1) >= 60)
    assert sky_of(ground) is ground
