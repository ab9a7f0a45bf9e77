"""Small networks: the plain reference that the compiled kernels must match."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import linear


def relu_layers(x: Tensor, weights: Sequence[Tensor]) -> Tensor:
    """Apply linear layers without biases, with ReLU between them, as in Instant-NGP (Müller et al. 2022, section 4).

    (S, I) -> (S, O); ``weights``: those of each layer, (to, from).
    """
    for weight in weights[:-1]:
        x = torch.relu_(linear(x, weight))
    return linear(x, weights[-1])
