"""A training that diverges says so, and its last good state is what is left."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor, nn

from svv.errors import BadInput, silent
from svv.train.pipeline import train_scene
from svv.train.run.loop import CHECK_EVERY, KEEP_EVERY, Loop
from tests.balls import SHORT, balls_views


class Counting(nn.Module):
    """A parameter that counts the steps, until it is spoiled."""

    def __init__(self) -> None:
        super().__init__()
        self.count = nn.Parameter(torch.zeros(3))


def run(bad: int, steps: int, spoiled: str, value: float = math.nan) -> tuple[float, list[str], Loop]:
    network, notes = Counting(), list[str]()
    loop = Loop(steps, None, silent, "counting", network=network, notes=notes)

    def step(number: int, fraction: float) -> Tensor:
        with torch.no_grad():
            network.count.add_(1.0)
            if number >= bad and spoiled == "parameter":
                network.count[1] = value
        return torch.tensor(value if number >= bad and spoiled == "loss" else 0.1)

    loop.run(step)
    return float(network.count[0].detach()), notes, loop


@given(
    st.integers(CHECK_EVERY, 3 * KEEP_EVERY), st.integers(1, 600), st.sampled_from(["loss", "parameter"]),
    st.sampled_from([math.nan, math.inf, -math.inf]),
)  # fmt: skip
def test_the_last_good_state_is_kept(bad: int, more: int, spoiled: str, value: float) -> None:
    left, notes, loop = run(bad, bad + more, spoiled, value)
    assert bad - KEEP_EVERY - CHECK_EVERY <= left <= bad, "it is from before, but not from long before"
    assert len(notes) == 1 and f"state of step {left:.0f}" in notes[0] and "--set" in notes[0]
    assert loop.done <= bad + KEEP_EVERY + CHECK_EVERY, "no time is lost on what is spoiled"


def test_a_run_that_is_good_says_nothing_and_one_that_never_was_is_an_error() -> None:
    assert run(10_000, 200, "loss")[:2] == (200.0, [])
    for steps in (10, 200):
        with pytest.raises(BadInput, match="diverged at step"):
            run(0, steps, "loss")


@pytest.mark.parametrize(("stage", "label"), [("reconstruct", "base NeRF"), ("recolour", "palette colour network")])
def test_stages_with_absurd_rates_end_with_a_sentence(stage: str, label: str) -> None:
    """Rates that spoil every network within a few steps."""
    wild = replace(SHORT, **{stage: replace(getattr(SHORT, stage), network_rate=1e30, feature_rate=1e30)})
    with pytest.raises(BadInput, match=rf"'{label}' diverged at step \d+.*lower its learning rates"):
        train_scene(balls_views(), wild)
