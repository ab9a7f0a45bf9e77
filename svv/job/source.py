"""Where a job's views come from: a volume and its transfer function, or a folder of views."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.core.cameras import Camera
from svv.errors import BadInput, Progress, part
from svv.io.view_meta import ViewMeta, known
from svv.io.viewset import CLASSIFIED, files_of, read_meta
from svv.job.stages import fingerprint
from svv.options.making import ViewOptions


class Drawn(ABC):
    """A volume and its transfer function, of which views are drawn."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Of the volume, for the record."""

    @abstractmethod
    def identity(self) -> dict[str, Any]:
        """What tells whether the volume, the function and their options are still the same (JSON)."""

    @abstractmethod
    def image(self) -> Any:
        """The volume, a ``vtkImageData``."""

    @abstractmethod
    def how(self) -> dict[str, Any]:
        """Arguments of :func:`svv.dvr.views.make_views`: ``tf``, and what it needs besides."""

    def make_views(self, folder: Path, options: ViewOptions, progress: Progress) -> ViewMeta:
        """Draw the views into a folder; see :func:`svv.dvr.views.make_views`.

        Returns:
            What the views say about how they were made.
        """
        from svv.dvr.views import make_views

        drawing, writing = part(progress, 0.0, 0.9), part(progress, 0.9, 1.0)
        train, unseen = make_views(self.image(), **self.how(), options=options, name=self.name, progress=drawing)
        train.write(folder, "train", part(writing, 0.0, 0.8))
        if unseen is not None:
            unseen.write(folder, "test", part(writing, 0.8, 1.0))
        return train.meta

    def truth(self, views: Path, cameras: Sequence[Camera], progress: Progress) -> NDArray[np.uint8]:
        """The volume as direct volume rendering shows it from other cameras than those of ``views``.

        Args:
            views: Folder of the views that were made, which say with which function, light and ray caster.
            cameras: All of one size.
            progress: Told after each view.

        Returns:
            (n, height, width, 4) uint8, straight alpha.

        Raises:
            BadInput: the views do not say how they were drawn.
        """
        from svv.dvr.transfer_functions import TransferFunction
        from svv.dvr.views import render_views

        meta = read_meta(views)
        tf, mapper = TransferFunction.from_dict(known(meta.tf, "tf")), known(meta.mapper, "mapper")
        return render_views(self.image(), tf, cameras, mapper, known(meta.shading, "shading"), progress=progress)


@dataclass(frozen=True)
class VolumeSource(Drawn):
    """A volume file and a transfer function; the rest as in :func:`svv.dvr.volumes.read_volume`."""

    volume: Path
    tf: Path | None = None
    """A JSON file; None for two ranges of the histogram."""
    dims: tuple[int, int, int] | None = None
    dtype: str | None = None
    spacing: tuple[float, float, float] | None = None
    array: str | None = None

    @property
    def name(self) -> str:
        """The file's."""
        return self.volume.name

    def identity(self) -> dict[str, Any]:
        """Files and options.

        Raises:
            BadInput: one of the files is missing.
        """
        files = [("volume", self.volume)] + ([("transfer function", self.tf)] if self.tf else [])
        for kind, path in files:
            if not path.exists():
                raise BadInput(f"There is no {kind} {path}; check the path.")
        return {
            "files": [fingerprint(path) for _, path in files] + [fingerprint(path) for path in _data_of(self.volume)],
            "options": [self.dims, self.dtype, self.spacing, self.array],
        }

    def image(self) -> Any:
        """Read the volume."""
        from svv.dvr.volumes import read_volume

        return read_volume(self.volume, self.dims, self.dtype, self.spacing, None, self.array)

    def how(self) -> dict[str, Any]:
        """The function's file."""
        return {"tf": self.tf}


def _data_of(header: Path) -> list[Path]:
    """The file that holds the voxels, where a header (.mhd, .nhdr) names one of its own."""
    if header.suffix.lower() not in (".mhd", ".nhdr"):
        return []
    named = re.search(
        r"^(?:ElementDataFile\s*=|data ?file:)\s*(\S.*?)\s*$", header.read_text("latin-1"), re.MULTILINE | re.IGNORECASE
    )
    data = header.parent / named[1] if named else header
    return [data] if data != header and data.is_file() else []


@dataclass(frozen=True)
class ViewSource:
    """A folder of views, ours or other people's."""

    folder: Path

    def identity(self) -> dict[str, Any]:
        """What tells whether the views are still the same.

        Raises:
            BadInput: the folder holds no training views, or an image that they name is not there.
        """
        if not (self.folder / "transforms_train.json").exists():
            raise BadInput(f"{self.folder} holds no views: there is no transforms_train.json.")
        splits = [split for split in ("train", "test") if (self.folder / f"transforms_{split}.json").exists()]
        files = [path for split in splits for path in files_of(self.folder, split)]
        files += [path for path in (self.folder / CLASSIFIED,) if path.exists()]
        return {"files": [[path.name, path] for path in files]}
