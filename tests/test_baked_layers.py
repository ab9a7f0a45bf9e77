"""Baked volumes of joined scenes: extinctions add, colours mix by them, and each function can be seen alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, look_at
from svv.core.volumes.opacity_code import depths
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.options.baking import BakeOptions
from svv.render.baking.baked import Baker, bake, grid_for
from svv.render.baking.baked_volume import BakedVolume, summed
from svv.render.baking.voxels import Grid, grid_around
from tests.baked_views import BakedCaster
from tests.cube import cube_scene
from tests.loose_balls import LEFT, RIGHT, TOP, loose_balls


def extinction(volume: BakedVolume) -> np.ndarray:
    """Extinction of each point, 1 / world unit. (Z, Y, X)"""
    return (depths(volume.most) / volume.grid.unit_distance)[volume.rgba[..., 3]]


def balls(*centres: tuple[float, float, float], colour: tuple[float, float, float]) -> Scene:
    return loose_balls(centres).edited(0, colour=colour, opacity=0.1)


@pytest.fixture(scope="module")
def both() -> Scene:
    return joined([balls(LEFT, RIGHT, colour=(0.9, 0.1, 0.1)), balls(RIGHT, TOP, colour=(0.1, 0.1, 0.9))])


def test_extinctions_add_and_colours_mix(both: Scene) -> None:
    whole, one, two = (bake(s) for s in (both, both.hidden(2, 3), both.hidden(0, 1)))
    assert whole.grid == one.grid == two.grid == grid_for(both, BakeOptions())
    sums = extinction(one) + extinction(two)
    seen = sums > 0.01 * sums.max()
    np.testing.assert_allclose(extinction(whole)[seen], sums[seen], rtol=0.06)  # half a code is 3 %, of each
    mixed = extinction(one)[..., None] * one.rgba[..., :3] + extinction(two)[..., None] * two.rgba[..., :3]
    np.testing.assert_allclose(whole.rgba[seen][:, :3], mixed[seen] / sums[seen, None], atol=8)
    overlap = (extinction(one) > 1.0) & (extinction(two) > 1.0)
    assert overlap.any() and (whole.rgba[overlap][:, [0, 2]].min(axis=1) > 60).all(), "red and blue make purple"


def test_vtk_draws_what_we_draw(both: Scene) -> None:
    camera = Camera.orthographic(look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)), 1.0, 64, 64)
    drawn, ours = BakedCaster(bake(both)).render(camera).astype(float) / 255, both.render(camera).rgba
    assert np.abs(drawn[..., 3] - ours[..., 3]).mean() < 0.01
    inside = ours[..., 3] > 0.2
    assert np.abs(drawn[..., :3] - ours[..., :3])[inside].mean() < 0.02


def test_functions_in_other_boxes_stay_where_they_are() -> None:
    """A shifted box of another size: the points of its volume lie between those of the first."""
    first, second = balls(LEFT, colour=(0.9, 0.1, 0.1)), balls(TOP, colour=(0.1, 0.1, 0.9))
    moved = replace(second, occupancy=replace(second.occupancy, box=Box((-0.3, -0.3, -0.41), 0.8, (1.0,) * 3)))
    whole = joined([first, moved])
    volume = bake(whole)
    camera = Camera.orthographic(look_at((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)), 1.4, 64, 64)
    drawn, ours = BakedCaster(volume).render(camera).astype(float) / 255, whole.render(camera).rgba
    assert np.abs(drawn[..., 3] - ours[..., 3]).mean() < 0.01
    small = bake(whole, BakeOptions(memory=5e-5))
    assert small.rgba.nbytes <= 50_000 and small.grid.spacing > volume.grid.spacing
    everything = np.array([*first.occupancy.box.bounds, *moved.occupancy.box.bounds])
    end = np.add(small.grid.origin, small.grid.spacing * (np.array(small.grid.shape) - 1))
    assert (np.array(small.grid.origin) >= everything.min(0) - small.grid.spacing).all()
    assert (end <= everything.max(0) + small.grid.spacing).all()


def test_a_volume_is_its_own_sum_and_ranges_are_those_of_the_bytes(both: Scene) -> None:
    alone = bake(cube_scene())
    again = summed([alone], alone.grid)
    np.testing.assert_array_equal(again.rgba[..., 3], alone.rgba[..., 3])
    seen = alone.rgba[..., 3] > 0
    np.testing.assert_array_equal(again.rgba[seen], alone.rgba[seen])
    for volume in (again, bake(both), bake(both.hidden(0, 1, 2, 3))):
        flat = volume.rgba.reshape(-1, 4).astype(np.float64)
        assert np.array_equal(volume.ranges[0], np.stack([flat.min(axis=0), flat.max(axis=0)], axis=1))
        assert volume.ranges[1] == pytest.approx((0.0, np.linalg.norm(flat, axis=1).max()))
    assert bake(both.hidden(0, 1, 2, 3)).empty


def test_only_the_function_that_was_edited_is_baked_again(both: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    baker, options = Baker(), BakeOptions()
    baker.bake(both, options)
    worked: list[int] = []
    plain = Baker.bake

    def counted(self: Baker, scene: Scene, *rest: object) -> BakedVolume:
        worked.append(len(scene.regions))
        return plain(self, scene, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(Baker, "bake", counted)
    baker.bake(both.edited(2, opacity=0.3), options)
    assert worked == [4, 2]


@settings(max_examples=50)
@given(
    st.lists(
        st.tuples(
            st.tuples(*[st.integers(2, 40)] * 3), st.tuples(*[st.floats(-1, 1)] * 3), st.floats(0.01, 0.1)
        ),
        min_size=1, max_size=4,
    ),
    st.floats(1e-5, 1e-2),
)  # fmt: skip
def test_the_grid_holds_all_within_memory(parts: list, memory: float) -> None:
    grids = [Grid(round(1 / spacing), shape, (0, 0, 0), origin, spacing) for shape, origin, spacing in parts]
    grid = grid_around(grids, memory)
    assert 4 * grid.points <= memory * 1e9
    end = np.add(grid.origin, grid.spacing * (np.array(grid.shape) - 1))
    for own in grids:
        assert (np.array(grid.origin) <= np.array(own.origin) + 1e-5).all()
        assert (end >= np.add(own.origin, own.spacing * (np.array(own.shape) - 1)) - 1e-5).all()
    assert grid.spacing >= min(own.spacing for own in grids)
