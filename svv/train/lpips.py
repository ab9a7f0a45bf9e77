"""LPIPS with AlexNet (Zhang et al. 2018, version 0.1), where its weights are on this machine; else no number.

The weights are two files that we may not ship: AlexNet's (torchvision's, in torch's cache) and the linear heads
(in the package ``lpips``, whose code is not imported, since it needs torchvision). Nothing is downloaded here.
"""

from __future__ import annotations

import hashlib
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.errors import BadInput

ALEXNET_FILE = "alexnet-owt-7be5be79.pth"
ALEXNET_SHA256_PREFIX = "7be5be79"
"""Torch names its weight files after the first digits of their SHA-256."""
HEADS_FILE = Path("weights", "v0.1", "alex.pth")
CHANNELS = (64, 192, 384, 256, 256)
MIN_SIZE = 31
"""Below it AlexNet's second pooling is left with nothing."""


class Lpips(nn.Module):
    """Weighted squared distance of unit-length AlexNet activations, averaged over the picture."""

    shift: Tensor
    scale: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("shift", torch.tensor((-0.030, -0.088, -0.188)).view(3, 1, 1), persistent=False)
        self.register_buffer("scale", torch.tensor((0.458, 0.448, 0.450)).view(3, 1, 1), persistent=False)
        # the names features.0, .3, .6, .8, .10 are those of torchvision's weight file
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
        """Distance (n,) of pictures (n, 3, h, w) in [-1, 1]."""
        pairs = zip(self._activations(a), self._activations(b), self.heads, strict=True)
        return torch.stack([((x - y) ** 2 * head).sum(1).mean((1, 2)) for x, y, head in pairs]).sum(0)

    def _activations(self, picture: Tensor) -> list[Tensor]:
        """Activations after each ReLU, of length 1 along the channels."""
        x = (picture - self.shift) / self.scale
        found = []
        for layer in self.features:
            x = layer(x)
            if isinstance(layer, nn.ReLU):
                found.append(x / (x.norm(dim=1, keepdim=True) + 1e-10))
        return found


def load_lpips() -> Lpips | None:
    """LPIPS with its published weights; None where AlexNet's or the heads are not on this machine.

    Raises:
        BadInput: AlexNet's file is not the published one (its SHA-256 does not begin as its name says).
    """
    alexnet = Path(torch.hub.get_dir(), "checkpoints", ALEXNET_FILE)
    package = find_spec("lpips")
    folders = (package.submodule_search_locations if package else None) or []
    heads = next((path for folder in folders if (path := Path(folder) / HEADS_FILE).is_file()), None)
    if heads is None or not alexnet.is_file():
        return None
    if not hashlib.sha256(alexnet.read_bytes()).hexdigest().startswith(ALEXNET_SHA256_PREFIX):
        raise BadInput(f"{alexnet} is not the published AlexNet; delete it and download it again.")
    network = Lpips()
    trunk = torch.load(alexnet, map_location="cpu", weights_only=True)
    linear = torch.load(heads, map_location="cpu", weights_only=True)
    state = {name: value for name, value in trunk.items() if name.startswith("features.")}
    state |= {f"heads.{i}": linear[f"lin{i}.model.1.weight"] for i in range(len(CHANNELS))}
    network.load_state_dict(state)
    return network.eval()


@torch.no_grad()
def lpips(network: Lpips, prediction: NDArray[np.floating], truth: NDArray[np.floating]) -> float:
    """LPIPS of two pictures (h, w, 3) in [0, 1]; 0 for equal ones. Raises BadInput below 31 x 31 pixels."""
    if prediction.shape != truth.shape or min(truth.shape[:2]) < MIN_SIZE:
        raise BadInput(f"LPIPS needs two pictures of one size, {MIN_SIZE} x {MIN_SIZE} or more; render them larger.")
    pair = np.stack((np.clip(prediction, 0, 1), truth)).astype(np.float32)
    a, b = (torch.from_numpy(pair) * 2 - 1).permute(0, 3, 1, 2).split(1)
    return float(network(a, b))
