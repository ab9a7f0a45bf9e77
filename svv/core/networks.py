"""Small networks: the plain reference that the compiled kernels must match."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import linear


def relu_layers(x: Tensor, weights: Sequence[Tensor]) -> Tensor:
    """Linear layers without biases and ReLU between them, as Instant-NGP's (Müller et al. 2022, section 4).

    Args:
        x: Inputs of S samples. (S, I)
        weights: Of each layer, the first on the inputs. (to, from) each

    Returns:
        What the last layer gives. (S, O)
    """
    for weight in weights[:-1]:
        x = torch.relu_(linear(x, weight))
    return linear(x, weights[-1])
