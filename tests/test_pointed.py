"""Regions corrected by pointing at places: pieces move, are divided or become new regions; the rest stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from svv.core.colour.correction import Correction, Point
from svv.dvr.draw.views import make_views
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.fields.scene.splitting import regions_in_cells
from svv.io.views.viewset import ViewSet
from svv.train.correct import correct_palette
from svv.train.palette.pointed import InCells, pointed
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS, ReconstructSettings
from svv_bench.stability.scenes import BLUE, GOLD, KnownScene, Range, ring_and_balls

SHORT = replace(
    PRESETS["draft"], reconstruct=ReconstructSettings(iterations=120, rays=1024, samples=8192, cells=32),
    recolour=replace(PRESETS["draft"].recolour, iterations=120, rays=1024, samples=8192),
)  # fmt: skip

Drawn = tuple[Scene, ViewSet, ViewSet]

RING: Point = (0.6, 0.0, 0.0)
UPPER: Point = (0.0, 0.0, 0.65)
LOWER: Point = (0.0, 0.0, -0.65)
MIDDLE: Point = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    """A gold ring and three blue balls, learned from views alone; the views with their volume come last."""
    known = KnownScene(ring_and_balls, (Range(-0.5, 0.3, 0.9, BLUE), Range(0.7, 1.5, 0.9, GOLD)))
    train, _ = make_views(known.volume(32), known.transfer_function(), n=16, size=80, mapper="cpu")
    alone = replace(train, classified=None)
    return train_scene(alone, SHORT)[0], alone, train


def at(scene: Scene, place: Point) -> int:
    """The region at a place."""
    assert scene.palette_network is not None
    box = torch.tensor(scene.occupancy.box.to_box(np.array(place))[None], dtype=torch.float32)
    return int(scene.palette_network.material(box)[1].argmax())


def cell_at(scene: Scene, place: Point, cells: int) -> tuple[int, ...]:
    return tuple(np.floor(scene.occupancy.box.to_box(np.array(place)) * cells).astype(int))


def test_a_piece_becomes_the_region_that_it_is_said_to_be_and_the_others_stay(drawn: Drawn) -> None:
    scene = drawn[0]
    ring, ball = at(scene, RING), at(scene, UPPER)
    assert {ring, ball} == {0, 1}
    _, before, opacity = regions_in_cells(scene)
    found = pointed(scene, ((UPPER, ring),), ())
    assert found.region[cell_at(scene, UPPER, found.cells)] == ring
    for place, own in ((LOWER, ball), (MIDDLE, ball), (RING, ring)):
        assert found.region[cell_at(scene, place, found.cells)] == own
    moved = opacity[(found.region != before)].sum() / opacity[before == ball].sum()
    assert 0.2 < moved < 0.5  # one of three balls
    assert (found.region[before == ring] == ring).all()
    assert found.added is None and len(found.said) == 1


def test_points_that_differ_divide_a_piece_between_them(drawn: Drawn) -> None:
    """Two sides of the ring, which is of one piece: each side of it goes to its point."""
    scene = drawn[0]
    ring, ball = at(scene, RING), at(scene, UPPER)
    found = pointed(scene, ((RING, ring), ((-0.6, 0.0, 0.0), ball)), ())
    _, before, opacity = regions_in_cells(scene)
    middle = np.argwhere(before == ring)
    x = scene.occupancy.box.low[0] + (middle[:, 0] + 0.5) / found.cells * scene.occupancy.box.size
    to_ball, weight = found.region[before == ring] == ball, opacity[before == ring]
    for side, share in ((x < -0.4, 1.0), (x > 0.4, 0.0)):
        assert np.average(to_ball[side], weights=weight[side]) == pytest.approx(share, abs=0.1)


def test_the_number_after_the_last_is_a_new_region_in_the_colour_that_is_there(drawn: Drawn) -> None:
    scene = drawn[0]
    ball = at(scene, UPPER)
    found = pointed(scene, ((UPPER, 2),), ())
    assert found.region[cell_at(scene, UPPER, found.cells)] == 2
    assert found.added == pytest.approx(scene.regions[ball].colour, abs=0.15)


def test_what_was_pointed_at_is_trained_and_the_rest_looks_as_before(drawn: Drawn) -> None:
    scene, alone, _ = drawn
    ring, ball = at(scene, RING), at(scene, UPPER)
    named = scene.edited(ring, name="ring")
    found, report = correct_palette(named, alone, Correction(points=((UPPER, ring),)), SHORT)
    assert [at(found, place) for place in (UPPER, LOWER, MIDDLE, RING)] == [ring, ball, ball, ring]
    assert found.regions[ring].name == "ring" and len(found.regions) == 2
    assert any("is now region" in note for note in report["notes"])
    camera = alone.cameras[0]
    before, after = (s.render(camera, "pcn").rgba for s in (scene, found))
    assert float(np.abs(before[..., :3] - after[..., :3]).mean()) < 0.03
    both, _ = correct_palette(found, alone, Correction(same=((RING, LOWER),)), SHORT)
    assert len(both.regions) == 1
    three, _ = correct_palette(scene, alone, Correction(points=((UPPER, 2),)), SHORT)
    assert len(three.regions) == 3 and at(three, UPPER) == 2 and at(three, LOWER) == at(three, MIDDLE) != 2


def test_cells_without_a_region_have_that_of_the_nearest() -> None:
    region = np.full((4, 1, 1), -1)
    region[0], region[3] = 1, 0
    owners = InCells(region, 4, torch.device("cpu"))
    points = torch.tensor([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1], [0.6, 0.1, 0.1], [1.0, 0.1, 0.1]])
    assert owners.of(points).tolist() == [1, 1, 0, 0]
    weights = torch.tensor([[0.2, 0.8]]).expand(4, 2)
    assert owners.assign(weights, points)[1].tolist() == pytest.approx([0.8, 0.8, 0.2, 0.2])


@pytest.mark.parametrize(
    ("points", "same", "said"),
    [
        (((5.0, 0.0, 0.0),), (), "There is nothing at 5, 0, 0"),
        (((float("nan"), 0.0, 0.0),), (), "There is nothing at nan"),
        ((), (((9.0, 9.0, 9.0), RING),), "There is nothing at 9, 9, 9"),
        ((), ((UPPER, LOWER),), "Both places are region"),
    ],
)
def test_places_where_nothing_can_be_done_are_refused(
    drawn: Drawn, points: tuple[Point, ...], same: tuple[tuple[Point, Point], ...], said: str
) -> None:
    with pytest.raises(BadInput, match=said):
        pointed(drawn[0], tuple((place, 0) for place in points), same)


def test_contradictions_and_what_leaves_nothing_are_refused(drawn: Drawn) -> None:
    scene, alone, with_volume = drawn
    ring, ball = at(scene, RING), at(scene, UPPER)
    with pytest.raises(BadInput, match="contradict each other"):
        pointed(scene, ((RING, 0), (RING, 1)), ())
    with pytest.raises(BadInput, match="have these regions already"):
        pointed(scene, ((RING, ring), (UPPER, ball)), ())
    with pytest.raises(BadInput, match=f"Nothing would be left of region {ring}"):
        pointed(scene, ((RING, ball),), ())
    with pytest.raises(BadInput, match="There is no region 3: the scene has the regions 0 to 1, and 2 would be new"):
        pointed(scene, ((RING, 3),), ())
    split = scene.split_at(UPPER)
    with pytest.raises(BadInput, match="has parts of regions"):
        pointed(split, ((RING, ball),), ())
    point = Correction(points=((UPPER, ring),))
    with pytest.raises(BadInput, match="in a second correction"):
        correct_palette(scene, alone, replace(point, remove=(0,)), SHORT)
    valued = replace(scene, regions=tuple(replace(r, values=(0.0, 1.0)) for r in scene.regions))
    with pytest.raises(BadInput, match="give --views-only"):
        correct_palette(valued, with_volume, point, SHORT)
