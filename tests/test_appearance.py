"""Blanked, cropped, stretched volumes, and such without interpolation, as VTK's GPU ray caster draws them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction, vtkUniformGrid
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import CameraRig
from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION
from svv.dvr.draw.classify import classified_as
from svv.dvr.draw.frame import set_stage
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance, put
from svv.dvr.read.grids import as_volume, from_array, index_to_world, set_geometry, to_array
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput
from tests.nightly import nightly

SHAPE = (18, 20, 16)
FLAT = Shading(on=False)


def blobs() -> np.ndarray:
    """Three soft balls of different values. (z, y, x) float32"""
    z, y, x = np.indices(SHAPE)
    balls = [((5, 6, 5), 4.0, 1.0), ((11, 13, 9), 5.0, 0.6), ((12, 5, 11), 4.0, 0.8)]
    found = [top * np.exp(-((z - a) ** 2 + (y - b) ** 2 + (x - c) ** 2) / r**2) for (a, b, c), r, top in balls]
    return np.max(found, axis=0).astype(np.float32)


def tf() -> TransferFunction:
    colours = ((0.0, 0.1, 0.2, 0.9), (0.5, 0.2, 0.9, 0.3), (1.0, 0.9, 0.1, 0.1))
    return TransferFunction(colours, ((0.0, 0.0, 0.5, 0.0), (0.2, 0.0, 0.5, 0.0), (1.0, 0.5, 0.5, 0.0)), 1.5)


def some(share: float) -> np.ndarray:
    return np.random.default_rng(1).random(SHAPE) < share


CROP = np.array([[2.3, 4.1, 3.6], [13.2, 15.4, 12.1]])
APPEARANCES = {
    "half blank": Appearance(blank=np.arange(SHAPE[0])[:, None, None] * np.ones(SHAPE) > 8),
    "holes": Appearance(blank=some(0.03)),
    "cropped": Appearance(crop=CROP),
    "nearest": Appearance(nearest=True),
    "stretched": Appearance(stretch=np.array([2.0, 0.5, 1.0])),
    "all": Appearance(some(0.02), CROP, True, np.array([0.5, 1.6, 1.25])),
}
AXES = {"plain": np.diag([1.0, 1.2, 0.9]), "turned, mirrored": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, -1]]) * 0.8}


def image(appearance: Appearance, axes: np.ndarray = AXES["plain"]) -> vtkImageData:
    made = from_array(blobs())
    set_geometry(made, axes, np.array([3.0, -2.0, 5.0]))
    put(made, appearance)
    return made


def on_white(views: np.ndarray) -> np.ndarray:
    alpha = views[..., 3:] / 255.0
    return np.asarray(alpha * views[..., :3] + 255.0 * (1.0 - alpha))


@pytest.mark.parametrize("axes", nightly(AXES, "turned, mirrored"))
@pytest.mark.parametrize("name", APPEARANCES)
def test_it_is_drawn_as_by_vtk(name: str, axes: str) -> None:
    volume = image(APPEARANCES[name], AXES[axes])
    stage = set_stage(volume, tf())
    x, y, z = stage.centre.tolist()
    cameras = CameraRig((x, y, z), 4.0 * float(np.linalg.norm(stage.visible_size)), 0.4).sphere(4, 96)
    ours, theirs, plain = (
        on_white(render_views(made, tf(), cameras, mapper, FLAT, step=0.1))
        for made, mapper in ((volume, "cpu"), (volume, "gpu"), (image(Appearance(), AXES[axes]), "cpu"))
    )
    assert np.abs(ours - theirs).mean() < 0.5
    assert np.abs(plain - theirs).mean() > 4.0 * np.abs(ours - theirs).mean()


def test_an_image_carries_it() -> None:
    wanted = APPEARANCES["all"]
    found = Appearance.of(as_volume(image(wanted)))
    assert found.blank is not None and found.crop is not None and found.nearest
    assert np.array_equal(found.blank, wanted.blank) and np.allclose(found.crop, CROP)
    assert np.allclose(found.stretch, wanted.stretch) and not found.plain
    assert Appearance.of(as_volume(image(Appearance()))).plain


def test_a_blanked_voxel_hides_a_cube_and_half_a_cell_on_each_side() -> None:
    blank = np.zeros((9, 9, 9), bool)
    blank[4, 4, 4] = True
    places = np.arange(2.125, 6.0, 0.25)
    z, y, x = np.meshgrid(places, places, places, indexing="ij")
    hidden = Appearance(blank).hidden_at(np.stack([x, y, z], axis=-1))
    inside = [np.abs(axis - 4) < 0.5 for axis in (x, y, z)]
    beside = [np.abs(axis - 4) < 1.0 for axis in (x, y, z)]
    expected = np.zeros(x.shape, bool)
    for axis in range(3):
        expected |= np.logical_and.reduce([beside[k] if k == axis else inside[k] for k in range(3)])
    assert np.array_equal(hidden, expected)


def ghosts(array: np.ndarray) -> object:
    flags = numpy_to_vtk(np.ascontiguousarray(array, np.uint8).ravel(), deep=True)
    flags.SetName("vtkGhostType")
    return flags


def test_blanking_is_read_from_points_cells_and_grids() -> None:
    grid = vtkUniformGrid()
    grid.ShallowCopy(from_array(blobs()))
    grid.BlankPoint(7)
    blank = Appearance.of(as_volume(grid)).blank
    assert blank is not None and np.flatnonzero(blank).tolist() == [7]
    by_cell = from_array(blobs())
    flags = np.zeros([n - 1 for n in SHAPE])
    flags[2, 3, 4] = 32
    by_cell.GetCellData().AddArray(ghosts(flags))
    blank = Appearance.of(as_volume(by_cell)).blank
    assert blank is not None and np.argwhere(blank).tolist() == [[2, 3, 4]]  # VTK blanks the cell's first corner
    cells = from_array(blobs())
    cells.GetPointData().RemoveArray(0)
    values = numpy_to_vtk(blobs()[:-1, :-1, :-1].ravel(), deep=True)
    values.SetName("s")
    cells.GetCellData().AddArray(values)
    cells.GetCellData().AddArray(ghosts(flags))
    blank = Appearance.of(as_volume(cells)).blank
    assert blank is not None and np.argwhere(blank).tolist() == [[2, 3, 4]]
    cells.GetPointData().AddArray(ghosts(np.arange(blobs().size) == 5))
    with pytest.raises(BadInput, match="Cell Data To Point Data"):
        as_volume(cells)


def test_ghost_layers_are_cut_off() -> None:
    divided = from_array(blobs())
    flags = np.zeros([n - 1 for n in SHAPE])
    flags[:2], flags[:, :, -1:] = 1, 1
    divided.GetCellData().AddArray(ghosts(flags))
    volume = as_volume(divided)
    assert np.array_equal(to_array(volume), blobs()[2:, :, :-1]) and Appearance.of(volume).blank is None
    assert index_to_world(volume)[:3, 3].tolist() == [0.0, 0.0, 2.0]


def test_the_array_of_the_cells_is_not_mixed_up_with_that_of_the_points() -> None:
    both = from_array(blobs(), name="s")
    values = numpy_to_vtk((2.0 + blobs()[:-1, :-1, :-1]).ravel(), deep=True)
    values.SetName("s")
    both.GetCellData().AddArray(values)
    assert to_array(as_volume(both, "s")).max() <= 1.0
    assert to_array(as_volume(both, "s", cells=True)).min() >= 2.0


def test_between_labels_there_are_no_others() -> None:
    """A ball of label 3 in label 0 had a rim of label 2, whose colour training gave it."""
    z, y, x = np.indices(SHAPE)
    made = from_array(np.where((z - 9) ** 2 + (y - 10) ** 2 + (x - 8) ** 2 < 36, 3, 0).astype(np.uint8))
    put(made, Appearance(nearest=True))
    colours = ((1.0, 0.9, 0.1, 0.1), (2.0, 0.1, 0.9, 0.1), (3.0, 0.1, 0.1, 0.9))
    steps = TransferFunction(
        colours, ((0.5, 0, 0.5, 0), (0.5, 0.1, 0.5, 0), (2.5, 0.9, 0.5, 0), (2.5, 0.4, 0.5, 0)), 1.0
    )
    volume = classified_as(made, steps)
    shown = volume.exponent > EMPTY_LOG_EXTINCTION
    wanted = np.log(-np.log(1.0 - 0.4) * volume.box.size)
    np.testing.assert_allclose(volume.exponent[shown], wanted, atol=0.01)
    assert shown.any() and (volume.owner[shown] == len(volume.ranges) - 1).all()


@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (0.5, 0.5, 4.0)])
def test_rays_do_not_miss_a_thin_slice(stretch: tuple[float, float, float]) -> None:
    """A slice of a fifth of a voxel, opaque, had stripes through which one saw."""
    crop = np.array([[1.0, 1.0, 8.0], [14.0, 18.0, 8.2]])
    opaque = TransferFunction([(0.0, 1.0, 1.0, 1.0)], [(-1.0, 1.0, 0.5, 0.0), (0.9, 1.0, 0.5, 0.0), (0.95, 0, 0.5, 0)])
    made = image(Appearance(crop=crop, stretch=np.array(stretch)))
    views, _ = make_views(made, opaque, n=6, size=32, mapper="bricks", rescale=False, shading=FLAT)
    drawn, finer = views.images[..., 3], render_views(made, opaque, views.cameras, "bricks", FLAT, step=0.02)[..., 3]
    assert finer.any() and np.abs(drawn.astype(int) - finer).mean() < 1.0


@pytest.mark.parametrize("name", ["half blank", "cropped"])
def test_training_starts_without_what_is_not_shown(name: str) -> None:
    whole, part = (classified_as(image(shown), tf()) for shown in (Appearance(), APPEARANCES[name]))
    x, y, z = part.box.size * np.indices(part.exponent.shape).reshape(3, -1) / part.cells
    world = np.stack([x, y, z], axis=1) + part.box.low
    to_index = np.linalg.inv(index_to_world(image(Appearance())))
    hidden = APPEARANCES[name].hidden_at(world @ to_index[:3, :3].T + to_index[:3, 3])
    seen = part.exponent.ravel() > part.exponent.min()
    assert not seen[hidden].any() and seen[~hidden].any()
    assert np.all(part.box.size <= whole.box.size)


def test_nothing_left_is_said() -> None:
    for gone in (Appearance(blank=np.ones(SHAPE, bool)), Appearance(crop=np.array([[30.0] * 3, [40.0] * 3]))):
        with pytest.raises(BadInput, match="blanked or cropped away"):
            make_views(image(gone), tf(), n=3, size=16)


def test_files_keep_their_blanking(tmp_path: Path) -> None:
    file = tmp_path / "blank.vti"
    writer = vtkXMLImageDataWriter()
    writer.SetInputData(image(APPEARANCES["holes"]))
    writer.SetFileName(str(file))
    writer.Write()
    assert np.array_equal(Appearance.of(read_volume(file)).blank, APPEARANCES["holes"].blank)
    views, _ = make_views(file, tf(), n=3, size=24)
    assert views.meta is not None and views.meta.mapper == "bricks"


def test_colours_beyond_the_range_and_wrapped_hues_are_those_of_vtk() -> None:
    table = vtkColorTransferFunction()
    table.AddRGBPoint(1.0, 1.0, 0.0, 0.0)
    table.AddRGBPoint(3.0, 1.0, 0.0, 0.5)
    table.SetColorSpaceToHSV()
    table.HSVWrapOn()
    table.UseBelowRangeColorOn()
    table.UseAboveRangeColorOn()
    table.SetBelowRangeColor(0.0, 1.0, 0.0)
    table.SetAboveRangeColor(0.0, 0.0, 1.0)
    opacity = vtkPiecewiseFunction()
    opacity.AddPoint(0.0, 1.0)
    plain = TransferFunction.from_vtk(table, opacity)
    values = np.concatenate([np.linspace(0.5, 3.5, 301), [1.0, 3.0]])
    expected = np.array([table.GetColor(value) for value in values])
    assert np.abs(plain.colour_at(values) - expected)[(values != 1.0) & (values != 3.0)].max() < 2e-3
    assert expected[np.isclose(values, 2.0)][0][1] == 0.0  # by way of magenta, not of green
