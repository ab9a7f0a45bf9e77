"""Images in HDF5 as pycinema and the Topology ToolKit write them: ``/channels`` and ``/meta``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput

SUFFIXES = (".h5", ".hdf5")
"""Suffixes of HDF5 files, lower case."""


def read_channels(path: Path) -> tuple[NDArray[np.uint8], dict[str, object]]:
    """Return a file's uint8 levels (height, width, 3 or 4) and metadata; BadInput if damaged, or without h5py."""
    try:
        import h5py
    except ImportError as error:
        raise BadInput(
            "The images are HDF5 files, which need h5py, and it is not installed: pip install 'svv[cinema]'."
        ) from error
    try:
        with h5py.File(path, "r") as file:
            channels = file.get("channels", {})
            name = next((n for n in ("rgba", "RGBA", "rgb", "RGB") if n in channels), None)
            if name is None:
                raise BadInput(f"{path} has no channel rgba: {', '.join(channels) or 'it has no channels at all'}.")
            picture = np.asarray(channels[name])
            meta = {key: _plain(value[()]) for key, value in file.get("meta", {}).items()}
    except BadInput:
        raise
    except (OSError, KeyError, ValueError, RuntimeError, AttributeError) as error:
        said = (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")
        raise BadInput(f"Cannot read {path} ({said}); it is truncated or not an HDF5 file.") from error
    if picture.ndim != 3 or picture.shape[-1] not in (3, 4):
        raise BadInput(f"The channel {name} of {path} has the shape {picture.shape}, not (height, width, 4).")
    if picture.dtype != np.uint8:
        if not np.issubdtype(picture.dtype, np.floating):
            raise BadInput(f"The channel {name} of {path} holds {picture.dtype}, not 8-bit levels or values in [0, 1].")
        picture = np.rint(255.0 * np.clip(np.nan_to_num(picture), 0.0, 1.0)).astype(np.uint8)
    return picture, meta


def _plain(value: object) -> object:
    """Return text for bytes, and arrays without axes of length 1 at their ends."""
    array = np.squeeze(np.asarray(value))
    if array.dtype.kind in "SO" and array.ndim == 0:
        item = array.item()
        return item.decode("utf-8", "replace") if isinstance(item, bytes) else str(item)
    return array.item() if array.ndim == 0 else array
