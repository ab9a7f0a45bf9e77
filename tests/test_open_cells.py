"""What images leap where regions are cut off or hidden changes nothing that they show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import svv.fields.scene.images as of_images
from svv.core.geometry.cameras import Camera, look_at
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.open_cells import open_cells_of
from svv.fields.scene.scene import Rendering, Scene
from svv.kernels.types import UNSURE
from tests.cube import cube_scene, lit_cube_scene

SHAPES = ("x>20%", "plane:0,0.1,0:1,2,-1", "outside sphere:0.1,0,0.2:0.4", "cylinder:0,0.1,0:1,0.5,0:0.25")


def opaque(scene: Scene, factor: float) -> Scene:
    for region in range(len(scene.regions)):
        scene = scene.edited(region, opacity=factor)
    return replace(scene, joined=0.0)


def smooth(scene: Scene) -> Scene:
    """The scene with regions that are larger than its cells."""
    assert scene.palette_network is not None and isinstance(scene.palette_network.encoding, SparseLattice)
    with torch.no_grad():
        encoding = scene.palette_network.encoding
        encoding.table[encoding.rows_of_level(1)] = 0.0
    return scene


def without_leaping(scene: Scene, camera: Camera) -> Rendering:
    """The image that looks at every sample."""
    how = of_images.marching_as_edited

    def endless(one: Any, network: str) -> Marching:
        return replace(how(one, network), fade=0.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(of_images, "open_cells_of", lambda _: None)
        patch.setattr(of_images, "key_of", lambda *_: None)
        patch.setattr(of_images, "marching_as_edited", endless)
        return scene.render(camera, "pcn")


@given(
    st.sampled_from((cube_scene, lit_cube_scene)), st.sampled_from((0.1, 1.0, 30.0)),
    st.lists(st.tuples(st.integers(0, 2), st.sampled_from(SHAPES)), max_size=3), st.sets(st.integers(0, 2), max_size=2),
    st.tuples(*[st.floats(-1.0, 1.0)] * 3),
)  # fmt: skip
@settings(deadline=None, max_examples=25)
def test_what_is_leapt_is_not_seen(
    make: Callable[[], Scene], factor: float, cuts: list[tuple[int, str]], hidden: set[int], eye: tuple[float, ...]
) -> None:
    if np.linalg.norm(eye) < 0.3:
        return
    scene = opaque(smooth(make()), factor).cut(*(f"{k}={shape}" for k, shape in cuts))
    scene = scene.hidden(*hidden) if hidden else scene
    camera = Camera(look_at(3.0 * np.array(eye) / np.linalg.norm(eye), (0.0, 0.0, 0.0)), 0.5, 16, 16)
    leapt, brute = scene.render(camera, "pcn"), without_leaping(scene, camera)
    # Pieces of rays begin at faces, so samples there lie elsewhere; there are few cells, and faces are many.
    difference = np.abs(leapt.rgba[..., 3] - brute.rgba[..., 3])
    assert float(difference.mean()) < (0.03 if cuts else 0.01)


def test_cells_of_hidden_regions_are_not_marched() -> None:
    scene = opaque(cube_scene(), 1.0)
    assert open_cells_of(scene) is None and open_cells_of(scene.cut("x>50%")) is None
    every = open_cells_of(scene.hidden(0, 1, 2))
    assert every is not None and not every.there.occupied.any() and not bool(every.kept.any())
    assert not scene.hidden(0, 1, 2).render(cube(), "pcn").rgba.any()
    none = open_cells_of(scene.cut("0,1,2=x>2"))  # a plane that misses
    assert none is not None and none.there.occupied.all() and bool(none.kept.all())
    half = open_cells_of(scene.cut("0,1,2=x>50%"))
    assert half is not None
    assert half.there.occupied[:2].all() and not half.there.occupied[3:].any() and not bool(half.kept[2:].any())


def test_open_cells_are_remembered_until_what_is_shown_changes() -> None:
    scene = cube_scene()
    one = open_cells_of(scene.hidden(1))
    assert open_cells_of(scene.hidden(1).edited(0, colour=(0.0, 1.0, 0.0))) is one
    assert open_cells_of(scene.hidden(2)) is not one


def test_cells_found_for_other_cuts_before_are_those_of_a_new_scene() -> None:
    """What is kept of a scene's regions does not depend on where a cut was."""
    scene = opaque(cube_scene(), 1.0)
    edits: tuple[Callable[[Scene], Scene], ...] = (
        lambda s: s.cut("1=x>50%"), lambda s: s.cut("1=x>20%"), lambda s: s.cut("0,2=y>40%", "1=x>50%"),
        lambda s: s.hidden(1), lambda s: s.hidden(1).cut("2=z>10%"), lambda s: s.cut("1=x>50%"),
    )  # fmt: skip
    for edit in edits:
        known, new = open_cells_of(edit(scene)), open_cells_of(edit(opaque(cube_scene(), 1.0)))
        assert known is not None and new is not None
        np.testing.assert_array_equal(known.there.occupied, new.there.occupied)
        assert torch.equal(known.kept, new.kept) and torch.equal(known.distance, new.distance)
        sure = known.distance[0] == 0
        assert torch.equal(sure, known.kept)
        assert torch.equal((known.distance[0] == UNSURE) | sure, torch.from_numpy(known.there.occupied > 0))


def cube() -> Camera:
    return Camera(look_at((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)), 0.5, 16, 16)
