"""Places that commands name: pixels of a picture, and points in the world."""

from __future__ import annotations

import pytest

from svv.cli.pointing import PictureOptions, parse_pointed, point_in
from svv.errors import BadInput
from tests.cube import cube_scene


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("410,320=2", ((410.0, 320.0), 2)),
        ("0.5, -1, 2e-3 = 0", ((0.5, -1.0, 0.002), 0)),
        ("1,2=3,4", ((1.0, 2.0), (3.0, 4.0))),
        ("1,2=3,4,5", ((1.0, 2.0), (3.0, 4.0, 5.0))),
    ],
)
def test_a_place_is_a_region_or_one_with_another_place(text: str, meant: object) -> None:
    assert parse_pointed(text) == meant


@pytest.mark.parametrize("text", ["", "1,2", "1=2", "1,2=", "=1", "1,2=bone", "1,2,3,4=0", "1,2=-1", "1;2=0"])
def test_what_points_nowhere_is_refused(text: str) -> None:
    with pytest.raises(BadInput, match="does not point at a place: write place=region"):
        parse_pointed(text)


def test_a_pixel_is_what_it_shows_and_a_point_is_itself() -> None:
    scene = cube_scene()
    assert point_in(scene, (1.0, 2.0, 3.0), PictureOptions()) == (1.0, 2.0, 3.0)
    middle = point_in(scene, (32.0, 32.0), PictureOptions(size=(64, 64)))
    low, high = scene.occupancy.box.bounds
    assert all(a <= m <= b for a, m, b in zip(low, middle, high, strict=True))
    with pytest.raises(BadInput, match="two numbers, not three"):
        point_in(scene, (1.0, 2.0, 3.0), PictureOptions(size=(64, 64)))
    with pytest.raises(BadInput, match="outside the picture"):
        point_in(scene, (64.0, 0.0), PictureOptions(size=(64, 64)))
