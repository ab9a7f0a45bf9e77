"""Views are kept while a scene is edited: the same images, and none that no longer holds."""

from __future__ import annotations

import copy
import gc
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import svv.fields.scene.images as of_images
from svv.core.geometry.cameras import Camera
from svv.errors import BadInput
from svv.fields.radiance.cutting import march_uncut
from svv.fields.radiance.rendering import Rays
from svv.fields.scene import view_cache
from svv.fields.scene.scene import Rendering, Scene
from svv.fields.scene.view_cache import KEPT, Look, View, ViewCache, bytes_of, disable_view_cache
from svv.kernels.types import Samples
from svv.render.frames import write_frames, write_frames_of
from tests.cube import cube_camera, cube_paint, cube_scene, lit_cube_scene

FACTORS = st.floats(0.0, 2.0)
COLOURS = st.none() | st.tuples(*[st.floats(0.0, 1.0)] * 3)


@pytest.fixture(autouse=True)
def of_their_own(monkeypatch: pytest.MonkeyPatch) -> ViewCache:
    """Each test has its own kept views."""
    own = ViewCache()
    monkeypatch.setattr(view_cache, "KEPT", own)
    return own


def painted_cube() -> Scene:
    scene = cube_scene()
    regions = (replace(scene.regions[0], style="noise", strength=0.7), *scene.regions[1:])
    return still(replace(scene, styled=cube_paint(scene, 3), regions=regions))


def still(scene: Scene) -> Scene:
    """The scene, no longer trained."""
    for network in (scene.base, scene.palette_network, scene.styled):
        if network is not None:
            network.requires_grad_(False)
    return scene


SCENES = {"cube": lambda: still(cube_scene()), "lit": lambda: still(lit_cube_scene()), "painted": painted_cube}


def fresh(scene: Scene, camera: Camera) -> Rendering:
    """The image, of which nothing is known."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(view_cache, "KEPT", ViewCache())
        return scene.render(camera)


def assert_same(one: Rendering, other: Rendering) -> None:
    np.testing.assert_array_equal(one.rgba, other.rgba)
    np.testing.assert_array_equal(one.depth, other.depth)
    np.testing.assert_array_equal(one.region, other.region)


@pytest.fixture
def marched(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of rays that have been marched."""
    rays: list[int] = []

    def counted(first: Rays, *rest: Any, **named: Any) -> Samples:
        rays.append(len(first))
        return march_uncut(first, *rest, **named)

    monkeypatch.setattr(of_images, "march_uncut", counted)
    return rays


@pytest.mark.parametrize("name", SCENES)
def test_the_third_image_of_a_view_marches_no_ray(name: str, marched: list[int]) -> None:
    scene, camera = SCENES[name](), cube_camera()
    first = scene.render(camera)
    for _ in range(2):
        assert marched
        assert_same(scene.render(camera), first)
    marched.clear()
    assert_same(scene.render(camera), first)
    brighter = scene.edited(1, lighting=1.5)
    assert_same(brighter.render(camera), fresh(scene.edited(1, lighting=1.5), camera))


@pytest.fixture(scope="module")
def scenes() -> Mapping[str, Scene]:
    """One of each for all examples, of whose images some are kept."""
    return {name: make() for name, make in SCENES.items()}


@settings(max_examples=25)
@given(
    edits=st.lists(st.tuples(st.integers(0, 2), FACTORS, FACTORS, COLOURS), max_size=4),
    name=st.sampled_from(["cube", "lit", "painted"]),
)
def test_after_any_edits_an_image_is_the_one_of_which_nothing_is_known(
    scenes: Mapping[str, Scene], edits: list[tuple[int, float, float, tuple[float, float, float] | None]], name: str
) -> None:
    scene, camera = scenes[name], cube_camera(12)
    for _ in range(2):
        scene.render(camera)
    for region, lighting, opacity, colour in edits:
        colour = None if scene.regions[region].style else colour
        scene = scene.edited(region, lighting=lighting, opacity=opacity, colour=colour)
        scene.render(camera)
        assert_same(scene.render(camera), fresh(scene, camera))


@pytest.mark.parametrize("part", ["density", "features", "palette", "weights"])
def test_a_changed_network_is_seen(part: str) -> None:
    scene, camera = still(cube_scene()), cube_camera()
    for _ in range(3):
        before = scene.render(camera)
    assert scene.base.density is not None and scene.palette_network is not None
    tables: dict[str, torch.Tensor] = {
        "density": scene.base.density.table,
        "features": scene.base.encoding.table,
        "palette": scene.palette_network.encoding.table,
        "weights": next(scene.palette_network.palette_mlp.parameters()),
    }
    tables[part].mul_(0.3)
    after = scene.render(camera)
    assert_same(after, fresh(scene, camera))
    assert not np.array_equal(after.rgba, before.rgba)


def test_a_network_in_the_place_of_another_is_seen() -> None:
    scene, camera = still(cube_scene()), cube_camera()
    for _ in range(3):
        scene.render(camera)
    other = replace(scene, palette_network=copy.deepcopy(scene.palette_network))
    assert other.palette_network is not None
    other.palette_network.encoding.table.mul_(-1.0)
    assert_same(other.render(camera), fresh(other, camera))
    assert_same(scene.render(camera), fresh(scene, camera))


def test_changed_paint_is_seen() -> None:
    scene, camera = painted_cube(), cube_camera()
    for _ in range(3):
        before = scene.render(camera)
    assert scene.styled is not None
    scene.styled.encoding.table.mul_(-1.0)
    assert_same(scene.render(camera), fresh(scene, camera))
    other = replace(scene, styled=cube_paint(scene, 8).requires_grad_(False))
    after = other.render(camera)
    assert_same(after, fresh(other, camera))
    assert not np.array_equal(after.rgba, before.rgba)


def test_another_view_is_marched(marched: list[int]) -> None:
    scene, camera = still(cube_scene()), cube_camera()
    for _ in range(3):
        scene.render(camera)
    turned = replace(camera, fov_x=1.1 * camera.fov_x)
    shifted = replace(camera, centre=(camera.width / 2 + 1.0, camera.height / 2))
    for changed, view in (
        (scene, turned),
        (scene, shifted),
        (replace(scene, joined=0.2), camera),
        (replace(scene, stride=2.0), camera),
        (scene.edited(0, opacity=0.4), camera),
    ):
        marched.clear()
        got = changed.render(view)
        assert marched
        assert_same(got, fresh(changed, view))


def test_what_is_being_trained_is_not_kept(of_their_own: ViewCache) -> None:
    scene = cube_scene()
    assert scene.palette_network is not None
    scene.palette_network.requires_grad_(True)
    for _ in range(3):
        scene.render(cube_camera())
    assert not of_their_own.bytes


def test_views_go_with_their_scene() -> None:
    with pytest.MonkeyPatch.context() as patch:
        own = ViewCache()
        patch.setattr(view_cache, "KEPT", own)
        scene = still(cube_scene())
        for _ in range(2):
            scene.render(cube_camera())
        assert own.bytes > 0
        del scene
        gc.collect()
        assert not own.bytes


def some_look(samples: int) -> Look:
    position, one = torch.zeros(samples, 3), torch.zeros(samples)
    number = torch.zeros(1, dtype=torch.int64)
    return Look(Samples(position, one, one, one.int(), number, number, one[:1], 0.1), torch.zeros(samples, 9), None)


def drawn(kept: ViewCache, key: str, looks: list[Look], monkeypatch: pytest.MonkeyPatch) -> int:
    """Draw a view of these looks; returns how many were made."""
    monkeypatch.setattr(view_cache, "KEPT", kept)
    view, made = View(key), 0

    def make(look: Look) -> Look:
        nonlocal made
        made += 1
        return look

    for first, look in enumerate(looks):
        view.look(first, partial(make, look))
    view.drawn()
    return made


def test_only_what_fits_into_memory_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    one = some_look(100)
    kept = ViewCache(most=2 * one.bytes)
    assert [drawn(kept, "a", [one], monkeypatch) for _ in range(3)] == [1, 1, 0]
    assert [drawn(kept, "b", [one], monkeypatch) for _ in range(3)] == [1, 1, 0]
    assert drawn(kept, "a", [one], monkeypatch) == 0
    assert [drawn(kept, "c", [one], monkeypatch) for _ in range(3)] == [1, 1, 0], "b was the oldest"
    assert drawn(kept, "b", [one], monkeypatch) == 1
    assert [drawn(kept, "large", [one] * 3, monkeypatch) for _ in range(3)] == [3, 3, 3]
    assert drawn(kept, "c", [one], monkeypatch) == 0, "what is too large takes no other's place"
    assert kept.bytes <= kept.most


def test_a_view_that_was_not_finished_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = ViewCache()
    monkeypatch.setattr(view_cache, "KEPT", kept)
    View("a").drawn()
    View("a").look(0, lambda: some_look(3))  # stopped here
    assert not kept.bytes


def test_a_view_in_which_nothing_is_visible_is_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    assert bytes_of({0: None}) == 0
    kept = ViewCache()
    monkeypatch.setattr(view_cache, "KEPT", kept)
    for _ in range(3):
        view = View("empty")
        assert view.look(0, lambda: None) is None
        view.drawn()


def test_orbits_are_not_kept(of_their_own: ViewCache) -> None:
    scene = still(cube_scene())
    for size in range(8, 20):
        scene.render(cube_camera(size))
    assert not of_their_own.bytes
    assert KEPT is not of_their_own


def test_what_is_measured_is_drawn_anew(marched: list[int], of_their_own: ViewCache) -> None:
    scene, camera = still(cube_scene()), cube_camera()
    for _ in range(3):
        first = scene.render(camera)
    marched.clear()
    with disable_view_cache():
        assert_same(scene.render(camera), first)
    assert marched
    marched.clear()
    scene.render(camera)
    assert not marched
    of_their_own.forget(-1)
    assert of_their_own.bytes


def test_frames_of_edits_and_paintings_of_a_scene_march_each_view_once(tmp_path: Path, marched: list[int]) -> None:
    """Also if the scenes come from files of their own; and the files are those of each scene alone."""
    scene, cameras = painted_cube(), [cube_camera(20), cube_camera(28)]
    scenes = {
        "plain": scene,
        "edited": scene.edited(1, lighting=1.5),
        "again": replace(scene, base=copy.deepcopy(scene.base), palette_network=copy.deepcopy(scene.palette_network)),
    }
    with disable_view_cache():
        alone = {name: write_frames(tmp_path / "alone" / name, one, cameras) for name, one in scenes.items()}
    marched.clear()
    write_frames_of({tmp_path / name: one for name, one in scenes.items()}, cameras)
    assert len(marched) == len(cameras)
    for name, paths in alone.items():
        for path in paths:
            assert (tmp_path / name / path.name).read_bytes() == path.read_bytes()
    assert view_cache.KEPT.bytes == 0
    marched.clear()
    write_frames_of({tmp_path / name: one for name, one in scenes.items()}, cameras)
    assert not marched  # they are there


def test_frames_of_other_networks_are_their_own(tmp_path: Path) -> None:
    scene, camera = still(cube_scene()), cube_camera()
    other = replace(scene, palette_network=copy.deepcopy(scene.palette_network))
    assert other.palette_network is not None
    other.palette_network.encoding.table.mul_(-1.0)
    write_frames_of({tmp_path / "one": scene, tmp_path / "other": other}, [camera])
    (alone,) = write_frames(tmp_path / "alone", other, [camera])
    assert (tmp_path / "other" / alone.name).read_bytes() == alone.read_bytes()
    assert (tmp_path / "one" / alone.name).read_bytes() != alone.read_bytes()


def test_a_frame_that_cannot_be_written_ends_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files are written beside the next image: its error must neither be lost nor wait until all others are drawn."""
    scene, cameras = still(cube_scene()), [cube_camera(size) for size in (16, 17, 18, 19)]

    def full(path: Path, *rest: object) -> None:
        raise BadInput(f"Cannot write {path}: the disk is full.")

    monkeypatch.setattr("svv.render.frames.write_png", full)
    drawn: list[float] = []
    with pytest.raises(BadInput, match=r"0000\.png: the disk is full"):
        write_frames(tmp_path, scene, cameras, progress=lambda fraction, label: drawn.append(fraction))
    assert max(drawn) <= 0.5  # the second image was drawn beside it, and no other
