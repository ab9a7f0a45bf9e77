"""Shots: what is between key frames, what moves do, and which frames a film has."""

from __future__ import annotations

import gc
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st

import svv
from svv.cli.app import app
from svv.core.colour.oklab import rgb_to_oklab
from svv.core.geometry.camera_path import CameraPath, camera_path
from svv.core.geometry.cuts import Cut
from svv.core.geometry.key_curves import along, directed
from svv.errors import BadInput, Cancelled
from svv.fields.scene import view_cache
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.render import frames as frames_module
from svv.render.frames import RenderSettings, seen_from, write_frames
from svv.render.shots.film import Film, render_shot
from svv.render.shots.moves import place_of
from svv.render.shots.moving_cuts import CutTrack, nothing_of
from svv.render.shots.tracks import KeyFrames
from tests.cube import cube_paint, cube_scene, lit_cube_scene
from tests.movies import frames_of

SIZE = (24, 24)


@pytest.fixture(scope="module")
def painted(cube: Scene) -> Scene:
    """The cube with paint on two of its three regions, one of which has a name."""
    return cube.edited(1, name="bone").painted(cube_paint(cube, 5), {0: "a", 2: "b"}, {})


def film(scene: Scene, content: dict[str, Any], fps: float = 10.0) -> Film:
    return Film(scene, svv.read_shot(content), SIZE, fps)


def same(one: svv.Camera, other: svv.Camera) -> None:
    np.testing.assert_allclose(one.camera_to_world, other.camera_to_world, atol=1e-7)
    assert (one.fov_x, one.span_x) == pytest.approx((other.fov_x, other.span_x))


# --- curves ----------------------------------------------------------------------------------------------------------

times = st.lists(st.floats(0.05, 5.0), min_size=1, max_size=5).map(lambda steps: [0.0, *np.cumsum(steps).tolist()])


@given(times, st.data())
def test_a_curve_passes_its_keys_and_nothing_beyond_them(when: list[float], data: st.DataObject) -> None:
    values = np.array([data.draw(st.floats(-3, 3)) for _ in when])
    np.testing.assert_allclose(along(values[:, None], when, when)[:, 0], values, atol=1e-9)
    at = np.linspace(when[0] - 1.0, when[-1] + 1.0, 60)
    found = along(values[:, None], when, at)[:, 0]
    np.testing.assert_allclose(along(values[:, None], 7.0 * np.array(when), 7.0 * at)[:, 0], found, atol=1e-9)
    for k, value in zip(np.clip(np.searchsorted(when, at) - 1, 0, len(when) - 2), found, strict=True):
        assert min(values[k : k + 2]) - 1e-9 <= value <= max(values[k : k + 2]) + 1e-9
    for time in when[1:-1]:  # the velocity does not jump
        before, here, after = along(values[:, None], when, [time - 1e-5, time, time + 1e-5])[:, 0]
        assert (here - before) == pytest.approx(after - here, abs=1e-5)


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=2, max_size=2), st.floats(0, 1))
def test_directions_turn_evenly(ends: list[tuple[float, ...]], part: float) -> None:
    assume(all(np.linalg.norm(v) > 0.1 for v in ends))
    one, other = (np.array(v) / np.linalg.norm(v) for v in ends)
    angle = np.arccos(np.clip(one @ other, -1, 1))
    assume(angle < 3.0)
    found = directed([one, other], [2.0, 4.0], 2.0 + 2.0 * part, "It")
    assert np.linalg.norm(found) == pytest.approx(1.0)
    assert np.arccos(np.clip(found @ one, -1, 1)) == pytest.approx(part * angle, abs=1e-5)
    with pytest.raises(BadInput, match="It at 2 s and 4 s points in opposite directions"):
        directed([one, -one], [2.0, 4.0], 3.0, "It")


def test_a_path_at_equal_times_is_that_of_the_command(cube: Scene) -> None:
    """And at others, it passes the key frames at their times, around the scene."""
    keys = [seen_from(cube, *angles, *SIZE) for angles in ((0, 0), (90, 30), (150, 0))]
    shown = film(
        cube,
        {"keys": [{"time": 2 * k, "camera": {"view": list(v)}} for k, v in enumerate(((0, 0), (90, 30), (150, 0)))]},
    )
    for camera, other in zip(camera_path(keys, 41, cube.rig.centre), shown.cameras, strict=True):
        same(camera, other)
    path = CameraPath(keys, [0.0, 1.0, 5.0], cube.rig.centre)
    for key, passed in zip(keys, path.at([0.0, 1.0, 5.0]), strict=True):
        same(key, passed)
    assert [np.linalg.norm(c.position) for c in path.at(np.linspace(0, 5, 9))] == pytest.approx([3.0] * 9)
    with pytest.raises(BadInput, match="cameras at 0 s and at 2 s of the path are half a turn apart"):
        film(cube, {"keys": [{"time": 0, "camera": {"view": [0, 0]}}, {"time": 2, "camera": {"view": [180, 0]}}]})


# --- key frames ------------------------------------------------------------------------------------------------------


def test_what_a_key_frame_leaves_out_goes_on(cube: Scene) -> None:
    shown = film(cube, {"keys": [{"time": 0}, {"time": 1, "camera": {"view": [40, 0]}},
                                 {"time": 2, "regions": {"1": {"lighting": 0}}}]})  # fmt: skip
    same(shown.cameras[0], seen_from(cube, 0, 0, *SIZE))
    same(shown.cameras[5], seen_from(cube, 20, 0, *SIZE))
    same(shown.cameras[20], seen_from(cube, 40, 0, *SIZE))
    assert [shown.at(k).regions[1].lighting for k in (0, 5, 10, 20)] == pytest.approx([1.0, 0.75, 0.5, 0.0])
    assert shown.at(7).regions[0] == cube.regions[0] and len(shown.cameras) == 21


def test_colours_change_in_oklab_and_opacity_fades(cube: Scene) -> None:
    shown = film(cube, {"keys": [{"time": 0, "regions": {"0": {"colour": "#0000ff"}}},
                                 {"time": 2, "regions": {"0": {"colour": "#ffff00", "opacity": 0}}}]})  # fmt: skip
    start, middle, end = (torch.tensor(shown.at(k).regions[0].edited_colour) for k in (0, 10, 20))
    np.testing.assert_allclose(rgb_to_oklab(middle), 0.5 * (rgb_to_oklab(start) + rgb_to_oklab(end)), atol=1e-3)
    opacity = [shown.at(k).regions[0].opacity for k in range(21)]
    assert opacity[0] == 1.0 and opacity[20] == 0.0 and 0.1 < opacity[10] < 0.3
    assert all(a > b for a, b in pairwise(opacity))
    assert [shown.at(k).regions[0].hidden for k in (0, 19, 20)] == [False, False, True]


def test_what_hides_fades_and_returns_as_opaque_as_it_was(cube: Scene) -> None:
    keys = [{"time": 0, "regions": {"2": {"opacity": 0.4}}}, {"time": 1, "regions": {"2": {"hidden": True}}},
            {"time": 2, "regions": {"2": {"hidden": False}}}]  # fmt: skip
    shown = film(cube, {"keys": keys})
    seen = [shown.at(k).regions[2].seen_opacity for k in (0, 5, 10, 15, 20)]
    assert seen[0] == seen[4] == 0.4 and seen[2] == 0.0 and 0.0 < seen[1] == pytest.approx(seen[3])
    begun = film(cube.hidden(2), {"keys": [{"time": 0}, {"time": 1, "regions": {"2": {"hidden": False}}}]})
    assert [begun.at(k).regions[2].seen_opacity for k in (0, 10)] == [0.0, 1.0]


def test_the_pace_between_key_frames(cube: Scene) -> None:
    def azimuths(easing: str) -> Any:
        keys = [{"time": 0, "camera": {"view": [0, 0]}, "easing": easing}, {"time": 1, "camera": {"view": [60, 0]}}]
        positions = np.array([c.position for c in film(cube, {"keys": keys}, 8).cameras])
        front, side = positions[0] / 3.0, seen_from(cube, 90, 0, *SIZE).position / 3.0
        return np.degrees(np.arctan2(positions @ side, positions @ front)) / 60.0

    at = np.arange(9) / 8
    np.testing.assert_allclose(azimuths("linear"), at, atol=1e-6)
    np.testing.assert_allclose(azimuths("ease-in"), at**2, atol=1e-6)
    np.testing.assert_allclose(azimuths("smooth"), at**2 * (3 - 2 * at), atol=1e-6)


def test_lights_turn_evenly(cube: Scene) -> None:
    lit = lit_cube_scene()
    keys = [{"time": 0, "light": {"azimuth": 10}}, {"time": 1, "light": {"azimuth": 70, "intensity": 3}},
            {"time": 2, "light": {"azimuth": 70, "elevation": 60}}]  # fmt: skip
    shown = film(lit, {"keys": keys})
    lamps = [shown.at(k).lamp for k in (0, 5, 15)]
    assert [(round(lamp.azimuth, 6), round(lamp.elevation, 6)) for lamp in lamps] == [(10, 0), (40, 0), (70, 30)]
    assert lamps[1].intensity == pytest.approx(2.0, abs=0.3)
    keys = [{"time": 0, "light": {"direction": [0, 0, 5]}}, {"time": 1, "light": {"direction": [1, 0, 0]}}]
    assert film(lit, {"keys": keys}).at(5).lamp.direction == pytest.approx((0.5**0.5, 0.0, 0.5**0.5))
    for one, other, said in (({"azimuth": 1}, {"direction": [1, 0, 0]}, "in all key frames"),
                             ({"azimuth": -90}, {"azimuth": 90}, "opposite")):  # fmt: skip
        with pytest.raises(BadInput, match=said):
            film(lit, {"keys": [{"time": 0, "light": one}, {"time": 1, "light": other}]})
    shine = film(lit, {"keys": [{"time": 0}, {"time": 2, "regions": {"0": {"specular": 1.5}}}]})
    shadowed = lit.with_shadow(0.8, (1.0, 2.0, 1.0), 3.0)
    for told in (keys, [{"time": 0, "light": {"azimuth": 10}}, {"time": 1, "light": {"azimuth": 70}}]):
        assert all(film(shadowed, {"keys": told}).at(k).lamp.casts == shadowed.lamp.casts for k in (0, 5, 10))
    held = lit.coefficients()
    assert held is not None and shine.at(0).regions[0].specular == pytest.approx(float(held[0, 2]))


def test_time_steps_play_between_key_frames(cube: Scene) -> None:
    class Steps(SimpleNamespace):
        def __len__(self) -> int:
            return 5

    series = replace(cube, steps=Steps(own=0))
    keys = KeyFrames(series, svv.read_shot({"keys": [{"time": 1, "step": 0}, {"time": 3, "step": 4}]}).keys, SIZE)
    assert [keys.at(t).step for t in (0.0, 1.0, 1.49, 1.5, 2.99, 3.0, 9.0)] == [0, 0, 0, 1, 3, 4, 4]
    with pytest.raises(BadInput, match="at 1 s: The scene has no time step 5: it has the steps 0 to 4"):
        KeyFrames(series, svv.read_shot({"keys": [{"time": 1, "step": 5}]}).keys, SIZE)


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ({"regions": {"3": {"opacity": 1}}}, r"region '3', but .* not have it: its regions are 0, 1 \(bone\), 2"),
        ({"regions": {"skin": {"opacity": 1}}}, "region 'skin', but the scene does not have it"),
        ({"regions": {"1": {"opacity": 1}, "bone": {"opacity": 0}}}, "are one region"),
        ({"regions": {"0": {"colour": "#ff0000"}}}, "at 1 s: Region 0 is styled"),
        ({"regions": {"0": {"stroke_width": 1.2}}}, "no strokes to edit"),
        ({"cuts": ["w>3"]}, "is no cut"),
        ({"camera": {"position": [1, 0, 0], "centre": [1, 0, 0]}}, "at 1 s: A camera cannot look at its own position"),
        ({"camera": {"camera_to_world": [[1, 0, 0, 0]] * 4}}, "at 1 s: A camera matrix must end with"),
        ({"cuts": ["9=x>3"]}, "no region 9"),
        ({"light": {"azimuth": 3}}, "light"),
        ({"step": 1}, "no time step 1: it has none"),
    ],
)  # fmt: skip
def test_what_the_scene_does_not_have_is_one_sentence(painted: Scene, key: dict[str, Any], said: str) -> None:
    with pytest.raises(BadInput, match=said):
        film(painted, {"keys": [{"time": 1, **key}]})


def test_moves_that_the_scene_does_not_have(cube: Scene, painted: Scene) -> None:
    for scene, move, said in (
        (cube, {"move": "paint"}, "The scene is not painted"),
        (painted, {"move": "paint", "regions": ["bone"]}, "Region 1 is not painted"),
        (cube, {"move": "peel", "regions": [7]}, "region '7', but"),
        (cube, {"move": "cut", "cut": "q"}, "is no cut"),
        (
            cube.cut(*(f"x>{2 + k}" for k in range(16))),
            {"move": "cut", "cut": "x>1", "start": 0.5},
            "At 1 s, the shot has 17 cuts with those of its moves, and a scene has at most 16: leave some out",
        ),
    ):
        with pytest.raises(BadInput, match=said):
            film(scene, {"duration": 1, "moves": [move]})
    with pytest.raises(BadInput, match="no painting"):
        film(cube, {"keys": [{"time": 1, "strength": 0.5}]})


# --- cuts ------------------------------------------------------------------------------------------------------------

BOUNDS = np.array([[-1.0, 0.0, 2.0], [1.0, 3.0, 4.0]])
number = st.floats(-3, 3)
point = st.tuples(number, number, number)
shapes = st.one_of(
    st.builds(lambda p, n: Cut.parse(f"plane:{p[0]},{p[1]},{p[2]}:{n[0]},{n[1]},{n[2]}", BOUNDS), point,
              point.filter(lambda n: np.linalg.norm(n) > 0.1)),
    st.builds(lambda p, r: Cut(centre=p, radius=r), point, st.floats(0.1, 3)),
    st.builds(lambda p, a, r: Cut(centre=p, axis=a, radius=r), point,
              point.filter(lambda n: np.linalg.norm(n) > 0.1), st.floats(0.1, 3)),
    st.sampled_from([Cut.parse("x>50%&y<1", BOUNDS), Cut.parse("box:0,0,2:1,1,3", BOUNDS)]),
)  # fmt: skip


@given(shapes, st.booleans())
def test_a_cut_where_it_cuts_nothing(cut: Cut, outside: bool) -> None:
    cut = replace(cut, outside=outside)
    nothing = nothing_of(cut, BOUNDS)
    points = torch.from_numpy(np.random.default_rng(0).uniform(BOUNDS[0], BOUNDS[1], (500, 3)))
    assert float(nothing.depth(points).max()) <= (1e-5 if cut.centre is not None else 0.0)
    track = CutTrack([(0.0, []), (1.0, [cut])], BOUNDS, BOUNDS.mean(0))
    assert track.at(0.0) == () and track.at(1.0) == (cut,)
    taken = [int((track.at(t)[0].depth(points) > 0).sum()) for t in (0.2, 0.4, 0.6, 0.8, 1.0)]
    assert taken == sorted(taken)  # it takes away ever more


def test_planes_turn_around_the_middle_and_balls_wander() -> None:
    middle = np.array([1.0, 2.0, 3.0])
    one, other = (Cut.parse(f"plane:1,2,3:{n}", BOUNDS) for n in ("1,0,0", "0,1,0"))
    (cut,) = CutTrack([(0, [one]), (2, [other])], BOUNDS, middle).at(1)
    x, y, z, d = cut.planes[0]
    assert (x, y, z) == pytest.approx((0.5**0.5, 0.5**0.5, 0)) and d == pytest.approx(np.dot((x, y, z), middle))
    balls = [(0, [Cut(centre=(0, 0, 0), radius=1)]), (2, [Cut(centre=(2, 0, 0), radius=3)])]
    assert CutTrack(balls, BOUNDS, middle).at(1) == (Cut(centre=(1, 0, 0), radius=2),)
    for cuts in ([balls[1][1][0]], [replace(other, outside=True)], [replace(other, regions=(1,))]):
        with pytest.raises(BadInput, match=r"The cuts at 0 s and 1 s, cut x > 1 and .* are of different kinds"):
            CutTrack([(0, [one]), (1, cuts)], BOUNDS, middle)


# --- moves -----------------------------------------------------------------------------------------------------------


@given(st.integers(1, 3), st.sampled_from([-1, 1]), st.integers(5, 24), st.integers(1, 3))
def test_a_turntable_closes_without_a_doubled_frame(cube: Scene, turns: int, way: int, fps: int, seconds: int) -> None:
    shown = film(cube, {"duration": seconds, "moves": [{"move": "turntable", "turns": way * turns}]}, fps)
    count = fps * seconds
    assert len(shown.cameras) == count
    assert np.array_equal(shown.moment(count).camera.camera_to_world, shown.cameras[0].camera_to_world)
    angle = 2 * np.pi * turns / count
    for one, other in zip(shown.cameras, [*shown.cameras[1:], shown.cameras[0]], strict=True):
        assert one.position @ other.position / 9.0 == pytest.approx(np.cos(angle), abs=1e-9)
    right = seen_from(cube, 5, 0, *SIZE).position - shown.cameras[0].position
    assert np.sign((shown.cameras[1].position - shown.cameras[0].position) @ right) == way or angle > 2.0


def test_half_a_turn_and_a_rest_have_their_last_frame(cube: Scene) -> None:
    assert len(film(cube, {"duration": 1, "moves": [{"move": "turntable", "turns": 0.5}]}).cameras) == 11
    assert len(film(cube, {"duration": 1, "moves": [{"move": "swing"}]}).cameras) == 10
    swing = film(cube, {"duration": 1, "moves": [{"move": "swing", "angle": 40}]}, 8)
    same(swing.cameras[2], seen_from(cube, 40, 0, *SIZE))
    same(swing.cameras[6], seen_from(cube, -40, 0, *SIZE))


@pytest.mark.parametrize("span", [None, 2.5])
def test_a_zoom_ends_where_the_region_fills_the_picture(cube: Scene, span: float | None) -> None:
    scene = replace(cube, camera_rig=replace(cube.rig, span_x=span))
    shown = film(scene, {"duration": 1, "moves": [{"move": "zoom", "region": 0, "fill": 0.5}]})
    place, last = place_of(scene, 0), shown.cameras[10]
    same(shown.cameras[0], seen_from(scene, 0, 0, *SIZE))
    column, row, _ = last.project(place.centre)
    assert (column, row) == pytest.approx((12, 12), abs=1e-6)
    rng = np.random.default_rng(0).normal(size=(4000, 3))
    ball = place.centre + place.radius * rng / np.linalg.norm(rng, axis=1, keepdims=True)
    assert np.ptp(last.project(ball)[0]) == pytest.approx(12, rel=0.05)  # half of 24 pixels
    back = film(scene, {"duration": 1, "moves": [{"move": "zoom", "region": 0, "back": True}]})
    assert len(back.cameras) == 10
    same(back.cameras[5], film(scene, {"duration": 1, "moves": [{"move": "zoom", "region": 0}]}).cameras[10])
    again = film(
        scene, {"duration": 2, "moves": [{"move": "zoom", "region": 0, "duration": 1}, {"move": "zoom", "start": 1}]}
    )
    same(again.moment(20).camera, again.cameras[0])


def test_regions_are_peeled_and_paint_grows_in_turn(cube: Scene, painted: Scene) -> None:
    peel = film(cube, {"duration": 2, "moves": [{"move": "peel", "regions": [2, 0], "easing": "linear"}]})
    seen = np.array([[r.seen_opacity for r in peel.at(k).regions] for k in (0, 5, 10, 15, 20)])
    assert seen[:, 1].tolist() == [1.0] * 5 and seen[0].tolist() == [1.0] * 3 and seen[4].tolist() == [0, 1, 0]
    assert 0 < seen[1, 2] < 1 == seen[1, 0] and seen[2, 2] == 0 and seen[2, 0] == 1
    grow = film(painted, {"duration": 2, "moves": [{"move": "paint", "regions": [2, 0], "easing": "linear"}]})
    assert [grow.at(k).paint_shares.tolist() for k in (0, 5, 20)] == [[0, 0, 0], [0, 0, 0.5], [1, 0, 1]]
    every = film(painted, {"duration": 2, "moves": [{"move": "paint"}]})
    assert every.at(10).paint_shares.tolist() == [0.5, 0, 0.5]


def test_a_cut_sweeps_and_leaves_the_scene_whole_at_its_start(cube: Scene) -> None:
    shown = film(cube, {"duration": 1, "moves": [{"move": "cut", "cut": "x>50%", "easing": "linear"}]})
    assert shown.at(0).cuts == () and shown.at(10).cuts == (Cut.parse("x>50%", cube.bounds),)
    assert shown.at(5).cuts[0].planes[0][3] == pytest.approx(0.25, abs=1e-5)
    pictures = [cube.render(shown.cameras[0]).rgba, shown.at(0).render(shown.cameras[0]).rgba]
    np.testing.assert_array_equal(*pictures)
    hollow = film(cube, {"keys": [{"time": 0}, {"time": 1, "cuts": ["sphere:0,0,0:0.3"]}]})
    start = hollow.moment(0).of(cube)
    np.testing.assert_array_equal(start.render(hollow.cameras[0]).rgba, pictures[0])


def test_a_section_switches_and_its_line_grows(cube: Scene) -> None:
    keys = [{"time": 0, "cuts": ["x>50%"]}, {"time": 1, "regions": {"1": {"section": "hatched", "section_line": 4}}},
            {"time": 2, "regions": {"all": {"section": "flat"}}}]  # fmt: skip
    shown = film(cube, {"keys": keys, "duration": 3})
    seen = [shown.at(k).regions for k in (0, 5, 9, 10, 15, 20, 25)]
    assert [r[1].section for r in seen] == ["learned", "learned", "learned", "hatched", "hatched", "flat", "flat"]
    assert [r[0].section for r in seen] == ["learned"] * 5 + ["flat"] * 2
    assert [r[1].section_line for r in seen[:1] + seen[3:]] == [0.0, 4.0, 4.0, 4.0, 4.0]
    assert 0.0 < seen[1][1].section_line < seen[2][1].section_line < 4.0


def test_moves_and_key_frames_have_no_more_cuts_together_than_a_scene(cube: Scene) -> None:
    many, move = [f"x>{2 + k}" for k in range(16)], {"move": "cut", "cut": "x>1", "start": 0.5}
    with pytest.raises(BadInput, match="At 2 s, the shot has 17 cuts with those of its moves, and a scene has at most"):
        film(cube, {"keys": [{"time": 0}, {"time": 2, "cuts": many}], "moves": [move]})
    fewer = film(cube.cut(*many), {"keys": [{"time": 0, "cuts": []}], "duration": 1, "moves": [move]})
    assert len(fewer.at(10).cuts) == 1


# --- films -----------------------------------------------------------------------------------------------------------

SHOT = svv.read_shot(
    {"keys": [{"time": 0}, {"time": 1, "camera": {"view": [40, 10]}, "regions": {"0": {"opacity": 0.2}}}]}
)


def test_a_film_shows_each_moment_and_goes_on_after_a_stop(
    cube: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Path] = []
    rendered = frames_module._rendered

    def counted(path: Path, *rest: Any) -> Any:
        drawn.append(path)
        return rendered(path, *rest)

    monkeypatch.setattr(frames_module, "_rendered", counted)

    def stop(part: float, label: str) -> None:
        if len(drawn) == 3:
            raise Cancelled

    movie = tmp_path / "film.mp4"
    with pytest.raises(Cancelled):
        render_shot(movie, cube, SHOT, SIZE, fps=5, progress=stop)
    assert not movie.exists() and [p.name for p in tmp_path.iterdir()] == ["film.mp4.frames"]
    kept = sorted(p.name for p in (tmp_path / "film.mp4.frames").iterdir())
    render_shot(movie, cube, SHOT, SIZE, fps=5)
    assert kept[0] == "0000.png" and len(drawn) == 3 + 6 - len(kept)
    assert [p.name for p in tmp_path.iterdir()] == ["film.mp4"]
    render_shot(tmp_path / "again.mp4", cube, SHOT, SIZE, fps=5)
    assert (tmp_path / "again.mp4").read_bytes() == movie.read_bytes()  # drawn at once, or read from files
    folder = tmp_path / "frames"
    render_shot(folder, cube, SHOT, SIZE, RenderSettings(background=(1.0, 1.0, 1.0)), fps=5)
    shown = Film(cube, SHOT, SIZE, 5)
    frames = frames_of(movie)
    assert len(frames) == len(shown.cameras) == 6
    for number, frame in enumerate(frames):
        exact = svv.core.colour.colour.over(shown.at(number).render(shown.cameras[number]).rgba)
        assert np.abs(frame / 255.0 - exact).mean() < 0.03, number
    before = len(drawn)
    write_frames(folder, shown, shown.cameras, RenderSettings(background=(1.0, 1.0, 1.0)))
    assert len(drawn) == before  # they are known by what they show
    other = svv.read_shot(
        {"keys": [{"time": 0}, {"time": 1, "camera": {"view": [40, 10]}, "regions": {"0": {"opacity": 0.3}}}]}
    )
    render_shot(folder, cube, other, SIZE, RenderSettings(background=(1.0, 1.0, 1.0)), fps=5)
    assert len(drawn) == before + 5  # the first one shows the same


def test_memory_does_not_grow_with_the_frames(painted: Scene, tmp_path: Path) -> None:
    """Frame 120 leaves behind what frame 20 did: counted, not timed."""
    last = {"time": 10, "regions": {"all": {"opacity": 0.5}}, "cuts": ["x>50%"]}
    content = {"duration": 12, "keys": [{"time": 0}, last], "moves": [{"move": "turntable"}, {"move": "paint"}]}
    shown = Film(painted, svv.read_shot(content), (2, 2), 10.0)
    counts: dict[int, tuple[int, int, int]] = {}

    def count(part: float, label: str) -> None:
        number = round(part * 121)
        if number in (20, 120) and number not in counts:
            gc.collect()
            caches = view_cache.KEPT
            counts[number] = len(gc.get_objects()), caches.bytes, len(caches._drawn)

    write_frames(tmp_path, shown, shown.cameras, progress=count)
    assert len(list(tmp_path.iterdir())) == len(shown.cameras) == 121
    assert counts[120][0] - counts[20][0] < 50  # less than an object for two frames
    assert counts[120][1:] == counts[20][1:]


def test_a_joined_scene_is_filmed_as_well(cube: Scene) -> None:
    both = joined([cube, cube_scene(1)])
    shown = film(both, {"keys": [{"time": 0}, {"time": 1, "regions": {"4": {"opacity": 0.3}}, "cuts": ["x>50%"]}]})
    exact = both.edited(4, opacity=0.3).cut("x>50%")
    np.testing.assert_array_equal(shown.at(10).render(shown.cameras[10]).rgba, exact.render(shown.cameras[10]).rgba)


def test_a_film_has_a_number_of_frames_that_can_be(cube: Scene, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="has 2592000 frames at 30 a second"):
        Film(cube, svv.read_shot({"duration": 86400, "moves": [{"move": "swing"}]}))
    with pytest.raises(BadInput, match="16 bits"):
        render_shot(tmp_path / "a.mp4", cube, SHOT, SIZE, RenderSettings(what="depth"))
    render_shot(tmp_path / "regions.mp4", cube, SHOT, SIZE, RenderSettings(what="region"), fps=2)
    assert len(frames_of(tmp_path / "regions.mp4")) == 3


def test_the_command_renders_a_shot(cube: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cube.save("cube.svv")
    svv.write_shot("shot.json", SHOT)

    def run(*options: str) -> None:
        app(["render", "cube.svv", "--device", "cpu", *options], prog_name="svv", standalone_mode=False)

    run("--shot", "shot.json", "--size", "32x24", "--fps", "4", "--out", "frames")
    render_shot("same", Scene.load("cube.svv"), SHOT, (32, 24), fps=4)
    for number in range(5):
        assert Path(f"frames/{number:04d}.png").read_bytes() == Path(f"same/{number:04d}.png").read_bytes()
    run("--shot", "shot.json", "--size", "32x24", "--preview", "--out", "preview.mp4")
    assert frames_of(tmp_path / "preview.mp4").shape == (11, 6, 8, 3)
    wrong = {
        ("--orbit", "4"): "--orbit or --shot, not both",
        ("--view", "0,0"): "--view or --shot, not both",
        ("--path", "4"): "leave out --frame and --path",
        ("--play",): "give key frames a step",
        ("--time", "1"): "give key frames a step",
        ("--out", "one.png"): "A shot has many views",
    }
    for options, said in wrong.items():
        with pytest.raises(BadInput, match=said):
            run("--shot", "shot.json", "--out", "other", *options)
    with pytest.raises(BadInput, match="--preview needs --shot"):
        run("--preview", "--out", "other")
    Path("shot.json").write_text('{"keys": [{"time": 1, "regions": {"5": {"opacity": 1}}}]}')
    with pytest.raises(BadInput, match="region '5', but"):
        run("--shot", "shot.json", "--out", "film.mp4")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "cube.svv", "frames", "preview.mp4", "same", "shot.json"
    ]  # fmt: skip


def test_a_region_is_found_where_it_is(balls: Scene) -> None:
    """Two balls of radius .3 at x = -.35 and .35; stray samples around them do not count."""
    places = [place_of(balls, region) for region in range(2)]
    left, right = sorted(places, key=lambda place: place.centre[0])
    for place, x in ((left, -0.35), (right, 0.35)):
        np.testing.assert_allclose(place.centre, (x, 0.0, 0.0), atol=0.06)
        assert 0.24 < place.radius < 0.42


def test_a_name_of_several_regions_is_refused(cube: Scene) -> None:
    scene = cube.edited(0, name="bone").edited(2, name="bone")
    with pytest.raises(BadInput, match="region 'bone', but several regions have that name"):
        film(scene, {"keys": [{"time": 1, "regions": {"bone": {"opacity": 0.5}}}]})
    assert film(scene, {"keys": [{"time": 1, "regions": {"2": {"opacity": 0.5}}}]}).at(10).regions[2].opacity == 0.5
