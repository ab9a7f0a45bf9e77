"""Haze is not pruned where pixels show nothing else, however short the steps are."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import orbit_cameras
from svv.fields.radiance.occupancy import FAINTEST, Occupancy, pruned_extinction
from svv.io.views.view_meta import ViewMeta
from svv.io.views.viewset import ViewSet
from svv.train.base.left_out import MISSED, missed, prune_unseen, say_left_out

CELLS = 16
UNIT = Box((-0.5, -0.5, -0.5), 1.0, (1.0, 1.0, 1.0))


def within(radius: float) -> np.ndarray:
    """The cells of a ball in the middle of the box, uint8."""
    middle = (np.indices((CELLS,) * 3) + 0.5) / CELLS - 0.5
    return (np.square(middle).sum(axis=0) < radius**2).astype(np.uint8)


def showing(radius: float) -> ViewSet:
    """Views of a ball of that radius, which is as good as transparent."""
    cameras = orbit_cameras(6, radius=4.0, size=128)
    images = np.zeros((6, 128, 128, 4), np.uint8)
    for image, camera in zip(images, cameras, strict=True):
        across = (np.indices((128, 128)) - 63.5) * camera.pixel_at(4.0)
        image[..., 3] = np.where(np.square(across).sum(axis=0) < radius**2, 5, 0)
    return ViewSet(cameras, images, tuple(f"{k}.png" for k in range(6)), ViewMeta())


@pytest.mark.parametrize(("haze", "left"), [(0.3, 0.45), (0.1, 0.45), (0.05, 0.45)], ids=["haze", "faint", "fainter"])
def test_cells_stay_if_pixels_see_nothing_else(haze: float, left: float) -> None:
    """Haze around a core is kept, however faint."""
    views, occupied = showing(0.45), within(0.45)
    there = Occupancy(UNIT, CELLS, occupied)
    extinction = torch.from_numpy(np.where(within(0.15), 50.0, haze)[occupied > 0].astype(np.float32))
    found = prune_unseen(views, there, extinction, pruned_extinction(0.003, 1.0 / 1024.0), False)
    np.testing.assert_array_equal(found.occupied, within(left))


def test_what_no_pixel_shows_is_pruned() -> None:
    views, occupied = showing(0.15), within(0.45)
    extinction = torch.from_numpy(np.where(within(0.15), 50.0, 0.3)[occupied > 0].astype(np.float32))
    found = prune_unseen(views, Occupancy(UNIT, CELLS, occupied), extinction, 0.7, False)
    np.testing.assert_array_equal(found.occupied, within(0.15))


def test_the_part_that_is_missed() -> None:
    views = showing(0.45)
    assert missed(views, Occupancy(UNIT, CELLS, within(0.6))) == 0.0
    core = missed(views, Occupancy(UNIT, CELLS, within(0.15)))
    assert 0.4 < core <= 1.0 - (0.15 / 0.45) ** 2 and core > MISSED
    empty = replace(views, images=np.zeros_like(views.images))
    assert missed(empty, Occupancy(UNIT, CELLS, within(0.15))) == 0.0


def test_what_is_left_out_is_told() -> None:
    views = showing(0.45)
    hull, core = (Occupancy(UNIT, CELLS, within(radius)) for radius in (0.6, 0.15))
    assert say_left_out(views, hull) == say_left_out(views, core, core) == ""
    assert re.match("; [45][0-9]% of the visible pixels show only haze", say_left_out(views, core, hull))


def test_shorter_steps_do_not_prune_more() -> None:
    steps = [1.0 / n for n in (32, 64, 128, 256, 512, 4096)]
    least = [pruned_extinction(0.003, step) for step in steps]
    assert least == sorted(least) and least[-1] == least[-2] == least[-3] > FAINTEST
