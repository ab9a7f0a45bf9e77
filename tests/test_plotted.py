"""Volumes as Python has them: what PyVista's plotter shows is drawn alike, and arrays are what they are said to be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from vtkmodules.vtkCommonCore import vtkIdTypeArray
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction, vtkPlane
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction, vtkVolumeProperty

pyvista = pytest.importorskip("pyvista")

import svv  # noqa: E402
from svv.core.colour.shading import Shading  # noqa: E402
from svv.core.geometry.given_cameras import camera_of  # noqa: E402
from svv.dvr.draw.given import given_volume  # noqa: E402
from svv.dvr.draw.plotted import function_of  # noqa: E402
from svv.dvr.draw.views import make_views, render_views  # noqa: E402
from svv.dvr.read.grids import assumed_of, index_to_world, to_array  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from tests.nightly import nightly  # noqa: E402

SIZE = (120, 96)
TINY: dict[str, Any] = {"n": 3, "size": 16, "mapper": "cpu"}


def values() -> np.ndarray:
    """Two blobs of different sizes, which no turn and no mirror maps to themselves. [z, y, x]"""
    z, y, x = np.mgrid[0:20, 0:24, 0:28].astype(float)
    large = np.exp(-((x - 9) ** 2 + 1.5 * (y - 8) ** 2 + (z - 9) ** 2) / 30)
    return large + 0.7 * np.exp(-((x - 20) ** 2 + (y - 17) ** 2 + (z - 12) ** 2) / 12)


def image() -> Any:
    grid = pyvista.wrap(np.ascontiguousarray(values().transpose(2, 1, 0)))
    grid.spacing, grid.origin = (1.0, 0.8, 1.3), (3.0, -2.0, 5.0)
    return grid


def bytes_() -> Any:
    grid = image()
    grid["values"] = (200 * grid["values"]).astype(np.uint8)
    return grid


def sheared() -> Any:
    grid = image().cast_to_structured_grid()
    points = grid.points.copy()
    points[:, 0] += 0.15 * points[:, 1]
    grid.points = points
    return grid


class Case(NamedTuple):
    """A grid, what add_volume is told, what is done to the plotter, and what differs at most."""

    grid: Callable[[], Any] = image
    told: dict[str, Any] = {}  # noqa: RUF012 - never changed
    after: Callable[[Any, Any], object] = lambda plotter, actor: None
    overlap: float = 0.98
    levels: float = 1.5
    shift: float = 0.3
    """Pixels. VTK's ray caster for unstructured grids draws half a pixel further up and to the right."""


TURN = np.array(pyvista.transformations.axis_angle_rotation((1, 2, 3), 40)) @ np.diag((2.0, 2.0, 2.0, 1.0))

SHOWN = {
    "as it is": Case(),
    "voxels": Case(after=lambda plotter, actor: actor.prop.SetInterpolationTypeToNearest()),
    "turned and larger": Case(told={"user_matrix": TURN}),
    "taller": Case(after=lambda plotter, actor: plotter.set_scale(zscale=2.0)),
    "moved": Case(after=lambda plotter, actor: actor.SetPosition(4.0, -3.0, 2.0)),
    "bytes": Case(bytes_),
    "cells": Case(lambda: image().point_data_to_cell_data()),
    "range": Case(told={"clim": (0.1, 0.6)}),
    "logarithmic": Case(told={"log_scale": True, "clim": (0.01, 1.0)}),
    "own opacities": Case(told={"opacity": [0.0, 0.0, 0.5, 0.1, 1.0]}),
    "unit distance": Case(told={"opacity_unit_distance": 10.0}),
    "parallel rays": Case(after=lambda plotter, actor: plotter.enable_parallel_projection()),
    "shaded": Case(told={"shade": True, "specular": 0.4, "ambient": 0.2}, levels=5.0),  # highlights are wider on a CPU
    "structured": Case(sheared, overlap=0.96, levels=4.0, shift=1.0),
    "tetrahedra": Case(lambda: image().cast_to_unstructured_grid().triangulate(), overlap=0.96, levels=4.0, shift=1.0),
}


@pytest.fixture
def plotter():
    made = pyvista.Plotter(off_screen=True, window_size=list(SIZE), lighting="none")
    made.add_light(pyvista.Light(light_type="headlight"))
    made.set_background("white")
    yield made
    made.close()


def add(plotter: Any, grid: Any = None, **told: Any) -> Any:
    given = {"cmap": "plasma", "opacity": "sigmoid_5", "show_scalar_bar": False, **told}
    actor = plotter.add_volume(image() if grid is None else grid, **given)
    actor.prop.SetInterpolationTypeToLinear()
    return actor


def look(plotter: Any) -> None:
    plotter.view_vector((1.0, -2.0, 0.7), (0.0, 0.0, 1.0))
    plotter.camera.zoom(1.3)


def middle(picture: np.ndarray) -> np.ndarray:
    """The mean row and column, each pixel as heavy as it is dark. (2,)"""
    weight = 255.0 - picture.min(-1)
    return np.array([(np.indices(weight.shape)[axis] * weight).sum() for axis in (0, 1)]) / weight.sum()


@pytest.mark.parametrize(
    "case",
    nightly(
        SHOWN,
        "voxels",
        "turned and larger",
        "moved",
        "cells",
        "range",
        "logarithmic",
        "own opacities",
        "parallel rays",
        "shaded",
        "structured",
    ),
)
def test_what_a_plotter_shows_is_drawn_where_and_as_pyvista_draws_it(plotter: Any, case: str) -> None:
    asked = SHOWN[case]
    actor = add(plotter, asked.grid(), **asked.told)
    asked.after(plotter, actor)
    look(plotter)
    theirs = plotter.screenshot(return_img=True).astype(float)
    shown, function = given_volume(plotter), function_of(plotter)
    assert isinstance(shown, vtkImageData) and function is not None
    drawn = render_views(shown, function, [camera_of(plotter, NO_SCENE)], "cpu")[0] / 255.0
    ours = 255.0 * (drawn[..., :3] * drawn[..., 3:] + 1.0 - drawn[..., 3:])
    one, two = theirs.min(-1) < 245, ours.min(-1) < 245
    assert 1000 < one.sum() < 0.7 * one.size
    assert (one & two).sum() > asked.overlap * (one | two).sum()
    assert np.linalg.norm(middle(theirs) - middle(ours)) < asked.shift  # pixels
    assert np.abs(theirs - ours)[one | two].mean() < asked.levels


class NoScene:
    """What is seen where no name of a side asks for it."""

    @property
    def rig(self) -> Any:
        raise AssertionError("A plotter's camera needs no rig.")


NO_SCENE = NoScene()


def test_views_of_a_plotter_are_those_of_its_actor_and_have_its_function_and_light(plotter: Any) -> None:
    actor = add(plotter, shade=True, diffuse=0.6)
    sets = [make_views(given, **TINY)[0] for given in (plotter, actor, plotter.renderer)]
    for other in sets[1:]:
        np.testing.assert_array_equal(sets[0].images, other.images)
    meta = sets[0].meta
    assert meta.shading == Shading(True, 0.1, 0.6, 0.2, 10.0) and not meta.tf_rescaled and meta.assumed is None
    assert meta.tf is not None and meta.tf["ScalarOpacityUnitDistance"] == actor.prop.opacity_unit_distance
    # The function of a property or plotter for another volume, and another function for the plotter's.
    for tf in (actor.prop, plotter):
        np.testing.assert_array_equal(make_views(image(), tf, **TINY)[0].images, sets[0].images)
    flat = make_views(plotter, actor.prop, shading=Shading(False), **TINY)[0]
    assert flat.meta.shading == Shading(False) and (flat.images != sets[0].images).any()


def test_interpolation_is_the_actors_or_the_propertys(plotter: Any) -> None:
    actor = add(plotter)
    actor.prop.SetInterpolationTypeToNearest()
    assert make_views(plotter, **TINY)[0].meta.nearest and make_views(image(), actor.prop, **TINY)[0].meta.nearest


@pytest.mark.slow
def test_a_mesh_is_resampled_and_interpolated_whatever_its_property_says(plotter: Any) -> None:
    actor = add(plotter)
    actor.prop.SetInterpolationTypeToNearest()
    mesh = make_views(sheared(), actor.prop, **TINY)[0].meta
    assert not mesh.nearest and mesh.assumed is not None and "was resampled to" in mesh.assumed


def test_levels_of_grey_are_colours() -> None:
    grey, opacity, made = vtkPiecewiseFunction(), vtkPiecewiseFunction(), vtkVolumeProperty()
    for value, level in ((0.0, 0.1), (1.0, 0.9)):
        grey.AddPoint(value, level)
        opacity.AddPoint(value, value)
    made.SetColor(grey)
    made.SetScalarOpacity(opacity)
    function = function_of(made)
    assert function is not None
    np.testing.assert_allclose(function.colour_at([0.0, 0.25, 1.0]), np.repeat([[0.1], [0.3], [0.9]], 3, 1))
    assert function.unit_distance == 1.0


def test_what_is_not_painted_is_said(plotter: Any) -> None:
    plotter.enable_lightkit()
    add(plotter, shade=True)
    plotter.add_mesh(pyvista.Sphere())
    said = assumed_of(given_volume(plotter))  # type: ignore[arg-type]
    assert said is not None
    assert "lit from the camera alone, not by the plotter's 5 lights." in said
    assert "not the 1 other things" in said


def gradient(plotter: Any, actor: Any) -> None:
    function = vtkPiecewiseFunction()
    function.AddPoint(0.0, 0.0)
    function.AddPoint(1.0, 1.0)
    actor.prop.SetGradientOpacity(function)


def rgba(plotter: Any, actor: Any) -> None:
    grid = image()
    grid["values"] = np.full((grid.n_points, 4), 200, np.uint8)
    plotter.remove_actor(actor)
    plotter.add_volume(grid, scalars="values", show_scalar_bar=False)


REFUSED: dict[str, tuple[Callable[[Any, Any], object], str]] = {
    "another volume": (lambda plotter, actor: add(plotter, bytes_()), "There are 2 volumes"),
    "nothing": (lambda plotter, actor: plotter.remove_actor(actor), "shows no volume"),
    "hidden": (lambda plotter, actor: actor.SetVisibility(False), "shows no volume"),
    "closed": (lambda plotter, actor: plotter.show(), r"show\(auto_close=False\)"),
    "blend mode": (lambda plotter, actor: actor.mapper.SetBlendModeToMaximumIntensity(), "blend mode"),
    "cropped": (lambda plotter, actor: actor.mapper.CroppingOn(), "cropped"),
    "clipped": (lambda plotter, actor: actor.mapper.AddClippingPlane(vtkPlane()), "clipping planes"),
    "gradients": (gradient, "depend on gradients"),
    "brighter": (lambda plotter, actor: actor.mapper.SetFinalColorLevel(0.3), "colour window"),
    "2D": (lambda plotter, actor: actor.prop.SetTransferFunctionModeTo2D(), "2D transfer function"),
    "colours": (rgba, "has 4 components"),
    "sheared": (
        lambda plotter, actor: actor.SetUserMatrix(
            pyvista.vtkmatrix_from_array(np.array([[1, 0.5, 0, 0], *np.eye(4)[1:]]))
        ),
        "which shears it",
    ),
    "flat": (lambda plotter, actor: actor.SetScale(1.0, 1.0, 0.0), "to nothing"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_reproduced_is_refused_in_one_sentence(plotter: Any, case: str) -> None:
    change, words = REFUSED[case]
    actor = add(plotter)
    change(plotter, actor)
    with pytest.raises(BadInput, match=words) as caught:
        make_views(plotter, **TINY)
    assert "\n" not in str(caught.value)


def test_several_actors_are_several_volumes(plotter: Any) -> None:
    both = plotter.add_volume(pyvista.MultiBlock([image(), bytes_()]), show_scalar_bar=False)
    with pytest.raises(BadInput, match="There are 2 volumes"):
        make_views(both, **TINY)


def test_an_array_is_the_file_of_it(tmp_path: Any) -> None:
    array, spacing, origin = values().astype(np.float32), (1.0, 0.8, 1.3), (3.0, -2.0, 5.0)
    shown = given_volume(array, spacing=spacing, origin=origin)
    assert isinstance(shown, vtkImageData)
    np.testing.assert_array_equal(to_array(shown), array)
    np.testing.assert_allclose(index_to_world(shown), [[1, 0, 0, 3], [0, 0.8, 0, -2], [0, 0, 1.3, 5], [0, 0, 0, 1]])
    assert assumed_of(shown) is None
    np.save(tmp_path / "v.npy", array)
    for layout in (array, np.asfortranarray(array), array.astype(">f4")):
        np.testing.assert_array_equal(
            make_views(layout, **TINY)[0].images, make_views(tmp_path / "v.npy", **TINY)[0].images
        )
    same = make_views(values(), spacing=spacing, origin=origin, **TINY)[0].images
    np.testing.assert_array_equal(same, make_views(image(), **TINY)[0].images)
    said = make_views(array, **TINY)[0].meta.assumed
    assert said is not None and "taken for [z, y, x], with voxels of 1 x 1 x 1" in said


@pytest.mark.parametrize("kind", [bool, np.int8, np.uint16, np.int64, np.float16, np.float64, np.longdouble])
def test_arrays_of_all_real_kinds_are_volumes(kind: type) -> None:
    array: np.ndarray = (60 * values()).astype(kind)
    shown = given_volume(array, spacing=(1, 1, 1))
    np.testing.assert_array_equal(to_array(shown), array.astype(np.float64))  # type: ignore[arg-type]


BAD: dict[str, tuple[Any, dict[str, Any], str]] = {
    "not numbers": (np.full((4, 4, 4), np.nan), {}, "no voxel with a value"),
    "infinite": (np.full((4, 4, 4), -np.inf), {}, "no voxel with a value"),
    "complex": (values() + 1j, {}, "values of type complex128"),
    "structured": (np.zeros((4, 4, 4), [("a", float), ("b", int)]), {}, "values of type"),
    "objects": (values().astype(object), {}, "values of type object"),
    "text": (values().astype(str), {}, "values of type"),
    "times": (np.zeros((4, 4, 4), "M8[s]"), {}, "values of type"),
    "two axes": (values()[0], {}, "needs three axes"),
    "five axes": (values()[None, ..., None], {}, "needs three axes"),
    "one number": (np.array(3.0), {}, "needs three axes"),
    "empty": (np.zeros((0, 4, 4)), {}, "is empty"),
    "flat": (np.zeros((1, 4, 4)), {}, "at least 2 along each axis"),
    "masked": (np.ma.masked_less(values(), 1e9), {}, "no voxel with a value"),
    "two steps": (values(), {"spacing": (1, 2)}, "spacing needs three"),
    "one step": (values(), {"spacing": 2.0}, "spacing needs three"),
    "no steps": (values(), {"spacing": (1, 0, 1)}, "three positive numbers"),
    "steps back": (values(), {"spacing": (1, -1, 1)}, "three positive numbers"),
    "no number": (values(), {"spacing": (1, np.nan, 1)}, "spacing needs three"),
    "letters": (values(), {"origin": "abc"}, "origin needs three"),
    "a grid with a spacing": (image(), {"spacing": (1, 1, 1)}, "are for arrays"),
    "a file with an origin": ("v.npy", {"origin": (0, 0, 0)}, "are for arrays"),
    "a list": (values().tolist(), {}, "not one of the type list"),
    "a surface": (pyvista.Sphere(), {}, "fill no space"),
    "a table": (pyvista.Table({"a": np.ones(2)}), {}, "not one of the type Table"),
    "an array of VTK's": (vtkIdTypeArray(), {}, "not one of the type"),
    "no function": (values(), {"tf": 3}, "A transfer function is an svv.TransferFunction"),
    "half a function": (values(), {"tf": vtkColorTransferFunction()}, "A transfer function is an svv.TransferFunction"),
}


@pytest.mark.parametrize("case", BAD)
def test_other_things_are_refused_in_one_sentence(case: str) -> None:
    volume, changes, words = BAD[case]
    with pytest.raises(BadInput, match=words) as caught:
        make_views(volume, **{**TINY, **changes})
    assert "\n" not in str(caught.value)


def test_a_property_without_points_is_refused() -> None:
    with pytest.raises(BadInput):
        make_views(values(), vtkVolumeProperty(), **TINY)


@pytest.mark.slow
def test_the_volume_of_an_array_is_known_again() -> None:
    views, _ = make_views(values(), spacing=(1.0, 0.8, 1.3), n=16, size=64, mapper="cpu")
    scene, _ = svv.train_scene(views, "draft")
    assert svv.volume_panel(scene, values()).shows == "volume rendering"
    assert svv.volume_panel(scene, values()[::-1]).shows == "palette network"
