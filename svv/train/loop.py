"""The loop of every stage: schedule, progress, time limit, and checkpoints."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from svv.errors import Cancelled, Progress, silent
from svv.train import ranks
from svv.train.checkpoint import Checkpoint

SAVE_EVERY = 30.0
"""Seconds between two checkpoints."""

SHOW_EVERY = 0.2
"""Seconds between two calls of the progress."""

AGREE_EVERY = 8
"""Steps between two times at which several ranks agree on how much of the time limit is over, and whether to stop."""

PARTS = 10
"""Number of parts of a run whose losses are recorded separately."""


@dataclass(frozen=True)
class Running:
    """How to run a stage, independent of its task."""

    seed: int
    """Seed of initial features, batches and jitter."""
    limit: float | None = None
    """Time limit in seconds; None for no limit."""
    progress: Progress = silent
    """Called several times a second; stops the work when it raises."""
    saved: Checkpoint | None = None
    """Checkpoint to resume from and to save to."""


@dataclass
class Loop:
    """Runs a step repeatedly.

    A run that would exceed its time limit is shortened. Its learning rates then fall with the remaining time, so the
    result is as good as the time allows.
    """

    iterations: int
    """Number of steps."""
    limit: float | None
    """Time limit in seconds; None for no limit."""
    progress: Progress
    """Called several times a second; stops the work when it raises."""
    label: str
    """Label of the progress."""
    save: Callable[[int, float], None] | None = None
    """Called with the steps done and the seconds spent, to write a checkpoint."""
    watch: Callable[[], None] | None = None
    """Called after every step."""
    done: int = 0
    """Number of steps done."""
    spent: float = 0.0
    """Seconds spent."""
    course: dict[int, list[Tensor]] = field(default_factory=dict)
    """Losses of each of the ``PARTS`` parts of the run, since it was started or resumed."""

    def run(self, step: Callable[[int, float], Tensor]) -> float:
        """Call ``step(number, fraction)`` until done; it returns the loss, which is shown next to the label.

        The loss is read only when it is shown, because reading it waits for the GPU. If several processes train, the
        first one's time limit counts, and all stop at the same step.

        Returns:
            Seconds spent, including those before an interruption.
        """
        begin = saved = told = time.monotonic()
        before = self.spent
        mean: Tensor | None = None
        elapsed: float | None = None  # as a fraction of the limit
        stop = False
        while self.done < self.iterations:
            if elapsed is None or not ranks.many() or self.done % AGREE_EVERY == 0:
                elapsed = ranks.agreed(0.0 if self.limit is None else self.spent / self.limit, stop)
            fraction = max(self.done / self.iterations, elapsed)
            if fraction >= 1.0:
                break
            loss = step(self.done, fraction)
            mean = loss if mean is None else mean + 0.05 * (loss - mean)
            self.course.setdefault(int(PARTS * fraction), []).append(loss)
            self.done += 1
            now = time.monotonic()
            self.spent = before + now - begin
            if now - told > SHOW_EVERY:
                told = now
                try:
                    self.progress(fraction, f"{self.label} (loss {float(mean):.4f})")
                except Cancelled:
                    if not ranks.many():
                        raise
                    stop = True
            if self.save is not None and now - saved > SAVE_EVERY:
                self.save(self.done, self.spent)
                saved = time.monotonic()
            if self.watch is not None:
                self.watch()
        self.progress(1.0, self.label)
        return self.spent

    def last_gain(self) -> float | None:
        """Return how many dB the mean loss of the last part is below that of the part before; None without both."""
        ends = [self.course.get(PARTS - k) for k in (2, 1)]
        if not all(ends):
            return None
        before, last = (float(torch.stack(losses).mean()) for losses in ends if losses)
        return 10.0 * math.log10(max(before, 1e-12) / max(last, 1e-12))


def falling(fraction: float, end: float) -> float:
    """Return the factor on a learning rate, which falls exponentially from 1 to ``end``."""
    return float(end**fraction)


def network_adam(parameters: Sequence[Tensor] | Sequence[dict[str, Any]], rate: float = 1e-3) -> torch.optim.Adam:
    """Return Adam for a stage's networks; on a GPU, one kernel updates all parameters of a group.

    Args:
        parameters: Parameters, or groups of them, all on one device.
        rate: Learning rate.
    """
    first = parameters[0]
    one = first["params"][0] if isinstance(first, dict) else first
    return torch.optim.Adam(parameters, rate, betas=(0.9, 0.99), eps=1e-12, fused=one.is_cuda or None)
