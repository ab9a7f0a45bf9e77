"""The generated scenes by which the confidence of regions is measured: ``python -m campaign.doubtful_regions``."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from campaign.doubtful_regions import known_scene, regions_of_scene


@pytest.mark.parametrize("seed", range(12))
def test_a_seed_is_a_scene_of_ranges_that_are_apart_and_there(seed: int) -> None:
    one, again = known_scene(seed), known_scene(seed)
    assert one.ranges == again.ranges and 2 <= len(one.ranges) <= 5
    assert all(lower.high < upper.low for lower, upper in pairwise(one.ranges))
    axis = np.linspace(-1.0, 1.0, 24)
    point = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"))
    values = one.field(point)
    np.testing.assert_array_equal(values, again.field(point))
    assert np.isfinite(values).all()
    assert len(set(one.classes(values).ravel()) - {-1}) >= 2


@pytest.mark.slow
def test_confidence_is_about_right_in_scenes_that_it_was_not_fitted_to() -> None:
    rows = [regions_of_scene(seed)[0] for seed in (4, 7, 15, 29, 77)]
    told, true = (np.concatenate([row[name] for row in rows]) for name in ("told", "true"))
    assert np.abs(told - true).mean() < 0.15
    assert true[told > 0.9].min() > 0.6
