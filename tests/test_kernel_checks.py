"""The checks of kernels find what is wrong with them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from svv.fields.devices.gpu_check import run_checks
from svv.fields.devices.kernel_checks import CPU, checks
from svv.fields.devices.region_checks import region_checks
from svv.fields.devices.training_checks import training_checks
from svv.kernels import reference
from svv.kernels.numba import kernels as numba_kernels
from svv.kernels.types import Kernels, RaySamples, Samples


def scaled(result: Any, factor: float = 1.0001) -> Any:
    """Return numbers that are off by one in ten thousand."""
    return tuple(scaled(part, factor) for part in result) if isinstance(result, tuple) else result * factor


def lost_row(x: Tensor, g: Tensor, where: Any, gradient: Tensor, used: Tensor) -> None:
    reference.lattice_backward(x, g, where, gradient, used)
    used[used.nonzero()[0]] = 0


def lost_sum(x: Tensor, g: Tensor, *rest: Any) -> None:
    """The gradient of one sample is lost, as where two threads race."""
    g = g.clone()
    g[0] = 0.0
    reference.hash_backward(x, g, *rest)


def one_sample_twice(*arguments: Any) -> tuple[Samples, int]:
    samples, room = reference.march(*arguments)
    place = samples.position.clone()
    place[: len(place) // 2] = place[0]
    return replace(samples, position=place), room


def stops_early(*arguments: Any) -> tuple[Samples, int]:
    samples, room = reference.march(*arguments)
    return replace(samples, tail=samples.tail + 1e-3), room


def unmarked_rows_move(table: Tensor, *rest: Any) -> None:
    reference.adam(table, *rest)
    table += 1e-4


WRONG: dict[str, tuple[str, Any]] = {
    "lattice, 4 features": ("lattice_encode", lambda *a: scaled(reference.lattice_encode(*a))),
    "lattice, 1 features": ("lattice_backward", lost_row),
    "hash grid": ("hash_backward", lost_sum),
    "adam": ("adam", unmarked_rows_move),
    "march, training": ("march", one_sample_twice),
    "march, image": ("march", stops_early),
    "composite, 3 channels": ("composite", lambda *a: scaled(reference.composite(*a))),
    "composite, 8 channels": ("composite_backward", lambda *a: scaled(reference.composite_backward(*a), 1.001)),
    "representatives": ("representatives", lambda s, e, shift: reference.representatives(s, 2.0 * e, shift)),
    "leaps": ("leaps", lambda occupied: reference.leaps(occupied) + 1),
    "directions": ("directions_of_samples", lambda *a: scaled(reference.directions_of_samples(*a))),
    "network (32, 64, 2, 3)": ("network", lambda x, w, rough: reference.network(x, w, rough) * 1.001),
    "network, full precision": ("network", lambda x, w, rough: reference.network(x, w, rough) * 1.001),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_slightly_wrong_is_found(name: str) -> None:
    function, wrong = WRONG[name]
    broken: Any = SimpleNamespace(**{**vars(reference), function: wrong})
    checks()[name](reference, CPU, 0)
    with pytest.raises(AssertionError):
        checks()[name](broken, CPU, 0)


def less_along(seen: RaySamples, kept: float, *rest: Any) -> Tensor:
    """All of an error is left along the pixel's colour."""
    return reference.REGIONS.errors(seen, 1.0, *rest)


def lost_ray(seen: RaySamples, *rest: Any) -> Tensor:
    return reference.REGIONS.normal_equations(replace(seen, pixel=seen.pixel.clone().index_fill_(0, ONE, 0.0)), *rest)


def without_neighbours(
    near: Any, error: Tensor, light: Tensor, step: Tensor, pace: tuple[float, float], *rest: Any
) -> None:  # fmt: skip
    reference.REGIONS.descend(near, error, light, step, (0.0, pace[1]), *rest)


def turned(*arguments: Any) -> Tensor:
    return reference.REGIONS.normals(*arguments).flip(1)


ONE = torch.tensor([1])
WRONG_REGIONS: dict[str, tuple[str, Any]] = {
    "regions, light": ("normal_equations", lost_ray),
    "regions, errors": ("errors", less_along),
    "regions, descent": ("descend", without_neighbours),
    "regions, blurred": ("blurred", lambda values, deviation: reference.REGIONS.blurred(values, 1.001 * deviation)),
    "regions, normals": ("normals", turned),
}


@pytest.mark.parametrize("name", WRONG_REGIONS)
def test_regions_that_are_slightly_wrong_are_found(name: str) -> None:
    function, wrong = WRONG_REGIONS[name]
    broken: Any = SimpleNamespace(REGIONS=SimpleNamespace(**{**vars(reference.REGIONS), function: wrong}))
    check = region_checks(150)[name]
    check(reference, CPU, 0)
    with pytest.raises(AssertionError):
        check(broken, CPU, 0)


@pytest.mark.parametrize("kernels", [reference, numba_kernels])
def test_all_kernels_of_the_cpu_pass(kernels: Kernels) -> None:
    found = list(run_checks(kernels, CPU, 2000, 2))
    assert [wrong for _, _, wrong in found if wrong] == []
    steps = {} if kernels.TRAINING is None else training_checks(2000)
    assert [name for name, *_ in found] == [*checks(), *region_checks(2000), *steps]


def test_a_fault_is_a_finding_and_not_the_end() -> None:
    def faults(*arguments: Any) -> Tensor:
        raise RuntimeError("CUDA error: an illegal memory access\nwas encountered")

    broken: Any = SimpleNamespace(**{**vars(reference), "leaps": faults})
    found = {name: wrong for name, _, wrong in run_checks(broken, torch.device("cpu"), 150, 1)}
    assert found["leaps"] == "RuntimeError: CUDA error: an illegal memory access was encountered"
    assert found["adam"] == ""
