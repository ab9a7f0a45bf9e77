"""View sets: images with straight alpha and the cameras that took them, in the NeRF-synthetic layout.

On disk: ``transforms_<split>.json`` and a folder ``<split>`` of PNG files. The JSON file holds ``camera_angle_x``
(radians), one frame per image (``file_path`` without ``.png`` and ``transform_matrix``), and, in the sets that we
write, metadata under ``svv`` and, if the volume is known, the name of its ``classified.npz`` under ``svv_classified``.
Sets of other programs may say more, see :mod:`svv.io.views.transforms`.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera
from svv.core.json_values import parsed
from svv.core.volumes.classified import ALIKE, ClassifiedVolume, ValueGrid, ValueRange
from svv.errors import BadInput, Progress, is_lack_of_memory, part, silent
from svv.io.files.atomic import (
    atomic_path,
    cannot_write,
    is_file,
    make_folder,
    partial_folder,
    sync,
    sync_folder,
    to_json,
)
from svv.io.files.declared_sizes import arrays_of_npz
from svv.io.views.transforms import file_in, intrinsics_of, leaves, mask_files, names_of, present, read_transforms
from svv.io.views.view_images import Images, in_threads, read_views
from svv.io.views.view_meta import ViewMeta

PNG_LEVEL = 1
"""zlib level; level 6 takes five times as long and saves only a sixth of the bytes."""

MIN_TRAIN_VIEWS = 3
"""Minimum number of training views."""

CLASSIFIED = "classified.npz"
"""File name of the classified volume."""


@dataclass(frozen=True, eq=False)
class ViewSet:
    """Images of one scene and the cameras that took them.

    Args:
        cameras: One camera per image, with the size of the images.
        images: uint8 levels with straight alpha. (n, height, width, 4)
        names: File names without suffix, all different.
        meta: Metadata on how the images were made.
        classified: The classified volume; None if only the images are known.

    Raises:
        BadInput: There is no view, or counts, sizes or types do not match.

    >>> len(views), views.images.shape, views.cameras[0].width
    (24, (24, 56, 56, 4), 56)
    """

    cameras: tuple[Camera, ...]
    images: Images
    names: tuple[str, ...]
    meta: ViewMeta = field(default_factory=ViewMeta)
    classified: ClassifiedVolume | None = None

    def __post_init__(self) -> None:
        if self.images.ndim != 4 or self.images.shape[-1] != 4 or self.images.dtype != np.uint8:
            raise BadInput("The images of a view set must be an array (n, height, width, 4) of uint8.")
        n, height, width = self.images.shape[:3]
        if n == 0:
            raise BadInput("A view set needs at least one view.")
        if len(self.cameras) != n or len(self.names) != n or len(set(self.names)) != n:
            raise BadInput("A view set needs one camera and one unique name for each image.")
        if any((camera.width, camera.height) != (width, height) for camera in self.cameras):
            raise BadInput(f"All cameras of a view set must have the images' size, {width} x {height}.")

    def __len__(self) -> int:
        return len(self.cameras)

    def take(self, indices: Sequence[int]) -> ViewSet:
        """Return the views with these indices, in this order."""
        return ViewSet(
            tuple(self.cameras[i] for i in indices),
            self.images[list(indices)],
            tuple(self.names[i] for i in indices),
            self.meta,
            self.classified,
        )

    @classmethod
    def read(cls, folder: str | Path, split: str = "train", progress: Progress = silent) -> ViewSet:
        """Read ``transforms_<split>.json``, or ``transforms.json``, and its images (:mod:`svv.io.views.transforms`).

        Images without alpha take that of their masks. Without masks, if their corners all show one colour, pixels of
        that colour count as empty and all others as opaque; other images without alpha are rejected. Distorted images
        are undistorted. Images of the same shape but of different sizes, which their frames state, are reduced to the
        smallest. Frames whose pictures are missing are left out. ``meta.assumed`` says what was assumed or changed.

        Args:
            folder: Folder of the JSON file, or the file itself.
            split: ``train`` (at least 3 views), ``test`` or ``val``.
            progress: Called after each image.

        Raises:
            BadInput: Most pictures are missing, one is named twice or damaged, images differ in shape or have neither
                alpha nor a uniform background, a camera model is not supported, a matrix is not a rotation, there are
                too few views, or metadata is invalid.
        """
        path, scene, listed = read_transforms(folder, split)
        meta = ViewMeta.from_json(scene.get("svv"), f"{path}: svv")
        frames, missing = present(path, listed)
        if split == "train" and len(frames) < MIN_TRAIN_VIEWS:
            raise BadInput(f"{path} has {len(frames)} views; at least {MIN_TRAIN_VIEWS} are needed.")
        images, cameras, assumed = read_views(path, scene, frames, progress, f"Reading {split} views")
        if assumed or missing:
            meta = replace(meta, assumed=" ".join(filter(None, (meta.assumed, missing, assumed))))
        file = path.parent / CLASSIFIED
        classified = _read_classified(file) if scene.get("svv_classified") == CLASSIFIED and file.exists() else None
        return cls(cameras, images, names_of(frames), meta, classified)

    def write(self, folder: str | Path, split: str = "train", progress: Progress = silent) -> None:
        """Write the set; ``read`` returns it bit by bit.

        All files are first written to a temporary folder and moved into place at the end. A failure or a cancelled run
        leaves the previous files. While files are moved there is no JSON file, so that a killed run never leaves new
        images with old cameras.

        Args:
            folder: Target folder, created if it is missing.
            split: Name of the split, see ``read``.
            progress: Called after each image.

        Raises:
            BadInput: The folder cannot be written to, has such a split that svv did not write, or the disk is full.
        """
        target = make_folder(folder)
        _check_own(target / f"transforms_{split}.json")
        try:
            with partial_folder(target / split) as staging:
                jobs = [(staging / f"{name}.png", image) for name, image in zip(self.names, self.images)]
                for _ in in_threads(_encode, jobs, progress, f"Writing {split} views"):
                    pass
                if self.classified is not None:
                    _write_classified(staging / CLASSIFIED, self.classified)
                    sync(staging / CLASSIFIED)
                self._move_in(staging, target, split)
        except OSError as error:
            raise cannot_write(target, error) from error

    def _transforms(self, split: str) -> dict[str, object]:
        first = self.cameras[0]
        frames = []
        for name, camera in zip(self.names, self.cameras, strict=True):
            frame: dict[str, object] = {"file_path": f"./{split}/{name}"}
            if (camera.fov_x, camera.span_x) != (first.fov_x, first.span_x):
                frame |= {"camera_model": "PINHOLE"} if first.is_orthographic else {}
                frame |= intrinsics_of(camera)
            if camera.centre is not None:
                frame["cx"], frame["cy"] = camera.centre
            frame["transform_matrix"] = camera.camera_to_world.tolist()
            frames.append(frame)
        about = {"w": first.width, "h": first.height, "svv": self.meta.to_json()}
        if self.classified is not None:
            about["svv_classified"] = CLASSIFIED
        return {**intrinsics_of(first), **about, "frames": frames}

    def _move_in(self, staging: Path, target: Path, split: str) -> None:
        final = target / f"transforms_{split}.json"
        images = make_folder(target / split)
        stale = _own_files(final) - {images / f"{name}.png" for name in self.names}
        if self.classified is not None:
            stale.discard(target / CLASSIFIED)
        with atomic_path(final) as manifest:
            manifest.write_text(to_json(self._transforms(split), indent=1), encoding="utf-8")
            sync(manifest)
            if final.exists():
                final.unlink()
                sync_folder(target)
            for name in self.names:
                os.replace(staging / f"{name}.png", images / f"{name}.png")
            sync_folder(images)
            if self.classified is not None:
                os.replace(staging / CLASSIFIED, target / CLASSIFIED)
        for file in stale:
            file.unlink(missing_ok=True)


def write_splits(folder: str | Path, train: ViewSet, test: ViewSet | None, progress: Progress = silent) -> None:
    """Write training views, and test views if there are any; test views that svv wrote there before are removed.

    Raises BadInput as :meth:`ViewSet.write`.
    """
    target = Path(folder)
    check_splits(target)
    train.write(target, "train", part(progress, 0.0, 0.8))
    if test is not None:
        test.write(target, "test", part(progress, 0.8, 1.0))
        return
    final = target / "transforms_test.json"  # of other views: scores on them would mean nothing
    own = _own_files(final) - {target / CLASSIFIED}
    try:
        for file in (final, *own):
            file.unlink(missing_ok=True)
        if own:
            (target / "test").rmdir()
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):  # others' files stay
            raise cannot_write(target, error) from error


def check_splits(folder: Path) -> None:
    """Raise BadInput if :func:`write_splits` would overwrite views that svv did not write."""
    for split in ("train", "test"):
        _check_own(folder / f"transforms_{split}.json")


def _check_own(path: Path) -> None:
    try:
        ours = "svv" in parsed(path.read_bytes())
    except FileNotFoundError:
        return
    except (OSError, ValueError, TypeError):
        ours = False
    if not ours:
        raise BadInput(f"{path} lists views that svv did not write: choose another folder.")


def read_meta(folder: str | Path) -> ViewMeta:
    """Return the metadata of the training views in a folder; raises BadInput if there are none, or they are invalid."""
    path, scene, _ = read_transforms(folder, "train")
    return ViewMeta.from_json(scene.get("svv"), f"{path}: svv")


def read_classified(folder: str | Path) -> ClassifiedVolume | None:
    """Return the classified volume that a folder's training views name, if any; raises BadInput if it is damaged."""
    folder = Path(folder).parent if Path(folder).is_file() else Path(folder)
    file, views = folder / CLASSIFIED, folder / "transforms_train.json"
    if not (file.exists() and views.exists()):
        return None
    try:
        named = parsed(views.read_bytes()).get("svv_classified")
    except (OSError, ValueError, AttributeError) as error:
        raise BadInput(f"Cannot read {views} ({error}); make the views again.") from error
    return _read_classified(file) if named == CLASSIFIED else None


def _write_classified(file: Path, volume: ClassifiedVolume) -> None:
    low, size, extent = (np.array(part) for part in astuple(volume.box))
    ranges = np.array([(r.low, r.high, *r.colour) for r in volume.ranges])
    own = volume.values
    values: dict[str, Any] = {}
    if own is not None:
        numbers = np.array([*own.interval, *own.visible])
        values = {"value_cells": np.array(own.cells), "codes": own.codes, "counted": numbers, "integral": own.integral,
                  "edges": np.array(own.edges), "nearest": np.array(own.nearest)}  # fmt: skip
        values |= {} if own.colours is None else {"colours": own.colours}
    np.savez_compressed(
        file, low=low, size=size, extent=extent, cells=np.array(volume.cells), exponent=volume.exponent,
        owner=volume.owner, ranges=ranges, **values,
    )  # fmt: skip


def _read_classified(file: Path) -> ClassifiedVolume:
    names = ("low", "size", "extent", "cells", "exponent", "owner", "ranges")
    # Files from before the values were kept have none of these, and older ones no edges of voxels, colours or nearest.
    of_values = ("codes", "counted", "value_cells", "integral", "edges", "colours", "nearest")
    large = ("exponent", "owner", "codes")
    try:
        with file.open("rb") as opened:
            arrays = arrays_of_npz(opened, names, of_values, large, str(file))
        low, size, extent, cells, exponent, owner, values = (arrays[k] for k in names)
        grid = None
        if "codes" in arrays:
            start, stop, least, most = arrays["counted"].tolist()
            cells_of_values, own = int(arrays["value_cells"]), arrays["codes"]
            edges = tuple(map(tuple, arrays["edges"].tolist())) if "edges" in arrays else ALIKE
            counted, shown = ((start, stop), (least, most)), arrays.get("colours")
            jumps = bool(arrays.get("nearest", False))
            grid = ValueGrid(cells_of_values, own, *counted, arrays["integral"], edges, shown, jumps)
        box = Box(tuple(low.tolist()), float(size), tuple(extent.tolist()))
        ranges = tuple(ValueRange(start, stop, tuple(colour)) for start, stop, *colour in values.tolist())
        return ClassifiedVolume(box, int(cells), exponent, owner, ranges, grid)
    except Exception as error:  # a damaged archive makes NumPy and zipfile raise all kinds of errors
        if is_lack_of_memory(error):
            raise
        what = "make the views again, or delete it to learn from them alone"
        raise BadInput(f"Cannot read {file} ({str(error).rstrip('.')}); {what}.") from error


def _own_files(path: Path) -> set[Path]:
    """Return the images and the classified volume of an existing set if it is ours; other sets are left alone.

    A set of someone else may name any files: those outside its folder are not ours, either.
    """
    try:
        scene = parsed(path.read_bytes())
        frames = scene["frames"] if "svv" in scene else []
        names = [str(frame["file_path"]) for frame in frames]
        own = {CLASSIFIED} if scene.get("svv_classified") == CLASSIFIED else set()
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return set()
    folder = path.parent.resolve()
    files = {path.parent / name for name in {*(f"{name}.png" for name in names if not leaves(name)), *own}}
    return {file for file in files if is_file(file) and folder in file.resolve().parents}


def files_of(folder: Path, split: str) -> list[Path]:
    """Return the files of a split, first the JSON file, then images; raises BadInput if one is missing or invalid."""
    path, _, listed = read_transforms(folder, split)
    frames, _ = present(path, listed)
    return [path, *(file_in(path, frame) for frame in frames), *(mask_files(path, frames) or [])]


def _encode(job: tuple[Path, Images]) -> None:
    path, image = job
    try:
        Image.fromarray(image).save(path, compress_level=PNG_LEVEL)
        sync(path)
    except OSError as error:
        raise cannot_write(path, error) from error
