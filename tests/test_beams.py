"""Image tiles whose rays miss everything are skipped, and no tile is skipped through which something is visible."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, look_at
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, RayCaster, march
from svv.fields.scene.scene import Scene
from svv.kernels.dispatch import CPU
from svv.kernels.numba import kernels as numba_kernels

pytestmark = pytest.mark.usefixtures("all_threads")

BOX = Box((-2.0, 1.0, 0.0), 3.0, (1.0, 0.9, 0.75))


def occupancy_of(seed: int, share: float) -> Occupancy:
    occupied = (np.random.default_rng(seed).random((16, 15, 12)) < share).astype(np.uint8)
    return Occupancy(BOX, 16, occupied)


def camera_at(seed: int, away: float, fov: float, width: int, height: int) -> Camera:
    """Somewhere at ``away`` box units from the middle, looking about there; within the box where that is small."""
    draw = np.random.default_rng(seed)
    middle, place, towards = BOX.bounds.mean(axis=0), draw.normal(size=3), draw.normal(size=3)
    place *= away * BOX.size / np.linalg.norm(place)
    return Camera(look_at(middle + place, middle + 0.3 * BOX.size * towards, (0.0, 0.0, 1.0)), fov, width, height)


@given(
    st.integers(0, 10**6), st.sampled_from([0.0005, 0.01, 0.3]), st.floats(0.05, 4.0), st.floats(0.1, 2.4),
    st.integers(1, 61), st.integers(1, 61), st.none() | st.floats(0.1, 6.0),
    st.none() | st.tuples(st.floats(-60.0, 120.0), st.floats(-60.0, 120.0)),
)  # fmt: skip
def test_no_ray_that_meets_something_is_left_out(
    seed: int, share: float, away: float, fov: float, width: int, height: int, span: float | None,
    centre: tuple[float, float] | None,
) -> None:  # fmt: skip
    occupancy, camera = occupancy_of(seed, share), camera_at(seed, away, fov, width, height)
    camera = replace(camera, span_x=span, centre=centre)
    caster = RayCaster([camera], BOX, CPU)
    meets = march(caster.view(0), occupancy, None, Marching(1 / 64)).count > 0
    in_sight = caster.in_sight(occupancy)
    assert len(in_sight.unique()) == len(in_sight)
    assert np.isin(torch.nonzero(meets)[:, 0], in_sight).all()


@pytest.mark.parametrize("span", [None, 6.0])
def test_most_of_an_image_of_little_is_left_out(span: float | None) -> None:
    occupied = np.zeros((16, 15, 12), np.uint8)
    camera = replace(camera_at(1, 2.0, 0.8, 200, 200), span_x=span)
    assert len(RayCaster([camera], BOX, CPU).in_sight(Occupancy(BOX, 16, occupied))) == 0
    occupied[8, 7, 6] = 1
    caster, little = RayCaster([camera], BOX, CPU), Occupancy(BOX, 16, occupied)
    meets = march(caster.view(0), little, None, Marching(1 / 64)).count > 0
    assert 0 < int(meets.sum()) < len(caster.in_sight(little)) < 0.1 * 200 * 200


@pytest.mark.parametrize(("away", "span"), [(0.2, None), (1.5, None), (1.5, 4.0)])
def test_images_are_those_of_all_pixels(away: float, span: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    occupancy = occupancy_of(5, 0.02)
    torch.manual_seed(0)
    settings = FieldSettings(resolutions=(8, 16), width=16)
    base = BaseField(settings, occupancy)
    assert isinstance(base.density, SparseLattice)
    with torch.no_grad():
        base.density.table.fill_(1.5)
    base.encoding.randomize(1.0, torch.Generator().manual_seed(0))
    scene = Scene(settings, occupancy, Marching(1 / 32), base.requires_grad_(False))
    camera = replace(camera_at(3, away, 1.0, 75, 50), span_x=span)
    monkeypatch.setattr(numba_kernels, "RAYS", 1000)  # so that there are several pieces
    image = scene.render(camera)
    monkeypatch.setattr(RayCaster, "in_sight", lambda self, _: torch.arange(self.width * self.height))
    whole = scene.render(camera)
    assert np.isfinite(whole.depth).any()
    np.testing.assert_allclose(image.rgba, whole.rgba, atol=1e-6)  # other batches may be added up in another order
    np.testing.assert_array_equal(image.region, whole.region)
    np.testing.assert_allclose(image.depth, whole.depth, rtol=1e-6)
