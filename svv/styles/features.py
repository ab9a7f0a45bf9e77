"""Features for style matching, as maps at a quarter of the picture's resolution.

There are two kinds: VGG-16 up to conv3, whose weights are fetched once, and patches in a cosine basis weighted by
frequency, which do not need weights.
"""

from __future__ import annotations

from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from svv.errors import BadInput, Progress, silent
from svv.styles import weights
from svv.styles.weight_files import VGG16_LAYERS

VGG16_WIDTHS = ((64, 64), (128, 128), (256, 256, 256))
STRIDE = 4
"""Pixels of the picture per cell of the feature map, along each axis."""


class PatchFeatures(nn.Module):
    """Patches of a picture in a cosine basis, of an even side >= 4 in pixels, as features that need no training.

    In natural pictures and paintings amplitudes fall roughly as 1 / frequency, so the flat part dominates the cosine
    distance of raw patches. Multiplying each coefficient by its frequency gives strokes and dots the same weight as the
    colour they are painted in. All three channels are treated alike; otherwise faint hues would become gaudy.
    """

    kernels: Tensor
    title = "cosine patches"
    """Name of the features in reports."""
    note = ""
    """Notice for the user that better features are not available; empty if there is nothing to say."""

    def __init__(self, side: int = 8) -> None:
        super().__init__()
        at = torch.arange(side)
        basis = torch.cos(torch.pi / side * (at[None] + 0.5) * at[:, None]) * (2 / side) ** 0.5
        basis[0] *= 0.5**0.5  # DCT-II, orthonormal
        gain = torch.hypot(at[:, None].float(), at[None].float())
        gain[0, 0] = 1
        kernels = torch.einsum("uy,vx,uv->uvyx", basis, basis, gain).reshape(-1, 1, side, side)
        self.register_buffer("kernels", kernels, persistent=False)
        self.margin, self.channels = (side - STRIDE) // 2, 3 * side * side

    def forward(self, image: Tensor) -> Tensor:
        """Return features of pictures: (n, 3, h, w) in [0, 1] -> (n, 3 side^2, h // 4, w // 4)."""
        padded = F.pad(image, (self.margin,) * 4, mode="reflect")
        # Each channel is treated as a separate picture: many times faster on a CPU than a grouped convolution.
        found = F.conv2d(padded.flatten(0, 1)[:, None], self.kernels, stride=STRIDE)
        return found.unflatten(0, (len(image), 3)).flatten(1, 2)


class VggFeatures(nn.Module):
    """VGG-16 up to conv3 (Simonyan & Zisserman 2015): the activations of conv3_1 to conv3_3, concatenated."""

    mean: Tensor
    deviation: Tensor
    note = ""

    def __init__(self, title: str = "VGG-16") -> None:
        super().__init__()
        self.title = title
        self.register_buffer("mean", torch.tensor([0.485, 0.456, 0.406]).view(3, 1, 1), persistent=False)
        self.register_buffer("deviation", torch.tensor([0.229, 0.224, 0.225]).view(3, 1, 1), persistent=False)
        self.layers: list[list[nn.Conv2d]] = []
        channels = 3
        for block in VGG16_WIDTHS:
            self.layers.append([])
            for width in block:
                self.layers[-1].append(nn.Conv2d(channels, width, 3, padding=1, padding_mode="reflect"))
                channels = width
        self.blocks = nn.ModuleList(nn.ModuleList(block) for block in self.layers)
        self.channels = sum(VGG16_WIDTHS[2])

    def forward(self, image: Tensor) -> Tensor:
        """Return features >= 0: sRGB in [0, 1] (n, 3, h, w), h and w >= 12 -> (n, channels, h // 4, w // 4)."""
        x = ((image - self.mean) / self.deviation).contiguous(memory_format=torch.channels_last)
        maps: list[Tensor] = []
        for number, block in enumerate(self.layers):
            if number:
                x = F.max_pool2d(x, 2)
            for layer in block:
                x = torch.relu(layer(x))
                maps.append(x)
        return torch.cat(maps[-len(self.layers[2]) :], 1)


FeatureNetwork = PatchFeatures | VggFeatures
"""A network whose features are matched to those of styles."""


def load_features(name: str = "auto", progress: Progress = silent) -> FeatureNetwork:
    """Load a feature network with frozen weights.

    Args:
        name: ``"embedded"``: features without weights (:class:`PatchFeatures`).
            ``"vgg16"``: VGG-16 with ImageNet weights, from this machine or fetched (:mod:`svv.styles.weights`).
            ``"auto"``: VGG-16 if it is on this machine or a small download away
            (:func:`svv.styles.weights.first_use`), otherwise the embedded features, whose ``note`` says how to get it.
            Any other text: the path of a file of VGG-16 weights (.pth or .safetensors).
        progress: Called during a download.

    Returns:
        The network, without gradients for its weights: (n, 3, h, w) in [0, 1] -> (n, channels, h // 4, w // 4).

    Raises:
        BadInput: The weights cannot be obtained, or the file does not contain them.
    """
    if name == "embedded":
        return PatchFeatures()
    if name == "auto":
        found = weights.first_use("vgg16", progress)
        if found is None:
            instead = PatchFeatures()
            instead.note = weights.BETTER
            return instead
        network = _network(found.state, "VGG-16")
    elif name == "vgg16":
        network = _network((weights.load(name) or weights.get(name, progress)).state, "VGG-16")
    else:
        network = read_features(Path(name))
    return network.eval().requires_grad_(False).to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def read_features(path: Path) -> VggFeatures:
    """Load VGG-16 with the weights in a file (``features.N.weight``, torchvision's names); BadInput if it is none."""
    if not path.is_file():
        raise BadInput(f"There is no file of feature weights at {path}: give a path, 'embedded' or 'vgg16'.")
    try:
        if path.suffix == ".safetensors":
            state = load_file(path)
        else:
            state = torch.load(path, map_location="cpu", weights_only=True)
    except (SafetensorError, RuntimeError, ValueError, EOFError, OSError, KeyError) as error:
        raise BadInput(f"{path} is not a file of feature weights (.pth or .safetensors): {error}.") from error
    except Exception as error:  # torch.load raises pickle's errors for anything but a state dict
        raise BadInput(f"{path} is not a file of feature weights that can be read safely.") from error
    return _network(state, path.name)


def _network(state: dict[str, Tensor], title: str) -> VggFeatures:
    # The convolutions up to conv3_3 among torchvision's layers 0 to 30.
    rows = [(b, i) for b, block in enumerate(VGG16_WIDTHS) for i in range(len(block))]
    wanted = {
        (f"features.{n}.{kind}", f"blocks.{b}.{i}.{kind}")
        for n, (b, i) in zip(VGG16_LAYERS, rows, strict=True)
        for kind in ("weight", "bias")
    }
    if any(there not in state for there, _ in wanted):
        raise BadInput(f"{title} does not hold the weights of VGG-16 (features.0.weight ...).")
    network = VggFeatures(title)
    try:
        network.load_state_dict({here: state[there].float() for there, here in wanted})
    except RuntimeError as error:
        raise BadInput(f"The weights in {title} do not have the shapes of VGG-16's layers.") from error
    return network
