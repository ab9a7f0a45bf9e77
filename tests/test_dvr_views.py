"""Views: optics with an analytic answer, geometry for any spacing and direction, and both ray casters."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("vtkmodules")

from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera, look_at, orbit_cameras, sphere_cameras
from svv.core.geometry.directions import geodesic_directions
from svv.dvr.draw import casters
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array, index_to_world, to_array
from svv.errors import BadInput, Cancelled
from svv.io.views.view_meta import known
from svv.io.views.viewset import read_meta
from tests.nightly import nightly
from tests.stirred_volume import stirred_transfer_function, stirred_volume

FLAT = Shading(on=False)


def constant(opacity: float, unit: float, value: float = 1.0) -> TransferFunction:
    return TransferFunction(((value, 1.0, 0.5, 0.25),), ((value, opacity, 0.5, 0.0),), unit)


def blob(z_step: float = 1.0) -> np.ndarray:
    """A round blob around (x, y, z) = (8, 12, 9) with values up to 1000, int16."""
    z, y, x = np.ogrid[0:20:z_step, 0:22, 0:24]
    return np.rint(1000 * np.exp(-((z - 9) ** 2 + (y - 12) ** 2 + (x - 8) ** 2) / 18)).astype(np.int16)


def ramp(unit: float | None = None) -> TransferFunction:
    """Red outside, blue inside, opaque in the middle."""
    colours = ((0, 1, 0, 0), (400, 1, 0.2, 0), (700, 0, 0.2, 1), (1000, 0, 0, 1))
    return TransferFunction(colours, ((200, 0, 0.5, 0), (500, 0.3, 0.5, 0), (1000, 0.9, 0.5, 0)), unit)


def on_white(images: np.ndarray) -> np.ndarray:
    alpha = images[..., 3:] / 255.0
    return images[..., :3] * alpha + 255.0 * (1 - alpha)


def differ(a: np.ndarray, b: np.ndarray) -> float:
    """Mean difference of two sets of images on white, levels of 255, where one of them shows something."""
    shown = (a[..., 3] > 0) | (b[..., 3] > 0)
    return float(np.abs(on_white(a) - on_white(b))[shown].mean())


def placed(array: np.ndarray, axes: np.ndarray, origin: np.ndarray, start: tuple = (0, 0, 0)) -> vtkImageData:
    """An image whose voxel (i, j, k) stands at origin + axes @ (i, j, k)."""
    spacing = np.linalg.norm(axes, axis=0)
    image = from_array(array, spacing)
    image.SetDirectionMatrix(*(axes / spacing).ravel())
    image.SetOrigin(*(origin - axes @ start))
    extent = np.array(image.GetExtent()).reshape(3, 2) + np.array(start)[:, None]
    image.SetExtent(*extent.ravel().tolist())
    return image


def rotation(seed: int) -> np.ndarray:
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return q * np.sign(np.linalg.det(q))


@pytest.fixture(scope="module")
def stirred() -> vtkImageData:
    return stirred_volume(24)


@pytest.mark.parametrize("opacity", nightly([0.003, 0.02, 0.1, 0.5, 0.9], 0.003, 0.5))
@pytest.mark.parametrize("unit", [1.0, 7.5])
def test_alpha_of_a_slab_is_the_analytic_one(mapper: str, opacity: float, unit: float) -> None:
    """A ray that runs d through opacity a leaves (1 - a)^(d / unit); colour is that of the slab, not darkened.

    Alpha to 1 level of 255, 2 on the GPU (two read-backs of 8 bits); a colour to half a level of what it adds.
    """
    image = from_array(np.full((31, 31, 31), 1, np.uint8))
    camera = Camera(look_at((15, 15, 315), (15, 15, 15)), 0.06, 9, 9)
    pixel = render_views(image, constant(opacity, unit), [camera], mapper, FLAT)[0, 4, 4].astype(float)
    expected = 255 * (1 - (1 - opacity) ** (30 / unit))
    assert abs(pixel[3] - expected) <= (1.0 if mapper == "cpu" else 2.0)
    slack = 1.0 + 255 * (0.6 if mapper == "cpu" else 1.1) / expected
    np.testing.assert_allclose(pixel[:3], (255, 127.5, 63.75), atol=slack)


@settings(max_examples=12, deadline=None)
@given(opacity=st.floats(0.001, 0.98), unit=st.floats(0.5, 20), kind=st.sampled_from(["u1", "i2", "i8", "f4", "f8"]))
def test_alpha_does_not_depend_on_the_sample_distance_or_type(opacity: float, unit: float, kind: str) -> None:
    image = from_array(np.full((11, 11, 11), 7, kind))
    camera = Camera(look_at((5, 5, 105), (5, 5, 5)), 0.05, 3, 3)
    expected = 255 * (1 - (1 - opacity) ** (10 / unit))
    for step in (0.25, 0.5, 1.0):
        pixel = render_views(image, constant(opacity, unit, 7.0), [camera], "cpu", FLAT, step)[0, 1, 1]
        # The ray caster ends a ray of which less than 255/32767 is left and calls it opaque: two levels of 255 at most.
        assert abs(float(pixel[3]) - expected) <= (1.5 if expected < 255 * (1 - 255 / 32767) else 2.0)


@pytest.mark.parametrize("scale", nightly([1e-30, 1e-9, 1e-3, 1e6, 1e13, 1e23], 1e-9, 1e23))
@pytest.mark.parametrize(("unit", "mapper"), [(None, "cpu"), (2.0, "cpu"), (None, "bricks"), (2.0, "bricks")])
def test_spacing_of_any_size_gives_the_same_views(scale: float, unit: float | None, mapper: str) -> None:
    """By bricks, a galaxy in centimetres was empty, and from 1e11 on lacked rays along an axis."""
    cameras = sphere_cameras(3, (8, 12, 9), 60, 0.6, 48)
    small = [Camera(look_at(c.position * scale, np.array((8, 12, 9)) * scale), 0.6, 48, 48) for c in cameras]
    plain = render_views(from_array(blob()), ramp(unit), cameras, mapper)
    tf = ramp(unit * scale if unit else None)
    scaled = render_views(from_array(blob(), (scale,) * 3), tf, small, mapper)
    assert plain[..., 3].max() > 200
    assert np.abs(plain.astype(int) - scaled).max() <= 1


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 99),
    spacing=st.tuples(*[st.floats(0.4, 3)] * 3),
    scale=st.sampled_from([1e-9, 1.0, 1e6]),
    mirror=st.booleans(),
    start=st.tuples(*[st.integers(-9, 9)] * 3),
)
def test_every_grid_shows_its_blob_where_it_is_in_the_world(
    seed: int, spacing: tuple, scale: float, mirror: bool, start: tuple
) -> None:
    """The blob's middle must be seen at the pixel to which the camera projects its world position."""
    axes = scale * rotation(seed) * spacing * (-1.0 if mirror else 1.0, 1.0, 1.0)
    origin = scale * np.random.default_rng(seed).normal(size=3) * 20
    world = origin + axes @ (8, 12, 9)  # x, y, z of the blob's centre
    eye = world + scale * 900 * geodesic_directions(12)[seed % 12] + scale * np.array([1.0, 0.5, 0.2])
    camera = Camera(look_at(eye, world + scale * np.array([3.0, -2.0, 1.0])), 0.06, 72, 64)
    shown = render_views(placed(blob(), axes, origin, start), ramp(), [camera], "cpu")[0, ..., 3].astype(float)
    assert shown.max() > 150
    rows, columns = np.mgrid[0:64, 0:72] + 0.5
    seen = np.array([(shown * columns).sum(), (shown * rows).sum()]) / shown.sum()
    local = camera.camera_to_world[:3, :3].T @ (world - camera.position)
    expected = np.array([36 + camera.focal * local[0] / -local[2], 32 - camera.focal * local[1] / -local[2]])
    np.testing.assert_allclose(seen, expected, atol=0.3)


@pytest.mark.parametrize("mirror", [False, True])
def test_turning_volume_and_cameras_together_changes_nothing(mapper: str, mirror: bool) -> None:
    """Also the shading: normals turn with the volume. A mirrored grid stores the same world in the other order."""
    turn, shift = rotation(3), np.array([5.0, -7.0, 2.0])
    array = blob()
    cameras = sphere_cameras(3, (8, 12, 9), 60, 0.6, 48)
    turned = []
    for camera in cameras:
        matrix = np.eye(4)
        matrix[:3, :3] = turn @ camera.camera_to_world[:3, :3]
        matrix[:3, 3] = turn @ camera.position + shift
        turned.append(Camera(matrix, 0.6, 48, 48))
    image = placed(array, turn, shift)
    if mirror:
        image = placed(array[:, :, ::-1], turn * (-1.0, 1, 1), shift + turn @ (array.shape[2] - 1.0, 0, 0))
    plain = render_views(from_array(array), ramp(), cameras, mapper)
    assert differ(plain, render_views(image, ramp(), turned, mapper)) < 0.5


def test_anisotropic_grids_show_the_same_world() -> None:
    """The same blob sampled at twice the density along z: the same picture up to interpolation."""
    cameras = sphere_cameras(3, (8, 12, 9), 60, 0.6, 48)
    coarse = render_views(from_array(blob()), ramp(1.0), cameras, "cpu")
    assert differ(coarse, render_views(from_array(blob(0.5), (1, 1, 0.5)), ramp(1.0), cameras, "cpu")) < 3


def test_leaving_out_what_is_empty_changes_next_to_nothing(
    monkeypatch: pytest.MonkeyPatch, stirred: vtkImageData
) -> None:
    """Where all rays are cast, and all the way, a view is the same to a tenth of what half a voxel's step costs."""
    cameras = sphere_cameras(12, (0.3, 0, 0), 4.5, 0.5, 64)
    tf = stirred_transfer_function()
    fast, fine = render_views(stirred, tf, cameras, "cpu"), render_views(stirred, tf, cameras, "cpu", step=0.125)
    monkeypatch.setattr(casters.CpuMapper, "_skip_empty_rays", lambda *_: None)
    whole = render_views(stirred, tf, cameras, "cpu")
    assert ((fast[..., 3] > 0) == (whole[..., 3] > 0)).mean() > 0.9999  # no outline is cut
    error, price = (np.square(on_white(fast) - on_white(other)).mean() for other in (whole, fine))
    assert error < 0.1 * price


def test_the_sample_distance_is_as_long_as_the_volume_allows() -> None:
    """Longer than half a voxel only where pictures stay within 50 dB of an eighth's, which a thin shell's do not."""
    z, y, x = np.ogrid[0:48, 0:48, 0:48]
    smooth = from_array(np.rint(200 * np.exp(-((z - 24) ** 2 + (y - 24) ** 2 + (x - 24) ** 2) / 200)).astype(np.uint8))
    colours = ((0, 1, 0, 0), (200, 0, 0, 1))
    thin = TransferFunction(colours, ((90, 0, 0.5, 0), (100, 0.9, 0.5, 0), (110, 0, 0.5, 0)), 1.0)
    faint = TransferFunction(colours, ((40, 0, 0.5, 0), (200, 0.1, 0.5, 0)), 1.0)
    steps = {}
    for name, tf in (("thin", thin), ("faint", faint)):
        views, _ = make_views(smooth, tf, n=3, size=64, mapper="cpu")
        fine, _ = make_views(smooth, tf, n=3, size=64, mapper="cpu", step=0.125)
        steps[name] = known(views.meta.sample_distance, "sample_distance")
        if steps[name] > 0.5:
            error = np.square((on_white(views.images) - on_white(fine.images)) / 255).mean()
            assert -10 * np.log10(error) > 49  # 50 dB in the pictures it was chosen by, which are others
    assert steps["thin"] == pytest.approx(0.5)
    assert steps["faint"] >= 0.625


def test_what_is_white_has_the_sample_distance_of_what_is_black(stirred: vtkImageData) -> None:
    """Against white, no distance was too long for it, and thin white shells had holes."""
    steps = [
        known(make_views(stirred, narrow, n=3, size=8, shading=Shading(on=False))[0].meta.sample_distance, "")
        for c in (0.0, 0.5, 1.0)
        for narrow in [TransferFunction([(0.0, c, c, c)], [(0.4, 0, 0.5, 0), (0.43, 0.9, 0.5, 0), (0.46, 0, 0.5, 0)])]
    ]
    assert steps[0] == pytest.approx(steps[2]) and steps[1] >= steps[0]


def test_a_blob_in_a_corner_of_a_large_volume_is_cropped_without_a_trace() -> None:
    small = blob()
    large = np.zeros((50, 60, 40), np.int16)
    large[20:40, 30:52, 5:29] = small
    cameras = sphere_cameras(3, (8, 12, 9), 60, 0.6, 48)
    moved = sphere_cameras(3, (13, 42, 29), 60, 0.6, 48)
    a = render_views(from_array(small), ramp(1.0), cameras, "cpu")
    assert np.abs(on_white(a) - on_white(render_views(from_array(large), ramp(1.0), moved, "cpu"))).max() <= 2


@pytest.mark.usefixtures("off_screen")
def test_both_ray_casters_agree() -> None:
    """Same conventions of shading and opacity; they differ in how they take gradients and round."""
    cameras = sphere_cameras(3, (8, 12, 9), 60, 0.6, 64)
    for shading, tolerance in ((FLAT, 1.0), (Shading(), 2.0), (Shading(True, 0.3, 0.4, 0.0, 1.0), 1.0)):
        a, b = (render_views(from_array(blob()), ramp(), cameras, m, shading, 0.5) for m in ("cpu", "gpu"))
        assert differ(a, b) < tolerance


def test_the_headlight_lights_what_faces_it() -> None:
    """Diffuse 1 and nothing else: full colour in the middle of an opaque ball, dark at its rim; ambient 1: flat."""
    tf = TransferFunction(((0, 1, 1, 1),), ((300, 0, 0.5, 0), (400, 1, 0.5, 0)), 0.5)
    cameras = [Camera(look_at((8, 12, 69), (8, 12, 9)), 0.25, 65, 65)]
    lit = render_views(from_array(blob()), tf, cameras, "cpu")[0]
    solid = lit[..., 3] == 255
    levels = lit[..., 0].astype(float)
    assert levels[32, 32] > 245
    rim = solid & ~np.roll(solid, 3, 0) | solid & ~np.roll(solid, -3, 0)
    assert levels[rim].mean() < 150
    ambient = render_views(from_array(blob()), tf, cameras, "cpu", Shading(True, 1.0, 0.0, 0.0, 1.0))[0]
    flat = render_views(from_array(blob()), tf, cameras, "cpu", FLAT)[0]
    assert np.abs(on_white(ambient) - on_white(flat)).max() <= 1
    assert (flat[solid][:, :3] >= 254).all()


def test_cameras_inside_and_looking_away() -> None:
    inside = Camera(look_at((8, 12, 9.5), (8, 12, 0)), 1.0, 32, 32)
    away = Camera(look_at((8, 12, 69), (8, 12, 100)), 0.5, 32, 32)
    images = render_views(from_array(blob()), ramp(), [inside, away, inside], "cpu")
    assert images[0, ..., 3].min() > 100 and images[1].max() == 0
    np.testing.assert_array_equal(images[0], images[2])


def test_straight_alpha_is_clean_where_nothing_shows() -> None:
    image = render_views(from_array(blob()), ramp(), sphere_cameras(3, (8, 12, 9), 60, 0.6, 48), "cpu")
    empty = image[..., 3] == 0
    assert empty.any() and (image[empty] == 0).all()


def test_views_come_with_all_that_made_them(tmp_path: Path) -> None:
    np.save(tmp_path / "blob.npy", blob())
    told: list[float] = []
    train, test = make_views(
        tmp_path / "blob.npy", ramp(), n=12, size=32, test=4, progress=lambda fraction, label: told.append(fraction)
    )
    assert told[-1] == 1.0 and all(a <= b for a, b in pairwise(told))
    assert test is not None and len(train) == 12 and len(test) == 4
    assert train.images.shape == (12, 32, 32, 4) and train.names[:2] == ("r_0000", "r_0001")
    assert test.names == ("r_0000", "r_0060", "r_0120", "r_0180")
    rig = train.meta.rig
    assert rig is not None
    for camera, name in zip(test.cameras, test.names):
        expected = orbit_cameras(181, rig.centre, rig.radius, rig.fov_x, 32)[int(name[2:])]
        np.testing.assert_array_equal(camera.camera_to_world, expected.camera_to_world)
    assert train.meta.volume == "blob.npy" and train.meta.mapper in ("bricks", "gpu")
    # The record is enough to make the same views again.
    again = render_views(
        from_array(blob()),
        TransferFunction.from_dict(train.meta.tf),
        train.cameras,
        train.meta.mapper,
        train.meta.shading,
    )
    np.testing.assert_array_equal(again, train.images)
    train.write(tmp_path / "views")
    assert read_meta(tmp_path / "views") == train.meta


def test_bounds_hold_all_that_is_visible_and_no_more() -> None:
    axes = rotation(5) * (1.0, 2.0, 0.5)
    image = placed(blob(), axes, np.array([3.0, 4.0, 5.0]))
    train, _ = make_views(image, ramp(), n=3, size=16)
    low, high = np.array(train.meta.bounds)
    z, y, x = np.nonzero(to_array(image) > 200)
    points = (index_to_world(image) @ np.stack([x, y, z, np.ones_like(x)]))[:3].T
    assert (points >= low - 1e-9).all() and (points <= high + 1e-9).all()
    assert ((high - low) < 1.7 * (points.max(axis=0) - points.min(axis=0)) + 3).all()


@pytest.mark.parametrize("fov", [np.pi / 6, 1.2])
def test_the_frame_is_filled_like_the_published_views(fov: float) -> None:
    """A volume of half width 0.516 is seen from 4.0311 at 30 degrees; wider angles come nearer."""
    array = np.random.default_rng(0).integers(0, 100, (5, 5, 5)).astype(np.uint8)
    tf = TransferFunction(((0, 1, 1, 1), (99, 1, 0, 0)), ((0, 0.1, 0.5, 0), (99, 0.9, 0.5, 0)))
    image = from_array(array, (0.258,) * 3, (-0.516,) * 3)
    train, _ = make_views(image, tf, n=3, size=16, fov=np.degrees(fov))
    rig = train.meta.rig
    assert rig is not None and rig.radius == pytest.approx(4.0311 * np.tan(np.pi / 12) / np.tan(fov / 2))
    np.testing.assert_allclose(rig.centre, 0, atol=1e-12)
    assert all(camera.fov_x == pytest.approx(fov) for camera in train.cameras)


def test_the_whole_volume_can_fill_the_frame() -> None:
    array = np.pad(blob(), ((0, 20), (0, 0), (0, 0)))
    near, far = (
        make_views(from_array(array), ramp(), n=3, size=16, frame=frame)[0].meta for frame in ("visible", "whole")
    )
    assert far.rig is not None and near.rig is not None and far.rig.radius > near.rig.radius
    np.testing.assert_allclose(far.rig.centre, (11.5, 10.5, 19.5))
    assert far.bounds == near.bounds


def test_without_a_function_two_ranges_are_shown(stirred: vtkImageData) -> None:
    train, test = make_views(stirred, None, n=3, size=32)
    assert test is None and 0.02 < (train.images[..., 3] > 0).mean() < 0.9


def test_progress_stops_the_work() -> None:
    def stop(fraction: float, label: str) -> None:
        if fraction > 0.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        make_views(from_array(blob()), ramp(), n=12, size=16, progress=stop)


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "n": ({"n": 2}, "At least 3"),
    "size": ({"size": 0}, "at least one pixel"),
    "test": ({"test": 182}, "0 to 181"),
    "memory": ({"n": 10**9, "size": 800}, "choose fewer or smaller"),
    "fov": ({"fov": 200.0}, "angle of view"),
    "frame": ({"frame": "all"}, "visible"),
    "mapper": ({"mapper": "cuda"}, "auto, gpu, cpu or bricks"),
    "step": ({"step": 0.0}, "sample distance"),
    "transparent": ({"tf": constant(0.0, 1.0, 500.0)}, "transparent everywhere"),
    "opaque": ({"tf": constant(1.0, 1.0, 500.0)}, "opaque everywhere"),
    "outside": ({"tf": constant(0.5, 1.0, 5000.0)}, "rescale"),
    "hidden": (
        {"tf": TransferFunction(((0, 1, 1, 1),), ((10, 1, 0.5, 0), (20, 0, 0.5, 0), (990, 0, 0.5, 0)))},
        "transparent everywhere",
    ),
    "no volume": ({"volume": "no.vti"}, "There is no volume"),
    "no function": ({"tf": "no.json"}, "Cannot read the transfer function"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_with_one_sentence(case: str) -> None:
    changes, words = BAD[case]
    array = np.where(blob() > 500, 900, 100).astype(np.int16) if case == "hidden" else blob()
    arguments = {"volume": from_array(array), "tf": ramp(), "n": 3, "size": 8, **changes}
    with pytest.raises(BadInput, match=words) as caught:
        make_views(**arguments)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_cameras_of_two_sizes_are_refused() -> None:
    camera = sphere_cameras(3, (0, 0, 0), 60, 0.6, 8)[0]
    for cameras in ([], [camera, camera.resized(9, 8)]):
        with pytest.raises(BadInput, match="one image size"):
            render_views(from_array(blob()), ramp(), cameras)


def test_without_opengl_the_gpu_is_refused_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr("svv.dvr.draw.casters.sys.platform", "linux")
    monkeypatch.setattr("svv.dvr.draw.casters.ctypes.util.find_library", lambda name: None)
    with pytest.raises(BadInput, match="libegl1 libosmesa6"):
        render_views(from_array(blob()), ramp(), sphere_cameras(3, (0, 0, 0), 60, 0.6, 8), "gpu")


def test_the_stirred_volume_is_always_the_same(stirred: vtkImageData) -> None:
    first, second = to_array(stirred), to_array(stirred_volume(24))
    np.testing.assert_array_equal(first, second)
    assert first.dtype == np.float32 and first.min() >= 0 and first.max() <= 1 and first.max() > 0.9
    assert np.abs(to_array(stirred_volume(24, seed=1)) - first).max() > 0.1
    # Three visible ranges, each of them there.
    tf = stirred_transfer_function()
    ranges = tf.visible_ranges(0.0, 1.0)
    assert len(ranges) == 3
    assert all(((first > low) & (first < high)).mean() > 0.002 for low, high in ranges)
    with pytest.raises(BadInput, match="16 voxels"):
        stirred_volume(8)
