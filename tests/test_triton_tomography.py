"""The first extinction by Triton kernels is that of the CPU.

They run on a GPU if there is one, otherwise in Triton's interpreter. See ``tests/test_triton_kernels.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch

from svv.fields.radiance.occupancy import carve
from svv.io.views.viewset import ViewSet
from svv.train.base import tomography
from svv.train.base.tomography import Tomography
from svv.train.base.tomography_there import TomographyThere
from tests.interpreted import GPU, triton_kernels, triton_tomography
from tests.test_tomography import blobs, orbit, views_of

DEVICE = torch.device("cuda" if GPU else "cpu")


@pytest.fixture(autouse=True)
def few_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the interpreter, a program takes as long for a thousand rays as for one."""
    if not GPU:
        monkeypatch.setattr(triton_tomography, "RAY_BLOCK", 1024)
        monkeypatch.setattr(triton_tomography, "VERTEX_BLOCK", 4096)


@pytest.mark.parametrize("parallel", [False, True])
def test_rounds_are_those_of_the_cpu(parallel: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tomography, "COARSEST", 16)
    views: ViewSet = views_of(orbit(8, parallel), blobs)
    occupancy = carve(views.images[..., 3] > 0, views.cameras, 16)
    here = Tomography(views, occupancy, 0)
    here._half = False  # the GPU uses all pixels
    assert triton_kernels.TOMOGRAPHY is not None
    there = TomographyThere(views, occupancy, 0, triton_kernels.TOMOGRAPHY, DEVICE)
    for work in (here, there):
        work.rounds(1, lambda: True)
        work.refine(occupancy, 32)
        work.rounds(1, lambda: True)
    apart = (here.lattice.table - there.lattice.table.cpu()).abs()
    moved = (here.lattice.table - tomography.START).abs()
    assert float(moved.median()) > 0.5
    # A sample within rounding of a cell's side falls into either cell, and so a few vertices differ by more.
    assert float(apart.quantile(0.99)) < 2e-3 and float(apart.mean()) < 1e-3
    assert there.agreement() == pytest.approx(here.agreement(), abs=0.02)


def test_alpha_is_reduced_as_on_the_cpu() -> None:
    views = views_of(orbit(8))
    occupancy = carve(views.images[..., 3] > 0, views.cameras, 16)
    assert triton_kernels.TOMOGRAPHY is not None
    there = TomographyThere(views, occupancy, 0, triton_kernels.TOMOGRAPHY, DEVICE)
    for which in (np.arange(8), np.array([1, 5])):
        expected = tomography.reduced(views.images[which, ..., 3], 3)
        np.testing.assert_allclose(there._reduced(which, 3).cpu(), expected, atol=1e-6)
