"""What is done to one scene can be done to a joined one: clicks, splits, undo, paint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.errors import BadInput
from svv.fields.following.other_cells import on_cells
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.joined import joined, members, with_members
from svv.fields.scene.scene import Scene
from svv.fields.scene.style_pictures import drop_styles
from svv.io.scene_file import checkpoint_of, checkpoint_of_layer, remove_checkpoints
from svv.train.paint.ink import Ink
from svv.train.pipeline import stylize_scene
from tests.balls import SHORT
from tests.cube import cube_camera, cube_paint, cube_scene
from tests.loose_balls import LEFT, RIGHT, TOP, from_front, in_world, loose_balls

ROUNDOFF = 2e-6


def balls(*centres: tuple[float, float, float], opacity: float = 1.0) -> Scene:
    return loose_balls(centres).edited(0, opacity=opacity)


@pytest.fixture(scope="module")
def both() -> Scene:
    """Two balls side by side, of the first function; a third one above them and half of the left one, of the second."""
    return joined([balls(LEFT, RIGHT), balls(TOP, LEFT, opacity=0.5)])


def same(one: Scene, other: Scene) -> None:
    a, b = (s.render(from_front(32)) for s in (one, other))
    np.testing.assert_array_equal(a.rgba, b.rgba)
    np.testing.assert_array_equal(a.depth, b.depth)


def test_a_click_shows_what_is_in_front_of_all_functions(both: Scene) -> None:
    picture = both.render(from_front())
    for region in (0, 2):
        row, column = (int(values[len(values) // 2]) for values in np.nonzero(picture.region == region))
        x, y, z = both.point_at(from_front(), (column, row))
        distance = float(np.linalg.norm(np.subtract((x, y, z), (0.0, 0.0, 3.0))))
        assert distance == pytest.approx(float(picture.depth[row, column]), abs=0.05)
    with pytest.raises(BadInput, match="Nothing is visible"):
        both.point_at(from_front(), (1, 2))


@pytest.mark.parametrize(("centre", "parent"), [(RIGHT, 0), (LEFT, 0), (TOP, 2)])
def test_a_split_belongs_to_the_function_that_shows_most_there(
    both: Scene, centre: tuple[float, float, float], parent: int, tmp_path: Path
) -> None:
    split = both.split_at(in_world(centre))
    assert [r.part_of for r in split.regions] == [None] * 4 + [parent]
    assert [r.layer for r in split.regions] == [0, 0, 1, 1, parent // 2]
    same(split.hidden(4).shown(4), both)
    alone = split.isolated(4).render(from_front())
    x, y, _ = in_world(centre)
    rows, columns = np.nonzero(alone.region == 4)
    middle = 32.0 + 64.0 / (2 * 3.0 * np.tan(0.2)) * np.array([-y, x])
    np.testing.assert_allclose([rows.mean() + 0.5, columns.mean() + 0.5], middle, atol=1.5)
    split.save(tmp_path / "split.svv")
    again = Scene.load(tmp_path / "split.svv")
    assert again.regions == split.regions
    same(again.isolated(4), split.isolated(4))


def test_what_was_split_can_be_joined() -> None:
    parts = balls(LEFT, RIGHT).split_at(in_world(RIGHT)).hidden(0)
    whole = joined([balls(TOP), parts])
    assert [r.part_of for r in whole.regions] == [None, None, None, None, 2]
    for number in range(2):
        whole = whole.hidden(number)
    np.testing.assert_allclose(whole.render(from_front()).rgba, parts.render(from_front()).rgba, atol=ROUNDOFF, rtol=0)
    assert [m.regions[-1].part_of for m in members(whole)] == [None, 0]


EDITS = st.one_of(
    st.sampled_from([LEFT, RIGHT, TOP]).map(lambda c: lambda s: s.split_at(in_world(c))),
    st.integers(0, 5).map(lambda k: lambda s: s.hidden(k)),
    st.just(lambda s: s.shown()),
    st.just(lambda s: s.undone()),
    st.just(lambda s: s.redone()),
)


@settings(max_examples=15)
@given(st.lists(EDITS, max_size=7))
def test_splits_of_all_functions_have_one_history(both: Scene, edits: list[Callable[[Scene], Scene]]) -> None:
    scene = both
    for edit in edits:
        try:
            scene = edit(scene)
        except BadInput:
            continue
    again = Scene.from_bytes(scene.to_bytes())
    assert (again.every_region, again.history) == (scene.every_region, scene.history)
    states = [again]
    while states[-1].history.past:
        states.append(states[-1].undone())
    assert states[-1].regions == both.regions
    same(states[-1], both)
    now = states[-1]
    for state in reversed(states[:-1]):
        now = now.redone()
        assert now.regions == state.regions
        same(now, state)
    assert with_members(scene, members(scene)).every_region == scene.every_region


@pytest.mark.parametrize(("undone", "split"), [(LEFT, TOP), (TOP, LEFT)])
def test_a_split_forgets_an_undone_one_of_another_function(
    both: Scene, undone: tuple[float, float, float], split: tuple[float, float, float], tmp_path: Path
) -> None:
    found = both.split_at(in_world(undone)).undone().split_at(in_world(split))
    found.save(tmp_path / "found.svv")
    again = Scene.load(tmp_path / "found.svv")
    assert again.every_region == found.every_region and not again.history.future
    same(again, found)
    same(again.undone(), both)


def undone_split() -> Scene:
    """Two balls that were split, edited, painted twice and put back together."""
    scene = balls(LEFT, RIGHT).split_at(in_world(RIGHT)).hidden(2)
    paint = UnrestrictedField(scene.settings, scene.occupancy, direct=True).requires_grad_(False)
    scene = scene.painted(paint, {0: "a", 2: "b"}, {}, "first")
    return scene.painted(paint, {2: "b"}, {}, "second").undone().undone()


@pytest.mark.parametrize("number", [0, 1])
def test_a_scene_with_an_undone_split_is_joined_and_read_again(number: int) -> None:
    every = [balls(TOP), balls(TOP)]
    every[number] = undone_split()
    whole = joined(every)
    again = Scene.from_bytes(whole.to_bytes())
    assert again.every_region == whole.regions
    same(again, whole)


def test_a_scene_with_an_undone_split_is_read_again_with_other_opacities() -> None:
    scene = undone_split()
    assert scene.base.density is not None
    changed = on_cells(scene, scene.occupancy, scene.base.density)
    again = Scene.from_bytes(changed.to_bytes())
    assert again.every_region == scene.regions and again.variants == ("first", "second")
    assert again.history.past == scene.history.past and not again.history.future
    same(again.with_variant("first"), scene.with_variant("first"))


# --- paint ------------------------------------------------------------------------------------------------------------

INKS = (Ink("stippling"), Ink("hatching"))


def test_regions_of_each_function_are_painted_as_if_it_were_alone(tmp_path: Path) -> None:
    first, second = balls(LEFT, RIGHT), balls(TOP)
    whole = joined([first, second]).edited(0, opacity=0.7)
    seen: list[Scene] = []
    checkpoint = checkpoint_of(tmp_path / "painted.svv")
    painted, report = stylize_scene(
        whole, INKS, SHORT, mapping={0: 0, 2: 1}, seed=3, checkpoint=checkpoint, preview=seen.append
    )
    assert [r.style for r in painted.regions] == ["ink:stippling", None, "ink:hatching", None]
    assert painted.regions[0].opacity == 0.7 and painted.networks == ("base", "pcn", "styled")
    assert report["styles"] == {"0": "ink:stippling", "2": "ink:hatching"} and report["seconds"]["total"] > 0
    assert len(seen[-1].regions) == 4 and drop_styles(painted.made)["stylized"] == report
    alone, _ = stylize_scene(second, INKS[1:], SHORT, mapping={0: 0}, seed=3)
    np.testing.assert_allclose(
        painted.isolated(2, 3).render(from_front()).rgba, alone.render(from_front()).rgba, atol=ROUNDOFF, rtol=0
    )
    files = [checkpoint_of_layer(checkpoint, number) for number in range(2)]
    remove_checkpoints(checkpoint, 2)
    assert not any(path.exists() for path in files) and not list(tmp_path.glob("*.checkpoint"))
    again = Scene.from_bytes(painted.to_bytes())
    read, kept = (s.render(from_front()).rgba for s in (again, painted))
    np.testing.assert_allclose(read, kept, atol=2e-3)  # a file holds paint in half precision

    once_more, report = stylize_scene(painted.hidden(0, 1), INKS[1:], SHORT, mapping={0: 0, 2: 0})
    assert [r.style for r in once_more.regions] == [None, None, "ink:hatching", None], "one painting, and it is new"
    assert any("region 0" in note for note in report["notes"])
    with pytest.raises(BadInput, match="--continue"):
        stylize_scene(whole, INKS, SHORT, go_on=True)


def test_going_on_keeps_the_paint_of_other_functions() -> None:
    first, second = cube_scene(0), cube_scene(1)
    paint = replace(first, styled=cube_paint(first, 5), painting="p")
    paint = replace(paint, regions=tuple(replace(r, style="s", mean_light=(1.0, 0.0)) for r in paint.regions))
    whole = joined([paint, second])
    painted, report = stylize_scene(whole, INKS[:1], SHORT, mapping={4: 0}, go_on=True)
    assert [r.style for r in painted.regions] == ["s"] * 3 + [None, "ink:stippling", None]
    assert report["continued"] == []
    own = painted.isolated(0, 1, 2).render(cube_camera()).rgba
    np.testing.assert_array_equal(own, whole.isolated(0, 1, 2).render(cube_camera()).rgba)


def test_files_of_joined_scenes_hold_ranges_and_values_of_all_functions() -> None:
    first, second = balls(LEFT, RIGHT), balls(TOP)
    told = {"values": (1.0, 2.0), "ranges": ((1.0, 1.5), (1.7, 2.0))}
    second = replace(second, regions=tuple(replace(region, **told) for region in second.regions))
    whole = joined([first, second])
    assert Scene.from_bytes(whole.to_bytes()).regions == whole.regions
