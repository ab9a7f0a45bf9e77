"""Networks with published weights, and the folder in which they are kept (:mod:`svv.styles.weights` loads them)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from svv.io.files.cache import cache_folder

FOLDER_VARIABLE = "SVV_WEIGHTS"
FAILED_FILE = "not-fetched"


@dataclass(frozen=True)
class Network:
    """A network with published weights."""

    name: str
    title: str
    use: str
    """Purpose of the weights."""
    file: str
    """Name of the weights' file in our folder."""
    content: str
    """:func:`svv.styles.weight_files.content_sha256` of the published values."""


NETWORKS = {
    network.name: network
    for network in (
        Network("vgg16", "VGG-16", "preset paper", "vgg16-conv3.safetensors",
                "09bc150e30079193455c830341737203d86a2643c389becc2dd588a3be1102b6"),
        Network("alexnet", "AlexNet", "LPIPS", "alexnet-lpips.safetensors",
                "90b047f27c97743647374881886d16f25704113535a4d6f6d464fe2040fc9a64"),
    )
}  # fmt: skip
"""Networks by name. The heads of ``alexnet`` are bit for bit those of the package lpips 0.1.4."""


def weights_folder() -> Path:
    """Return the folder of the weights: ``SVV_WEIGHTS``, or ``weights`` in the program's folder of the user's cache."""
    named = os.environ.get(FOLDER_VARIABLE)
    return Path(named).expanduser() if named else cache_folder() / "weights"
