"""The loop of every stage: schedule, progress, time limit, and checkpoints."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor, nn

from svv.errors import BadInput, Cancelled, Progress, silent
from svv.fields.devices.gpu import may_record
from svv.fields.radiance.networks import Layers
from svv.kernels.recorded import RecordedSteps
from svv.train.run import ranks
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.network_adam import FusedAdam, Group, NetworkAdam

SUMMED = 1 << 21
"""Numbers of a table that are summed at a time."""


class LastGood:
    """The last state of a network of which all parameters were finite numbers."""

    def __init__(self, network: nn.Module) -> None:
        self.network = network
        self.step: int | None = None
        """The step after which it was kept; None before the first one."""
        self._state: dict[str, Tensor] = {}

    def outgrown(self) -> bool:
        """Return whether the network's tables have another shape than those that were kept."""
        shapes = {name: value.shape for name, value in self.network.state_dict().items()}
        return shapes != {name: value.shape for name, value in self._state.items()}

    @torch.no_grad()
    def is_finite(self) -> bool:
        """Return whether all parameters are finite numbers."""
        # A sum is not finite if one of its terms is not. It copies what it sums, so large tables are summed in parts.
        values = (part for p in self.network.parameters() for part in p.reshape(-1).split(SUMMED))
        return all(bool(part.sum(dtype=torch.float64).isfinite()) for part in values)

    @torch.no_grad()
    def keep(self, step: int) -> bool:
        """Keep the present state, unless a parameter is not finite; return whether it was kept."""
        if not self.is_finite():
            return False
        if self.outgrown():
            self._state.clear()  # before there are copies of another shape
            self._state = {name: value.detach().clone() for name, value in self.network.state_dict().items()}
        else:
            for name, value in self.network.state_dict().items():
                self._state[name].copy_(value)
        self.step = step
        return True

    @torch.no_grad()
    def restore(self) -> int | None:
        """Bring back what was kept and return its step; None if nothing was, or the network has another shape now."""
        if self.step is None or self.outgrown():
            return None
        self.network.load_state_dict(self._state)
        return self.step


SAVE_EVERY = 30.0
"""Seconds between two checkpoints."""

SHOW_EVERY = 0.2
"""Seconds between two calls of the progress."""

AGREE_EVERY = 8
"""Steps between two times at which several ranks agree on how much of the time limit is over, and whether to stop."""

CHECK_EVERY, KEEP_EVERY = 64, 512
"""Steps between two times at which the loss is checked, and between two at which the network's state is kept."""

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
    notes: list[str] = field(default_factory=list)
    """Receives sentences for the user about how the stage went."""


@dataclass
class Loop:
    """Runs a step repeatedly; under a time limit fewer times, with learning rates that fall with the remaining time."""

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
    network: nn.Module | None = None
    """The network that is trained; if it or its loss is no longer finite, the run ends with its last good state."""
    notes: list[str] = field(default_factory=list)
    """Receives a sentence if that happens."""
    done: int = 0
    """Number of steps done."""
    spent: float = 0.0
    """Seconds spent."""
    course: dict[int, list[Tensor]] = field(default_factory=dict)
    """Losses of each of the ``PARTS`` parts of the run, since it was started or resumed."""

    def run(self, step: Callable[[int, float], Tensor]) -> float:
        """Call ``step(number, fraction)`` until done, and return the seconds spent, with those before an interruption.

        The step returns the loss, which is read only when it is shown, because that waits for the GPU. If several
        processes train, the first one's time limit counts, and all stop at the same step. Raises BadInput if the
        training diverged before there was a good state.
        """
        begin = saved = told = time.monotonic()
        before = self.spent
        good = None if self.network is None else LastGood(self.network)
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
            if good is not None and self.done % CHECK_EVERY == 0 and not self._is_good(good, mean):
                break
            now = time.monotonic()
            self.spent = before + now - begin
            if now - told > SHOW_EVERY:
                told, label = now, f"{self.label} (loss {float(mean):.4f})"
                asked = time.monotonic()
                try:
                    self.progress(fraction, label)
                    begin += time.monotonic() - asked  # a pause does not count
                except Cancelled:
                    if not ranks.many():
                        raise
                    stop = True
            if self.save is not None and now - saved > SAVE_EVERY and bool(mean.isfinite()):
                self.save(self.done, self.spent)
                saved = time.monotonic()
            if self.watch is not None:
                self.watch()
        if good is not None and mean is not None and not (bool(mean.isfinite()) and good.is_finite()):
            self._go_back(good)
        self.progress(1.0, self.label)
        return self.spent

    def _is_good(self, good: LastGood, mean: Tensor) -> bool:
        """Return whether the loss is finite and, now and then, whether the parameters are, which are then kept."""
        due = good.step is None or self.done - good.step >= KEEP_EVERY or good.outgrown()
        return bool(mean.isfinite()) and (not due or good.keep(self.done))

    def _go_back(self, good: LastGood) -> None:
        """Restore the last good state, and say so."""
        step = good.restore()
        advice = "lower its learning rates with --set, or leave those of the preset"
        if step is None:
            raise BadInput(
                f"The stage '{self.label}' diverged at step {self.done}, and no earlier state is good: {advice}."
            )
        self.notes.append(
            f"the stage '{self.label}' diverged at step {self.done} and ended with the state of step {step}: {advice}"
        )
        self.course.clear()

    def last_gain(self, until: float = 1.0) -> float | None:
        """Return the dB by which the last part's mean loss is below that of the part before, None without both.

        ``until`` leaves out parts in which learning rates fall to nothing: the loss falls there in any case.
        """
        ends = [self.course.get(round(PARTS * until) - k) for k in (2, 1)]
        if not all(ends):
            return None
        before, last = (float(torch.stack(losses).mean()) for losses in ends if losses)
        return 10.0 * math.log10(max(before, 1e-12) / max(last, 1e-12))


def falling(fraction: float, end: float, hold: float = 0.0) -> float:
    """Return the factor on a learning rate: it falls exponentially from 1 to ``end``.

    If that is 0, it falls linearly after the fraction ``hold``, the best end of a known schedule (Defazio et al. 2023).
    """
    if end > 0.0:
        return float(end**fraction)
    return min(1.0, (1.0 - fraction) / (1.0 - hold)) if hold < 1.0 else 1.0


def recorded_steps(device: torch.device) -> RecordedSteps:
    """Return what records a stage's steps, unless several processes train, whose steps wait for each other."""
    return RecordedSteps(may_record(device) and not ranks.many())


def growing(fraction: float, doublings: int, hold: float = 0.8) -> float:
    """Return which part of the largest batch a step takes: it doubles ``doublings`` times until ``hold``.

    Example:
        >>> [growing(fraction, 2, 0.75) for fraction in (0.0, 0.2, 0.25, 0.5, 1.0)]
        [0.25, 0.25, 0.5, 1.0, 1.0]
    """
    done = doublings if hold <= 0.0 else min(int(fraction / hold * (doublings + 1)), doublings)
    return float(0.5 ** (doublings - done))


def groups_of(networks: Iterable[Layers], rate: float, muon: bool) -> list[Group]:
    """Return the weights of networks as groups for :func:`network_adam`: hidden layers, and the last ones."""
    every = [network.weights for network in networks]
    hidden, last = [w for each in every for w in each[:-1]], [each[-1] for each in every]
    return [{"params": hidden, "full": rate, "muon": muon}, {"params": last, "full": rate}]


def network_adam(parameters: Sequence[Tensor] | Sequence[Group], rate: float = 1e-3) -> NetworkAdam:
    """Return Adam for parameters, or groups of them, all on one device; on a GPU, one kernel updates a group."""
    first = parameters[0]
    one = first["params"][0] if isinstance(first, dict) else first
    kind = FusedAdam if one.is_cuda else NetworkAdam
    return kind(parameters, rate, betas=(0.9, 0.99), eps=1e-12)
