"""View sets: images with straight alpha and the cameras that took them, in the NeRF-synthetic layout.

On disk: ``transforms_<split>.json`` and a folder ``<split>`` of PNG files. The JSON file holds
``camera_angle_x`` (radians), one frame per image (``file_path`` without ``.png`` and ``transform_matrix``),
and, in the sets that we write, metadata under the key ``svv``. If the volume is known, ``classified.npz`` in the same
folder contains the volume classified by its transfer function; the key ``svv_classified`` names it, and it is optional.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import threading
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.core.box import Box
from svv.core.cameras import Camera
from svv.core.classified import ClassifiedVolume, ValueRange
from svv.errors import BadInput, Progress, silent
from svv.io.atomic import atomic_path, cannot_write, make_folder, to_json
from svv.io.view_meta import ViewMeta

Images = NDArray[np.uint8]
Item = TypeVar("Item")
Result = TypeVar("Result")

SUFFIXES = ("", ".png", ".PNG", ".jpg", ".jpeg", ".tif", ".tiff")
"""Suffixes that ``file_path`` may lack; NeRF-synthetic sets omit ``.png``."""

PNG_LEVEL = 1
"""zlib level; level 6 takes five times as long and saves only a sixth of the bytes."""

CORNER_SPREAD = 16
"""Levels by which corner pixels may differ and still count as one background colour (JPEG noise)."""

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
        """Read ``transforms_<split>.json`` and its images.

        If images have no alpha but their corners all show one colour, pixels of that colour count as empty and all
        others as opaque, and ``meta.assumed`` says so; other images without alpha are rejected.

        Args:
            folder: Folder of the JSON file.
            split: ``train`` (at least 3 views), ``test`` or ``val``.
            progress: Called after each image.

        Raises:
            BadInput: A file is missing or damaged, images differ in size or have neither alpha nor a uniform
                background, a matrix is not a rotation, there are too few views, or metadata is invalid.
        """
        path = Path(folder) / f"transforms_{split}.json"
        scene, frames = _read_transforms(path)
        meta = ViewMeta.from_json(scene.get("svv"), f"{path}: svv")
        if split == "train" and len(frames) < MIN_TRAIN_VIEWS:
            raise BadInput(f"{path} has {len(frames)} views; at least {MIN_TRAIN_VIEWS} are needed.")
        files = [_image_file(path, frame) for frame in frames]
        decoded = list(_in_threads(_decode, files, progress, f"Reading {split} views"))
        height, width = decoded[0].shape[:2]
        for file, image in zip(files, decoded, strict=True):
            if image.shape[:2] != (height, width):
                raise BadInput(
                    f"All images of a set must have the same size, but {files[0].name} has {width} x {height} "
                    f"and {file} has {image.shape[1]} x {image.shape[0]} pixels."
                )
        images, assumed = _with_alpha(decoded, files)
        if assumed:
            meta = replace(meta, assumed=assumed)
        cameras = tuple(_camera(path, scene, frame, width, height) for frame in frames)
        file = path.parent / CLASSIFIED
        classified = _read_classified(file) if scene.get("svv_classified") == CLASSIFIED and file.exists() else None
        return cls(cameras, images, _names(frames), meta, classified)

    def write(self, folder: str | Path, split: str = "train", progress: Progress = silent) -> None:
        """Write the set; ``read`` returns it bit by bit.

        All files are first written to a temporary folder and moved into place at the end, the JSON file last, so a
        failure or a cancelled run leaves the previous files.

        Args:
            folder: Target folder, created if it is missing.
            split: Name of the split, see ``read``.
            progress: Called after each image.

        Raises:
            BadInput: The folder cannot be written to, or the disk is full.
        """
        target = make_folder(folder)
        try:
            staging = Path(tempfile.mkdtemp(prefix=f".{split}-", dir=target))
        except OSError as error:
            raise cannot_write(target, error) from error
        try:
            jobs = [(staging / f"{name}.png", image) for name, image in zip(self.names, self.images)]
            for _ in _in_threads(_encode, jobs, progress, f"Writing {split} views"):
                pass
            if self.classified is not None:
                _write_classified(staging / CLASSIFIED, self.classified)
            self._move_in(staging, target, split)
        finally:
            shutil.rmtree(staging, ignore_errors=True)

    def _transforms(self, split: str) -> dict[str, Any]:
        first = self.cameras[0]
        frames = []
        for name, camera in zip(self.names, self.cameras, strict=True):
            frame: dict[str, Any] = {"file_path": f"./{split}/{name}"}
            if camera.fov_x != first.fov_x:
                frame["camera_angle_x"] = camera.fov_x
            frame["transform_matrix"] = camera.camera_to_world.tolist()
            frames.append(frame)
        about = {"w": first.width, "h": first.height, "svv": self.meta.to_json()}
        if self.classified is not None:
            about["svv_classified"] = CLASSIFIED
        return {"camera_angle_x": first.fov_x, **about, "frames": frames}

    def _move_in(self, staging: Path, target: Path, split: str) -> None:
        final = target / f"transforms_{split}.json"
        images = make_folder(target / split)
        stale = _own_files(final) - {images / f"{name}.png" for name in self.names}
        if self.classified is not None:
            stale.discard(target / CLASSIFIED)
        with atomic_path(final) as manifest:
            manifest.write_text(to_json(self._transforms(split), indent=1), encoding="utf-8")
            for name in self.names:
                os.replace(staging / f"{name}.png", images / f"{name}.png")
            if self.classified is not None:
                os.replace(staging / CLASSIFIED, target / CLASSIFIED)
        for file in stale:
            file.unlink(missing_ok=True)


def read_meta(folder: str | Path) -> ViewMeta:
    """Return the metadata of the training views in a folder.

    Raises:
        BadInput: There are no training views, or the metadata is invalid.
    """
    path = Path(folder) / "transforms_train.json"
    return ViewMeta.from_json(_read_transforms(path)[0].get("svv"), f"{path}: svv")


def read_classified(folder: str | Path) -> ClassifiedVolume | None:
    """Return the classified volume that the training views in a folder name, or None if there is none.

    Raises:
        BadInput: The file is damaged.
    """
    file, views = Path(folder) / CLASSIFIED, Path(folder) / "transforms_train.json"
    if not (file.exists() and views.exists()):
        return None
    try:
        named = json.loads(views.read_text(encoding="utf-8")).get("svv_classified")
    except (OSError, ValueError, AttributeError) as error:
        raise BadInput(f"Cannot read {views} ({error}); make the views again.") from error
    return _read_classified(file) if named == CLASSIFIED else None


def _write_classified(file: Path, volume: ClassifiedVolume) -> None:
    low, size, extent = (np.array(part) for part in astuple(volume.box))
    ranges = np.array([(r.low, r.high, *r.colour) for r in volume.ranges])
    np.savez_compressed(
        file, low=low, size=size, extent=extent, cells=np.array(volume.cells), exponent=volume.exponent,
        owner=volume.owner, ranges=ranges,
    )  # fmt: skip


def _read_classified(file: Path) -> ClassifiedVolume:
    names = ("low", "size", "extent", "cells", "exponent", "owner", "ranges")
    try:
        # NumPy would leave a damaged file open.
        with file.open("rb") as opened, np.load(opened, allow_pickle=False) as arrays:
            low, size, extent, cells, exponent, owner, values = (arrays[k] for k in names)
        box = Box(tuple(low.tolist()), float(size), tuple(extent.tolist()))
        ranges = tuple(ValueRange(start, stop, tuple(colour)) for start, stop, *colour in values.tolist())
        return ClassifiedVolume(box, int(cells), exponent, owner, ranges)
    except (BadInput, OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        what = "make the views again, or delete it to learn from them alone"
        raise BadInput(f"Cannot read {file} ({str(error).rstrip('.')}); {what}.") from error


def _own_files(path: Path) -> set[Path]:
    """Return the images and the classified volume of an existing set if it is ours; other sets are left alone."""
    try:
        scene = json.loads(path.read_text())
        frames = scene["frames"] if "svv" in scene else []
        files = {path.parent / f"{frame['file_path']}.png" for frame in frames}
        return files | {path.parent / CLASSIFIED} if scene.get("svv_classified") == CLASSIFIED else files
    except (OSError, ValueError, KeyError, TypeError):
        return set()


def files_of(folder: Path, split: str) -> list[Path]:
    """Return the files from which the views of a split are read: first the JSON file, then the images.

    Raises:
        BadInput: The JSON file or an image is missing, or the JSON file is invalid.
    """
    path = folder / f"transforms_{split}.json"
    _, frames = _read_transforms(path)
    return [path, *(_image_file(path, frame) for frame in frames)]


def _read_transforms(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    try:
        scene = json.loads(path.read_text())
    except FileNotFoundError:
        raise BadInput(f"There is no {path}; a folder of views needs one (NeRF-synthetic layout).") from None
    except OSError as error:
        raise BadInput(f"Cannot read {path}: {error.strerror or error}.") from error
    except ValueError as error:
        raise BadInput(f"{path} is not valid JSON ({error}); write the views again.") from error
    frames = scene.get("frames") if isinstance(scene, dict) else None
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise BadInput(f"{path} has no list of frames; it must follow the NeRF-synthetic layout.")
    if not frames:
        raise BadInput(f"{path} has no views.")
    return scene, frames


def _image_file(path: Path, frame: dict[str, Any]) -> Path:
    name = frame.get("file_path")
    if not isinstance(name, str) or not name:
        raise BadInput(f"{path} has a frame without file_path.")
    for suffix in SUFFIXES:
        file = path.parent / (name + suffix)
        if file.is_file():
            return file
    raise BadInput(f"{path} names the image {name}, but there is no such file (with or without .png).")


def _camera(path: Path, scene: dict[str, Any], frame: dict[str, Any], width: int, height: int) -> Camera:
    angle = frame.get("camera_angle_x", scene.get("camera_angle_x"))
    try:
        matrix = np.array(frame.get("transform_matrix"), dtype=np.float64)
        fov_x = float(angle)  # type: ignore[arg-type]  # None or text is an error in the file, reported below
    except (TypeError, ValueError):
        raise BadInput(
            f"{path}, frame {frame['file_path']}: camera_angle_x must be a number of radians and "
            "transform_matrix a 4x4 matrix of numbers."
        ) from None
    try:
        return Camera(matrix, fov_x, width, height)
    except BadInput as error:
        raise BadInput(f"{path}, frame {frame['file_path']}: {error}") from None


def _names(frames: list[dict[str, Any]]) -> tuple[str, ...]:
    """Return the file stems, or the whole paths with _ for / if frames in different folders share a stem."""
    paths = [str(frame["file_path"]).removeprefix("./").replace("\\", "/") for frame in frames]
    bare = [p[: p.rfind(".")] if p.lower().endswith(SUFFIXES[1:]) else p for p in paths]
    stems = [p.rsplit("/", 1)[-1] for p in bare]
    if len(set(stems)) == len(stems):
        return tuple(stems)
    return tuple(p.replace("/", "_") for p in bare)


def _decode(file: Path) -> Images:
    """Return uint8 levels: (h, w, 4) with straight alpha, or (h, w, 3) if the file has no alpha."""
    try:
        with Image.open(file) as image:
            if image.mode.startswith("I") or image.mode == "F":  # PIL would clip instead of scale
                raise BadInput(f"{file} is a greyscale image of more than 8 bits; views must be 8-bit RGBA.")
            alpha = "A" in image.getbands() or "transparency" in image.info
            return np.asarray(image.convert("RGBA" if alpha else "RGB"))
    except BadInput:
        raise
    except (OSError, SyntaxError, ValueError, EOFError, Image.DecompressionBombError) as error:
        raise BadInput(f"Cannot read the image {file} ({error}); it is truncated or not an image.") from error


def _with_alpha(decoded: list[Images], files: list[Path]) -> tuple[Images, str | None]:
    channels = [image.shape[-1] for image in decoded]
    if min(channels) == 4:
        return np.stack(decoded), None
    if max(channels) == 4:
        with_, without = files[channels.index(4)], files[channels.index(3)]
        raise BadInput(f"{with_.name} has alpha and {without} does not; all images of a view set need alpha.")
    colours = np.stack(decoded)  # (n, h, w, 3)
    edge = max(1, min(colours.shape[1:3]) // 50)
    ends = [*range(edge), *range(-edge, 0)]
    corners = colours[:, ends][:, :, ends].reshape(-1, 3)
    background = np.median(corners, axis=0).astype(np.int16)
    spread = int(np.abs(corners.astype(np.int16) - background).max())
    if spread > CORNER_SPREAD:
        raise BadInput(
            f"The images of {files[0].parent} have no alpha, and their corners show no uniform background "
            "to replace it; save them as RGBA with straight alpha."
        )
    images = np.empty((*colours.shape[:3], 4), np.uint8)
    images[..., :3] = colours
    for image in images:
        difference = np.abs(image[..., :3].astype(np.int16) - background).max(axis=-1)
        image[..., 3] = np.where(difference <= max(2, spread), 0, 255)
    colour = ", ".join(str(int(c)) for c in background)
    return images, (
        f"The images have no alpha: pixels of the background colour ({colour}) count as empty, all others as opaque."
    )


def _encode(job: tuple[Path, Images]) -> None:
    path, image = job
    try:
        Image.fromarray(image).save(path, compress_level=PNG_LEVEL)
    except OSError as error:
        raise cannot_write(path, error) from error


def _in_threads(
    work: Callable[[Item], Result], items: Sequence[Item], progress: Progress, label: str
) -> Iterator[Result]:
    """Yield the results in order; the pool stops at the first error and when ``progress`` raises."""
    stop = threading.Event()

    def guarded(item: Item) -> Result | None:
        return None if stop.is_set() else work(item)

    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        try:
            for done, result in enumerate(pool.map(guarded, items), start=1):
                yield result  # type: ignore[misc]  # None only after stop, when results are no longer read
                progress(done / len(items), label)
        finally:
            stop.set()
