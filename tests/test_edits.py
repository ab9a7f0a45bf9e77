"""Edits of regions and their history: hidden regions keep their opacity, and edits can be undone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.errors import BadInput
from svv.fields.scene.history import IDENTITY, MOST_UNDO_STEPS, edits_of, with_edits
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.io import scene_file
from tests.cube import cube_camera

REGION, FACTOR = st.integers(0, 2), st.floats(0.0, 4.0)
COLOUR = st.tuples(*[st.floats(0.0, 1.0)] * 3)
SOME = st.lists(REGION, min_size=1, max_size=3, unique=True)
EDITS = st.one_of(
    st.builds(lambda r, c: lambda s: s.edited(r, colour=c), REGION, COLOUR),
    st.builds(lambda r, f: lambda s: s.edited(r, opacity=f), REGION, FACTOR),
    st.builds(lambda r, f, g: lambda s: s.edited(r, None, f, g), REGION, FACTOR, FACTOR),
    st.builds(lambda k: lambda s: s.isolated(*k), SOME),
    st.builds(lambda k: lambda s: s.hidden(*k), SOME),
    st.builds(lambda k: lambda s: s.shown(*k), SOME),
    st.builds(lambda k: lambda s: s.reset(*k), SOME),
    st.builds(lambda f: lambda s: s.with_strength(f), st.floats(0.0, 1.0)),
    st.builds(lambda f, k: lambda s: s.with_paint_light(f, *k), st.floats(0.0, 1.0), SOME),
    st.builds(lambda f, k: lambda s: s.with_occlusion(f, *k), st.floats(0.0, 1.0), SOME),
    st.builds(lambda f, k: lambda s: s.with_stroke_opacity(f, *k), st.floats(-1.0, 1.0), SOME),
    st.builds(lambda f, k, w: lambda s: s.with_outline(f, *k, width=w), st.floats(0.0, 1.0), SOME, st.floats(0.5, 9.0)),
    st.builds(lambda c: lambda s: s.with_outline(colour=c), COLOUR),
)
"""Functions from a scene of three regions to an edited one."""

Edit = Callable[[Scene], Scene]


def image(scene: Scene) -> np.ndarray:
    return scene.render(cube_camera()).rgba


def test_an_isolated_region_is_what_it_is_with_the_others_transparent(cube: Scene) -> None:
    expected = cube.edited(0, opacity=0.0).edited(2, opacity=0.0)
    np.testing.assert_array_equal(image(cube.isolated(1)), image(expected))
    np.testing.assert_array_equal(image(cube.hidden(0, 2)), image(expected))
    assert not np.array_equal(image(expected), image(cube))


def test_only_isolated_regions_are_seen(cube: Scene) -> None:
    assert set(np.unique(cube.render(cube_camera()).region)) == {-1, 0, 1, 2}
    assert set(np.unique(cube.isolated(0, 2).render(cube_camera()).region)) == {-1, 0, 2}
    assert image(cube.hidden(0, 1, 2)).max() == 0.0


def test_haze_of_hidden_regions_goes_with_them(cube: Scene) -> None:
    """Also what lies behind the last sample of a ray, which samples of low weight leave."""
    thin = replace(cube, marching=replace(cube.marching, step=1 / 200), joined=1 / 64)
    before, alpha = image(thin)[..., 3], image(thin.hidden(0, 1, 2))[..., 3]
    assert before.max() > 0.1
    assert alpha[before > 1 / 32].max() == 0.0


def test_plain_and_fused_images_of_hidden_regions_agree(cube: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = cube.edited(0, opacity=2.0).hidden(1)
    fused = scene.render(cube_camera())
    monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda _: None)
    plain = scene.render(cube_camera())
    np.testing.assert_allclose(fused.rgba, plain.rgba, atol=2e-5)


def test_hidden_regions_keep_their_opacity(cube: Scene) -> None:
    thin = cube.edited(0, opacity=0.3).edited(1, opacity=2.0)
    hidden = thin.isolated(2)
    assert [r.opacity for r in hidden.regions] == [0.3, 2.0, 1.0]
    assert hidden.shown().regions == thin.regions
    assert [r.hidden for r in hidden.shown(0).regions] == [False, True, False]
    np.testing.assert_array_equal(image(hidden.shown()), image(thin))


@given(st.lists(EDITS, min_size=1, max_size=8))
def test_everything_done_can_be_undone_and_redone(cube: Scene, edits: list[Edit]) -> None:
    states = [cube]
    for edit in edits:
        after = edit(states[-1])
        if after is not states[-1]:  # an edit that changes nothing is no step
            states.append(after)
    scene = states[-1]
    for state in reversed(states[:-1]):
        scene = scene.undone()
        assert scene.regions == state.regions
    with pytest.raises(BadInput, match="nothing to undo"):
        scene.undone()
    for state in states[1:]:
        scene = scene.redone()
        assert scene.regions == state.regions
    with pytest.raises(BadInput, match="nothing to redo"):
        scene.redone()
    assert scene.history == states[-1].history


@given(st.lists(EDITS, max_size=6), st.integers(0, 3))
def test_a_scene_file_holds_edits_and_history(cube: Scene, edits: list[Edit], undos: int) -> None:
    scene = cube
    for edit in edits:
        scene = edit(scene)
    for _ in range(min(undos, len(scene.history.past))):
        scene = scene.undone()
    again = Scene.from_bytes(scene.to_bytes())
    assert again.regions == scene.regions
    assert again.history == scene.history


def test_a_new_edit_forgets_what_was_undone(cube: Scene) -> None:
    scene = cube.edited(0, opacity=0.5).undone().hidden(1)
    assert [step.what for step in scene.history.past] == ["hide 1"]
    with pytest.raises(BadInput, match="nothing to redo"):
        scene.redone()


def test_the_history_is_bounded(cube: Scene) -> None:
    scene = cube
    for number in range(MOST_UNDO_STEPS + 10):
        scene = scene.edited(0, opacity=float(number))
    assert len(scene.history.past) == MOST_UNDO_STEPS
    for _ in range(MOST_UNDO_STEPS):
        scene = scene.undone()
    assert scene.regions[0].opacity == 9.0


def test_several_edits_as_one_step(cube: Scene) -> None:
    before = cube.hidden(2)
    after = before.edited(0, opacity=0.5).edited(1, lighting=2.0).isolated(0).as_one_step(before)
    assert [step.what for step in after.history.past][1:] == ["region 0: opacity 0.5; region 1: lighting 2; isolate 0"]
    assert after.undone().regions == before.regions
    assert after.undone().undone().regions == cube.regions
    back = before.shown().hidden(2).as_one_step(before)
    assert back.history == before.history


def test_reset_is_as_trained_and_can_be_undone(cube: Scene) -> None:
    edited = cube.edited(0, (0.0, 1.0, 0.0), 0.3, 2.0).edited(1, opacity=0.0).hidden(2)
    assert edited.reset().regions == cube.regions
    one = edited.reset(0)
    assert one.regions == (cube.regions[0], *edited.regions[1:])
    assert one.undone().regions == edited.regions


def test_every_field_is_an_edit_or_says_what_the_region_is() -> None:
    """So that undo, reset and files know the ones to come."""
    plain = Region((1.0, 0.0, 0.0), 0.5, values=(1.0, 2.0), ranges=((1.0, 2.0),), style="ink", mean_light=(0.7, 0.1))
    assert edits_of(plain) == {}
    reflects = {"ambient": 0.1, "diffuse": 0.2, "specular": 0.3, "shininess": 9.0}
    edited = replace(
        Region((1.0, 0.0, 0.0), 0.5, 0.5, 2.0, (0.0, 1.0, 0.0), "ink", 0.3, (1.0, 2.0), ((1.0, 2.0),), True),
        **reflects, paint_light=0.2, mean_light=(0.7, 0.1), outline=0.5, outline_width=3.0,
        outline_colour=(0.2, 0.0, 0.0), stroke_opacity=-0.4, stroke_relief=0.5, stroke_width=1.5,
        stroke_light=(0.0, 0.0, 1.0), stroke_palette=((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)), name="bone",
        recolour_in="oklab", matcap="jade", occlusion=0.4, section="hatched", section_line=2.0,
    )  # fmt: skip
    edits = edits_of(edited)
    assert set(edits) == set(vars(edited)) - set(IDENTITY)
    assert with_edits(plain, edits) == edited
    assert with_edits(edited, {}) == plain
    with pytest.raises(TypeError, match="not an edit"):
        with_edits(plain, {"share": 0.1})


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda s: s.hidden(3), "no region 3: the scene has the regions 0 to 2"),
        (lambda s: s.isolated(-1), "no region -1"),
        (lambda s: s.shown(0, 9), "no region 9"),
        (lambda s: s.reset(4), "no region 4"),
        (lambda s: s.isolated(), "at least one region"),
        (lambda s: s.hidden(), "at least one region"),
        (lambda s: s.with_strength(0.5, 7), "no region 7"),
        (lambda s: s.with_strength(1.5), "between 0 and 1"),
        (lambda s: s.undone(), "nothing to undo"),
        (lambda s: s.redone(), "nothing to redo"),
    ],
)
def test_edits_that_cannot_be_are_one_sentence(cube: Scene, edit: Edit, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        edit(cube)


@pytest.mark.parametrize(
    "history",
    [
        {"past": [{"what": "x", "edits": [{}]}], "future": []},
        {"past": [{"what": "x", "edits": [{"share": 1.0}, {}, {}]}], "future": []},
        {"past": []},
        [],
        {"past": [3], "future": []},
    ],
)
def test_a_history_of_another_scene_is_damage(cube: Scene, history: Any, tmp_path: Path) -> None:
    header, arrays = cube.to_arrays()
    scene_file.write_scene_file(tmp_path / "a.svv", {**header, "history": history}, arrays)
    with pytest.raises(BadInput, match="damaged"):
        Scene.load(tmp_path / "a.svv")
