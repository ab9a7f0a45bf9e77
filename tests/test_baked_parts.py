"""Parts of regions in baked volumes: hidden and recoloured as in images."""

from __future__ import annotations

import numpy as np

from svv.options.baking import BakeOptions
from svv.render.baking.baked import Baker
from tests.loose_balls import RIGHT, in_world, loose_balls


def test_a_part_is_hidden_and_recoloured() -> None:
    whole, baker, options = loose_balls(), Baker(), BakeOptions(light="none")
    split = whole.split_at(in_world(RIGHT))
    part = len(split.regions) - 1
    before, same = baker.bake(whole, options), baker.bake(split, options)
    np.testing.assert_array_equal(same.rgba, before.rgba)
    hidden = baker.bake(split.hidden(part), options)
    red = baker.bake(split.edited(part, colour=(1.0, 0.0, 0.0)), options)
    left = before.rgba.shape[2] // 2
    np.testing.assert_array_equal(hidden.rgba[:, :, :left], before.rgba[:, :, :left])
    assert before.rgba[:, :, left:, 3].any() and not hidden.rgba[:, :, left:, 3].any()
    seen = before.rgba[..., 3] > 0
    changed = (red.rgba[..., :3] != before.rgba[..., :3]).any(axis=-1) & seen
    assert not changed[:, :, :left].any()
    assert changed[:, :, left:].sum() > 0.9 * seen[:, :, left:].sum()
