"""LPIPS with AlexNet (Zhang et al. 2018, version 0.1), if :mod:`svv.styles.weights` finds its weights."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.errors import BadInput
from svv.styles import weights

CHANNELS = (64, 192, 384, 256, 256)
MIN_SIZE = 31
"""Minimum side of pictures in pixels: AlexNet's second pooling has no output for smaller ones."""


class Lpips(nn.Module):
    """Weighted squared distance of unit-length AlexNet activations, averaged over the picture."""

    shift: Tensor
    scale: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("shift", torch.tensor((-0.030, -0.088, -0.188)).view(3, 1, 1), persistent=False)
        self.register_buffer("scale", torch.tensor((0.458, 0.448, 0.450)).view(3, 1, 1), persistent=False)
        # The names features.0, .3, .6, .8 and .10 are those of torchvision's weight file.
        self.features = nn.Sequential(
            *(nn.Conv2d(3, 64, 11, stride=4, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2)),
            *(nn.Conv2d(64, 192, 5, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2)),
            *(nn.Conv2d(192, 384, 3, padding=1), nn.ReLU()),
            *(nn.Conv2d(384, 256, 3, padding=1), nn.ReLU()),
            *(nn.Conv2d(256, 256, 3, padding=1), nn.ReLU()),
        )
        self.heads = nn.ParameterList(torch.ones(1, width, 1, 1) for width in CHANNELS)
        self.requires_grad_(False)

    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        """Return the distances (n,) between pictures (n, 3, h, w) in [-1, 1]."""
        pairs = zip(*(map(_unit, self.activations(x)) for x in (a, b)), self.heads, strict=True)
        return torch.stack([((x - y) ** 2 * head).sum(1).mean((1, 2)) for x, y, head in pairs]).sum(0)

    def activations(self, picture: Tensor) -> list[Tensor]:
        """Return the activations of pictures (n, 3, h, w) in [-1, 1] after each ReLU, each (n, channels, ..., ...)."""
        x = (picture - self.shift) / self.scale
        found = []
        for layer in self.features:
            x = layer(x)
            if isinstance(layer, nn.ReLU):
                found.append(x)
        return found


def _unit(x: Tensor) -> Tensor:
    """Normalize to length 1 along the channels."""
    return x / (x.norm(dim=1, keepdim=True) + 1e-10)


def load_lpips() -> Lpips | None:
    """Return LPIPS with its published weights, None without them; raises BadInput if torch's cache has another file."""
    found = weights.load("alexnet")
    if found is None:
        return None
    network = Lpips()
    network.load_state_dict(found.state)
    return network.eval()


@torch.no_grad()
def lpips(network: Lpips, prediction: NDArray[np.floating], truth: NDArray[np.floating]) -> float:
    """Return the LPIPS of two pictures (h, w, 3) in [0, 1]; 0 if equal. Raises BadInput below 31 x 31 pixels."""
    if prediction.shape != truth.shape or min(truth.shape[:2]) < MIN_SIZE:
        raise BadInput(f"LPIPS needs two pictures of the same size, at least {MIN_SIZE} x {MIN_SIZE} pixels.")
    pair = np.stack((np.clip(prediction, 0, 1), truth)).astype(np.float32)
    a, b = (torch.from_numpy(pair) * 2 - 1).permute(0, 3, 1, 2).split(1)
    return float(network(a, b))
