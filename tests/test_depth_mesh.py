"""Surfaces that show images at their depth: where their vertices lie, and what they cover."""

from __future__ import annotations

import numpy as np
import pytest
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPolyData, vtkTable

from svv.core.geometry.cameras import Camera, look_at
from svv.core.geometry.depth_mesh import DepthMesh, depth_mesh
from svv.errors import BadInput
from svv.pv.work.vtk_data import drawn_in, put_drawn, put_image, put_mesh

POSE = look_at((3.0, 1.0, 2.0), (0.1, 0.2, 0.0))
CAMERAS = [Camera(POSE, 0.6, 12, 9), Camera.orthographic(POSE, 2.5, 12, 9), Camera(POSE, 0.6, 12, 9, None, (2.0, 3.5))]


def picture(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """An image whose pixels show something at random, at distances of their own; alpha is 0 where they do not."""
    random = np.random.default_rng(seed)
    rgba = random.integers(1, 256, (9, 12, 4), dtype=np.uint8)
    depth = random.uniform(2.0, 5.0, (9, 12)).astype(np.float32)
    nothing = random.random((9, 12)) < 0.4
    rgba[nothing, 3], depth[nothing] = 0, np.nan
    return rgba, depth


def covered(mesh: DepthMesh, camera: Camera, at: np.ndarray) -> np.ndarray:
    """How many triangles of a surface a ray through each place of the image hits. (P, 2) -> (P,)"""
    column, row, _ = camera.project(mesh.points.astype(np.float64))
    corners = np.stack([column, row], axis=1)[np.concatenate([mesh.quads[:, :3], mesh.quads[:, [0, 2, 3]]])]
    edges = np.roll(corners, -1, axis=1) - corners  # (triangles, 3, 2)
    aside = at[:, None, None] - corners  # (P, triangles, 3, 2)
    turn = edges[..., 0] * aside[..., 1] - edges[..., 1] * aside[..., 0]
    return ((turn > 0).all(2) | (turn < 0).all(2)).sum(1)


@pytest.mark.parametrize("camera", CAMERAS, ids=["perspective", "orthographic", "off the centre"])
def test_each_pixel_is_a_point_on_its_ray_at_its_depth(camera: Camera) -> None:
    rgba, depth = picture()
    mesh = depth_mesh(rgba, depth, camera)
    origins, directions = camera.rays()
    seen = rgba[..., 3] > 0
    places = (origins + directions * np.nan_to_num(depth)[..., None])[seen]
    far = np.linalg.norm(mesh.points[:, None] - places, axis=2)
    nearest = far.argmin(axis=0)
    assert far.min(axis=0).max() < 1e-5
    assert np.array_equal(mesh.colours[nearest], rgba[seen])
    rest = np.ones(len(mesh.points), bool)
    rest[nearest] = False
    beyond = np.array(camera.project(mesh.points.astype(np.float64))[:2])
    inside = ((beyond > 0).all(0)) & (beyond[0] < 12) & (beyond[1] < 9)
    assert not mesh.colours[rest & inside, 3].any(), "a pixel that shows nothing is not transparent"


@pytest.mark.parametrize("camera", CAMERAS, ids=["perspective", "orthographic", "off the centre"])
def test_every_place_of_a_seen_pixel_is_covered_once(camera: Camera) -> None:
    rgba, depth = picture(1)
    places = np.random.default_rng(2).uniform(0.01, 0.99, (400, 2)) * (12, 9)
    pixel = tuple(places.astype(int).T[::-1])
    hits = covered(depth_mesh(rgba, depth, camera), camera, places)
    assert hits.max() == 1 and hits[rgba[..., 3][pixel] > 0].min() == 1


def test_an_opaque_surface_covers_whole_pixels_that_are_half_opaque() -> None:
    camera, rgba = CAMERAS[0], np.zeros((9, 12, 4), np.uint8)
    rgba[2:6, 3:7] = 10, 20, 30, 128
    rgba[7, 7:10] = 40, 50, 60, 127  # not opaque enough
    mesh = depth_mesh(rgba, np.full((9, 12), 3.0, np.float32), camera, opaque=True)
    assert (mesh.colours == (10, 20, 30, 255)).all()
    rows, columns = np.mgrid[0.25:9:0.5, 0.25:12:0.5]
    places = np.stack([columns.ravel(), rows.ravel()], axis=1)
    inside = ((places > (3, 2)) & (places < (7, 6))).all(1)
    no_corner = (np.abs(places - (5, 4)) < 1.5).any(1)  # corners may be cut
    hits = covered(mesh, camera, places)
    assert not (no_corner & (hits != inside)).any()


def test_a_pixel_without_a_depth_is_left_out() -> None:
    rgba, depth = np.full((9, 12, 4), 255, np.uint8), np.full((9, 12), np.nan, np.float32)
    depth[4, 5] = 0.0
    mesh = depth_mesh(rgba, depth, CAMERAS[0])
    assert mesh.points.shape == (0, 3) and mesh.colours.shape == (0, 4) and mesh.quads.shape == (0, 4)


@pytest.mark.parametrize("camera", CAMERAS[:2])
def test_an_image_knows_its_camera(camera: Camera) -> None:
    (rgba, depth), image, data = picture(), vtkImageData(), vtkPolyData()
    put_drawn(image, {"RGBA": rgba, "Depth": depth}, camera)
    again = drawn_in(image)
    assert np.array_equal(again[0], rgba) and np.array_equal(again[1], depth, equal_nan=True)
    for ours, given in zip(again[2].identity, camera.identity, strict=True):
        assert np.array_equal(ours, given)
    mesh = depth_mesh(*again)
    put_mesh(mesh, data)
    assert data.GetNumberOfPoints() == len(mesh.points) and data.GetNumberOfCells() == len(mesh.quads)
    assert data.GetCell(3).GetPointId(2) == mesh.quads[3, 2]
    assert data.GetPointData().GetScalars().GetTuple(5) == tuple(mesh.colours[5])
    plain = vtkImageData()
    put_image(plain, {"RGBA": rgba})
    for wrong in (None, plain, vtkTable()):
        with pytest.raises(BadInput, match="not an image of a scene"):
            drawn_in(wrong)
