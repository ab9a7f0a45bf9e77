"""Layers of one scene: transfer functions, arrays and volumes of which each gets views of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput
from svv.job.source import VolumeSource
from svv.options.making import ShownVolumeOptions

MOST = 8
"""Maximum number of layers: as many scenes as are joined into one (:mod:`svv.fields.scene.joined`)."""

ENDINGS = (".nii.gz", ".ome.tif", ".ome.tiff", ".ome.zarr")
"""Endings of two words, which are no part of a volume's name."""


def layers(volumes: Sequence[Path], reading: ShownVolumeOptions) -> dict[str, tuple[Path, ShownVolumeOptions]]:
    """Return the volume and the options of each layer, by its name; a single one has the name ''.

    Several volumes (members of an ensemble), arrays, or transfer functions are layers. With one transfer function for
    each array or volume, each has its own; otherwise they share the only one, or each has ranges of its own. Raises
    BadInput if volumes and arrays are both several, counts do not fit, two names are the same, or there are more than
    :data:`MOST`.

    >>> [*layers([Path("a.vti")], ShownVolumeOptions(array=("heat", "speed")))]
    ['heat', 'speed']
    """
    functions, arrays = reading.tf, reading.array
    if len(volumes) > 1 and len(arrays) > 1:
        raise BadInput("Give several volumes or several --array, not both: join the scenes of each with svv join.")
    several = max(len(volumes), len(arrays))
    if several < 2:
        names = [_function_name(tf) for tf in functions] if len(functions) > 1 else [""]
        each = [replace(reading, tf=(tf,)) for tf in functions] or [reading]
        _check(names, "Transfer functions", "rename one of their files")
        return {name: (volumes[0], one) for name, one in zip(names, each, strict=True)}
    if len(functions) > 1 and len(functions) != several:
        raise BadInput(
            f"There are {several} layers and {len(functions)} --tf: give one for all, or one for each, in their order."
        )
    own = [(tf,) for tf in functions] if len(functions) > 1 else [functions] * several
    if len(arrays) > 1:
        _check(list(arrays), "Arrays", "name each array once")
        return {
            _folder(name): (volumes[0], replace(reading, array=(name,), tf=tf))
            for name, tf in zip(arrays, own, strict=True)
        }
    names = [_stem(path) for path in volumes]
    _check(names, "Volumes", "rename one of the files, or name each once")
    return {name: (path, replace(reading, tf=tf)) for name, path, tf in zip(names, volumes, own, strict=True)}


def _check(names: Sequence[str], what: str, advice: str) -> None:
    folders = [_folder(name) for name in names]
    twice = next((name for name, folder in zip(names, folders) if folders.count(folder) > 1), None)
    if twice is not None:
        raise BadInput(f"{what} of the same name, '{twice}', would share a folder: {advice}.")
    if len(names) > MOST:
        raise BadInput(
            f"{len(names)} layers are more than the {MOST} that one scene holds: choose {MOST}, or show all side by "
            "side as small multiples (svv figure)."
        )


def _function_name(tf: Path) -> str:
    from svv.dvr.functions.named import file_and_name

    name = file_and_name(tf)[1]
    return tf.stem if name is None else name


def _stem(path: Path) -> str:
    name = path.name
    ending = next((e for e in ENDINGS if name.lower().endswith(e)), path.suffix)
    return name[: len(name) - len(ending)] or name


def _folder(name: str) -> str:
    """Return a name as that of a folder: characters that folders do not take become '_'.

    >>> _folder("Velocity/Magnitude")
    'Velocity_Magnitude'
    """
    return "".join(c if c.isalnum() or c in " -_.()[]+=" else "_" for c in name).strip(" .") or "_"


def check_layers(sources: Sequence[VolumeSource]) -> None:
    """Open each layer's volume before anything is drawn; raises BadInput if one is unreadable, or two lie apart."""
    first: NDArray[np.float64] | None = None
    for source in sources:
        volume = source.image("auto")
        if not hasattr(volume, "GetBounds"):
            continue  # a large volume, opened without reading it: joining compares what is visible of it
        bounds = np.array(volume.GetBounds()).reshape(3, 2).T
        first = bounds if first is None else first
        if (np.minimum(first[1], bounds[1]) <= np.maximum(first[0], bounds[0])).any():
            raise BadInput(
                f"{sources[0].name} and {source.name} are of different places: layers of one scene must overlap."
            )
