"""Views as they are drawn, one file each: an interrupted drawing goes on from them, and processes share it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.core.sharing import ALONE, Sharing
from svv.io.files.atomic import atomic_path, make_folder
from svv.io.files.keyed_results import read_record, write_record

RECORD = "drawing.json"
"""File with the key of the views and their sample distance."""


class DrawnViews:
    """The views in a folder that is created with the first, and removed when all of them are written where they belong.

    ``key`` is a hash of all on which they depend (:func:`svv.io.files.keyed_results.key_of`); views with another one
    are removed.
    """

    def __init__(self, folder: Path, key: str, sharing: Sharing = ALONE) -> None:
        self.folder, self.key, self.sharing = folder, key, sharing

    def step(self, measure: Callable[[], float]) -> float:
        """Return the sample distance in voxels: the one with which the drawing began, or what ``measure`` finds.

        All processes call this before they draw; the first one measures. Raises BadInput if the folder cannot be
        written.
        """

        def known() -> float:
            begun = read_record(self.folder / RECORD, self.key)
            if begun is not None:
                return float(begun["step"])
            shutil.rmtree(self.folder, ignore_errors=True)
            step = measure()
            make_folder(self.folder)
            write_record(self.folder / RECORD, self.key, {"step": step})
            return step

        return float(self.sharing.once(known))

    def get(self, number: int, shape: tuple[int, ...]) -> NDArray[np.uint8] | None:
        """Return a view of this shape if it has been drawn, else None."""
        try:
            with self._file(number).open("rb") as file:  # NumPy would leave a damaged file open
                view = np.load(file, allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        return view if isinstance(view, np.ndarray) and (view.shape, view.dtype) == (shape, np.uint8) else None

    def put(self, number: int, view: NDArray[np.uint8]) -> None:
        """Keep a view that has been drawn; raises BadInput if the folder cannot be written."""
        with atomic_path(self._file(number)) as temporary, temporary.open("wb") as file:
            np.save(file, view)

    def clear(self) -> None:
        """Remove the views; after an error that passes, a second time."""
        for _ in range(2):
            shutil.rmtree(self.folder, ignore_errors=True)

    def _file(self, number: int) -> Path:
        return self.folder / f"{number:05d}.npy"
