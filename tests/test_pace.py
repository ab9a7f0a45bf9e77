"""The size of pictures while a camera moves, and the scene as it is drawn then."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from svv.core.colour.colour import WHITE, over
from svv.core.frame_rate import AIM, SMALLEST, STEADY, Pace
from svv.core.geometry.cameras import Camera
from svv.fields.scene.images import MOVING_JOINED
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.render.frames import orbit
from tests.cube import cube_scene, faint, lit_cube_scene


@given(st.floats(1e-4, 1e3))
def test_pictures_whose_time_grows_with_their_pixels_soon_take_what_is_aimed_at(whole: float) -> None:
    pace = Pace()
    for _ in range(3):
        pace.took(whole * pace.part**2)
    taken = whole * pace.part**2
    if pace.part == 1.0:
        assert taken <= AIM * (1 + STEADY) ** 2
    elif pace.part == SMALLEST:
        assert taken >= AIM / (1 + STEADY) ** 2
    else:
        assert AIM / (1 + STEADY) ** 2 <= taken <= AIM / (1 - STEADY) ** 2


@given(st.lists(st.floats(AIM * 0.85, AIM * 1.15), max_size=20))
def test_its_size_does_not_flicker(seconds: list[float]) -> None:
    pace = Pace()
    before = pace.part
    for taken in seconds:
        pace.took(taken)
    assert pace.part == before


@given(st.lists(st.floats(0.0, 1e9), max_size=20))
def test_its_size_stays_in_its_range_whatever_a_picture_takes(seconds: list[float]) -> None:
    pace = Pace()
    for taken in seconds:
        pace.took(taken)
        assert SMALLEST <= pace.part <= 1.0


def drawn(scene: Scene, camera: Camera) -> np.ndarray:
    return over(scene.render(camera).rgba, WHITE)


def samples_of(scene: Scene, camera: Camera) -> int:
    return len(scene.visible_samples(scene.caster([camera]).view(0), scene.networks[-1]))


def test_a_moving_scene_has_fewer_samples_and_looks_the_same() -> None:
    fog = faint(cube_scene())
    camera = orbit(fog, 9, 96, 96)[2]
    still, moving = drawn(fog, camera), drawn(fog.while_moving(), camera)
    assert samples_of(fog.while_moving(), camera) < samples_of(fog, camera)
    small = drawn(fog, camera.resized(48, 48)).repeat(2, axis=0).repeat(2, axis=1)
    assert 0.0 < np.abs(moving - still).mean() < np.abs(small - still).mean()


def test_every_function_of_a_joined_scene_moves() -> None:
    first, second = cube_scene(), faint(lit_cube_scene())
    both = joined([first, second]).while_moving()
    assert [one.joined for one in (both, *both.layers)] == [MOVING_JOINED] * 2
