"""Compressed grids come back as they were, and damaged ones are refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hn

from svv.core.geometry.box import Box
from svv.core.geometry.displacement import came_from, small
from svv.core.volumes.classified import COARSE, LARGEST
from svv.core.volumes.packing import packed, unpacked
from svv.errors import BadInput
from svv.fields.radiance.time_steps import TimeSteps, packed_codes

GRIDS = hn.arrays(np.uint16, hn.array_shapes(min_dims=1, max_dims=4, max_side=5))


@given(GRIDS)
def test_numbers_come_back(grid: np.ndarray) -> None:
    assert np.array_equal(unpacked(packed(grid), grid.shape), grid)
    signed = grid.view(np.int16)
    assert np.array_equal(unpacked(packed(signed), grid.shape).view(np.int16), signed)


@given(GRIDS, st.integers(0, 255), st.floats(0.0, 1.0))
def test_damage_is_never_taken_for_another_shape(grid: np.ndarray, byte: int, where: float) -> None:
    content = packed(grid)
    with pytest.raises(ValueError, match="grid"):
        unpacked(content, (*grid.shape, 2))
    with pytest.raises(ValueError, match="grid"):
        unpacked(content[: int(where * (len(content) - 1))], grid.shape)
    spoilt = content.copy()
    spoilt[int(where * (len(content) - 1))] = byte
    try:
        assert unpacked(spoilt, grid.shape).shape == grid.shape
    except ValueError:
        pass


def test_smooth_grids_need_few_bits() -> None:
    x, y, z = np.meshgrid(*[np.linspace(0.0, 3.0, 48)] * 3, indexing="ij")
    values = 0.5 + 0.5 * np.sin(x) * np.cos(y + z)
    codes = (1 + COARSE * np.rint(LARGEST / COARSE * values)).astype(np.uint16)
    assert 8 * len(packed_codes(codes)) / codes.size < 2.6


def test_matter_is_followed_back_over_several_steps() -> None:
    """A ball that moves along x by 1.5 cells a step, and in the end back."""
    x, y, z = np.meshgrid(*[np.arange(32.0)] * 3, indexing="ij")

    def ball(place: float) -> np.ndarray:
        return np.exp(-((x - place) ** 2 + (y - 16) ** 2 + (z - 16) ** 2) / 30.0).astype(np.float32)

    moved, before = None, ball(10.0)
    for step in (1, 2, 3):
        after = ball(10.0 + 1.5 * step)
        moved = came_from(before, after, moved)
        before = after
        there = round(10.0 + 1.5 * step), 16, 16
        assert moved[(slice(None), *there)] == pytest.approx([-1.5 * step, 0.0, 0.0], abs=0.3)


def test_flat_grids_do_not_move() -> None:
    assert np.abs(came_from(np.ones((9, 9, 9), np.float32), np.ones((9, 9, 9), np.float32))).max() == 0.0
    assert came_from(np.ones((9, 2, 9), np.float32), np.ones((9, 2, 9), np.float32)).shape == (3, 9, 2, 9)
    assert small(np.ones((97, 49, 2), np.float32)).shape == (49, 25, 2)


@pytest.mark.parametrize(
    "wrong",
    [
        {"cells": 3}, {"cells": 1 << 20}, {"times": (1.0, 1.0)}, {"times": (math.nan,)}, {"interval": (1.0, 1.0)},
        {"own": 1}, {"codes": ()}, {"box": Box((0.0,) * 3, 1.0, (2.0, 1.0, 1.0))},
        {"box": Box((0.0,) * 3, math.inf, (1.0,) * 3)}, {"cells": 1 << 12},
    ],
)  # fmt: skip
def test_time_steps_that_do_not_fit_are_refused(wrong: dict[str, Any]) -> None:
    """Also grids so large that no memory could hold them, whatever a file says."""
    box, content = Box((0.0,) * 3, 1.0, (1.0,) * 3), packed_codes(np.ones((5, 5, 5), np.uint16))
    right = {"box": box, "cells": 4, "interval": (0.0, 1.0), "times": (0.0,), "codes": (content,), "moves": (None,)}
    assert TimeSteps(**right).grid(0, (0.0, 1.0)).values().max() == 0.0  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="steps"):
        TimeSteps(**{**right, **wrong})


def test_damaged_displacements_are_one_sentence() -> None:
    box, content = Box((0.0,) * 3, 1.0, (1.0,) * 3), packed_codes(np.ones((5, 5, 5), np.uint16))
    steps = TimeSteps(box, 4, (0.0, 1.0), (0.0, 1.0), (content, content), (None, content[:-3]))
    assert np.array_equal(steps.place(0)(np.ones((2, 3))), np.ones((2, 3)))
    with pytest.raises(BadInput, match="Time step 1"):
        steps.place(1)
