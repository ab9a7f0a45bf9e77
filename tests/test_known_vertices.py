"""Vertices that are known from other views: an image is what it would be without them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch

from svv.core.geometry.cameras import Camera
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.scene import known_vertices
from svv.fields.scene.image import both_tables
from svv.fields.scene.known_vertices import KnownVertices
from svv.fields.scene.scene import Scene
from svv.fields.scene.vertices import _alone
from svv.kernels.numba import image, vertices
from svv.kernels.numba.bfloat16 import LEAST_SAMPLES
from svv.render.frames import orbit
from tests.cube import cube_scene


def scene_anew(headlight: str = "axis") -> Scene:
    """A cube of which no vertex is known; every call returns the same one."""
    scene = cube_scene()
    for network in (scene.base, scene.palette_network):
        assert network is not None
        network.requires_grad_(False)
    return replace(scene, vertices_a_cell=1, settings=replace(scene.settings, headlight=headlight))


def cameras() -> list[Camera]:
    return list(orbit(cube_scene(), 12, 200, 200))[:3]


def image_of(scene: Scene, camera: Camera) -> np.ndarray:
    return scene.render(camera, network="pcn").rgba


@pytest.mark.parametrize("headlight", ["axis", "point"])
def test_an_image_does_not_depend_on_the_views_drawn_before(headlight: str) -> None:
    scene = scene_anew(headlight)
    for camera in cameras():
        np.testing.assert_array_equal(image_of(scene, camera), image_of(scene_anew(headlight), camera))


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_an_image_does_not_depend_on_how_many_are_kept(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """None are, if a view needs more than that; or those of some views, which others replace."""
    counts, ask = [], KnownVertices.rows_of

    def counted(self: KnownVertices, places: torch.Tensor, *others: object) -> object:
        counts.append(len(places))
        return ask(self, places, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(KnownVertices, "rows_of", counted)
    expected = [image_of(fine(scene_anew()), camera) for camera in cameras()]
    most = int(share * max(counts))
    for module in ("svv.fields.scene.vertices", "svv.fields.scene.known_vertices"):
        monkeypatch.setattr(f"{module}.MOST", most)
    scene = fine(scene_anew())
    for camera, exact in zip(cameras(), expected, strict=True):
        np.testing.assert_array_equal(image_of(scene, camera), exact)
    assert len(set(counts)) > 1 and len(counts) == (3 if share < 1.0 else 6)


def fine(scene: Scene) -> Scene:
    """The scene with so many vertices that views need different ones, and that all are asked in half precision."""
    return replace(scene, vertices_a_cell=4)


def test_networks_that_change_are_asked_again() -> None:
    scene, camera = scene_anew(), cameras()[0]
    before = image_of(scene, camera)
    assert scene.palette_network is not None
    with torch.no_grad():
        scene.palette_network.encoding.table.mul_(0.5)
    assert np.abs(image_of(scene, camera) - before).max() > 0.01
    with torch.no_grad():
        scene.palette_network.encoding.table.mul_(2.0)
    np.testing.assert_array_equal(image_of(scene, camera), before)


def test_threads_may_draw_a_scene_together() -> None:
    expected = [image_of(scene_anew(), camera) for camera in cameras()]
    scene = scene_anew()
    with ThreadPoolExecutor(3) as pool:
        drawn = list(pool.map(lambda camera: image_of(scene, camera), cameras() * 3))
    for found, exact in zip(drawn, expected * 3, strict=True):
        np.testing.assert_array_equal(found, exact)


@pytest.mark.parametrize("one", [True, False])
def test_features_and_light_apart_are_what_networks_say_at_once(one: bool) -> None:
    palette, geometry = scene_anew().palette_network, scene_anew().base.encoding
    assert palette is not None and palette.lighting_mlp is not None
    assert isinstance(palette.encoding, SparseLattice) and isinstance(geometry, SparseLattice)
    generator = torch.Generator().manual_seed(3)
    position = torch.rand(LEAST_SAMPLES + 5, 3, generator=generator)
    along = torch.nn.functional.normalize(torch.rand(len(position), 3, generator=generator) - 0.5, dim=1)
    along = along[:1].expand(len(position), 3).contiguous() if one else along
    tables, layout = both_tables(geometry.table, palette.encoding), geometry.layout
    networks = [[w.detach() for w in part.weights] for part in (palette.lighting_mlp, palette.palette_mlp)]
    light, raw = image.looks(_alone(position), along, layout, tables, *networks)
    features, apart = vertices.unlit(position, layout, tables, networks[1])
    order = torch.randperm(len(position), generator=generator)
    np.testing.assert_array_equal(apart.numpy(), raw.numpy())
    found = vertices.light(features, order.int(), along[order].contiguous(), networks[0])
    np.testing.assert_array_equal(found.numpy(), light[order].numpy())


def test_only_new_vertices_are_asked_about(monkeypatch: pytest.MonkeyPatch) -> None:
    known, asked = KnownVertices((4, 5, 6)), []

    def unlit(position: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        asked.append(position[:, 0].tolist())
        return position, 2.0 * position

    def ask(*places: int) -> None:
        at = torch.tensor(places, dtype=torch.int32)
        position = at[:, None].float().expand(-1, 3)
        rows, features, raw = known.rows_of(at, position, unlit)
        np.testing.assert_array_equal(features[rows], position)
        np.testing.assert_array_equal(raw[rows], 2.0 * position)

    monkeypatch.setattr(known_vertices, "MOST", 6)
    ask(3, 5, 119)
    ask(0, 3, 5)
    ask(3, 119)
    assert asked == [[3.0, 5.0, 119.0], [0.0]]
    ask(7, 8, 9, 10)  # all others make room
    ask(3, 7)
    assert asked[2:] == [[7.0, 8.0, 9.0, 10.0], [3.0]]
