"""The first extinction by Triton kernels is that of the CPU.

They run on a GPU if there is one, otherwise in Triton's interpreter. See ``tests/test_triton_kernels.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from svv.fields.devices.tomography_checks import tomography_checks
from svv.fields.radiance import occupancy
from svv.fields.radiance.occupancy import carve
from svv.io.views.viewset import ViewSet
from svv.kernels import dispatch
from svv.train.base import tomography
from svv.train.base.tomography import Tomography, TomographyThere
from tests.interpreted import GPU, triton_kernels, triton_tomography
from tests.nightly import nightly
from tests.test_tomography import blobs, orbit, views_of

DEVICE = torch.device("cuda" if GPU else "cpu")


@pytest.fixture(autouse=True)
def few_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the interpreter, a program takes as long for a thousand rays as for one."""
    if not GPU:
        monkeypatch.setattr(triton_tomography, "RAY_BLOCK", 1 << 14)
        monkeypatch.setattr(triton_tomography, "VERTEX_BLOCK", 1 << 16)
        monkeypatch.setattr(triton_tomography, "CELL_BLOCK", 1 << 18)


CHECKS = tomography_checks(150)


@pytest.mark.parametrize("name", CHECKS)
@pytest.mark.parametrize("seed", nightly([0, 1], 0))
def test_a_kernel_gives_what_the_cpu_gives(name: str, seed: int) -> None:
    CHECKS[name](triton_kernels, DEVICE, seed)


WRONG: dict[str, Callable[..., torch.Tensor]] = {
    "visual hull": lambda own, *rest: own.visual_hull(*rest[:3], 1.1 * rest[3], rest[4]),
    "optical depths": lambda own, *rest: own.optical_depths(*rest) + 1e-3,
    "back-projection": lambda own, *rest: own.back_project(rest[0], 1.02 * rest[1], *rest[2:]),
}
"""Kernels that are slightly wrong: cells that reach too far, depths above 0, vertices beside theirs."""


@pytest.mark.parametrize("name", WRONG)
def test_what_is_slightly_wrong_is_found(name: str) -> None:
    own = triton_kernels.TOMOGRAPHY
    assert own is not None
    function = {"visual hull": "visual_hull", "optical depths": "optical_depths"}.get(name, "back_project")
    broken = SimpleNamespace(TOMOGRAPHY=SimpleNamespace(**{function: lambda *rest: WRONG[name](own, *rest)}))
    with pytest.raises(AssertionError):
        CHECKS[name](cast(Any, broken), DEVICE, 0)


@pytest.mark.slow
@pytest.mark.parametrize("parallel", [False, True])
def test_a_card_carves_the_hull_of_the_cpu(parallel: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of pictures that are shrunk, and of frames that cut off what they show."""
    monkeypatch.setattr(occupancy, "MASK_SIZE", 20)
    views = views_of(orbit(5, parallel))
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: triton_kernels)
    for alpha in (views.images[..., 3], np.roll(views.images[..., 3], 28, axis=2)):
        expected = carve(alpha, views.cameras, 24)
        found = carve(torch.from_numpy(alpha).to(DEVICE), views.cameras, 24)
        np.testing.assert_array_equal(found.box.bounds, expected.box.bounds)
        assert (found.occupied != expected.occupied).sum() <= 1e-4 * expected.occupied.size
        assert 0.0 < expected.fraction < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("parallel", [False, True])
def test_rounds_are_those_of_the_cpu(parallel: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tomography, "COARSEST", 16)
    views: ViewSet = views_of(orbit(8, parallel), blobs)
    cells = carve(views.images[..., 3] > 0, views.cameras, 16)
    here = Tomography(views, cells, 0)
    here._half = False  # the GPU uses all pixels
    assert triton_kernels.TOMOGRAPHY is not None
    there = TomographyThere(views, cells, 0, triton_kernels.TOMOGRAPHY, DEVICE)
    for work in (here, there):
        work.rounds(1, lambda: True)
        work.refine(cells, 32)
        work.rounds(1, lambda: True)
    apart = (here.lattice.table - there.lattice.table.cpu()).abs()
    moved = (here.lattice.table - tomography.START).abs()
    assert float(moved.median()) > 0.5
    # A sample within rounding of a cell's side falls into either cell, and so a few vertices differ by more.
    assert float(apart.quantile(0.99)) < 2e-3 and float(apart.mean()) < 1e-3
    assert there.agreement() == pytest.approx(here.agreement(), abs=0.02)


def test_alpha_is_reduced_as_on_the_cpu() -> None:
    views = views_of(orbit(8))
    cells = carve(views.images[..., 3] > 0, views.cameras, 16)
    assert triton_kernels.TOMOGRAPHY is not None
    there = TomographyThere(views, cells, 0, triton_kernels.TOMOGRAPHY, DEVICE)
    for which in (np.arange(8), np.array([1, 5])):
        expected = tomography.reduced(views.images[which, ..., 3], 3)
        np.testing.assert_allclose(there._reduced(which, 3).cpu(), expected, atol=1e-6)
