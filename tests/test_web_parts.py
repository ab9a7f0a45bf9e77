"""Parts of regions in pages: they are regions with weights and colours of their own."""

from __future__ import annotations

import numpy as np

from svv.render.web.fields import Field, fields_of
from tests.loose_balls import RIGHT, in_world, loose_balls


def named(fields: list[Field], name: str) -> np.ndarray:
    return next(field for field in fields if field.name == name).values()


def test_a_part_has_its_own_weight_and_colour() -> None:
    whole = loose_balls()
    split = whole.split_at(in_world(RIGHT))
    before, after = (fields_of(scene)[0] for scene in (whole, split))
    old, new = named(before, "weights"), named(after, "weights")
    assert (old.shape[1], new.shape[1]) == (2, 3)
    np.testing.assert_allclose(new[:, 0] + new[:, 2], old[:, 0], atol=1 / 60)
    assert 0.3 < (new[:, 2] > 0.25).mean() < 0.7, "one of two equal balls"
    assert (np.minimum(new[:, 0], new[:, 2]) == 0.0).all()
    old, new = (named(fields, "material")[:, 1:].reshape(len(old), -1, 3) for fields in (before, after))
    own = named(after, "weights")[:, 2] > 0.25
    np.testing.assert_allclose(new[own, 2], old[own, 0], atol=0.05)
