"""Regions that cannot carry strokes: an even wash, and a note that says so; small and crumpled bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.errors import silent
from svv.fields.scene.scene import Scene
from svv.fields.strokes.stroke_paint import StrokePaint
from svv.options.making import HandName
from svv.styles.gallery import gallery_picture
from svv.styles.hand import measure_hand
from svv.train.paint.brushwork import Painter
from svv.train.paint.stroke_painting import glaze_of
from tests.nightly import nightly
from tests.test_brushing import BROAD, EMPTY, WIDTH, ball, painted


def test_a_region_without_room_for_strokes_is_washed_and_named(
    balls: Scene,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("svv.train.paint.stroke_painting.Painter.painted", lambda self, progress: None)
    scene, report = painted(balls, stroke_size=BROAD)
    assert scene.styled is not None and scene.styled.brushed is not None and not scene.styled.brushed.regions
    said = "Region 0 has no room for strokes: it gets an even wash in the colour of the picture's sky."
    assert said in report["notes"]


@pytest.mark.parametrize("technique", ["watercolour", "ink-wash"])
@pytest.mark.parametrize("radius", nightly([0.8, 1.5, 3.0], 0.8))
def test_washes_cover_bodies_that_are_smaller_than_their_strokes(technique: HandName, radius: float) -> None:
    hand = replace(measure_hand(gallery_picture("watercolour", 300)), technique=technique)
    painter = Painter(hand, ball(radius * WIDTH), EMPTY, 64, WIDTH, 0.004, 0)
    work = painter.painted(silent)
    assert work is not None
    covered = StrokePaint(work.strokes, work.brush, 0.1 * WIDTH).coverage(painter.surface.points)[:, 3] > 0.05
    dark = painter.tone < painter.technique.layers[0].lightest - 0.05
    assert covered[dark].mean() > 0.95


@pytest.mark.parametrize("reach", [0.001, 0.02, 0.2, 3.0])
def test_what_is_around_a_point_counts_whichever_way_it_faces(reach: float) -> None:
    found = ball(0.2)
    assert found.spread(np.full(len(found), 0.7), reach) == pytest.approx(0.7)
    side = (found.points[:, 0] > 0.5).astype(np.float64)
    mean = found.spread(side, reach)
    assert mean.min() >= -1e-6 and mean.max() <= 1.0 + 1e-6
    far = np.abs(found.points[:, 0] - 0.5) > 0.15
    assert np.abs(mean - side)[far].max() < (0.01 if reach < 0.03 else 1.0)
    if reach == 3.0:
        assert mean == pytest.approx(side.mean(), abs=0.02)


PARTS = st.floats(0.0, 1.0)


@given(dry=st.booleans(), clear=PARTS, deep=st.floats(0.0, 3.0), crumpled=PARTS, more=PARTS)
def test_opacity_follows_strokes_less_where_form_is_crumpled_deep_or_opaque(
    dry: bool, clear: float, deep: float, crumpled: float, more: float
) -> None:
    found = glaze_of(dry, clear, deep, crumpled)
    assert 0.0 <= found <= 1.0
    assert found >= glaze_of(dry, clear * more, deep, crumpled)
    assert found >= glaze_of(dry, clear, deep + more, crumpled)
    assert found >= glaze_of(dry, clear, deep, crumpled + (1.0 - crumpled) * more)
    assert glaze_of(dry, 0.0, deep, crumpled) == 0.0
    assert glaze_of(dry, clear, deep, 1.0) == 0.0
