"""Regions that cannot carry strokes get an even wash, and a note says so."""

from __future__ import annotations

import pytest

from svv.fields.scene.scene import Scene
from tests.test_brushing import BROAD, painted


def test_a_region_without_room_for_strokes_is_washed_and_named(
    balls: Scene,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("svv.train.paint.stroke_painting.Painter.painted", lambda self, progress: None)
    scene, report = painted(balls, stroke_size=BROAD)
    assert scene.styled is not None and scene.styled.brushed is not None and not scene.styled.brushed.regions
    said = "Region 0 has no room for strokes: it gets an even wash in the colour of the picture's sky."
    assert said in report["notes"]
