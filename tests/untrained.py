"""VGG-16 with untrained weights of the right shapes, for tests that need no strokes."""

from __future__ import annotations

import torch

from svv.styles.features import VGG16_WIDTHS


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
