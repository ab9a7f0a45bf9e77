"""Timing of the parts of a step from outside, without any support in the measured code.

The functions of :func:`svv_bench.profile.work.watched` are temporarily replaced by ones that report their stage to
torch's profiler. Hooks on modules do the same for networks, and autograd's names identify the parts of the backward
pass. All time is assigned once, to the innermost stage, so the times of a step's stages add up to that of the step.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import torch
from torch import nn
from torch.autograd.profiler import record_function
from torch.nn.modules.module import register_module_forward_hook, register_module_forward_pre_hook

from svv_bench.profile.work import Watched, Work, linear_layer

STEP = "svv.step"
MARK = "svv:"
NETWORKS = "networks"
NODE = "autograd::engine::evaluate_function: "
OF_NETWORKS = (
    "MmBackward0", "TBackward0", "ReluBackward0", "NetworkBackward", "HalfNetworkBackward",
    "torch::autograd::AccumulateGrad",
)  # fmt: skip
"""Nodes of autograd's graph that occur only in the networks."""

REST, REST_BACK = "other torch operations", "other torch operations, backward"
OPTIMISER, GLUE = "Adam, networks", "between (Python, NumPy)"


class Watch:
    """Timer and counter of steps, for use within ``with watch.on():``."""

    def __init__(self, functions: list[Watched]) -> None:
        self._functions = functions
        self._counting = self._whole = False
        self._found: dict[str, Work] = defaultdict(Work)

    @contextmanager
    def on(self) -> Iterator[None]:
        """Replace the functions; they are restored in any case."""
        with ExitStack() as stack:
            for one in self._functions:
                before = getattr(one.owner, one.name)
                stack.callback(setattr, one.owner, one.name, before)
                setattr(one.owner, one.name, self._told(one, before))
            running: list[record_function] = []

            def enter(module: nn.Module, _: Any) -> None:
                if isinstance(module, nn.Sequential):
                    running.append(record_function(MARK + NETWORKS))
                    running[-1].__enter__()

            def leave(module: nn.Module, inputs: Any, result: Any) -> None:
                if isinstance(module, nn.Sequential):
                    running.pop().__exit__(None, None, None)
                    if self._counting:
                        self._count_network(module, inputs[0], result)

            for hook in (register_module_forward_pre_hook(enter), register_module_forward_hook(leave)):
                stack.callback(hook.remove)
            yield

    def _told(self, one: Watched, before: Callable[..., Any]) -> Callable[..., Any]:
        def told(*arguments: Any, **more: Any) -> Any:
            if self._whole:
                return before(*arguments, **more)
            if self._counting and one.count is not None:
                with torch.no_grad():
                    self._found[one.stage] += one.count(arguments)
            with record_function(MARK + one.stage):
                self._whole = one.count is None
                try:
                    return before(*arguments, **more)
                finally:
                    self._whole = False

        return told

    def _count_network(self, network: nn.Sequential, x: torch.Tensor, y: torch.Tensor) -> None:
        """Count the forward pass and, with a graph, the backward pass: products for gradients of inputs and weights."""
        ends = 4.0 * len(x) * (x.shape[1] + y.shape[1])
        forward = Work(len(x), ends)
        for layer in network:
            if isinstance(layer, nn.Linear):
                forward += linear_layer(len(x), layer.in_features, layer.out_features)
        self._found[NETWORKS] += forward
        if y.requires_grad:
            self._found[f"{NETWORKS}, backward"] += forward.times(2)

    def count(self, step: Callable[[], object], repeats: int) -> dict[str, Work]:
        """Return the mean work of a step's stages."""
        self._found.clear()
        self._counting = True
        try:
            for _ in range(repeats):
                step()
        finally:
            self._counting = False
        return {stage: work.times(1 / repeats) for stage, work in self._found.items()}

    def time(self, step: Callable[[], object], repeats: int) -> list[dict[str, float]]:
        """Return the seconds of every stage of each step."""
        with torch.profiler.profile(activities=[torch.profiler.ProfilerActivity.CPU]) as profile:
            for _ in range(repeats):
                with record_function(STEP):
                    step()
        steps = []
        for event in profile.events():
            if event.name == STEP:
                seconds: dict[str, float] = defaultdict(float)
                _add(event, GLUE, seconds)
                steps.append(dict(seconds))
        return steps


def _add(event: Any, stage: str, seconds: dict[str, float]) -> None:
    """Add the times of an event and of its children to their stages."""
    name = event.name
    if name.startswith(MARK):
        stage = name.removeprefix(MARK)
    elif name.startswith(NODE):
        of_networks = name.removeprefix(NODE) in OF_NETWORKS
        stage = f"{NETWORKS}, backward" if of_networks else REST_BACK
    elif name.startswith("Optimizer."):
        stage = OPTIMISER
    elif stage == GLUE and name != STEP:
        stage = REST
    seconds[stage] += event.self_cpu_time_total * 1e-6
    for child in event.cpu_children:
        _add(child, stage, seconds)
