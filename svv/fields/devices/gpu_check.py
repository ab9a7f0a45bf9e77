"""The check of a GPU on its first use: every kernel against plain torch, compiled and in parallel.

:mod:`svv.fields.devices.gpu` runs it in a process of its own. One image and one training step would not do: most of the
faults of ``tests/test_kernel_checks.py`` change them by less than the half precision of networks does, or not at all.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np
import torch

from svv.fields.devices.gpu import RECORDS, current_gpu, why_no_gpu
from svv.fields.devices.image_checks import image_checks
from svv.fields.devices.kernel_checks import Check, checks
from svv.fields.devices.recorded_check import check_recorded
from svv.fields.devices.region_checks import region_checks
from svv.fields.devices.stroke_checks import BRUSHES, check_strokes
from svv.fields.devices.tomography_checks import tomography_checks
from svv.fields.devices.training_checks import training_checks
from svv.kernels.dispatch import kernels_of
from svv.kernels.numba import kernels as numba_kernels
from svv.kernels.types import Kernels

SAMPLES = 1 << 14
"""Samples per check: hundreds of a kernel's programs run at once."""

SEEDS = 2
"""Number of inputs of each check; only the first one waits for the compiler."""


def run_checks(kernels: Kernels, device: torch.device, samples: int, seeds: int) -> Iterator[tuple[str, float, str]]:
    """Run all checks; yields the name of each, its seconds, and what is wrong, or an empty text.

    A fault of the GPU itself ends all later checks of the process, each with the same message.
    """
    yield from run_each(checks_of(kernels, samples), kernels, device, seeds)


def run_each(
    named: Mapping[str, Check], kernels: Kernels, device: torch.device, seeds: int
) -> Iterator[tuple[str, float, str]]:
    """Run some checks; yields as :func:`run_checks`."""
    for name, check in named.items():
        begin = time.perf_counter()
        wrong = _wrong(check, kernels, device, seeds)
        yield name, time.perf_counter() - begin, wrong


def checks_of(kernels: Kernels, samples: int) -> dict[str, Check]:
    """Return the checks of everything that a set of kernels has, with so many samples each."""
    found = dict(checks(samples)) | region_checks(samples)
    if kernels.IMAGE is not None and kernels.NAME != numba_kernels.NAME:
        found |= image_checks(samples)
    if kernels.TRAINING is not None:
        found |= training_checks(samples)
    if kernels.TOMOGRAPHY is not None:
        found |= tomography_checks(samples)
    if kernels.STROKES is not None:
        counts = tuple(np.random.default_rng(0).integers(0, 9, min(max(40, samples // 8), 1 << 13)).tolist())
        found |= {f"strokes, {name}": partial(check_strokes, brush=name, counts=counts) for name in BRUSHES}
    return found


def _wrong(check: Check, kernels: Kernels, device: torch.device, seeds: int) -> str:
    try:
        for seed in range(seeds):
            check(kernels, device, seed)
    except Exception as error:  # whatever a compiler or a driver raises is a finding
        return f"{type(error).__name__}: {' '.join(str(error).split())}"
    return ""


def main() -> None:
    """Print one line that says what was found; ends with code 1 if something is wrong."""
    reason = why_no_gpu()
    if reason is not None:
        print(reason)
        sys.exit(1)
    begin, device = time.perf_counter(), current_gpu()
    kernels = kernels_of(device.type)
    found = list(run_checks(kernels, device, SAMPLES, SEEDS))
    failed = [f"{name}: {wrong}" for name, _, wrong in found if wrong]
    if failed:
        print(f"{len(failed)} of {len(found)} kernels are wrong; {failed[0]}")
        sys.exit(1)
    unlike = (
        _wrong(check_recorded, kernels, device, 1)
        if kernels.TRAINING is not None and kernels.TRAINING.SPARE
        else "there are no such kernels"
    )
    print(RECORDS if not unlike else f"training steps are not recorded: {unlike}")
    what = f"{len(found)} results of the {kernels.NAME} kernels are those of plain torch"
    print(f"checked in {time.perf_counter() - begin:.0f} s: {what}")


if __name__ == "__main__":
    main()
