"""Grids that are no images: resampled, with their edges, and refused where they fill no space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray
from vtkmodules.vtkCommonDataModel import (
    vtkDataSetAttributes,
    vtkImageData,
    vtkMultiBlockDataSet,
    vtkPartitionedDataSet,
    vtkRectilinearGrid,
    vtkSphere,
    vtkUnstructuredGrid,
)
from vtkmodules.vtkFiltersCore import vtkAppendFilter
from vtkmodules.vtkFiltersGeneral import vtkClipDataSet, vtkDataSetTriangleFilter, vtkImageDataToPointSet
from vtkmodules.vtkFiltersHyperTree import vtkHyperTreeGridToUnstructuredGrid
from vtkmodules.vtkFiltersSources import vtkRandomHyperTreeGridSource, vtkSphereSource
from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from svv.dvr.draw.large import open_volume
from svv.dvr.draw.views import make_views
from svv.dvr.functions.histogram import default_transfer_function
from svv.dvr.read.appearance import Appearance
from svv.dvr.read.grids import as_volume, from_array, own_unit_distance, to_array
from svv.dvr.read.meshes import is_mesh, resampled
from svv.dvr.read.volumes import read_volume
from svv.errors import BadInput

SIZE = 9


def image(low: float = -1.0) -> vtkImageData:
    """Values of a smooth function at 9 x 9 x 9 points from ``low`` to ``low + 2`` along x and -1 to 1 along y and z."""
    axis = np.linspace(-1, 1, SIZE)
    z, y, x = np.meshgrid(axis, axis, axis + low + 1, indexing="ij")
    return from_array(np.exp(-(x**2)) + np.sin(3 * y) * z, (2 / (SIZE - 1),) * 3, (low, -1.0, -1.0), "s")


def unstructured(of: vtkImageData | None = None) -> vtkUnstructuredGrid:
    append = vtkAppendFilter()
    append.AddInputData(of or image())
    append.Update()
    return append.GetOutput()


def ball(radius: float) -> vtkUnstructuredGrid:
    sphere, clip = vtkSphere(), vtkClipDataSet()
    sphere.SetRadius(radius)
    clip.SetClipFunction(sphere)
    clip.InsideOutOn()
    clip.SetInputData(unstructured())
    clip.Update()
    return clip.GetOutput()


def blocks(kind: type) -> vtkMultiBlockDataSet | vtkPartitionedDataSet:
    both = kind()
    put = both.SetBlock if kind is vtkMultiBlockDataSet else both.SetPartition
    for number, block in enumerate((unstructured(image(-3.0)), image(-1.0))):
        put(number, block)
    return both


def volume_of(mesh: vtkUnstructuredGrid) -> float:
    """Sum of the volumes of its cells."""
    sizes = vtkCellSizeFilter()
    sizes.SetInputData(mesh)
    sizes.Update()
    return float(vtk_to_numpy(sizes.GetOutput().GetCellData().GetArray("Volume")).sum())


def as_tetrahedra() -> vtkUnstructuredGrid:
    split = vtkDataSetTriangleFilter()
    split.SetInputData(unstructured())
    split.Update()
    return split.GetOutput()


def test_a_box_of_cells_gets_as_many_points_as_it_has() -> None:
    """So that its values are left as they are, and their gradients are smooth."""
    for mesh in (unstructured(), as_tetrahedra()):
        assert is_mesh(mesh) and not is_mesh(image())
        found = resampled(mesh)
        assert found.GetDimensions() == (SIZE,) * 3 and Appearance.of(as_volume(found)).blank is None
        np.testing.assert_allclose(to_array(found), to_array(image()), atol=1e-4)
        np.testing.assert_allclose(found.GetBounds(), image().GetBounds(), atol=1e-5)


def test_the_unit_distance_is_that_of_the_mesh() -> None:
    """ParaView's: the diagonal over the cube root of the number of cells, whatever the image has."""
    for mesh, along in ((unstructured(), None), (unstructured(), 30), (as_tetrahedra(), 30)):
        kept = own_unit_distance(as_volume(resampled(mesh, along=along)))
        assert kept == pytest.approx(np.sqrt(12) / np.cbrt(mesh.GetNumberOfCells()), rel=1e-5)
    views, _ = make_views(resampled(unstructured(), along=15), n=3, size=16, mapper="cpu", step=1.0)
    assert views.meta.tf is not None
    assert views.meta.tf["ScalarOpacityUnitDistance"] == pytest.approx(np.sqrt(12) / 8, rel=1e-5)


def test_points_outside_a_ball_are_blanked() -> None:
    mesh = ball(0.8)
    volume = as_volume(resampled(mesh))
    shown, size = Appearance.of(volume), np.array(volume.GetDimensions())
    assert size.min() >= 90
    at = np.random.default_rng(0).uniform(-0.8, 0.8, (20000, 3))
    index = (at - volume.GetOrigin()) / volume.GetSpacing()
    drawn = ~shown.hidden_at(index)
    assert drawn.mean() * 1.6**3 == pytest.approx(volume_of(mesh), rel=0.02)
    assert not drawn[np.linalg.norm(at, axis=1) > 0.83].any() and drawn[np.linalg.norm(at, axis=1) < 0.7].all()
    values = vtk_to_numpy(mesh.GetPointData().GetArray("s"))
    assert values.min() - 1e-9 <= to_array(volume).min() and to_array(volume).max() <= values.max() + 1e-9


@pytest.mark.parametrize("kind", [vtkMultiBlockDataSet, vtkPartitionedDataSet])
def test_blocks_are_one_volume(kind: type) -> None:
    found = resampled(blocks(kind), along=2 * SIZE - 1)
    assert found.GetDimensions() == (2 * SIZE - 1, SIZE, SIZE) and Appearance.of(as_volume(found)).blank is None
    first, second = to_array(image(-3.0)), to_array(image())
    np.testing.assert_allclose(to_array(found)[..., :8], first[..., :8], atol=1e-4)
    np.testing.assert_allclose(to_array(found)[..., 9:], second[..., 1:], atol=1e-4)


def test_uneven_planes_are_interpolated() -> None:
    grid, rng = vtkRectilinearGrid(), np.random.default_rng(0)
    grid.SetDimensions(12, 11, 10)
    planes = [np.sort(np.r_[0, 1, rng.uniform(0, 1, n - 2)]) for n in (12, 11, 10)]
    for put, places in zip((grid.SetXCoordinates, grid.SetYCoordinates, grid.SetZCoordinates), planes):
        put(numpy_to_vtk(places, deep=True))
    z, y, x = np.meshgrid(*planes[::-1], indexing="ij")
    array = numpy_to_vtk((x + 2 * y - 3 * z).ravel(), deep=True)
    array.SetName("linear")
    grid.GetPointData().AddArray(array)
    found = resampled(grid)
    z, y, x = np.meshgrid(*(np.linspace(0, 1, n) for n in found.GetDimensions()[::-1]), indexing="ij")
    np.testing.assert_allclose(to_array(found), x + 2 * y - 3 * z, atol=1e-5)


def test_values_of_cells_are_those_of_the_points_in_them() -> None:
    mesh = unstructured()
    array = numpy_to_vtk(np.arange(mesh.GetNumberOfCells()), deep=True)
    array.SetName("s")
    mesh.GetCellData().AddArray(array)
    found = resampled(mesh, "s", cells=True, along=17)
    assert set(np.unique(to_array(found))) == set(range(mesh.GetNumberOfCells()))
    assert to_array(resampled(mesh, "s", along=17)).max() < 3
    levels = vtkMultiBlockDataSet()
    part = image()
    part.GetPointData().Initialize()
    part.GetCellData().AddArray(array)
    levels.SetBlock(0, part)
    np.testing.assert_array_equal(to_array(resampled(levels)).ravel(), np.arange(8**3))  # at the centres


@pytest.mark.parametrize("masked", [0.0, 0.3])
def test_hyper_tree_grids_have_the_values_of_their_leaves(masked: float) -> None:
    source = vtkRandomHyperTreeGridSource()
    source.SetMaxDepth(3)
    source.SetSplitFraction(0.5)
    source.SetMaskedFraction(masked)
    source.SetDimensions(4, 3, 5)
    source.SetOutputBounds(0, 3, 0, 2, 0, 4)
    source.Update()
    assert is_mesh(source.GetOutput())
    leaves = vtkHyperTreeGridToUnstructuredGrid()
    leaves.SetInputData(source.GetOutput())
    leaves.Update()
    cells = leaves.GetOutput()
    centres = np.array(
        [np.array(cells.GetCell(k).GetBounds()).reshape(3, 2).mean(1) for k in range(cells.GetNumberOfCells())]
    )
    found = resampled(source.GetOutput(), "Depth")
    if not masked:
        assert found.GetDimensions() == (24, 16, 32)  # the finest leaves
    index = np.rint((centres - found.GetOrigin()) / found.GetSpacing() - (0 if masked else 1e-3)).astype(int)
    blank = Appearance.of(as_volume(found)).blank
    depth = vtk_to_numpy(cells.GetCellData().GetArray("Depth"))
    at = tuple(index.T[::-1])
    assert (blank is None) == (not masked) and (blank is None or not blank[at].any())
    # Values at the edge of what is masked are means of their neighbours.
    assert (to_array(found)[at] == depth).mean() > (0.95 if masked else 0.9999)
    if blank is not None:
        sizes = [np.diff(np.array(cells.GetCell(k).GetBounds()).reshape(3, 2)).prod() for k in range(len(centres))]
        assert 1 - blank.mean() == pytest.approx(sum(sizes) / 24, abs=0.05)


def test_hidden_cells_and_points_of_blocks_are_not_drawn() -> None:
    for on_cells in (True, False):
        block = vtkMultiBlockDataSet()
        part = image()
        size = [n - on_cells for n in (SIZE,) * 3]
        flags = np.zeros(size, np.uint8)
        flags[:, :, 4:] = vtkDataSetAttributes.HIDDENCELL if on_cells else vtkDataSetAttributes.HIDDENPOINT
        ghosts = numpy_to_vtk(flags.ravel(), deep=True)
        ghosts.SetName(vtkDataSetAttributes.GhostArrayName())
        (part.GetCellData() if on_cells else part.GetPointData()).AddArray(ghosts)
        block.SetBlock(0, part)
        np.testing.assert_allclose(resampled(block, "s").GetBounds()[:2], (-1.0, 0.0 if on_cells else -0.25), atol=1e-5)


def test_blanked_points_of_a_curvilinear_grid_are_not_drawn() -> None:
    convert = vtkImageDataToPointSet()
    convert.SetInputData(image())
    convert.Update()
    grid = convert.GetOutput()
    for point in np.flatnonzero(np.indices((SIZE,) * 3)[2].ravel() > 4):
        grid.BlankPoint(int(point))
    np.testing.assert_allclose(resampled(grid, "s").GetBounds()[:2], (-1.0, 0.0), atol=1e-5)


def test_surfaces_beside_cells_are_left_out() -> None:
    sphere, append = vtkSphereSource(), vtkAppendFilter()
    sphere.SetRadius(20)
    sphere.Update()
    far = sphere.GetOutput()
    far.GetPointData().AddArray(named("s", np.full(far.GetNumberOfPoints(), 99.0)))
    append.AddInputData(unstructured())
    append.AddInputData(far)
    append.Update()
    found = resampled(append.GetOutput(), "s")
    np.testing.assert_allclose(found.GetBounds(), resampled(unstructured(), "s").GetBounds())
    assert to_array(found).max() < 3


def test_blocks_may_have_arrays_of_different_types() -> None:
    """Else values of one would be cut off to the type of another."""
    parts = vtkMultiBlockDataSet()
    for k, values in enumerate((np.arange(8**3) % 200, np.arange(8**3) + 1000.5)):
        mesh = unstructured(image(-1.0 - 2 * k))
        mesh.GetCellData().AddArray(named("c", values.astype((np.uint8, np.float64)[k])))
        parts.SetBlock(k, mesh)
    found = to_array(resampled(parts, "c", cells=True))
    assert found.max() == 1000.5 + 8**3 - 1 and found.min() == 0.0


def test_integers_that_are_too_close_are_refused_before_they_are_interpolated() -> None:
    mesh = unstructured()
    mesh.GetPointData().AddArray(named("i", 2**60 + np.arange(SIZE**3)))
    with pytest.raises(BadInput, match="cannot tell most of them apart"):
        resampled(mesh, "i")


def test_the_default_function_does_not_count_what_is_blanked() -> None:
    """Else the points outside a small mesh would be its background, and the smallest values invisible."""
    volume = as_volume(resampled(ball(0.5), along=40))
    blank = Appearance.of(volume).blank
    assert blank is not None and blank.mean() > 0.4
    values = to_array(volume)[~blank]
    alone = from_array(np.pad(values, (0, -len(values) % 4), mode="edge").reshape(-1, 2, 2))
    found, expected = (default_transfer_function(one) for one in (volume, alone))
    np.testing.assert_allclose(found.opacities, expected.opacities, atol=0.02)


def named(name: str, values: np.ndarray) -> vtkDataArray:
    array = numpy_to_vtk(values, deep=True)
    array.SetName(name)
    return array


def flat() -> vtkUnstructuredGrid:
    cut = from_array(np.random.default_rng(0).random((5, 5, 5)), name="s")
    mesh = unstructured(cut)
    for k in range(mesh.GetNumberOfPoints()):
        x, y, _ = mesh.GetPoint(k)
        mesh.GetPoints().SetPoint(k, x, y, 0.0)
    return mesh


def surface() -> object:
    sphere = vtkSphereSource()
    sphere.Update()
    data = sphere.GetOutput()
    data.GetPointData().SetScalars(data.GetPointData().GetNormals())
    one = numpy_to_vtk(np.arange(data.GetNumberOfPoints(), dtype=float), deep=True)
    one.SetName("s")
    data.GetPointData().SetScalars(one)
    return data


REFUSED = {
    "surface": (surface, {}, "vtkPolyData of points, lines or surfaces, which fill no space: insert Delaunay 3D"),
    "flat": (flat, {}, "The input is flat"),
    "empty": (vtkUnstructuredGrid, {}, "without cells"),
    "no blocks": (vtkMultiBlockDataSet, {}, "without cells"),
    "another array": (lambda: blocks(vtkMultiBlockDataSet), {"array": "t"}, "has no array 't'; it has s"),
    "too fine": (unstructured, {"along": 4000}, "4000 x 4000 x 4000 points, more than fit into memory"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_resampled_is_refused(case: str) -> None:
    make, options, words = REFUSED[case]
    with pytest.raises(BadInput, match=words):
        resampled(make(), **options)


def test_arrays_of_vectors_are_refused() -> None:
    mesh = unstructured()
    array = numpy_to_vtk(np.zeros((mesh.GetNumberOfPoints(), 3)), deep=True)
    array.SetName("v")
    mesh.GetPointData().AddArray(array)
    with pytest.raises(BadInput, match="'v' has 3 components"):
        resampled(mesh, "v")


def test_files_of_meshes_are_volumes(tmp_path: Path) -> None:
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / "ball.vtu"))
    writer.SetInputData(ball(0.8))
    writer.Write()
    found = read_volume(tmp_path / "ball.vtu", resample_to=20)  # by a process of its own
    expected = as_volume(resampled(ball(0.8), along=20))
    np.testing.assert_array_equal(to_array(found), to_array(expected))
    np.testing.assert_array_equal(Appearance.of(found).blank, Appearance.of(expected).blank)
    assert own_unit_distance(found) == own_unit_distance(expected) and found.GetOrigin() == expected.GetOrigin()
    opened = open_volume(tmp_path / "ball.vtu", resample_to=20)
    assert isinstance(opened, vtkImageData) and opened.GetDimensions() == (20, 20, 20)
