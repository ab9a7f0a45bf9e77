"""The loop of every stage: how learning rates fall, and which time counts."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.train.run.config import PRESETS
from svv.train.run.loop import Loop, falling

FRACTIONS = st.floats(0.0, 1.0)


@given(FRACTIONS, FRACTIONS, st.floats(0.0, 1.0), st.floats(0.0, 0.999))
def test_rates_start_whole_and_never_rise(first: float, second: float, end: float, hold: float) -> None:
    assert falling(0.0, end, hold) == 1.0
    early, late = sorted((first, second))
    assert 0.0 <= falling(late, end, hold) <= falling(early, end, hold) <= 1.0


@given(st.floats(0.0, 0.99), FRACTIONS)
def test_rates_that_end_at_nothing_are_held_and_then_fall_on_a_line(hold: float, part: float) -> None:
    assert falling(hold * part, 0.0, hold) == 1.0
    assert falling(hold + part * (1.0 - hold), 0.0, hold) == pytest.approx(1.0 - part, abs=1e-9)


@given(st.floats(0.001, 1.0), FRACTIONS, FRACTIONS)
def test_other_rates_fall_by_equal_factors(end: float, first: float, second: float) -> None:
    assert falling(1.0, end) == pytest.approx(end)
    product = falling(first, end) * falling(second, end)
    assert product == pytest.approx(falling(first + second, end), rel=1e-9)


def test_the_paper_s_schedule_is_the_paper_s() -> None:
    paper, others = PRESETS["paper"], [p for name, p in PRESETS.items() if name != "paper"]
    for stage in ("reconstruct", "recolour"):
        assert getattr(paper, stage).decay > 0.0 and getattr(paper, stage).by_contrast == 0.0
        assert all(getattr(other, stage).decay == 0.0 for other in others)


def test_a_pause_does_not_count_towards_the_time_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("svv.train.run.loop.time.monotonic", lambda: now[0])

    def step(number: int, fraction: float) -> torch.Tensor:
        now[0] += 1.0
        return torch.tensor(0.0)

    def pause(fraction: float, label: str) -> None:
        now[0] += 1000.0

    loop = Loop(100, 10.0, pause, "work")
    assert loop.run(step) == loop.done == 10
