"""Sources of a job's views: a volume and its transfer function, or a folder of views."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.bricks.opened import data_files
from svv.core.geometry.cameras import Camera
from svv.core.sharing import ALONE, Sharing
from svv.errors import BadInput, Progress, part, silent
from svv.io.cinema.table import read_table
from svv.io.cinema.views import read_database
from svv.io.files.keyed_results import digest, key_of
from svv.io.views.drawn_views import DrawnViews
from svv.io.views.transforms import transforms_file
from svv.io.views.view_meta import ViewMeta, known
from svv.io.views.viewset import CLASSIFIED, ViewSet, check_splits, files_of, read_meta, write_splits
from svv.job.stages import fingerprint
from svv.options.described import chosen
from svv.options.making import ViewOptions

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkImageData

    from svv.dvr.draw.large import LargeVolume

    Volume = vtkImageData | LargeVolume


class Drawn(ABC):
    """A volume and its transfer function, from which views are drawn."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name of the volume, for the record."""

    @abstractmethod
    def identity(self) -> dict[str, object]:
        """Identify the volume, the transfer function and their options, to detect changes (JSON)."""

    @abstractmethod
    def image(self, mapper: str = "cpu", memory: float | None = None, progress: Progress = silent) -> Volume:
        """Return the volume, a ``vtkImageData``, or a large one to be drawn by bricks (:mod:`svv.dvr.draw.large`)."""

    @abstractmethod
    def how(self) -> dict[str, Any]:
        """Return arguments of :func:`svv.dvr.draw.views.make_views`: ``tf``, and others that the source requires."""

    def make_views(self, folder: Path, options: ViewOptions, progress: Progress, sharing: Sharing = ALONE) -> ViewMeta:
        """Draw the views into a folder, a kept one at a time (:class:`DrawnViews`), and return their metadata."""
        check_splits(folder)  # before the work, not after it
        drawing, writing = part(progress, 0.0, 0.9), part(progress, 0.9, 1.0)
        kept = DrawnViews(folder / ".drawing", key_of("views", self.identity(), chosen(options)), sharing)
        train, unseen = self.draw(options, drawing, kept)
        if sharing.is_first:
            write_splits(folder, train, unseen, writing)
            kept.clear()
        return train.meta

    def draw(self, options: ViewOptions, progress: Progress, kept: DrawnViews) -> tuple[ViewSet, ViewSet | None]:
        """Draw the training and test views; see :func:`svv.dvr.draw.views.make_views`."""
        from svv.dvr.draw.views import make_views

        reading, drawing = part(progress, 0.0, 0.3), part(progress, 0.3, 1.0)
        found: list[Volume] = []
        # One process first, because it may have to make a pyramid.
        kept.sharing.once(lambda: found.append(self.image(options.mapper, options.memory, reading)))
        volume = found[0] if found else self.image(options.mapper, options.memory)
        return make_views(volume, **self.how(), options=options, name=self.name, kept=kept, progress=drawing)

    def truth(self, views: Path, cameras: Sequence[Camera], progress: Progress) -> NDArray[np.uint8]:
        """Render the volume from cameras of one image size as views in a folder were drawn. (n, height, width, 4) uint8

        Alpha is straight. Raises BadInput if the metadata do not say how the views were drawn.
        """
        return self.render(read_meta(views), cameras, progress)

    def render(self, meta: ViewMeta, cameras: Sequence[Camera], progress: Progress) -> NDArray[np.uint8]:
        """Render the volume as views with these metadata were drawn; see :func:`svv.dvr.draw.views.render_views`."""
        from svv.dvr.draw.views import render_views
        from svv.dvr.functions.transfer_functions import TransferFunction

        tf, mapper = TransferFunction.from_dict(known(meta.tf, "tf")), known(meta.mapper, "mapper")
        # A volume that fits into memory was drawn by bricks from there.
        volume = self.image("auto" if mapper == "bricks" else mapper)
        return render_views(volume, tf, cameras, mapper, known(meta.shading, "shading"), progress=progress)


READ = ("dims", "dtype", "spacing", "array", "channel", "time", "resample_to")
"""Fields of :class:`VolumeSource` that say how its file is read."""


@dataclass(frozen=True)
class VolumeSource(Drawn):
    """A volume file and a transfer function; other fields as in :func:`svv.dvr.read.volumes.read_volume`."""

    volume: Path
    tf: Path | None = None
    """Transfer function, a file, one of several in a file, or a colour map
    (:meth:`svv.dvr.functions.transfer_functions.TransferFunction.read`); None derives two ranges from the histogram."""
    dims: tuple[int, int, int] | None = None
    dtype: str | None = None
    spacing: tuple[float, float, float] | None = None
    array: str | None = None
    channel: str | None = None
    time: int | None = None
    resample_to: int | None = None
    rescale: bool | None = None
    """Whether to stretch the function over the data; see
    :meth:`svv.dvr.functions.transfer_functions.TransferFunction.fitted`."""
    nearest: bool = False
    """Whether to show each voxel's own value, without interpolation."""

    @property
    def name(self) -> str:
        """Name of the volume file."""
        return self.volume.name

    def identity(self) -> dict[str, object]:
        """Identify the files and options; raises BadInput if a file is missing."""
        from svv.dvr.functions.named import file_and_name

        file, named = (None, None) if self.tf is None else file_and_name(self.tf)
        files = [("volume", self.volume)] + ([("transfer function", file)] if file else [])
        for kind, path in files:
            if not path.exists():
                raise BadInput(f"There is no {kind} {path}; check the path.")
        # Not in the keys of volumes that have none of them: what was made of these stays.
        chosen = self.channel, self.time, self.resample_to, self.rescale
        return {
            "files": [fingerprint(path) for _, path in files] + [fingerprint(path) for path in data_files(self.volume)],
            "options": [
                self.dims,
                self.dtype,
                self.spacing,
                self.array,
                *(chosen if any(one is not None for one in chosen) else ()),
                *(["nearest"] if self.nearest else ()),
                *([] if named is None else [named, self._colour_map() if file is None else None]),
            ],
        }

    def _colour_map(self) -> dict[str, object]:
        """Return the colour map that the transfer function is."""
        from svv.dvr.functions.transfer_functions import TransferFunction

        assert self.tf is not None
        return TransferFunction.read(self.tf).to_dict()

    def image(self, mapper: str = "cpu", memory: float | None = None, progress: Progress = silent) -> Volume:
        """Read the volume, or open it to be drawn by bricks."""
        from svv.dvr.draw.large import open_volume

        return open_volume(
            self.volume, self.dims, self.dtype, self.spacing, self.array, mapper, memory, progress,
            self.channel, self.time, self.resample_to, self.nearest,
        )  # fmt: skip

    def how(self) -> dict[str, Any]:
        """Return the file of the transfer function, and how it is fitted to the data."""
        return {"tf": self.tf, "rescale": self.rescale}

    def draw(self, options: ViewOptions, progress: Progress, kept: DrawnViews) -> tuple[ViewSet, ViewSet | None]:
        """Draw the views, whose metadata also say how the file was read."""
        train, unseen = super().draw(options, progress, kept)
        how = {name: value for name in READ if (value := getattr(self, name)) is not None}
        file = {"content": content_of(self.volume), **how}
        train = replace(train, meta=replace(train.meta, file=file))
        return train, None if unseen is None else replace(unseen, meta=train.meta)


@dataclass(frozen=True)
class ViewSource:
    """A folder of views, drawn by this package or by another program."""

    folder: Path

    def identity(self) -> dict[str, object]:
        """Identify the views, to detect changes; raises BadInput if none are for training, or an image is missing."""
        if transforms_file(self.folder, "train") is None:
            raise BadInput(f"{self.folder} holds no views: there is no transforms_train.json or transforms.json.")
        splits = [split for split in ("train", "test") if transforms_file(self.folder, split) is not None]
        files = [path for split in splits for path in files_of(self.folder, split)]
        files += [path for path in (self.folder / CLASSIFIED,) if path.exists()]
        return {"files": [[path.name, path] for path in files]}


def content_of(volume: Path) -> str:
    """Return a hash by which a volume's file is known again, wherever it is; raises BadInput if it is unreadable.

    A folder, and a file of more than a gigabyte, are known by the sizes and times of files instead.
    """
    told = [fingerprint(file) for file in (volume, *data_files(volume))]
    return digest([{key: value for key, value in one.items() if key != "name"} for one in told])


def imported_views(database: Path, folder: Path, progress: Progress) -> Path:
    """Return a Cinema database's folder of views, made anew only if it changed; raises BadInput as `read_database`."""
    if transforms_file(folder, "train") is not None:
        known_as = read_meta(folder).other.get("cinema")
        if isinstance(known_as, dict) and known_as.get("key") == read_table(database).key():
            return folder
    read_database(database, None, part(progress, 0.0, 0.7)).write(folder, part(progress, 0.7, 1.0))
    return folder
