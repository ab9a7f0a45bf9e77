"""Regions of one painting as they are rendered: kept apart, told where they are not, and moved apart by an edit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from svv.core.colour.colour_vision import COLOUR_VISIONS, LEAST_DIFFERENCE
from svv.errors import BadInput, silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.fields.scene.seen_colours import look_alikes, pairs_of, seen_in
from svv.fields.strokes.stored_strokes import Brushed
from svv.render.distinct import distinct
from svv.styles.gallery import gallery_picture
from svv.train.paint.ink import StyleInput
from svv.train.paint.legibility import notes_on
from svv.train.paint.painting import owners_of, painted_field
from svv.train.paint.pairing import glimpse_of
from svv.train.paint.pieces_apart import keep_pieces_apart
from svv.train.pipeline import stylize_scene
from tests.balls import SHORT

BROAD = 2.0  # painting takes a third of the time


def painted(scene: Scene, name: str, **how: object) -> Scene:
    return stylize_scene(scene, [StyleInput(gallery_picture(name, 300), name)], SHORT, **how)[0]


def apart(scene: Scene, network: str | None = None) -> float:
    return pairs_of(list(seen_in(scene, network).values()), ("normal",))[0].difference


@pytest.fixture(scope="module")
def strokes(balls: Scene) -> Scene:
    """Balls painted by strokes with the whole of one picture."""
    return painted(balls, "oil", divide="no", stroke_size=BROAD)


@pytest.fixture(scope="module")
def similar(strokes: Scene) -> Scene:
    """The same, with the same colours on both, as nobody's painting would be any more."""
    paint = strokes.styled
    assert paint is not None and paint.brushed is not None
    same = [(0.35, 0.4, 0.5), (0.45, 0.5, 0.6)]
    return strokes.with_strokes(palette=same)


def test_a_whole_picture_on_two_regions_is_legible_as_well(balls: Scene, strokes: Scene) -> None:
    assert apart(strokes) >= min(LEAST_DIFFERENCE, apart(balls, "pcn"))
    assert notes_on(strokes) == [] and look_alikes(strokes) == []


def test_pieces_are_kept_apart(balls: Scene) -> None:
    whole = painted(balls, "mosaic", divide="no", manner="pieces")
    assert whole.styled is not None and not isinstance(whole.styled.brushed, Brushed)
    assert apart(whole) >= min(LEAST_DIFFERENCE, apart(balls, "pcn"))


def test_other_paint_does_not_move_with_pieces(balls: Scene) -> None:
    field = painted_field(balls, 1.0 / balls.occupancy.cells)
    lattice = field.encoding
    assert isinstance(lattice, SparseLattice)
    lattice.table.data.fill_(0.5)
    picture, flats = gallery_picture("mosaic", 100), torch.full((2, 3), 0.5)
    keep_pieces_apart(balls, field, {1: picture}, [0, 1], flats, silent)
    owner, table = owners_of(balls, field.resolutions[-1], [0, 1]), lattice.table.detach().numpy()
    assert (table[owner == 0] == 0.5).all() and (owner == 0).any()
    assert np.abs(table[owner == 1] - 0.5).min() > 0.02


def test_strokes_that_look_alike_are_told_and_moved_apart_by_one_edit(balls: Scene, similar: Scene) -> None:
    assert apart(similar) < LEAST_DIFFERENCE <= apart(balls, "pcn")
    (said,) = notes_on(similar)
    assert "hard to tell apart" in said and "--distinct" in said
    found = distinct(similar)
    assert found.nearest is not None and found.nearest.difference >= LEAST_DIFFERENCE
    seen = list(seen_in(found.scene).values())
    assert min(pair.difference for pair in pairs_of(seen, COLOUR_VISIONS)) >= LEAST_DIFFERENCE
    assert found.scene.undone().regions == similar.regions
    for before, after in zip(similar.regions, found.scene.regions, strict=True):
        assert before.edited_colour == after.edited_colour and before.style == after.style


def test_hidden_regions_are_no_look_alikes(similar: Scene) -> None:
    assert notes_on(similar.hidden(1)) == []


def test_every_member_of_a_joined_scene_is_seen(balls: Scene, similar: Scene) -> None:
    both = joined([balls, balls.edited(0, colour=(0.1, 0.8, 0.3))])
    found = glimpse_of(both)
    assert len(found.seen) == 2 * len(balls.regions) and (found.seen > 0.0).all()
    assert found.seen.sum() == pytest.approx(1.0) and (np.diag(found.together) == 1.0).all()
    alone = glimpse_of(balls)
    count = len(balls.regions)
    assert found.seen[:count] == pytest.approx(0.5 * alone.seen)
    assert (found.encloses[:count, :count] == alone.encloses).all() and not found.encloses[:count, count:].any()


def test_strokes_of_a_joined_scene_are_not_moved_without_a_word(similar: Scene) -> None:
    both = joined([similar, replace(similar)])
    with pytest.raises(BadInput, match="strokes of a joined scene"):
        distinct(both)
    assert all("--distinct" not in said for said in notes_on(both))
