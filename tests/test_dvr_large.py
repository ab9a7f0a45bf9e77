"""Drawing by bricks: the same images as VTK's ray caster, and the choice between the two."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from scipy.ndimage import maximum_filter, minimum_filter
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

from svv.bricks.formats.source import ArraySource, Box
from svv.bricks.halving import halved
from svv.bricks.opened import open_bricks
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import CameraRig, sphere_cameras
from svv.dvr.draw import casters, large
from svv.dvr.draw.frame import set_stage
from svv.dvr.draw.large import LargeVolume, memory_allowed, open_volume, straight
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance, put
from svv.dvr.read.grids import from_array, index_to_world, level_of_image, set_geometry, to_array
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput, silent
from svv.io.views.viewset import ViewSet
from svv.options.making import MapperName
from svv_bench.volume_size.generated import GeneratedSource
from svv_bench.volume_size.written import write_meta
from tests.nightly import nightly
from tests.stirred_volume import stirred_transfer_function, stirred_volume

SHADINGS = {"ParaView's": Shading(), "glossy": Shading(ambient=0.2, diffuse=0.6, specular=0.5, specular_power=8.0)}
AXES = {
    "straight": np.diag([1.0, 1.0, 1.0]),
    "turned and mirrored": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]) @ np.diag([1.0, 1.3, 0.8]),
}


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SVV_PYRAMIDS", str(tmp_path / "pyramids"))


def tf() -> TransferFunction:
    return stirred_transfer_function().mapped(255.0, 0.0)


@pytest.mark.parametrize("projection", nightly(["perspective", "orthographic"], "perspective"))
@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("shading", SHADINGS)
def test_images_are_those_of_vtk(shading: str, axes: str, projection: str) -> None:
    """Mean difference below one level; the rest is VTK's 15-bit arithmetic, which rounds up at each sample."""
    image = stirred_volume(64, levels=255)
    set_geometry(image, AXES[axes], np.array([5.0, 6.0, 7.0]))
    stage = set_stage(image, tf())
    x, y, z = stage.centre.tolist()
    rig = CameraRig((x, y, z), 3.0 * float(np.linalg.norm(stage.visible_size)), np.pi / 9)
    if projection == "orthographic":
        rig = CameraRig((x, y, z), rig.radius, rig.fov_x, span_x=rig.view_width)
    cameras = rig.sphere(3, 120)
    ours, theirs = (
        render_views(image, tf(), cameras, mapper, SHADINGS[shading], step=0.5) for mapper in ("bricks", "cpu")
    )
    one, other = ours.astype(float), theirs.astype(float)
    for picture in (one, other):
        picture[..., :3] *= picture[..., 3:] / 255.0
    assert other[..., 3].max() > 200
    assert np.abs(one - other).mean() < 1.0
    seen = other[..., 3] > 0
    assert np.abs(one - other)[seen].mean() < 2.5


def test_a_coarser_level_is_in_the_same_place(tmp_path: Path) -> None:
    """Where a pixel covers several voxels, a coarser level is drawn; it is finer if it fits into memory."""
    file = tmp_path / "v.npy"
    np.save(file, GeneratedSource(160).read(0, (0, 0, 0), (160, 160, 160)))
    function = TransferFunction.from_bumps([{"centre": 200, "width": 100, "opacity": 0.2}])
    volume = open_volume(file, mapper="bricks")
    assert isinstance(volume, LargeVolume)
    assert len(volume.source.levels) == 3
    image = from_array(np.load(file))
    stage = set_stage(image, function)
    x, y, z = stage.centre.tolist()
    cameras = CameraRig((x, y, z), 2.3 * float(np.linalg.norm(stage.visible_size)), np.pi / 6).sphere(3, 30)
    assert volume.level_for(cameras[0], stage) == 1
    wanted = render_views(volume, function, cameras)[..., 3].astype(float)
    volume.memory = 1_000_000
    assert volume.level_for(cameras[0], stage) == 2
    coarse = render_views(volume, function, cameras)[..., 3].astype(float)
    theirs = render_views(image, function, cameras, "cpu")[..., 3].astype(float)
    assert np.abs(wanted - theirs).mean() < 1.0
    assert np.abs(wanted - theirs).mean() < np.abs(coarse - theirs).mean() < 2.0
    for axis in (1, 2):  # half a voxel's shift would show
        aside = 0.5 * (np.roll(theirs, 1, axis=axis) + theirs)
        assert np.abs(coarse - theirs).mean() < 0.5 * np.abs(aside - theirs).mean()


def test_views_by_bricks_train_like_others(tmp_path: Path) -> None:
    file = tmp_path / "gen_40x40x40_uint8.raw"
    GeneratedSource(40).read(0, (0, 0, 0), (40, 40, 40)).tofile(file)
    function = TransferFunction.from_bumps([{"centre": 200, "width": 100, "opacity": 0.5}])
    train, test = make_views(file, function, n=3, test=2, size=48, rescale=False, mapper="bricks")
    other, _ = make_views(file, function, n=3, test=0, size=48, rescale=False, mapper="cpu")
    assert isinstance(test, ViewSet)
    assert train.meta.mapper == "bricks"
    assert train.meta.grid == other.meta.grid
    assert train.meta.rig == other.meta.rig
    assert train.classified is not None and other.classified is not None
    assert np.array_equal(train.classified.exponent, other.classified.exponent)
    assert np.abs(train.images.astype(int) - other.images.astype(int))[..., 3].mean() < 2.0


def test_auto_takes_bricks_if_vtk_needs_too_much_memory(tmp_path: Path) -> None:
    file = tmp_path / "gen_400x320x320_uint8.raw"
    np.tile(GeneratedSource(320).read(0, (120, 0, 0), (200, 320, 320)), (4, 1, 5)).reshape(-1)[
        : 400 * 320 * 320
    ].tofile(file)
    said: list[str] = []
    volume = open_volume(file, memory=0.25, progress=lambda fraction, label: said.append(label))
    assert isinstance(volume, LargeVolume)
    assert any("Drawing by bricks: VTK would need 0.5 GB, more than 0.2 GB" in label for label in said)
    assert volume.memory == 125_000_000
    assert not isinstance(open_volume(file, memory=1.0), LargeVolume)
    assert not isinstance(open_volume(file, memory=0.25, mapper="cpu"), LargeVolume)
    with pytest.raises(BadInput, match=r"at least 0\.25 GB"):
        memory_allowed(0.1)


def test_a_file_without_bricks_is_read_as_a_whole(tmp_path: Path) -> None:
    values = GeneratedSource(24).read(0, (0, 0, 0), (24, 24, 24))
    np.save(tmp_path / "v.npy", values)
    head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 24 24 24\nencoding: raw\n\n"
    (tmp_path / "v.nrrd").write_bytes(head.encode() + values.tobytes())
    function = TransferFunction.from_bumps([{"centre": 200, "width": 100, "opacity": 0.5}])
    one, other = (
        make_views(tmp_path / name, function, n=3, test=0, size=24, rescale=False, mapper="bricks")[0]
        for name in ("v.npy", "v.nrrd")
    )
    assert one.meta.mapper == other.meta.mapper == "bricks"
    assert np.array_equal(one.images, other.images)


def test_the_overview_and_the_range_are_those_of_the_volume() -> None:
    image = stirred_volume(24, levels=255)
    matrix = index_to_world(image)
    volume = LargeVolume(ArraySource(to_array(image), matrix[:3, :3], matrix[:3, 3]), 1 << 20)
    assert np.array_equal(to_array(volume.overview), to_array(image))
    assert np.allclose(index_to_world(volume.overview), matrix)
    assert volume.range == (to_array(image).min(), to_array(image).max())
    assert level_of_image(image).voxels == 24**3


@pytest.mark.parametrize("kind", ["u1", "i2", "f4", "f8"])
def test_what_vtk_writes_is_read_by_bricks_and_the_other_way_round(kind: str, tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 100, (7, 6, 5)).astype(kind)
    image = from_array(values, name="heat")
    set_geometry(image, AXES["turned and mirrored"], np.array([1.0, 2.0, 3.0]))
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(image)
    writer.SetFileName(str(tmp_path / "v.vti"))
    writer.SetCompressorTypeToNone()
    writer.EncodeAppendedDataOff()
    writer.Write()
    source = open_bricks(tmp_path / "v.vti", array="heat")
    assert source is not None
    write_meta(tmp_path / "v.mha", source, 0, silent)
    again = open_bricks(tmp_path / "v.mha")
    assert again is not None
    for found in (source, again):
        assert np.array_equal(found.read(0, (1, 2, 3), (7, 4, 5)), values[1:7, 2:4, 3:5])
        assert np.allclose(found.levels[0].axes, index_to_world(image)[:3, :3])
        assert np.allclose(found.levels[0].origin, index_to_world(image)[:3, 3])
    read = read_volume(tmp_path / "v.mha")
    assert np.array_equal(to_array(read), values)
    assert np.allclose(index_to_world(read), index_to_world(image))
    with pytest.raises(BadInput, match="has no array 'cold'; it has heat"):
        open_bricks(tmp_path / "v.vti", array="cold")
    writer.SetCompressorTypeToZLib()
    writer.Write()
    assert open_bricks(tmp_path / "v.vti") is None, "compressed values cannot be mapped"


def test_straight_alpha_keeps_colours() -> None:
    drawn = np.array([[[0.25, 0.125, 0.0, 0.5], [0.0, 0.0, 0.0, 0.0]]], np.float32)
    assert straight(drawn).tolist() == [[[128, 64, 0, 128], [0, 0, 0, 0]]]


@pytest.mark.parametrize(("mapper", "drawn"), [("auto", "bricks"), ("cpu", "cpu")])
def test_volumes_are_drawn_by_bricks_unless_another_ray_caster_is_named(
    mapper: MapperName, drawn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And their truth, for scores, is drawn as they were; the picture is the same."""
    monkeypatch.setattr(casters, "hardware_opengl", lambda: False)
    image = stirred_volume(40, levels=255)
    train, test = make_views(image, tf(), n=3, test=1, size=64, rescale=False, mapper=mapper)
    assert test is not None and train.meta.mapper == test.meta.mapper == drawn
    shading = train.meta.shading
    again = render_views(image, tf(), list(test.cameras), drawn, shading)
    assert np.array_equal(again, test.images)
    theirs = render_views(image, tf(), list(test.cameras), "cpu", shading)
    assert np.abs(theirs[..., 3].astype(float) - test.images[..., 3]).mean() < 1.0


class OwnLevels:
    """A volume whose file has a coarser level, too, and no record of the range of its values."""

    def __init__(self, values: np.ndarray) -> None:
        fine = ArraySource(values)
        self.name, self.dtype = "own.zarr", values.dtype
        self._parts = (fine, ArraySource(halved(values), 2.0 * np.eye(3), np.full(3, 0.5)))
        self.levels = tuple(part.levels[0] for part in self._parts)

    def read(self, level: int, start: Box, stop: Box) -> np.ndarray:
        return self._parts[level].read(0, start, stop)


@pytest.mark.parametrize("kind", ["u2", "f4"])
def test_values_that_coarser_levels_average_away_look_as_they_should(kind: str) -> None:
    """Bright specks had the opacity of the brightest voxel of the overview."""
    values, rng = np.full((8, 8, 520), 100, kind), np.random.default_rng(0)
    values[rng.integers(1, 7, 300), rng.integers(1, 7, 300), rng.integers(0, 520, 300)] = 60_000
    volume = LargeVolume(OwnLevels(values), 1 << 28)
    assert volume.range[1] < 40_000.0
    points = [(1000.0, 0.0, 0.5, 0.0), (20_000.0, 0.05, 0.5, 0.0), (45_000.0, 1.0, 0.5, 0.0)]
    specks = TransferFunction([(0.0, 0.1, 0.2, 0.9), (40_000.0, 0.1, 0.9, 0.2), (50_000.0, 0.9, 0.2, 0.1)], points, 1.0)
    whole = from_array(values)
    views, _ = make_views(whole, specks, n=3, size=400, mapper="bricks", rescale=False, step=0.5)
    drawn = render_views(volume, specks, views.cameras, "bricks", step=0.5).astype(int)
    assert np.abs(drawn - views.images).max() <= 1


@pytest.mark.parametrize("width", nightly([1e-1, 1e-3, 3e-5], 3e-5))
def test_a_function_is_resolved_where_it_varies_at_both_ends_of_a_wide_range(width: float) -> None:
    """Two phases, each within a small part of the range: below a ten-thousandth, the table showed them by chance."""
    share = to_array(stirred_volume(24)).astype(np.float64)
    share = (share - share.min()) / np.ptp(share)
    rises, tops = (0.0, 0.3, 0.6, 1.0), (0.0, 0.0, 0.4, 0.0)

    def views(low: float, high: float) -> np.ndarray:
        values = np.where(share > 0.5, high + width * (share - 0.5), low + width * share)
        points = [(end + width * r, top, 0.5, 0.0) for end in (low, high) for r, top in zip(rises, tops)]
        apart = TransferFunction([(low, 0.9, 0.1, 0.1), (high, 0.1, 0.1, 0.9)], points, 1.0)
        volume = from_array(values)
        put(volume, Appearance(nearest=True))  # no values between the phases
        flat = Shading(on=False)
        return make_views(volume, apart, n=3, size=32, mapper="bricks", rescale=False, shading=flat)[0].images

    near, far = (views(0.0, high).astype(float) for high in (2.0 * width, 1.0))
    assert near[..., 3].mean() > 3.0 and np.abs(near[..., 3] - far[..., 3]).mean() < 0.4


def test_values_that_are_no_numbers_are_refused_wherever_they_are() -> None:
    """A file with levels of its own is not read as a whole before it is drawn."""
    values = np.random.default_rng(0).random((8, 8, 520)).astype(np.float32)
    camera = sphere_cameras(3, (260.0, 4.0, 4.0), 300.0, 0.5, 300)[0]
    seen = TransferFunction([(0.0, 1.0, 0.0, 0.0)], [(0.0, 0.0, 0.5, 0.0), (1.0, 0.1, 0.5, 0.0)], 1.0)
    for place in ("coarse", "fine"):
        source = OwnLevels(values)
        source._parts[place == "coarse"]._values[2, 2, 2] = np.nan
        with pytest.raises(BadInput, match=r"own\.zarr contains values that are NaN or infinite"):
            render_views(LargeVolume(source, 1 << 28, source.name), seen, [camera], "bricks")


@pytest.mark.parametrize("far", nightly([1e3, 1e5, 1e9, -1e5, -1e9], 1e9, -1e5))
def test_a_single_value_far_away_changes_nothing_but_its_neighbours(far: float) -> None:
    """The table of colours is one of the values that are told apart, not of all from the smallest to the largest."""
    axis = np.linspace(-1.0, 1.0, 24)
    radius = np.sqrt(sum(np.square(a) for a in np.meshgrid(axis, axis, axis, indexing="ij")))
    values = np.clip(1.2 - radius, 0.0, 1.0).astype(np.float32)
    steps = [(0.3, 0.0), (0.32, 0.2), (0.36, 0.2), (0.38, 0.0), (0.7, 0.0), (0.75, 0.8), (1.2, 0.8), (1.21, 0.0)]
    function = TransferFunction(
        [(0.0, 0.9, 0.2, 0.1), (0.5, 0.9, 0.2, 0.1), (0.51, 0.1, 0.3, 0.9)],
        [(value, opacity, 0.5, 0.0) for value, opacity in steps], unit_distance=2.0,
    )  # fmt: skip
    camera = make_views(from_array(values), function, n=3, test=0, size=48, rescale=False)[0].cameras[0]
    shown = []
    for corner in (0.0, far):
        values[0, 0, 0] = corner
        shown.append(render_views(from_array(values), function, [camera], "bricks", Shading(on=False)).astype(float))
    away = np.abs(shown[1] - shown[0]).max(axis=(0, 3))
    assert shown[0].max() > 200.0 and (away > 3.0).mean() < 0.01 and away[12:36, 12:36].max() <= 3.0


@pytest.mark.parametrize("points", [((0.2, 0.0), (0.3, 1.0)), ((0.6, 1.0), (0.7, 0.0)), ((0.4, 0.2), (0.5, 0.2))])
def test_values_beyond_the_last_points_are_drawn_as_vtk_draws_them(points: tuple[tuple[float, float], ...]) -> None:
    axis = np.linspace(-1.0, 1.0, 24)
    values = (1.0 - np.abs(axis[:, None, None] + axis[None, :, None] + axis) / 3.0).astype(np.float32)
    function = TransferFunction(
        [(0.3, 0.9, 0.2, 0.1)], [(value, opacity, 0.5, 0.0) for value, opacity in points], unit_distance=2.0
    )
    camera = make_views(from_array(values), function, n=3, test=0, size=48, rescale=False)[0].cameras[0]
    ours, theirs = (
        render_views(from_array(values), function, [camera], mapper, Shading(on=False)).astype(float)
        for mapper in ("bricks", "cpu")
    )
    assert theirs[..., 3].mean() > 5.0 and np.abs(ours - theirs).mean() < 4.0
    alpha = theirs[0, ..., 3]
    within = (maximum_filter(alpha, 3) - minimum_filter(alpha, 3) < 16.0) & (alpha > 0.0)  # not at a box's edge
    assert within.mean() > 0.05 and np.abs(ours - theirs)[0][within].mean() < 1.0


def test_what_memory_or_the_table_does_not_hold_is_left_to_vtk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(casters, "hardware_opengl", lambda: False)
    image = stirred_volume(40, levels=255)
    assert large.quickest(image, "auto", 1.0) == "bricks"
    values = to_array(image)
    assert large.quickest(from_array(values.astype(np.int32) * 100), "auto", 1.0) == "auto"
    assert large.quickest(from_array(values.astype(np.float32) * 100), "auto", 1.0) == "bricks"
    far = values.astype(np.int32)
    far[0, 0, 0] = -30_000
    wide = from_array(far)
    assert large.quickest(wide, "auto", 1.0) == "auto"
    assert large.quickest(wide, "auto", 1.0, function_over(100, 200)) == "bricks"
    monkeypatch.setattr(large, "memory_allowed", lambda memory: 100_000)
    assert large.quickest(image, "auto", None) == "auto"


def function_over(low: float, high: float) -> TransferFunction:
    return TransferFunction([(low, 0, 0, 1), (high, 1, 0, 0)], [(low, 0.0, 0.5, 0.0), (high, 0.5, 0.5, 0.0)])


def test_values_far_apart_are_drawn_by_bricks_on_a_gpu_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(casters, "hardware_opengl", lambda: True)
    values = to_array(stirred_volume(40)).astype(np.float32)
    assert large.quickest(from_array(values), "auto", 1.0, function_over(0, 1), False) == "auto"
    values[0, 0, 0] = -99999.0
    assert large.quickest(from_array(values), "auto", 1.0, function_over(0, 1), False) == "bricks"
    assert large.quickest(from_array(values), "auto", 1.0, function_over(0, 1), True) == "auto"
    assert large.quickest(from_array(values), "gpu", 1.0, function_over(0, 1), False) == "gpu"
