"""Adam for the small networks on a CPU (Kingma & Ba 2015)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import torch
from torch import Tensor


class NetworkAdam:
    """What :class:`torch.optim.Adam` computes, in the part of its interface that training uses.

    Creating torch's loads its compiler: 150 MB and 1.5 seconds in every process that trains, for a few thousand
    parameters. The names in the state are torch's, so a checkpoint of either continues with the other.
    """

    def __init__(
        self, parameters: Sequence[Tensor] | Sequence[dict[str, Any]], lr: float, betas: tuple[float, float], eps: float
    ) -> None:
        """Optimise parameters, or groups of them with the key ``params``; each group may change its rate ``lr``."""
        groups = [p if isinstance(p, dict) else {"params": [p]} for p in parameters]
        self.param_groups: list[dict[str, Any]] = [{"lr": lr, **group} for group in groups]
        self.state: dict[int, dict[str, Tensor]] = {}
        self._betas, self._eps = betas, eps

    def _numbered(self) -> Iterator[tuple[int, float, Tensor]]:
        """Yield each parameter with its number among all and the rate of its group."""
        number = 0
        for group in self.param_groups:
            for parameter in group["params"]:
                yield number, group["lr"], parameter
                number += 1

    def zero_grad(self, set_to_none: bool = True) -> None:
        """Forget the gradients; ``set_to_none`` as in torch, where False would keep tensors of zeros."""
        for _, _, parameter in self._numbered():
            if parameter.grad is not None and not set_to_none:
                parameter.grad.zero_()
            else:
                parameter.grad = None

    @torch.no_grad()
    def step(self) -> None:
        """Take one step with the gradients that there are."""
        first, second = self._betas
        for number, rate, parameter in self._numbered():
            gradient = parameter.grad
            if gradient is None:
                continue
            if number not in self.state:
                self.state[number] = {
                    "step": torch.zeros(()),
                    "exp_avg": torch.zeros_like(parameter),
                    "exp_avg_sq": torch.zeros_like(parameter),
                }
            own = self.state[number]
            own["step"] += 1.0
            steps = float(own["step"])
            mean = own["exp_avg"].lerp_(gradient, 1.0 - first)
            square = own["exp_avg_sq"].mul_(second).addcmul_(gradient, gradient, value=1.0 - second)
            size = (square.sqrt() / (1.0 - second**steps) ** 0.5).add_(self._eps)
            parameter.addcdiv_(mean, size, value=-rate / (1.0 - first**steps))

    def state_dict(self) -> dict[str, Any]:
        """Return the state of each parameter by its number, under ``state``."""
        return {"state": dict(self.state)}

    def load_state_dict(self, saved: dict[str, Any]) -> None:
        """Restore the state returned by an earlier :meth:`state_dict`."""
        self.state = {int(number): dict(own) for number, own in saved["state"].items()}
