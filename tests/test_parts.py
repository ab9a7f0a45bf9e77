"""Parts of regions: a click splits off what is connected there, and nothing else changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, look_at
from svv.errors import BadInput
from svv.fields.radiance.networks import BaseField, FieldSettings, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, Rays, march
from svv.fields.scene.parts import Parts, table_of
from svv.fields.scene.scene import Rendering, Scene
from svv.train.paint.ink import PAPER, Ink
from svv.train.paint.painting import owners_at
from svv.train.pipeline import stylize_scene
from tests.balls import SHORT
from tests.cube import clear_place, cube_camera, cube_paint, lit_cube_scene
from tests.loose_balls import LEFT, RIGHT, TOP, from_front, from_left, in_world, loose_balls

ROUNDOFF = 2e-6


@pytest.fixture(scope="module")
def two() -> Scene:
    return loose_balls()


@pytest.fixture(scope="module")
def three() -> Scene:
    return loose_balls((LEFT, RIGHT, TOP))


@pytest.fixture(scope="module")
def split(two: Scene) -> Scene:
    """The balls, the left one a region of its own."""
    return two.split_at(in_world(LEFT))


def same(one: Rendering, other: Rendering) -> None:
    np.testing.assert_array_equal(one.rgba, other.rgba)
    np.testing.assert_array_equal(one.depth, other.depth)


def alike(one: Rendering, other: Rendering) -> None:
    """The same but for the order in which networks add the products of other numbers of samples."""
    np.testing.assert_allclose(one.rgba, other.rgba, atol=ROUNDOFF, rtol=0)
    np.testing.assert_allclose(one.depth, other.depth, atol=0, rtol=ROUNDOFF)


# --- what a click finds ---------------------------------------------------------------------------------------------


def pixel_of(scene: Scene, side: int) -> tuple[int, int]:
    """A pixel in the middle of the left (-1) or right (1) ball from the front."""
    rows, columns = np.nonzero(scene.render(from_front()).rgba[..., 3] > 0.9)
    own = (columns < 32) == (side < 0)
    return int(columns[own].mean()), int(rows[own].mean())


def test_a_pixel_shows_a_point_on_the_surface(two: Scene) -> None:
    x, y, z = two.point_at(from_front(), pixel_of(two, 1))
    assert (x, y) == pytest.approx(in_world(RIGHT)[:2], abs=0.03)
    assert z == pytest.approx(0.11, abs=0.03)  # the ball's front
    behind = replace(from_front(), camera_to_world=look_at((0.0, 0.0, -3.0), (0.0, 0.0, 0.0)))
    assert two.point_at(behind, pixel_of(two, -1))[2] == pytest.approx(-0.11, abs=0.03)


def test_a_click_beside_everything_is_one_sentence(two: Scene) -> None:
    with pytest.raises(BadInput, match="Nothing is visible at the pixel 1,2"):
        two.point_at(from_front(), (1.5, 2.5))
    with pytest.raises(BadInput, match="outside the picture of 64 x 64"):
        two.point_at(from_front(), (64, 0))
    for nowhere in ((0.0, 0.3, 0.0), (9.0, 0.0, 0.0), (float("nan"), 0.0, 0.0)):
        with pytest.raises(BadInput, match="There is nothing at"):
            two.split_at(nowhere)
    column, row = pixel_of(two, -1)
    with pytest.raises(BadInput, match="Nothing is visible"):
        two.hidden(0).point_at(from_front(), (column, row))


def test_what_is_hidden_is_looked_through(split: Scene) -> None:
    centre = (32, 32)
    assert split.point_at(from_left(), centre)[0] < 0.0 < split.hidden(2).point_at(from_left(), centre)[0]


# --- what a split is ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [-1, 1])
def test_a_click_on_one_of_two_balls_makes_it_a_region(two: Scene, side: int) -> None:
    scene = two.split_at(two.point_at(from_front(), pixel_of(two, side)))
    assert [r.part_of for r in scene.regions] == [None, None, 0]
    assert scene.regions[2].share == pytest.approx(0.5, abs=0.02)
    before, after = two.render(from_front()), scene.render(from_front())
    same(before, after)
    columns = np.arange(64) - 31.5
    own = np.where(side * columns > 0, 2, 0)
    np.testing.assert_array_equal(after.region, np.where(before.region < 0, -1, own[None]))


@pytest.mark.parametrize("camera", [from_front, from_left])
def test_hiding_one_ball_leaves_exactly_the_other(split: Scene, camera: Callable[[], Camera]) -> None:
    alike(split.hidden(2).render(camera()), loose_balls((RIGHT,)).render(camera()))
    alike(split.hidden(0).render(camera()), loose_balls((LEFT,)).render(camera()))


def test_samples_that_are_joined_change_little(split: Scene) -> None:
    """By default, what is faint is joined with what lies behind, whichever region it is of."""
    hidden = replace(split, joined=1 / 64).hidden(2).render(from_left()).rgba
    alone = replace(loose_balls((RIGHT,)), joined=1 / 64).render(from_left()).rgba
    assert np.abs(hidden - alone)[..., 3].max() < 2 / 64  # once before a region, once behind it


def test_a_part_is_recoloured_alone(two: Scene, split: Scene) -> None:
    before, red = two.render(from_front()), split.edited(2, colour=(0.9, 0.1, 0.1)).render(from_front())
    np.testing.assert_allclose(red.rgba[:, 32:], before.rgba[:, 32:], atol=ROUNDOFF)
    whole = two.edited(0, colour=(0.9, 0.1, 0.1)).render(from_front())
    np.testing.assert_allclose(red.rgba[:, :32], whole.rgba[:, :32], atol=ROUNDOFF)
    assert np.abs(red.rgba - before.rgba).max() > 0.2


def test_what_touches_does_not_fall_apart() -> None:
    with pytest.raises(BadInput, match="Region 0 is in one piece"):
        loose_balls(((0.5, 0.5, 0.5),)).split_at((0.0, 0.0, 0.0))
    with pytest.raises(BadInput, match="Region 0 is in one piece"):
        loose_balls(bar=5.0).split_at(in_world(LEFT))


def test_haze_does_not_connect_unless_the_level_is_low() -> None:
    hazy = loose_balls(bar=-0.5)
    part = hazy.split_at(in_world(LEFT))
    assert len(part.regions) == 3
    with pytest.raises(BadInput, match="one piece"):
        hazy.split_at(in_world(LEFT), level=0.01)
    for level in (0.0, 1.5, float("nan")):
        with pytest.raises(BadInput, match="level of a split must be above 0"):
            hazy.split_at(in_world(LEFT), level)
    # The haze is divided half way: none of it is lost, and each half goes with its ball.
    shown = hazy.render(from_front()).rgba[..., 3]
    halves = [part.hidden(k).render(from_front()).rgba[..., 3] for k in (2, 0)]
    np.testing.assert_allclose(np.maximum(*halves), shown, atol=1e-6)
    assert (np.minimum(*halves)[:, [29, 34]] < 1 / 255).all()


def test_parts_of_parts(three: Scene) -> None:
    first = three.split_at(in_world(LEFT))
    rest = first.split_at(in_world(TOP))
    assert [r.part_of for r in rest.regions] == [None, None, 0, 0]
    with pytest.raises(BadInput, match="Region 3 is in one piece"):
        rest.split_at(in_world(TOP))
    top = rest.isolated(3)
    alike(top.render(from_front()), loose_balls((TOP,)).render(from_front()))
    other = three.split_at(in_world(TOP)).split_at(in_world(LEFT)).isolated(2)
    same(top.render(from_front()), other.render(from_front()))


@given(st.integers(1, 4), st.integers(0, 10**6))
def test_the_table_of_zones_follows_the_splits_one_after_another(colours: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    parents = [int(rng.integers(colours + number)) for number in range(5)]
    inside = rng.random((8, 5)) < 0.6
    for zone, row in enumerate(table_of(inside, colours, parents)):
        for colour, found in enumerate(row):
            region = colour
            for number, parent in enumerate(parents):
                region = colours + number if parent == region and inside[zone, number] else region
            assert found == region


def test_there_are_at_most_256_zones() -> None:
    parts = Parts(16, np.zeros((16, 16, 16), np.uint8), np.zeros((1, 0), bool))
    for bit in range(8):
        parts = parts.with_part(np.arange(4096).reshape(16, 16, 16) >> bit & 1 > 0)
    assert len(parts.inside) == 256
    with pytest.raises(OverflowError):
        parts.with_part(np.arange(4096).reshape(16, 16, 16) >> 8 & 1 > 0)


# --- every way to draw ----------------------------------------------------------------------------------------------


def in_parts(scene: Scene, seed: int = 0) -> Scene:
    """A scene of three regions, two of which have a part in cells at random, one of them a part of its own."""
    rng = np.random.default_rng(seed)
    parts = Parts(8, np.zeros((8, 8, 8), np.uint8), np.zeros((1, 0), bool))
    for _ in range(3):
        parts = parts.with_part(rng.random((8, 8, 8)) < 0.5)
    regions = [*scene.regions]
    for parent in (0, 2, 3):
        regions.append(replace(regions[parent], part_of=parent))
    return replace(scene, regions=tuple(regions), parts=parts)


def test_a_split_without_edits_changes_no_picture(cube: Scene) -> None:
    edited = cube.edited(0, colour=(0.1, 0.9, 0.5), opacity=0.5)
    painted = edited.painted(cube_paint(cube, 1), {0: "oil"}, {}).with_strength(0.5)
    for scene in (cube, edited, painted, lit_cube_scene()):
        before, after = scene.render(cube_camera()), in_parts(scene).render(cube_camera())
        np.testing.assert_allclose(after.rgba, before.rgba, atol=1e-6, rtol=0)
    same(in_parts(cube).render(cube_camera()), cube.render(cube_camera()))


def test_a_samples_region_is_that_of_its_cell(cube: Scene) -> None:
    scene = in_parts(cube)
    assert scene.parts is not None and scene.palette_network is not None
    position = torch.rand(500, 3, generator=torch.Generator().manual_seed(0))
    position[:3] = torch.tensor([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.125, 0.25, 0.999]])
    weights = scene.palette_network.material(position)[1]
    table = table_of(scene.parts.inside, 3, (0, 2, 3))
    for at, colour, found in zip(position, weights.argmax(1), scene.region_of(position, weights), strict=True):
        cell = tuple(np.minimum((at.numpy() * 8).astype(int), 7))
        assert found == table[scene.parts.zone[cell], colour]
    assert set(scene.region_of(position, weights).tolist()) == set(range(6))


def test_plain_and_fused_images_of_parts_agree(cube: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    lit = in_parts(lit_cube_scene()).edited(3, specular=0.9, ambient=0.3).edited(0, diffuse=0.2)
    plain = in_parts(cube).edited(3, colour=(0.9, 0.9, 0.1), opacity=2.0).edited(4, lighting=0.2).hidden(5)
    paint = in_parts(cube).painted(cube_paint(cube, 1), {3: "oil", 2: "oil"}, {}).with_strength(0.5, 3)
    strokes = paint.with_stroke_opacity(0.7, 2)
    fused = [scene.render(cube_camera()) for scene in (lit, plain, paint, strokes)]
    monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda _: None)
    for scene, drawn in zip((lit, plain, paint, strokes), fused, strict=True):
        expected = scene.render(cube_camera())
        np.testing.assert_allclose(drawn.rgba, expected.rgba, atol=2e-5)
        np.testing.assert_array_equal(drawn.region, expected.region)


def test_an_edit_of_every_part_is_an_edit_of_the_whole(cube: Scene) -> None:
    """Colour, opacity, light and paint alike."""
    lit = lit_cube_scene()
    for scene, changes in ((cube, {"colour": (0.1, 0.9, 0.5), "opacity": 0.4}), (lit, {"specular": 0.7})):
        whole, parts = scene.edited(0, **changes), in_parts(scene)
        for region in (0, 3, 5):  # region 3 is a part of region 0, and region 5 of region 3
            parts = parts.edited(region, **changes)
        np.testing.assert_allclose(parts.render(cube_camera()).rgba, whole.render(cube_camera()).rgba, atol=1e-6)


# --- undo and files -------------------------------------------------------------------------------------------------


EDITS = st.one_of(
    st.sampled_from([LEFT, RIGHT, TOP]).map(lambda c: lambda s: s.split_at(in_world(c))),
    st.integers(0, 3).map(lambda k: lambda s: s.hidden(k)),
    st.integers(0, 3).map(lambda k: lambda s: s.edited(k, opacity=0.5)),
    st.just(lambda s: s.undone()),
    st.just(lambda s: s.redone()),
)
"""Functions from a scene of three balls to an edited one; some cannot be applied everywhere."""


@settings(max_examples=25)
@given(st.lists(EDITS, max_size=7))
def test_splits_can_be_undone_redone_and_saved(three: Scene, edits: list[Callable[[Scene], Scene]]) -> None:
    scene = three
    for edit in edits:
        try:
            scene = edit(scene)
        except BadInput:
            continue
    again = Scene.from_bytes(scene.to_bytes())
    assert (again.regions, again.every_region) == (scene.regions, scene.every_region)
    assert again.history == scene.history
    same(again.render(from_front(16)), scene.render(from_front(16)))
    states = [again]
    while states[-1].history.past:
        states.append(states[-1].undone())
    assert states[-1].regions == three.regions
    same(states[-1].render(from_front(16)), three.render(from_front(16)))
    now = states[-1]
    for state in reversed(states[:-1]):
        now = now.redone()
        assert now.regions == state.regions
        same(now.render(from_front(16)), state.render(from_front(16)))


def test_a_file_holds_parts_and_those_without_are_as_before(two: Scene, split: Scene, tmp_path) -> None:  # type: ignore[no-untyped-def]
    two.save(tmp_path / "two.svv")
    split.save(tmp_path / "split.svv")
    again = Scene.load(tmp_path / "split.svv")
    same(again.hidden(2).render(from_front()), split.hidden(2).render(from_front()))
    assert (tmp_path / "split.svv").stat().st_size - (tmp_path / "two.svv").stat().st_size < 4000
    assert b'"version":3' in (tmp_path / "two.svv").read_bytes()[:400].replace(b"\\", b"").replace(b" ", b"")


@pytest.mark.parametrize(
    "damage",
    [
        lambda h, t: h["parts"].update(cells=48),
        lambda h, t: h["parts"].update(cells=32 * 8),
        lambda h, t: h.update(undone=[{"colour": [0, 0, 0], "share": 0, "part_of": 7}]),
        lambda h, t: h.pop("parts"),
        lambda h, t: h["regions"][2].update(part_of=2),
        lambda h, t: h["regions"][2].update(part_of=-1),
        lambda h, t: h["regions"][0].update(part_of=0),
        lambda h, t: h["history"]["past"][0].update(edits=[{}]),
        lambda h, t: t["parts.zone"].fill(9),
        lambda h, t: t.pop("parts.inside"),
        lambda h, t: t.update({"parts.zone": t["parts.zone"][:-1]}),
        lambda h, t: t.update({"parts.inside": t["parts.inside"][:, :0]}),
    ],
)
def test_damaged_parts_are_one_sentence(split: Scene, damage: Callable[[dict, dict], object]) -> None:  # type: ignore[type-arg]
    import copy
    import json

    from svv.io.scene_file import scene_bytes

    header, arrays = split.to_arrays()
    header, arrays = json.loads(json.dumps(header, default=list)), copy.deepcopy(arrays)
    damage(header, arrays)
    with pytest.raises(BadInput, match="damaged"):
        Scene.from_bytes(scene_bytes(header, arrays))


def test_a_part_is_painted_alone(two: Scene, split: Scene) -> None:
    painted, report = stylize_scene(split, [Ink("hatching")], SHORT, mapping={2: 0})
    assert [r.style for r in painted.regions] == [None, None, "ink:hatching"] and list(report["styles"]) == ["2"]
    plain, inked = two.render(from_front()).rgba, painted.render(from_front()).rgba
    np.testing.assert_allclose(inked[:, 32:], plain[:, 32:], atol=ROUNDOFF)
    paper = inked[:, :32][inked[:, :32, 3] > 0.99]
    assert (np.abs(paper[:, :3] - PAPER).max(axis=1) < 0.1).mean() > 0.3  # and not the grey of the palette
    np.testing.assert_array_equal(inked[..., 3], plain[..., 3])


def test_paintings_keep_their_styles_when_regions_split(two: Scene) -> None:
    painted = two.painted(cube_paint(two, 1), {0: "oil"}, {}, "oil").painted(cube_paint(two, 2), {}, {}, "none")
    scene = painted.split_at(in_world(LEFT))
    assert [r.style for r in scene.regions] == [None, None, None]
    assert [r.style for r in scene.with_variant("oil").regions] == ["oil", None, "oil"]
    new = scene.painted(cube_paint(two, 3), {2: "ink"}, {}, "part")
    assert [r.style for r in new.regions] == [None, None, "ink"]
    back = Scene.from_bytes(new.undone().to_bytes())
    assert [r.style for r in back.regions] == [None, None]
    assert [r.style for r in back.redone().regions] == [None, None, "ink"]
    assert [r.style for r in back.with_variant("oil").redone().regions] == ["oil", None, "oil"]
    other = back.split_at(in_world(RIGHT))  # what was undone is forgotten
    assert [r.style for r in other.with_variant("oil").with_variant("part").regions] == [None, None, None]


@pytest.mark.parametrize("encoding", ["lattice", "hash"])
def test_the_extinction_at_a_point_is_that_of_a_sample(encoding: str) -> None:
    occupancy = Occupancy.full(Box((0.0,) * 3, 1.0, (1.0,) * 3), 4)
    base = BaseField(FieldSettings(encoding, (4, 8), levels=2, log2_entries=10, width=16), occupancy)
    for table in base.encodings:
        table.randomize(1.0, torch.Generator().manual_seed(0))
    rays = Rays(torch.rand(50, 3) * 0.1, torch.nn.functional.normalize(torch.rand(50, 3) + 0.1, dim=1))
    samples = march(rays, occupancy, base.density, Marching(1 / 16, least_weight=0.0, stop=1e9))
    assert len(samples) > 200
    with torch.no_grad():
        torch.testing.assert_close(base.extinction_at(samples.position), base.extinction(samples), rtol=1e-5, atol=0)


@pytest.mark.slow
def test_a_scene_of_the_papers_hash_grid_is_split(cube: Scene) -> None:
    settings = FieldSettings("hash", (4, 8), levels=2, log2_entries=10, width=16)
    torch.manual_seed(0)
    base = BaseField(settings, cube.occupancy)
    base.encoding.randomize(2.0, torch.Generator().manual_seed(0))
    palette = PaletteField(settings, cube.occupancy, base.geometry_width, cube.palette_network.colours)  # type: ignore[union-attr]
    palette.encoding.randomize(5.0, torch.Generator().manual_seed(1))
    scene = replace(cube, settings=settings, base=base, palette_network=palette.requires_grad_(False))
    parts = scene.split_at(clear_place(scene, 0), level=1.0)
    assert len(parts.regions) == 4
    np.testing.assert_allclose(parts.render(cube_camera()).rgba, scene.render(cube_camera()).rgba, atol=1e-6)
    hidden = parts.hidden(3).render(cube_camera()).rgba
    assert np.abs(hidden - scene.render(cube_camera()).rgba).max() > 0.01


def test_pieces_of_a_part_get_the_contrast_of_its_own_picture(two: Scene, split: Scene) -> None:
    place = np.array([split.occupancy.box.to_box(in_world(at)) for at in (LEFT, RIGHT)], np.float32)
    assert owners_at(two, place, range(1)).tolist() == [0, 0]
    assert owners_at(split, place, range(2)).tolist() == [1, 0]
