"""Strokes on surfaces: they follow the form, stay on it, and a scene painted with them has its picture's tone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from skimage.color import rgb2lab

from svv.core.strokes.strokes import Brush, straight_stroke
from svv.errors import BadInput, silent
from svv.fields.radiance.encodings import places_of
from svv.fields.scene.scene import Scene
from svv.fields.strokes.stored_strokes import NOBODY, Brushed
from svv.styles.gallery import gallery_picture
from svv.styles.hand import Hand, measure_hand
from svv.train.paint import tracing_kernels as numba_tracing
from svv.train.paint.brushwork import NARROWEST, WIDEST, Painter
from svv.train.paint.ink import Ink, StyleInput
from svv.train.paint.painting import owners_at, owners_of
from svv.train.paint.picture_map import PictureMap
from svv.train.paint.stroke_painting import stroke_width
from svv.train.paint.toning import retoned
from svv.train.paint.visible_surface import BENT, VisibleSurface, surface_of
from svv.train.pipeline import stylize_scene
from svv.train.run.report import Report
from tests.balls import SHORT

UP, WIDTH = np.array([0.0, 1.0, 0.0]), 0.03
EMPTY = np.zeros((64, 64, 64), np.float32)
BROAD = 2.0  # painting takes a third of the time


def surface(points: np.ndarray, normals: np.ndarray, side: float = 0.4 * WIDTH) -> VisibleSurface:
    """An opaque surface through at most one of the points in each cube."""
    cube = np.floor(points / side).astype(np.int64)
    _, first = np.unique(cube, axis=0, return_index=True)
    ones = np.ones(len(first))
    return surface_of(points[first], normals[first], 0.1 * WIDTH * ones, ones, ones, side, UP)


def plane(low: float = 0.2, high: float = 0.8) -> VisibleSurface:
    x, y = np.meshgrid(np.linspace(low, high, 120), np.linspace(low, high, 120))
    points = np.stack([x, y, np.full_like(x, 0.5)], -1).reshape(-1, 3)
    return surface(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)))


def tube(radius: float = 0.12, axis: int = 0) -> VisibleSurface:
    angle, along = np.meshgrid(np.linspace(0, 2 * np.pi, 240), np.linspace(0.2, 0.8, 160))
    normal = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], -1)
    points = 0.5 + radius * normal
    points[..., 0] = along
    points, normal = (np.roll(a.reshape(-1, 3), axis, axis=1) for a in (points, normal))
    return surface(points, normal)


def ball(radius: float = 0.2) -> VisibleSurface:
    normal = np.random.default_rng(0).normal(size=(60_000, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return surface(0.5 + radius * normal, normal)


@pytest.fixture(scope="module")
def hand() -> Hand:
    return measure_hand(gallery_picture("oil", 300))


# --- surfaces --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.08, 0.15])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_tube_bends_by_its_radius_across_and_not_along(radius: float, axis: int) -> None:
    found = tube(radius, axis)
    bends = found.bends(BENT * WIDTH)
    inside = np.abs(found.points[:, axis] - 0.5) < 0.2
    assert bends.strongest[inside] == pytest.approx(1.0 / radius, rel=0.2)
    assert bends.weakest[inside].max() < 0.15 / radius
    assert (bends.mean[inside] > 0.0).all()
    assert np.abs(bends.axis[inside, axis]).min() > 0.97


def test_a_ball_bends_equally_in_all_directions_and_from_inside_the_other_way() -> None:
    found = ball()
    bends = found.bends(BENT * WIDTH)
    assert bends.mean == pytest.approx(5.0, rel=0.15)
    assert (bends.strongest - bends.weakest).max() < 1.0
    inside = surface(found.points.astype(np.float64), -found.normals.astype(np.float64))
    assert inside.bends(BENT * WIDTH).mean == pytest.approx(-5.0, rel=0.15)


def test_thickness_is_the_distance_of_the_other_side() -> None:
    one, gap = plane(), 0.05
    points = np.concatenate([one.points, one.points - np.array([0.0, 0.0, gap], np.float32)]).astype(np.float64)
    normals = np.concatenate([one.normals, -one.normals]).astype(np.float64)
    assert surface(points, normals).thickness(0.1) == pytest.approx(gap, abs=1e-4)
    assert plane().thickness(0.1) == pytest.approx(0.1)


def test_tones_are_evenly_distributed_and_lighter_towards_the_light() -> None:
    found = ball()
    tone = found.tones(EMPTY, 64, WIDTH, np.full(len(found), 5.0))
    assert np.sort(tone) == pytest.approx((np.arange(len(tone)) + 0.5) / len(tone), abs=1e-3)
    sun = found.normals @ np.array([-0.447, 0.744, 0.496])
    assert tone[sun > 0.9].mean() > 0.85 > tone[np.abs(sun) < 0.1].mean() + 0.4
    assert tone[sun < -0.9].mean() < tone[sun > 0.9].mean() - 0.2


def test_a_shadow_is_darker() -> None:
    found = plane()
    wall = EMPTY.copy()
    wall[10:14, 10:54, 33:60] = 1.0  # to the left of the plane, between it and the light
    tone = found.tones(wall, 64, WIDTH, np.zeros(len(found)))
    assert tone[found.points[:, 0] < 0.3].mean() < tone[found.points[:, 0] > 0.6].mean() - 0.3


def test_averages_of_a_constant_are_constant_and_opposite_sides_do_not_mix() -> None:
    found = ball()
    assert found.average(np.full((len(found), 2), 3.0), 3) == pytest.approx(3.0)
    points = np.concatenate([plane().points, plane().points - np.array([0, 0, 0.02], np.float32)]).astype(np.float64)
    both = surface(points, np.concatenate([plane().normals, -plane().normals]).astype(np.float64))
    side = both.normals[:, 2].astype(np.float64)
    assert both.average(side) == pytest.approx(side)


# --- strokes on them -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_strokes_run_along_a_tube(axis: int, hand: Hand) -> None:
    found = tube(0.06, axis)
    painter = Painter(hand, found, EMPTY, 64, WIDTH, 0.004, 0)
    inside = np.abs(found.points[:, axis] - 0.5) < 0.2
    assert np.quantile(np.abs(painter.tangent[inside, axis]), 0.05) > 0.9


def test_directions_are_tangents_and_smooth_even_where_the_form_has_none(hand: Hand) -> None:
    """A ball has umbilics everywhere; the picture's flow must not break up there."""
    found = ball()
    mapped = PictureMap(hand, found, np.linspace(0, 1, len(found)), WIDTH, np.random.default_rng(0))
    tangent = mapped.flow(found.bends(BENT * WIDTH))
    assert np.abs((tangent * found.normals).sum(1)).max() < 1e-4
    near = found.tree.query(found.points, 2)[1][:, 1]
    aligned = np.abs((tangent * tangent[near]).sum(1))
    assert np.quantile(aligned, 0.1) > 0.9


def test_places_in_the_picture_are_inside_it(hand: Hand) -> None:
    found = ball()
    mapped = PictureMap(hand, found, np.linspace(0, 1, len(found)), WIDTH, np.random.default_rng(0))
    place = mapped.places(found.points, mapped.tree.query(found.points)[1])
    assert (place >= 0.0).all() and (place <= mapped.span + 1e-9).all()


def test_seeds_keep_their_distance_and_leave_no_room_for_another() -> None:
    found = plane()
    tangent = np.tile(np.array([[1.0, 0.0, 0.0]], np.float32), (len(found), 1))
    along, across = np.full(len(found), 0.08), np.full(len(found), 0.02)
    kept = np.empty(len(found), np.int64)
    order = np.random.default_rng(1).permutation(len(found))
    grid = found.points, found.normals
    count = numba_tracing.seeds(order, *grid, tangent, along, across, 0.08, kept)
    away = (found.points[:, None] - found.points[kept[:count]][None]) / np.array([0.08, 0.02, 0.02])
    distance = np.linalg.norm(away, axis=2)
    among = distance[kept[:count]]
    assert np.sort(among, axis=1)[:, 1].min() >= 1.0 - 1e-5
    assert distance.min(1).max() < 1.0 + 1e-5


def test_strokes_lie_on_the_surface_and_end_at_its_rim(hand: Hand) -> None:
    work = Painter(hand, plane(), EMPTY, 64, WIDTH, 0.004, 0).painted(silent)
    assert work is not None
    assert np.abs(work.strokes.where[:, 2] - 0.5).max() < 1e-3
    assert work.strokes.where[:, :2].min() > 0.2 - 1.5 * WIDTH and work.strokes.where[:, :2].max() < 0.8 + 1.5 * WIDTH
    around = Painter(hand, ball(), EMPTY, 64, WIDTH, 0.004, 0).painted(silent)
    assert around is not None
    assert np.linalg.norm(around.strokes.where - 0.5, axis=1) == pytest.approx(0.2, abs=0.15 * WIDTH)


def test_thin_bodies_get_thin_strokes(hand: Hand) -> None:
    thin, thick = (Painter(hand, tube(r), EMPTY, 64, WIDTH, 0.004, 0).size for r in (0.02, 0.2))
    assert np.median(thin) < 0.8 < np.median(thick)
    for size in (thin, thick):
        assert size.min() >= NARROWEST - 1e-6 and size.max() <= WIDEST + 1e-6


def test_colours_are_the_pictures_and_darker_where_the_form_is(hand: Hand) -> None:
    found = ball()
    painter = Painter(hand, found, EMPTY, 64, WIDTH, 0.004, 0)
    work = painter.painted(silent)
    assert work is not None
    light = rgb2lab(work.strokes.colour)[:, 0]
    middle = work.strokes.where[work.strokes.start[:-1]]
    tone = painter.tone[found.tree.query(middle)[1]]
    assert np.corrcoef(light, tone)[0, 1] > 0.6
    assert light.min() >= hand.colours[:, 0].min() - 1.0 and light.max() <= hand.colours[:, 0].max() + 1.0


def test_the_same_seed_lays_the_same_strokes_and_another_one_does_not(hand: Hand) -> None:
    one, two, other = (Painter(hand, plane(), EMPTY, 64, WIDTH, 0.004, s).painted(silent) for s in (3, 3, 4))
    assert one is not None and two is not None and other is not None
    assert all(np.array_equal(a, b) for a, b in zip(one.strokes.packed().values(), two.strokes.packed().values()))
    assert len(one.strokes.where) != len(other.strokes.where) or (one.strokes.where != other.strokes.where).any()


# --- tone ------------------------------------------------------------------------------------------------------------


def test_retoning_changes_lightness_as_asked_and_not_hue() -> None:
    stroke = straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.05, (0.4, 0.3, 0.25))
    lab, brighter = (rgb2lab(s.colour)[0] for s in (stroke, retoned(stroke, 1.0, 1.0, 12.0)))
    assert brighter[0] == pytest.approx(lab[0] + 12.0, abs=0.3)
    assert brighter[1:] == pytest.approx(lab[1:], abs=0.5)
    assert rgb2lab(retoned(stroke, 1.3, 1.0, 0.0).colour)[0] == pytest.approx(lab, abs=0.3)  # it is its own mean


# --- scenes ----------------------------------------------------------------------------------------------------------


def painted(scene: Scene, names: tuple[str, ...] = ("oil",), **options) -> tuple[Scene, Report]:
    styles = [StyleInput(gallery_picture(name, 300), name) for name in names]
    return stylize_scene(scene, styles, SHORT, **options)


def lightness(scene: Scene, size: int = 200) -> tuple[float, float]:
    """Mean and deviation of the lightness of what an image shows, without light."""
    flat = replace(scene, regions=tuple(replace(r, lighting=0.0) for r in scene.regions))
    image = flat.render(scene.rig.orbit(9, size, [4])[0], "styled").rgba
    light = rgb2lab(image[image[..., 3] > 0.9][:, :3])[:, 0]
    return float(light.mean()), float(light.std())


@pytest.fixture(scope="module")
def oil(balls: Scene) -> tuple[Scene, Report]:
    return painted(balls, stroke_size=BROAD, divide="no")  # tests ask about the whole picture


def test_a_painting_is_laid_by_strokes_without_weights(oil: tuple[Scene, Report]) -> None:
    scene, report = oil
    assert set(report["manner"].values()) == {"strokes"} and report["features"] == "none"
    assert any("painted by strokes" in note for note in report["notes"])
    assert scene.styled is not None and scene.styled.brushed is not None and scene.styled.brushed.complete


def test_what_is_shown_has_about_the_pictures_lightness(oil: tuple[Scene, Report]) -> None:
    wanted = rgb2lab(gallery_picture("oil", 300))[..., 0]
    mean, deviation = lightness(oil[0])
    assert mean == pytest.approx(wanted.mean(), abs=9.0)
    assert deviation > 0.4 * wanted.std()


def test_a_saved_painting_looks_the_same_and_is_small(oil: tuple[Scene, Report], balls: Scene, tmp_path: Path) -> None:
    scene = oil[0]
    scene.save(tmp_path / "painted.svv")
    balls.save(tmp_path / "plain.svv")
    again = Scene.load(tmp_path / "painted.svv")
    camera = scene.rig.orbit(9, 120, [3])[0]
    for moving in (False, True):
        before, after = (s.while_moving() if moving else s for s in (scene, again))
        difference = np.abs(before.render(camera, "styled").rgba - after.render(camera, "styled").rgba)
        assert difference.mean() < 0.004
    more = (tmp_path / "painted.svv").stat().st_size - (tmp_path / "plain.svv").stat().st_size
    assert scene.styled is not None
    assert more < min(1.5e6, scene.styled.encoding.table.numel())
    content = Scene.from_bytes(scene.to_bytes())
    assert content.styled is not None and content.styled.brushed is not None


def test_a_painting_without_its_strokes_is_damaged(oil: tuple[Scene, Report]) -> None:
    header, tensors = oil[0].to_arrays()
    for name in [n for n in tensors if n.startswith("brushed.")][:2]:
        with pytest.raises((KeyError, ValueError)):
            Scene.from_arrays(header, {k: v for k, v in tensors.items() if k != name})


def test_still_images_show_the_strokes_and_moving_ones_their_lattice(oil: tuple[Scene, Report], tmp_path: Path) -> None:
    oil[0].save(tmp_path / "oil.svv")
    scene = Scene.load(tmp_path / "oil.svv")
    assert scene.styled is not None and scene.styled.unbaked
    cells = scene.styled.resolutions[-1]
    near = scene.rig.orbit(9, 6 * cells, [3])[0]
    pixels = [scene.resolving(near.resized(size, size)).resolved for size in (6 * cells, cells // 2)]
    assert pixels[1] == pytest.approx(12 * pixels[0], rel=0.1)
    still = scene.render(near, "styled").rgba
    assert scene.styled.unbaked  # a still image does without the lattice
    moving = scene.while_moving().render(near, "styled").rgba
    seen = still[..., 3] > 0.9

    def detail(image: np.ndarray) -> float:
        return float(np.abs(np.diff(image[..., :3].mean(2), axis=1))[seen[:, 1:] & seen[:, :-1]].mean())

    assert detail(still) > 1.1 * detail(moving)
    assert np.abs(still - moving)[seen].mean() < 0.12


def test_each_region_has_its_own_strokes(oil: tuple[Scene, Report]) -> None:
    scene = oil[0]
    assert scene.styled is not None and scene.styled.brushed is not None
    assert scene.stroked == {k: k for k in scene.styled.brushed.regions}


@pytest.mark.slow
def test_both_manners_may_meet_in_one_painting(balls: Scene) -> None:
    scene, report = painted(balls, ("oil", "mosaic"), mapping={0: 0, 1: 1}, stroke_size=BROAD)
    assert report["manner"] == {"0": "strokes", "1": "pieces"}
    assert scene.styled is not None and scene.styled.brushed is not None
    assert list(scene.styled.brushed.regions) == [0] and not scene.styled.brushed.complete


def test_the_manner_can_be_chosen(balls: Scene) -> None:
    _, report = painted(balls, ("mosaic",), manner="strokes", stroke_size=BROAD)
    assert set(report["manner"].values()) == {"strokes"}
    assert not any("--manner" in note for note in report["notes"])
    with pytest.raises(BadInput, match="'paper'"):
        stylize_scene(balls, [gallery_picture("oil", 100)], "paper", manner="strokes")


@pytest.mark.slow
def test_going_on_keeps_the_strokes_of_other_regions(balls: Scene) -> None:
    first = painted(balls, mapping={0: 0}, stroke_size=BROAD)[0]
    second, report = painted(first, ("impasto",), mapping={1: 0}, go_on=True, stroke_size=BROAD)
    assert report["manner"] == {"1": "strokes"}
    assert second.styled is not None and second.styled.brushed is not None
    assert set(second.styled.brushed.regions) == {0, 1}
    inked, _ = stylize_scene(second, [Ink("hatching")], SHORT, mapping={1: 0}, go_on=True, stroke_size=BROAD)
    assert inked.styled is not None and inked.styled.brushed is not None
    assert set(inked.styled.brushed.regions) == {0}


def red_pixels() -> np.ndarray:
    picture = np.ones((64, 64, 3), np.float32)
    picture[30:33, 30] = 1.0, 0.0, 0.0
    return picture


ODD = {
    "flat": np.full((40, 40, 3), 0.4, np.float32),
    "8:1": gallery_picture("oil", 300)[:24, :192],
    "three red pixels": red_pixels(),
    "black and white": np.random.default_rng(0).integers(0, 2, (16, 16, 1)).repeat(3, 2).astype(np.float32),
}


@pytest.mark.parametrize("name", [*list(ODD)[:2], *(pytest.param(n, marks=pytest.mark.slow) for n in list(ODD)[2:])])
def test_any_picture_can_be_painted_by_strokes(balls: Scene, name: str) -> None:
    """Without a stroke in the picture, its colours are all that is taken."""
    scene, report = stylize_scene(balls, [ODD[name]], SHORT, manner="strokes", stroke_size=BROAD)
    assert set(report["manner"].values()) == {"strokes"}
    image = scene.render(scene.rig.orbit(9, 64, [3])[0], "styled").rgba
    shown = image[image[..., 3] > 0.9][:, :3]
    assert np.isfinite(image).all() and len(shown) > 50
    away = np.abs(shown.mean(0) - ODD[name].reshape(-1, 3).mean(0)).max()
    assert away < 0.25, away


def test_one_picture_serves_many_regions_and_hidden_ones_are_painted_as_well(balls: Scene) -> None:
    """They may be shown again later."""
    scene, report = painted(balls.hidden(1), mapping={0: 0, 1: 0}, stroke_size=BROAD)
    assert scene.styled is not None and scene.styled.brushed is not None
    assert set(scene.styled.brushed.regions) == {0, 1}
    assert report["manner"] == {"0": "strokes", "1": "strokes"}


def test_twice_the_stroke_size_is_twice_the_width(balls: Scene, oil: tuple[Scene, Report]) -> None:
    assert stroke_width(balls, 2.0) == pytest.approx(2.0 * stroke_width(balls, 1.0))
    widths = []
    for styled in (oil[0].styled, painted(balls, stroke_size=2.0 * BROAD)[0].styled):
        assert styled is not None and styled.brushed is not None
        radius = styled.brushed.regions[0][0].radius  # of what is painted: a stroke covers about its width squared
        widths.append(float(np.average(radius, weights=radius**2)))
    assert 1.4 < widths[1] / widths[0] < 2.3  # narrow places keep the larger brush out


def test_owners_of_vertices_are_those_with_the_largest_palette_weight(balls: Scene) -> None:
    occupied, cells = balls.occupancy.occupied, balls.occupancy.cells
    found = owners_of(balls, 2 * cells, [0, 1])
    exact = owners_at(balls, places_of(occupied, cells, 2 * cells), [0, 1])
    assert set(np.unique(exact)) == {0, 1}
    assert (found != exact).mean() < 1e-3
    assert (owners_of(balls, cells, [0, 1]) == owners_at(balls, places_of(occupied, cells, cells), [0, 1])).all()
    assert (owners_of(balls, 2 * cells, [1]) == 1).all()


def test_baked_paint_is_flat_where_no_stroke_reaches() -> None:
    stroke = straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.02, (1.0, 0.0, 0.0))
    place = np.array([[0.5, 0.5, 0.5], [0.5, 0.9, 0.5], [0.1, 0.1, 0.1], [0.5, 0.5, 0.5]], np.float32)
    owner = np.array([0, 0, NOBODY, 1], np.uint8)
    flats = np.array([[0.1, 0.2, 0.3], [0.7, 0.8, 0.9]], np.float32)
    found = Brushed({0: (stroke, Brush(0.0, 0.0, 0.0))}, owner, flats).baked(place, 0.004)
    assert found[0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-5)
    assert found[1:] == pytest.approx(np.array([flats[0], [0.5] * 3, flats[1]]))
