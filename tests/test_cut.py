"""Cutting baked volumes."""

from __future__ import annotations

import numpy as np
import pytest

from svv.core.volumes.opacity_code import depths
from svv.render.baking.baked import bake
from svv.render.baking.baked_volume import BakedVolume
from svv.render.baking.cut import cut
from svv.render.baking.voxels import Grid
from tests.cube import cube_scene

SIZE, SPACING = 24, 0.25


def block(code: int, most: float = 2.0) -> BakedVolume:
    """A block of one extinction, with a denser corner far away that has the code 255."""
    rgba = np.full((SIZE, SIZE, SIZE, 4), code, np.uint8)
    rgba[..., 3] = code
    rgba[0, 0, 0, 3] = 255
    grid = Grid(SIZE, (SIZE,) * 3, (0, 0, 0), (1.0, -2.0, 3.0), SPACING)
    return BakedVolume(rgba, grid, most, (np.array([[0.0, 255.0]] * 4), (0.0, 510.0)))


def along_x(volume: BakedVolume, y: int, z: int) -> float:
    """Length of the block along a line of the grid, voxels: its optical depth, relative to that of a voxel."""
    fine = np.linspace(0.0, SIZE - 1, 40 * (SIZE - 1) + 1)
    codes = np.interp(fine, np.arange(SIZE), volume.rgba[z, y, :, 3].astype(float))
    table = depths(volume.most)
    depth = np.interp(codes, np.arange(256), table)
    return float(depth.mean() * (SIZE - 1) / table[volume.rgba[z, y, 0, 3]])


@pytest.mark.parametrize("normal", [(1.0, 0.0, 0.0), (0.8, 0.5, 0.3), (2.0, -1.0, 0.5)])
@pytest.mark.parametrize("code", [60, 160])
def test_what_is_left_ends_at_the_surface(normal: tuple[float, float, float], code: int) -> None:
    through = np.array((1.0, -2.0, 3.0)) + SPACING * np.array((12.3, 11.6, 12.1))
    left = cut(block(code), lambda at: (at - through) @ np.array(normal))
    for y, z in ((9, 9), (12, 12), (14, 11), (16, 9)):
        there = 12.3 - ((y - 11.6) * normal[1] + (z - 12.1) * normal[2]) / normal[0]
        assert along_x(left, y, z) == pytest.approx(there, abs=0.5), (y, z)


def test_a_curved_surface_and_its_other_side() -> None:
    centre = np.array((1.0, -2.0, 3.0)) + SPACING * 12.0

    def ball(at: np.ndarray) -> np.ndarray:
        return np.square(at - centre).sum(1) - (6.0 * SPACING) ** 2

    index = np.stack(np.meshgrid(*[np.arange(SIZE)] * 3, indexing="ij"), axis=3)
    far = np.linalg.norm(index - 12.0, axis=3)
    for sign in (1.0, -1.0):
        left = cut(block(160), ball if sign > 0 else lambda at: -ball(at)).rgba[..., 3]
        assert not left[sign * (far - 6.0) > 4.0].any()  # e^-12 of it is below the least code
        assert (left[sign * (far - 6.0) < -0.6] > 0).all()


def test_the_densest_point_that_is_left_has_the_largest_code() -> None:
    whole = bake(cube_scene())
    left = cut(whole, lambda at: at[:, 2])  # the back half
    codes, kept = left.rgba[..., 3], whole.rgba[..., 3].copy()
    assert codes.max() == 255 == left.ranges[0][3, 1] and (whole.rgba[..., :3] == left.rgba[..., :3]).all()
    assert codes[:4].any() and depths(left.most)[codes[7:]].max() < 1e-3 * depths(whole.most)[kept[7:]].max()
    before, after = (np.log(depths(v.most)[c[:4]] + 1e-9) for v, c in ((whole, kept), (left, codes)))
    assert np.abs(before - after).max() < 0.06  # a step of the code
    assert (whole.rgba[..., 3] == kept).all(), "the volume itself was changed"
    nothing = cut(whole, lambda at: 3.0 + at[:, 0])
    assert nothing.empty
