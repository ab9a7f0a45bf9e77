"""Splats drawn by compiled kernels: values and gradients of the plain reference, and laws of pictures of splats."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera, look_at
from svv.core.rays.splatting import splatted
from svv.train.splats.raster import Eye, Gaussians, draw


def some_splats(count: int, degree: int, seed: int, opaque: float = 0.9) -> Gaussians:
    """Splats of many shapes in a cube of side 2."""
    random = np.random.default_rng(seed)
    arrays = (
        random.uniform(-0.8, 0.8, (count, 3)),
        np.exp(random.uniform(-4.0, -1.2, (count, 3))),
        random.normal(size=(count, 4)) * random.uniform(0.5, 2.0, (count, 1)),
        random.uniform(0.05, opaque, count),
        random.normal(size=(count, (degree + 1) ** 2, 3)) * 0.4,
    )
    return Gaussians(*(np.ascontiguousarray(array, np.float32) for array in arrays))


def an_eye(width: int, height: int, direction: tuple[float, float, float] = (1.0, 0.5, 2.0)) -> Eye:
    return Eye.of(Camera(look_at(np.array(direction) * 1.6, np.zeros(3)), 0.7, width, height), np.zeros(3), 1.0)


def reference(splats: Gaussians, eye: Eye, grad: bool = False) -> tuple[torch.Tensor, list[torch.Tensor]]:
    tensors = [torch.tensor(array, dtype=torch.float64, requires_grad=grad) for array in splats.arrays]
    camera = torch.tensor(eye.axes).double(), torch.tensor(eye.position).double(), eye.focal
    return splatted(tuple(tensors), camera, eye.width, eye.height), tensors  # type: ignore[arg-type]


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_values_and_gradients_are_those_of_the_reference(degree: int) -> None:
    splats, eye = some_splats(60, degree, degree), an_eye(50, 37)
    expected, tensors = reference(splats, eye, grad=True)
    drawing = draw(splats, eye)
    image = drawing.image.transpose(1, 2, 0)
    assert np.abs(image - expected.detach().numpy()).max() < 2e-5
    slope = np.random.default_rng(7).normal(size=image.shape).astype(np.float32)
    (expected * torch.from_numpy(slope)).sum().backward()  # type: ignore[no-untyped-call]
    found, _ = drawing.gradients(np.ascontiguousarray(slope.transpose(2, 0, 1)), np.zeros((37, 50), np.float32))
    for own, tensor in zip(found.arrays, tensors, strict=True):
        assert tensor.grad is not None
        there = tensor.grad.numpy()
        assert np.abs(own - there).max() < 2e-4 * np.abs(there).max()


def test_dense_splats_end_rays_as_in_the_reference() -> None:
    """Hundreds of opaque splats behind each other: pixels end early, and gradients are 0 behind."""
    splats, eye = some_splats(400, 1, 3, opaque=1.0), an_eye(24, 20)
    splats = Gaussians(splats.centres * 0.4, 2.0 * splats.scales, *splats.arrays[2:])
    expected, tensors = reference(splats, eye, grad=True)
    drawing = draw(splats, eye)
    assert (expected[..., 3] > 0.999).double().mean() > 0.3
    assert np.abs(drawing.image.transpose(1, 2, 0) - expected.detach().numpy()).max() < 5e-5
    expected.sum().backward()  # type: ignore[no-untyped-call]
    found, _ = drawing.gradients(np.ones_like(drawing.image), np.zeros((20, 24), np.float32))
    for own, tensor in zip(found.arrays, tensors, strict=True):
        assert tensor.grad is not None
        assert np.abs(own - tensor.grad.numpy()).max() < 1e-3 * tensor.grad.abs().max()


def test_a_splat_in_the_middle_is_a_gaussian_of_its_size() -> None:
    """A ball of standard deviation s at distance z has the variance (f s / z)^2 + 0.3 in the picture."""
    eye = Eye(np.eye(3, dtype=np.float32), np.zeros(3, np.float32), 100.0, 65, 65)
    ball = Gaussians(*(np.array(v, np.float32) for v in ([[0, 0, 5]], [[0.2] * 3], [[2, 0, 0, 0]], [0.5], [[[1] * 3]])))
    alpha = draw(ball, eye).image[3]
    rows, columns = (np.indices(alpha.shape) - 32.0) ** 2
    expected = 0.5 * np.exp(-0.5 * (rows + columns) / (4.0**2 + 0.3))
    assert np.abs(alpha - np.where(expected >= 1.0 / 255.0, expected, 0.0)).max() < 1e-5
    colour = draw(ball, eye).image[:3, 32, 32] / alpha[32, 32]
    assert colour == pytest.approx([0.5 + 0.5 / math.sqrt(math.pi)] * 3, abs=1e-5)


def test_the_number_of_threads_and_the_order_of_splats_change_no_bit() -> None:
    splats, eye = some_splats(500, 2, 5), an_eye(70, 70)
    slope = np.random.default_rng(1).normal(size=(4, 70, 70)).astype(np.float32)
    error = np.ones((70, 70), np.float32)

    def everything(own: Gaussians) -> list[NDArray[np.float32]]:
        drawing = draw(own, eye)
        found, seen = drawing.gradients(slope, error)
        return [drawing.image.copy(), *found.arrays, seen]

    before, threads = everything(splats), numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        alone = everything(splats)
    finally:
        numba.set_num_threads(threads)
    assert all(np.array_equal(one, other) for one, other in zip(before, alone, strict=True))
    turned = everything(Gaussians(*(np.ascontiguousarray(array[::-1]) for array in splats.arrays)))
    assert np.array_equal(before[0], turned[0])
    for one, other in zip(before[1:], turned[1:], strict=True):
        assert np.allclose(one, other[::-1], rtol=1e-5, atol=1e-5)


def test_weights_add_up_to_the_picture() -> None:
    splats, eye = some_splats(200, 0, 9), an_eye(64, 48)
    drawing = draw(splats, eye)
    error = np.random.default_rng(2).uniform(size=(48, 64)).astype(np.float32)
    _, seen = drawing.gradients(np.zeros_like(drawing.image), error)
    assert seen[:, 0].sum() == pytest.approx(drawing.image[3].sum(), rel=1e-4)
    assert seen[:, 1].sum() == pytest.approx((drawing.image[3] * error).sum(), rel=1e-4)


def test_splats_behind_the_camera_and_outside_show_nothing() -> None:
    eye = an_eye(32, 32, (0.0, 0.0, 1.0))
    splats = some_splats(50, 0, 4)
    behind = Gaussians(splats.centres + np.array((0.0, 0.0, 9.0), np.float32), *splats.arrays[1:])
    beside = Gaussians(splats.centres + np.array((90.0, 0.0, 0.0), np.float32), *splats.arrays[1:])
    for one in (behind, beside, Gaussians(*(array[:0] for array in splats.arrays))):
        drawing = draw(one, eye)
        assert not drawing.image.any()
        found, seen = drawing.gradients(np.ones_like(drawing.image), np.ones((32, 32), np.float32))
        assert not seen.any() and not any(array.any() for array in found.arrays)
