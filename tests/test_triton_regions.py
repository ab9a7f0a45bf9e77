"""Regions along rays by Triton's kernels."""

from __future__ import annotations

import pytest
import torch

from svv.fields.devices.region_checks import region_checks
from svv.kernels import dispatch
from svv.train.palette import along_rays
from svv.train.palette.along_rays import Solver
from tests.interpreted import GPU, triton_kernels
from tests.test_along_rays import lit_and_wrong

DEVICE = torch.device("cuda" if GPU else "cpu")
CHECKS = region_checks(300)


@pytest.mark.parametrize("name", CHECKS)
@pytest.mark.parametrize("seed", [0, 1])
def test_kernels_of_regions_are_those_of_plain_torch(name: str, seed: int) -> None:
    CHECKS[name](triton_kernels, DEVICE, seed)


def test_memberships_are_those_of_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, places, region = lit_and_wrong(0, 5)
    monkeypatch.setattr(along_rays, "TURNS", 1)
    monkeypatch.setattr(along_rays, "STEPS", 2)
    expected = Solver(seen, places).solve(region, 5, 0.02)
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: triton_kernels)
    torch.testing.assert_close(Solver(seen, places).solve(region, 5, 0.02), expected, atol=2e-4, rtol=0.0)
