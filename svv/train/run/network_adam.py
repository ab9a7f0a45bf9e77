"""Optimisers of the small networks, on a CPU and on a GPU.

Hidden layers may take the orthogonalized steps of Muon (Jordan et al. 2024), everything else takes those of Adam
(Kingma & Ba 2015).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypedDict

import torch
from torch import Tensor


class Group(TypedDict, total=False):
    """Parameters with a learning rate of their own."""

    params: Sequence[Tensor]
    lr: float | Tensor
    """A number, or a tensor (1,) on the parameters' device."""
    full: float
    """The rate at the beginning, for whoever changes ``lr``."""
    muon: bool
    """Whether they are weights of hidden layers, whose steps are orthogonalized; by default False."""


MOMENTUM = 0.9
"""Part of Muon's momentum that a step keeps."""

REACH = 10.0
"""Singular values of Muon's step, relative to the learning rate. From 2 to 10, scenes get the same PSNR."""

QUINTIC = (3.4445, -4.775, 2.0315)
"""Coefficients of a Newton-Schulz iteration that raises small singular values fast (Jordan et al. 2024)."""

TURNS = 5
"""Number of these iterations."""


def orthogonalized(matrix: Tensor) -> Tensor:
    """Return a matrix of the same singular vectors whose singular values are about 1; zeros for zeros. (M, N)

    By Newton-Schulz iterations, which only multiply: singular values from 0.01 of the largest on end between 0.7 and
    1.2.

    Example:
        >>> [round(value, 1) for value in orthogonalized(torch.tensor([[3.0, 0.0], [0.0, -0.2]])).diag().tolist()]
        [0.7, -1.1]
    """
    wide = matrix if matrix.shape[0] <= matrix.shape[1] else matrix.T
    # NumPy's products of small matrices take a tenth of torch's, which divides each among threads.
    x: Any = wide if matrix.is_cuda else wide.numpy()
    x = x / ((x * x).sum() ** 0.5 + 1e-20)
    a, b, c = QUINTIC
    for _ in range(TURNS):
        square = x @ x.T
        x = a * x + (b * square + c * (square @ square)) @ x
    found: Tensor = x if matrix.is_cuda else torch.from_numpy(x)
    return found if wide is matrix else found.T


class NetworkAdam:
    """What :class:`torch.optim.Adam` computes, with torch's names in its state: checkpoints of either continue both.

    Groups with ``muon`` take Muon's steps instead.

    Creating torch's loads its compiler: 150 MB and 1.5 seconds in every process that trains, for a few thousand
    parameters.
    """

    STEPS_THERE = False
    """Whether the numbers of steps lie on the parameters' device."""

    def __init__(
        self, parameters: Sequence[Tensor] | Sequence[Group], lr: float, betas: tuple[float, float], eps: float
    ) -> None:
        """Optimise parameters, or groups of them with the key ``params``; each group may change its rate ``lr``."""
        groups: list[Group] = [p if isinstance(p, dict) else {"params": [p]} for p in parameters]
        self.param_groups: list[Group] = [{"lr": lr, **group} for group in groups]
        self.state: dict[int, dict[str, Tensor]] = {}
        self._betas, self._eps = betas, eps

    def _numbered(self) -> Iterator[tuple[int, Group, Tensor]]:
        """Yield each parameter with its number among all and its group."""
        number = 0
        for group in self.param_groups:
            for parameter in group["params"]:
                yield number, group, parameter
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
        for number, group, parameter in self._numbered():
            gradient, rate = parameter.grad, group["lr"]
            if gradient is None:
                continue
            if group.get("muon", False):
                self._turn(number, parameter, rate)
                continue
            own = self._state_of(number, parameter)
            own["step"] += 1.0
            steps = float(own["step"])
            mean = own["exp_avg"].lerp_(gradient, 1.0 - first)
            square = own["exp_avg_sq"].mul_(second).addcmul_(gradient, gradient, value=1.0 - second)
            size = (square.sqrt() / (1.0 - second**steps) ** 0.5).add_(self._eps)
            parameter.addcdiv_(mean, size, value=-float(rate) / (1.0 - first**steps))

    def _turn(self, number: int, parameter: Tensor, rate: float | Tensor) -> None:
        """Take Muon's step of a parameter, a matrix (to, from)."""
        mean, gradient = self._state_of(number, parameter)["exp_avg"], parameter.grad
        assert gradient is not None
        mean.lerp_(gradient, 1.0 - MOMENTUM)
        step = orthogonalized(gradient.lerp(mean, MOMENTUM))
        outputs, inputs = parameter.shape
        parameter.sub_(step * (rate * REACH * max(1.0, outputs / inputs) ** 0.5))

    def _state_of(self, number: int, parameter: Tensor) -> dict[str, Tensor]:
        """Return the state of a parameter, which begins with zeros."""
        if number not in self.state:
            self.state[number] = {
                "step": torch.zeros((), device=parameter.device if self.STEPS_THERE else None),
                "exp_avg": torch.zeros_like(parameter),
                "exp_avg_sq": torch.zeros_like(parameter),
            }
        return self.state[number]

    def state_dict(self) -> dict[str, Any]:
        """Return the state of each parameter by its number, under ``state``."""
        return {"state": dict(self.state)}

    def load_state_dict(self, saved: dict[str, Any]) -> None:
        """Restore the state returned by an earlier :meth:`state_dict`."""
        self.state = {int(number): dict(own) for number, own in saved["state"].items()}


class FusedAdam(NetworkAdam):
    """The same in two operations for each group: what :class:`torch.optim.Adam` starts on a GPU if it is fused."""

    STEPS_THERE = True

    @torch.no_grad()
    def step(self) -> None:
        """Take one step with the gradients that there are."""
        first, second = self._betas
        for group, parameters in self._by_group():
            rate = group["lr"]
            if group.get("muon", False):
                for number, parameter in parameters:
                    self._turn(number, parameter, rate)
                continue
            states = [self._state_of(number, parameter) for number, parameter in parameters]
            steps, means, squares = ([own[k] for own in states] for k in ("step", "exp_avg", "exp_avg_sq"))
            values, gradients = [p for _, p in parameters], [p.grad for _, p in parameters if p.grad is not None]
            torch._foreach_add_(steps, 1.0)
            step = torch.ops.aten._fused_adam_
            (step.tensor_lr if isinstance(rate, Tensor) else step.default)(
                values, gradients, means, squares, [], steps, lr=rate, beta1=first, beta2=second, weight_decay=0.0,
                eps=self._eps, amsgrad=False, maximize=False,
            )  # fmt: skip

    def _by_group(self) -> Iterator[tuple[Group, list[tuple[int, Tensor]]]]:
        """Yield each group with those of its parameters that have a gradient, and their numbers."""
        number = 0
        for group in self.param_groups:
            numbered = list(enumerate(group["params"], start=number))
            number += len(numbered)
            there = [(k, p) for k, p in numbered if p.grad is not None]
            if there:
                yield group, there

    def load_state_dict(self, saved: dict[str, Any]) -> None:
        """Restore the state returned by an earlier :meth:`state_dict`, of any device."""
        super().load_state_dict(saved)
        for number, _, parameter in self._numbered():
            if number in self.state:
                own = self.state[number]
                self.state[number] = {name: value.to(parameter.device, torch.float32) for name, value in own.items()}
