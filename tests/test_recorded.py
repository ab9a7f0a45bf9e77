"""Training steps recorded on a GPU: which numbers they read there, and when a step is recorded again."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import torch

from svv.fields.devices import gpu
from svv.fields.devices.recorded_check import check_recorded
from svv.kernels import dispatch
from svv.kernels.constants import number_on
from svv.kernels.dispatch import CPU
from svv.kernels.recorded import RecordedSteps, StepNumbers
from tests.interpreted import GPU, triton_kernels
from tests.nightly import nightly
from tests.test_sample_room import DEVICE, stages


class OnCpu(StepNumbers):
    """Numbers that stay numbers."""

    def set(self, number: int, pixels: int, others: Sequence[float], rays: slice, there: bool) -> None:
        super().set(number, pixels, others, rays, False)


class Recording:
    """In a graph's place: a step that is taken when it is replayed."""

    def __init__(self, steps: RecordedSteps, step: Any) -> None:
        self.steps, self.step = steps, step

    def replay(self) -> None:
        self.steps._error = self.step()


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> RecordedSteps:
    def record(self: RecordedSteps, step: Any) -> None:
        self._graph, self._error = Recording(self, step), torch.zeros(())  # type: ignore[assignment]
        self.recordings += 1

    monkeypatch.setattr(RecordedSteps, "_record", record)
    monkeypatch.setattr(torch.cuda, "graph_pool_handle", lambda: None)
    return RecordedSteps(True)


def test_numbers_there_are_the_numbers_and_keep_their_place() -> None:
    here, there = StepNumbers(CPU), StepNumbers(CPU)
    places = set()
    for number, rays in ((7, 9), (8, 9), (9, 5)):
        for numbers, on_gpu in ((here, False), (there, True)):
            numbers.set(number, 2**31 - 1 - number, [0.5 * number, 3e-8], slice(2, 2 + rays), on_gpu)
        assert isinstance(there.pixels, torch.Tensor) and isinstance(there.march, torch.Tensor)
        assert int(there.pixels) == here.pixels == 2**31 - 1 - number and int(there.march) == here.march == number + 1
        assert [float(there.other(k)) for k in range(2)] == pytest.approx([here.other(k) for k in range(2)])
        assert torch.equal(there.shift, here.shift) and len(here.shift) == rays
        places.add((there.pixels.data_ptr(), there.march.data_ptr(), there.shift.data_ptr()))
    assert len(places) == 1


def test_a_number_is_there_or_is_put_there() -> None:
    held = torch.ones(1)
    assert number_on(held, CPU) is held
    assert number_on(0, CPU).dtype == torch.int32 and float(number_on(0.25, CPU)) == 0.25


@pytest.mark.slow
@pytest.mark.parametrize("stage", nightly([0, 1], 0), ids=["stage 1", "stage 2"])
def test_a_step_that_reads_its_numbers_on_the_gpu_is_the_same(stage: int, monkeypatch: pytest.MonkeyPatch) -> None:
    ends = []
    for there in (False, True):
        torch.manual_seed(0)
        work = stages(monkeypatch)[stage]
        work.recorded.possible = there and GPU
        work.numbers = StepNumbers(DEVICE) if there else OnCpu(DEVICE)
        losses = [float(work.step(number, 0.1 * number)) for number in range(5 if GPU else 2)]
        assert not there or not GPU or work.recorded.recordings > 0, work.recorded.notes
        ends.append([*losses, *(p.detach().cpu().flatten() for p in work.field.parameters())])
    for theirs, mine in zip(*ends, strict=True):
        torch.testing.assert_close(
            torch.as_tensor(mine), torch.as_tensor(theirs), atol=2e-3 if GPU else 1e-6, rtol=2e-3 if GPU else 1e-5
        )


def test_a_step_is_recorded_again_when_its_key_changes_and_taken_as_it_is_after_changes(
    recorded: RecordedSteps,
) -> None:
    taken: list[int] = []

    def take(key: object) -> float:
        return float(recorded.take(key, lambda: torch.tensor(float(taken.append(1) or len(taken)))))  # type: ignore[func-returns-value]

    assert [take("a"), recorded.recordings] == [1.0, 0]  # compiles what it needs
    assert [take("a"), take("a"), recorded.recordings] == [2.0, 3.0, 1]
    assert [take("b"), recorded.recordings, take("b"), recorded.recordings] == [4.0, 1, 5.0, 2]
    assert [take("a"), recorded.recordings, take("b"), take("b"), recorded.recordings] == [6.0, 2, 7.0, 8.0, 3]
    recorded.forget()
    assert [take("b"), recorded.recordings, take("b"), recorded.recordings] == [9.0, 3, 10.0, 4]


def test_an_error_stays_what_it_was_in_its_step(recorded: RecordedSteps) -> None:
    errors = torch.zeros(())
    found = [recorded.take(0, lambda: errors.add_(1.0)) for _ in range(4)]
    assert [float(error) for error in found[1:]] == [2.0, 3.0, 4.0]


def test_where_recording_fails_steps_go_on_and_a_sentence_says_so(
    recorded: RecordedSteps, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: RecordedSteps, step: Any) -> None:
        raise RuntimeError("operation not permitted when stream is capturing")

    monkeypatch.setattr(RecordedSteps, "_record", fail)
    assert [float(recorded.take(0, lambda: torch.tensor(2.0))) for _ in range(3)] == [2.0] * 3
    assert not recorded.possible and len(recorded.notes) == 1 and "stream is capturing" in recorded.notes[0]


@pytest.mark.slow  # kernels are interpreted, and other tests of recordings run every time
def test_the_check_finds_recordings_that_do_something_else(
    recorded: RecordedSteps, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: triton_kernels)
    if GPU:
        monkeypatch.undo()
        check_recorded(triton_kernels, DEVICE, 0)
        return
    few = functools.partial(check_recorded, triton_kernels, CPU, 0, recorded, (5, 4), 4)
    few()
    assert recorded.recordings == 2  # of both numbers of rays
    recorded.forget()
    monkeypatch.setattr(Recording, "replay", lambda self: None)  # numbers change, and nothing happens
    with pytest.raises(AssertionError, match=r"step \d+ of 4 is off"):
        few()


def test_steps_are_recorded_where_the_check_has_seen_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    card, monkey = torch.device("cuda", 0), monkeypatch
    monkey.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkey.delenv(gpu.SKIP_CHECK, raising=False)
    monkey.setattr(gpu, "key_of_gpu", lambda device: "card")
    assert not gpu.may_record(CPU) and not gpu.may_record(card)
    for records in (False, True):
        gpu._keep(card, gpu.Verdict(True, "checked in 14 s", 14.0, records))
        assert gpu.may_record(card) == records
    monkey.setenv(gpu.SKIP_CHECK, "0")
    assert gpu.may_record(card) and not gpu.may_record(CPU)
