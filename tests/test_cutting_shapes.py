"""ParaView's surfaces with handles as texts of cuts: a cut is where the surface's function says that a point lies."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from vtkmodules.vtkCommonDataModel import vtkBox, vtkCylinder, vtkImplicitFunction, vtkPlane, vtkSphere
from vtkmodules.vtkCommonTransforms import vtkTransform

from svv.core.geometry.cuts import Cut
from svv.errors import BadInput
from svv.pv.panel.cutting_shapes import cut_at, text_of

UNITS = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
places = st.tuples(*[st.floats(-50.0, 50.0)] * 3)
angles = st.tuples(*[st.floats(-180.0, 180.0)] * 3)
sizes = st.floats(0.01, 60.0)
directions = places.filter(lambda v: sum(x * x for x in v) > 1e-3)


@st.composite
def boxes(draw: st.DrawFn) -> vtkBox:
    """As ParaView 5.11 makes one of Position, Rotation and Length; bounds other than 0 to 1 with UseReferenceBounds."""
    box, transform = vtkBox(), vtkTransform()
    low, size = np.array(draw(st.sampled_from([(0.0, 0.0, 0.0), (-1.0, -2.0, 4.0)]))), draw(st.tuples(*[sizes] * 3))
    box.SetXMin(*low)
    box.SetXMax(*(low + (1.0 if not low.any() else np.array(size))))
    turned = draw(angles)
    transform.Translate(draw(places))
    transform.RotateZ(turned[2])
    transform.RotateX(turned[0])
    transform.RotateY(turned[1])
    transform.Scale(draw(st.tuples(*[sizes] * 3)))
    transform.Inverse()
    box.SetTransform(transform)
    return box


@st.composite
def cylinders(draw: st.DrawFn) -> vtkCylinder:
    """As ParaView makes one of Center, Axis and Radius: turned around its centre by a transform."""
    cylinder, transform, centre = vtkCylinder(), vtkTransform(), draw(places)
    cylinder.SetCenter(centre)
    cylinder.SetRadius(draw(sizes))
    transform.Translate(centre)
    transform.RotateWXYZ(draw(st.floats(-180.0, 180.0)), draw(directions))
    transform.Translate(*(-v for v in centre))
    transform.Inverse()
    if draw(st.booleans()):
        cylinder.SetTransform(transform)
    return cylinder


@st.composite
def planes(draw: st.DrawFn) -> vtkPlane:
    plane = vtkPlane()
    plane.SetOrigin(draw(places))
    plane.SetNormal(draw(directions))
    if hasattr(plane, "SetOffset"):  # since VTK 9.5
        plane.SetOffset(draw(st.floats(-5.0, 5.0)))
        plane.SetAxisAligned(draw(st.booleans()))
    return plane


def test_a_plane_that_is_moved_is_seen_where_it_is_in_the_event_already() -> None:
    """Since VTK 9.5 a plane's values have a change only after its event."""
    plane, seen = vtkPlane(), []
    plane.AddObserver("ModifiedEvent", lambda *_: seen.append(text_of(plane)))
    plane.SetOrigin(10.0, 0.0, 0.0)
    assert Cut.parse(seen[-1], UNITS) == Cut.parse(text_of(plane), UNITS)
    assert Cut.parse(seen[-1], UNITS).planes[0][3] == 0.0  # its normal is z
    plane.SetNormal(1.0, 0.0, 0.0)
    assert Cut.parse(seen[-1], UNITS).planes == ((1.0, 0.0, 0.0, 10.0),)


@st.composite
def spheres(draw: st.DrawFn) -> vtkSphere:
    sphere = vtkSphere()
    sphere.SetCenter(draw(places))
    sphere.SetRadius(draw(sizes))
    return sphere


@given(
    st.one_of(planes(), boxes(), spheres(), cylinders()),
    st.integers(0, 2**32 - 1),
    st.booleans(),
    st.sampled_from([(), (0, 2)]),
)
def test_what_is_cut_off_is_where_the_function_is_positive_or_else_negative(
    function: vtkImplicitFunction, seed: int, invert: bool, regions: tuple[int, ...]
) -> None:
    points = np.random.default_rng(seed).uniform(-80.0, 80.0, (200, 3))
    signs = np.array([function.FunctionValue(point) for point in points])
    cut = Cut.parse(cut_at(text_of(function), invert, regions), UNITS)
    depth = cut.depth(torch.from_numpy(points)).numpy()
    clear = np.abs(depth) > 1e-6 * 140.0
    assert cut.regions == regions
    assert ((depth > 0.0) == ((signs > 0.0) == invert))[clear].all()


def test_points_inside_are_tried_too() -> None:
    """A law over points that all lie outside would hold for anything."""
    box, transform = vtkBox(), vtkTransform()
    transform.RotateZ(45.0)
    transform.Scale(2.0, 2.0, 2.0)
    transform.Inverse()
    box.SetXMin(0.0, 0.0, 0.0)
    box.SetXMax(1.0, 1.0, 1.0)
    box.SetTransform(transform)
    cut = Cut.parse(text_of(box), UNITS)
    places = torch.tensor([[0.0, 1.4, 1.0], [0.0, 2.9, 1.0], [1.3, 1.3, 1.0], [0.0, 1.4, -0.1]], dtype=torch.float64)
    assert (cut.depth(places) > 0.0).tolist() == [True, False, False, False]


def test_a_surface_without_inside_or_with_wrong_numbers_is_refused() -> None:
    flat, transform = vtkBox(), vtkTransform()
    transform.RotateX(30.0)
    transform.Scale(1.0, 0.0, 1.0)
    transform.Inverse()
    flat.SetTransform(transform)
    with pytest.raises(BadInput, match=r"Cut Open By has no inside: .* lengths that are not 0"):
        cut_at(text_of(flat), True, ())
    sphere = vtkSphere()
    sphere.SetRadius(-1.0)  # before ParaView knows the bounds
    with pytest.raises(BadInput, match="radius of a cut must be above 0, not -1"):
        Cut.parse(cut_at(text_of(sphere), True, ()), UNITS)


def test_shapes_that_are_joined_hold_together() -> None:
    joined = Cut.parse("1=outside x>50%&plane:0,0,0:0,1,0&sphere:0,0,0:2", UNITS)
    assert joined.planes == ((1.0, 0.0, 0.0, 0.5), (0.0, 1.0, 0.0, 0.0))
    assert (joined.radius, joined.outside, joined.regions) == (2.0, True, (1,))
    with pytest.raises(BadInput, match=r"may have one ball or cylinder, but 'sphere:.*' has 2"):
        Cut.parse("sphere:0,0,0:2&x>1&cylinder:0,0,0:1,0,0:1", UNITS)
    with pytest.raises(BadInput, match="is no cut: give"):
        Cut.parse("x>1&", UNITS)
