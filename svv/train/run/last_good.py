"""What a training goes back to when it diverges: the last state in which every number was finite."""

from __future__ import annotations

import torch
from torch import Tensor, nn


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
        # A sum is not finite if one of its terms is not, and needs no memory.
        return all(bool(p.sum(dtype=torch.float64).isfinite()) for p in self.network.parameters())

    @torch.no_grad()
    def keep(self, step: int) -> bool:
        """Keep the present state, unless a parameter is not finite; return whether it was kept."""
        if not self.is_finite():
            return False
        self.step = step
        self._state = {name: value.detach().clone() for name, value in self.network.state_dict().items()}
        return True

    @torch.no_grad()
    def restore(self) -> int | None:
        """Bring back what was kept and return its step; None if nothing was, or the network has another shape now."""
        if self.step is None or self.outgrown():
            return None
        self.network.load_state_dict(self._state)
        return self.step
