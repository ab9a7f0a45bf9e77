"""VGG-16 with untrained weights of the right shapes, for tests that need no strokes."""

from __future__ import annotations

import torch
from torch import nn

from svv.styles.features import VGG16_WIDTHS, VggFeatures


def vgg16_state() -> dict[str, torch.Tensor]:
    """Weights of torchvision's names and shapes, small enough to keep numbers finite (He et al. 2015)."""
    state, channels, number = {}, 3, 0
    for block in VGG16_WIDTHS:
        for width in block:
            state[f"features.{number}.weight"] = torch.randn(width, channels, 3, 3) * (2 / (9 * channels)) ** 0.5
            state[f"features.{number}.bias"] = torch.zeros(width)
            channels, number = width, number + 2
        number += 1
    return state | {"classifier.0.weight": torch.zeros(2, 2)}


def untrained() -> nn.Module:
    """The network with such weights, always the same."""
    torch.manual_seed(0)
    network = VggFeatures("untrained VGG-16")
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight)
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return network.requires_grad_(False)
