"""VTK draws what orthographic and off-centre cameras see: its images against the geometry of our own rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera, look_at, sphere_cameras
from svv.core.geometry.directions import geodesic_directions
from svv.dvr.draw import casters
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.errors import BadInput
from tests.stirred_volume import stirred_transfer_function, stirred_volume

MIDDLE, RADIUS = np.array([11.0, 9.0, 10.0]), 6.0
FLAT = Shading(False)


def ball(spacing: tuple[float, float, float] = (1.0, 1.0, 1.0), scale: float = 1.0):
    """A ball whose values fall from 200 in its middle to 100 on its surface, on a grid of any spacing."""
    sizes = np.ceil(22 / np.array(spacing)).astype(int)
    x, y, z = (np.arange(n) * s for n, s in zip(sizes, spacing, strict=True))
    away = np.sqrt((x - 11) ** 2 + ((y - 9) ** 2)[:, None] + ((z - 10) ** 2)[:, None, None])
    values = np.clip(200 - 100 * away / RADIUS, 0, 255)
    return from_array(np.rint(10 * values).astype(np.uint16), tuple(scale * s for s in spacing))


def opaque() -> TransferFunction:
    return TransferFunction(((0, 1, 1, 1),), ((980, 0, 0.5, 0), (1020, 1, 0.5, 0)), 0.02)


def distance_of(camera: Camera, point: np.ndarray) -> np.ndarray:
    """How far each pixel's ray passes a point. (height, width)"""
    origins, directions = camera.rays()
    offset = point - origins
    along = (offset * directions).sum(-1, keepdims=True)
    return np.linalg.norm(offset - along * directions, axis=-1)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 11), span=st.none() | st.floats(16.0, 40.0), spacing=st.tuples(*[st.floats(0.5, 1.5)] * 3),
    scale=st.sampled_from([1e-6, 1.0, 1e6]), shift=st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
)  # fmt: skip
def test_a_ball_is_seen_where_rays_meet_it(
    seed: int, span: float | None, spacing: tuple, scale: float, shift: tuple[float, float]
) -> None:
    pose = look_at(scale * (MIDDLE + 60 * geodesic_directions(12)[seed]), scale * (MIDDLE + np.array((1.0, -1.0, 0.5))))
    centre = (36 + shift[0], 32 + shift[1])
    camera = Camera(pose, 0.4, 72, 64, None if span is None else scale * span, centre)
    alpha = render_views(ball(spacing, scale), opaque(), [camera], "cpu", FLAT)[0, ..., 3]
    away = distance_of(camera, scale * MIDDLE) / scale
    assert (alpha[away < RADIUS - 0.4] > 200).all()
    assert (alpha[away > RADIUS + 0.4] == 0).all()


@pytest.mark.parametrize("span", [None, 30.0])
def test_an_off_centre_view_is_a_crop_of_a_larger_one(span: float | None, mapper: str) -> None:
    pose = look_at(MIDDLE + np.array((20.0, 30.0, 45.0)), MIDDLE)
    large = Camera(pose, 0.5, 60, 50, span)
    crop = Camera(pose, 2 * np.arctan(0.5 * 32 / large.focal), 32, 30, span and span * 32 / 60, (30.0 - 17, 25.0 - 8))
    whole, part = (render_views(ball(), opaque(), [c], mapper, FLAT, 0.5)[0].astype(int) for c in (large, crop))
    assert np.abs(whole[8:38, 17:49] - part).max() <= 2


@pytest.mark.usefixtures("off_screen")
def test_both_ray_casters_see_the_same_in_parallel() -> None:
    cameras = sphere_cameras(3, MIDDLE, 60, 0.6, 64, 22.0)
    a, b = (render_views(ball(), opaque(), cameras, m, FLAT, 0.5)[..., 3].astype(int) for m in ("cpu", "gpu"))
    assert np.abs(a - b).mean() < 1.0


def test_leaving_out_what_is_empty_changes_next_to_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    volume = stirred_volume(32)
    cameras = sphere_cameras(12, (0.3, 0, 0), 4.5, 0.5, 64, 2.2)
    cameras += [replace(c, centre=(20.0, 40.0)) for c in cameras[:3]]
    tf = stirred_transfer_function()
    fast = render_views(volume, tf, cameras, "cpu", step=0.5)
    monkeypatch.setattr(casters.CpuMapper, "_skip_empty_rays", lambda *_: None)
    whole = render_views(volume, tf, cameras, "cpu", step=0.5)
    assert ((fast[..., 3] > 0) == (whole[..., 3] > 0)).mean() > 0.9999
    assert np.abs(fast.astype(int) - whole).mean() < 0.05


def test_orthographic_views_are_as_wide_as_others_at_the_centre() -> None:
    plain, _ = make_views(ball(), opaque(), n=3, size=32, mapper="cpu", test=0)
    parallel, test = make_views(ball(), opaque(), n=3, size=32, mapper="cpu", test=2, projection="orthographic")
    assert plain.meta.rig is not None and parallel.meta.rig is not None and test is not None
    assert parallel.meta.rig.span_x == pytest.approx(plain.meta.rig.view_width)
    assert all(c.span_x == parallel.meta.rig.span_x for c in [*parallel.cameras, *test.cameras])
    with pytest.raises(BadInput, match="projection"):
        make_views(ball(), opaque(), n=3, projection="oblique")


THIN: dict[str, tuple[slice, slice, slice]] = {
    "voxel": (slice(5, 6), slice(5, 6), slice(5, 6)),
    "corner": (slice(0, 1), slice(0, 1), slice(0, 1)),
    "plane": (slice(5, 6), slice(1, 9), slice(1, 9)),
}


@pytest.mark.parametrize("mapper", ["cpu", "bricks"])
@pytest.mark.parametrize("where", [*THIN])
def test_rays_do_not_miss_what_is_thinner_than_a_voxel(where: str, mapper: str) -> None:
    """With half a voxel between samples, a bright voxel was twice as opaque in one view as in another, or not there."""
    values = np.zeros((10, 10, 10), np.float32)
    values[THIN[where]] = 1.0
    tf = TransferFunction([(0.0, 1.0, 1.0, 1.0)], [(0.5, 0.0, 0.5, 0.0), (1.0, 0.8, 0.5, 0.0)], 1.0)
    views, _ = make_views(from_array(values), tf, n=8, size=48, mapper=mapper, rescale=False, shading=FLAT)
    drawn = views.images[..., 3].astype(float)
    finer = render_views(from_array(values), tf, views.cameras, mapper, FLAT, step=0.02)[..., 3]
    np.testing.assert_allclose(drawn.mean(axis=(1, 2)), finer.mean(axis=(1, 2)), rtol=0.4)
    assert (drawn[finer > 32] > 0).all()
