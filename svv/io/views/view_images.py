"""Images of a view set: decoded, given alpha where they have none, rectified, and all of one size."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.core.geometry.cameras import Camera
from svv.core.images.blank import blank, draw_into
from svv.errors import BadInput, Progress
from svv.io.files.declared_sizes import check_pixels
from svv.io.pictures.gamma import as_srgb, converted, exponent_of, stored
from svv.io.views.lenses import Lens, rectify
from svv.io.views.straight import ALPHAS, BESIDE_FRAMES, AlphaName, straightened
from svv.io.views.transforms import Frame, camera_in, file_in, mask_files

Images = NDArray[np.uint8]
Item = TypeVar("Item")
Result = TypeVar("Result")

CORNER_SPREAD = 16
"""Levels by which corner pixels may differ and still count as one background colour (JPEG noise)."""

LINEAR = (
    "{count} of the {all} images are linear, or of another power of light than sRGB, by their gAMA chunk: they were "
    "converted to sRGB."
)
RECTIFIED = "Lens distortion and pixels that are not square were removed from {count} of the {all} images."
RESIZED = "The images differ in size, so all were reduced to {width} x {height} pixels."


def read_views(
    path: Path, scene: Frame, frames: Sequence[dict[str, object]], progress: Progress, label: str
) -> tuple[Images, tuple[Camera, ...], str | None]:
    """Read the images and cameras of frames of a file ``transforms.json`` with the content ``scene``.

    Returns images with straight alpha (n, height, width, 4), their cameras, and what was assumed or changed, in
    sentences. Raises BadInput if a file is missing or damaged, images have neither alpha nor a mask nor a uniform
    background or differ in shape, or a camera is invalid or not supported.
    """
    files, masks = [file_in(path, frame) for frame in frames], mask_files(path, frames)
    of: Sequence[Path | None] = masks or [None] * len(files)
    jobs = list(zip(files, of, strict=True))
    whole = _Whole(len(jobs))
    numbered = list(enumerate(jobs))
    powers: list[float | None] = [None] * len(jobs)

    def read(job: tuple[int, tuple[Path, Path | None]]) -> Images:
        image, powers[job[0]] = _masked(*job[1])
        return whole.put(job[0], image)

    decoded = list(in_threads(read, numbered, progress, label))
    exponent = powers[0] if len(set(powers)) == 1 else None
    images, assumed = with_alpha(decoded, files, _alpha_of(path, scene), exponent=exponent)
    taken = [
        camera_in(path, scene, frame, image.shape[1], image.shape[0])
        for frame, image in zip(frames, images, strict=True)
    ]
    cameras, lenses = [camera for camera, _ in taken], [lens for _, lens in taken]
    linear = len(powers) - powers.count(None)
    notes = [LINEAR.format(count=linear, all=len(powers))] if linear else []
    notes += [] if assumed is None else [assumed]
    bent = sum(lens is not None for lens in lenses)
    if bent:
        images = list(in_threads(_rectified, list(zip(images, lenses, strict=True)), progress, "Undistorting views"))
        notes.append(RECTIFIED.format(count=bent, all=len(images)))
    if len({image.shape for image in images}) > 1:
        stated = all("w" in frame and "h" in frame for frame in frames)
        images, cameras = _of_one_size(images, cameras, files, stated)
        notes.append(RESIZED.format(width=cameras[0].width, height=cameras[0].height))
    return whole.of(images), tuple(cameras), " ".join(notes) or None


class _Whole:
    """An array of all images, into which each is decoded: images and their array together would take twice the memory.

    Only images of one size with alpha fit; others stay what they are.
    """

    def __init__(self, count: int) -> None:
        self._count, self._array = count, np.empty(0, np.uint8)
        self._lock = threading.Lock()

    def put(self, number: int, image: Images) -> Images:
        """Return the image in its place in the array if it fits there."""
        with self._lock:
            if not self._array.size and image.shape[-1] == 4:
                self._array = blank((self._count, *image.shape))
        if image.shape != self._array.shape[1:]:
            return image
        draw_into(self._array[number], image)
        return np.asarray(self._array[number])

    def of(self, images: Sequence[Images]) -> Images:
        """Return the array if all images are still in their places, otherwise a new one. (n, h, w, 4)"""
        return self._array if all(image.base is self._array for image in images) else np.stack(images)


def _alpha_of(path: Path, scene: Frame) -> AlphaName | None:
    """Return what a file says about alpha; ours is straight. BadInput is raised if it says something else."""
    given = scene.get("alpha", "straight" if "svv" in scene else None)
    if given is not None and given not in ALPHAS:
        raise BadInput(f'{path}: alpha must be "straight" or "premultiplied", not {given!r}; or leave it out.')
    return given


def _masked(file: Path, mask: Path | None) -> tuple[Images, float | None]:
    """Decode an image as :func:`decode_as_srgb`; if it has no alpha, its mask is its alpha."""
    image, exponent = decode_as_srgb(file)
    if mask is None or image.shape[-1] == 4:
        return image, exponent
    alpha = decode(mask)
    if alpha.shape[:2] != image.shape[:2]:
        raise BadInput(
            f"The mask {mask} has {alpha.shape[1]} x {alpha.shape[0]} pixels and its image {file.name} "
            f"{image.shape[1]} x {image.shape[0]}; make them the same size."
        )
    # Some programs store masks as an alpha channel.
    return np.dstack([image, alpha[..., 3] if alpha.shape[-1] == 4 else alpha.max(axis=-1)]), exponent


def _rectified(job: tuple[Images, Lens | None]) -> Images:
    image, lens = job
    return image if lens is None else rectify(image, lens)


def _of_one_size(
    images: Sequence[Images], cameras: Sequence[Camera], files: Sequence[Path], stated: bool
) -> tuple[list[Images], list[Camera]]:
    """Reduce images to the smallest's size.

    Raises BadInput if shapes differ, or frames do not state each one's size.
    """
    height, width = min(image.shape[:2] for image in images)
    for file, image in zip(files, images, strict=True):
        apart = abs(image.shape[0] * width - height * image.shape[1])
        if image.shape[:2] != (height, width) and (not stated or apart > max(image.shape[1], width)):
            why = "the same shape" if stated else "the same size, unless each frame states its own w and h"
            raise BadInput(
                f"All images of a set must have {why}, but one has {width} x {height} "
                f"and {file} has {image.shape[1]} x {image.shape[0]} pixels."
            )
    reduced = [
        image if image.shape[:2] == (height, width)
        else np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BOX))  # weighted by alpha
        for image in images
    ]  # fmt: skip
    return reduced, [camera.resized(width, height) for camera in cameras]


def decode(file: Path) -> Images:
    """Return uint8 levels as stored: (h, w, 4) with the file's alpha, or (h, w, 3) if it has none."""
    return _decoded(file, False)[0]


def decode_as_srgb(file: Path) -> tuple[Images, float | None]:
    """Return levels as :func:`decode`, in sRGB, and the other power of light, if any, that was stored."""
    return _decoded(file, True)


def _decoded(file: Path, srgb: bool) -> tuple[Images, float | None]:
    try:
        with Image.open(file) as image:
            check_pixels(file, *image.size)
            if image.mode.startswith("I") or image.mode == "F":  # PIL would clip instead of scale
                raise BadInput(f"{file} is a greyscale image of more than 8 bits; views must be 8-bit RGBA.")
            alpha = "A" in image.getbands() or "transparency" in image.info
            exponent = exponent_of(image) if srgb else None
            if exponent is not None:
                return np.asarray(converted(file, image, exponent).convert("RGBA" if alpha else "RGB")), exponent
            return np.asarray(image.convert("RGBA" if alpha else "RGB")), None
    except BadInput:
        raise
    except Exception as error:  # damaged files make Pillow raise all kinds of errors
        raise BadInput(f"Cannot read the image {file} ({error}); it is truncated or not an image.") from error


def with_alpha(
    decoded: list[Images],
    files: list[Path],
    given: AlphaName | None = None,
    how: str = BESIDE_FRAMES,
    exponent: float | None = None,
) -> tuple[list[Images], str | None]:
    """Return RGBA images with straight alpha, and a sentence that says what was taken for alpha, or about theirs.

    ``given`` says whether colours are multiplied by alpha and ``how`` the user says so (:mod:`svv.io.views.straight`),
    ``exponent`` of which power of light they were.

    Alpha that is 255 in every pixel of every image, as viewers and renderers save opaque pictures, is none.
    """
    opaque = all(image.shape[-1] == 4 and image[..., 3].min() == 255 for image in decoded)
    if opaque:
        decoded = [image[..., :3] for image in decoded]
    lack = "no alpha but 255 everywhere" if opaque else "no alpha"
    channels = [image.shape[-1] for image in decoded]
    if min(channels) == 4:
        levels = np.arange(256) / 255.0
        encoded = np.rint(255.0 * (levels if exponent is None else as_srgb(levels, exponent))).astype(np.uint8)
        return straightened(decoded, given, how, stored(exponent), encoded)
    if max(channels) == 4:
        with_, without = files[channels.index(4)], files[channels.index(3)]
        raise BadInput(f"{with_.name} has alpha and {without} does not; all images of a view set need alpha.")
    corners = np.stack([_corners(image) for image in decoded])  # (images, 4, pixels, 3)
    background = np.median(corners.reshape(-1, 3), axis=0).astype(np.int16)
    apart = np.abs(corners.astype(np.int16) - background).max(axis=(0, 2, 3))
    # A logo or a caption may fill one corner.
    spread = int(np.sort(apart)[-2])
    spread = int(apart.max()) if apart.max() <= CORNER_SPREAD else spread
    if spread > CORNER_SPREAD:
        raise BadInput(
            f"The images of {files[0].parent} have {lack}, and their corners show no uniform background "
            "to replace it; save them as RGBA with straight alpha, or give each frame a mask_path."
        )
    images = []
    for image in decoded:
        difference = np.abs(image.astype(np.int16) - background).max(axis=-1)
        images.append(np.dstack([image, np.where(difference <= max(2, spread), 0, 255).astype(np.uint8)]))
    colour = ", ".join(str(int(c)) for c in background)
    return images, (
        f"The images have {lack}: pixels of the background colour ({colour}) count as empty, all others as opaque."
    )


def _corners(image: Images) -> Images:
    """Return the pixels of the four corners. (4, pixels, 3)"""
    edge = max(1, min(image.shape[:2]) // 50)
    ends = slice(None, edge), slice(-edge, None)
    return np.stack([image[rows, columns].reshape(-1, 3) for rows in ends for columns in ends])


def in_threads(
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
