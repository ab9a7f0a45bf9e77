"""Whether colours of views are multiplied by alpha, and their division by it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Images = NDArray[np.uint8]
AlphaName = Literal["straight", "premultiplied"]

ALPHAS: tuple[AlphaName, ...] = ("straight", "premultiplied")
"""What a file of views may say about its images under the key ``alpha``."""

FEW, EXCEPTIONS = 50, 0.01
"""Translucent pixels that tell enough, and the fraction of them that may be noise."""

GROWS, SPREAD = 0.5, 0.05
"""Power of alpha with which colours must grow to be multiplied by it, and the least deviation of alpha's logarithm that
tells a power."""

LEAST_ALPHA = 1 << 24
"""A pixel as a number, if its alpha is 1 and it is black."""

DIVIDED = (
    "No translucent pixel is brighter than its alpha, and colours grow with alpha, so they were taken for multiplied "
    "by it (premultiplied) and divided by it; if they are dark and straight, {how}."
)
KEPT = (
    "No translucent pixel is brighter than its alpha, but colours do not grow with alpha, so they were taken for dark "
    "and straight; if they are multiplied by alpha, {how}."
)
MIXED = (
    "Colours of translucent pixels are mixed with the background {colour}, which transparent pixels have and which was "
    "taken out of them; if they are straight, {how}."
)
BESIDE_FRAMES = 'write "alpha": "{alpha}" beside "frames"'
"""How a file of views says what alpha is."""


def straightened(
    images: Sequence[Images], given: AlphaName | None, how: str, stored: NDArray[np.uint8], encoded: NDArray[np.uint8]
) -> tuple[list[Images], str | None]:
    """Return images whose colours are divided by alpha if they are multiplied by it, and what was assumed.

    The images (n) x (height, width, 4) are RGBA, sRGB; those that can be written to are changed in place. If nothing is
    ``given`` about them, all translucent pixels decide; ``how`` says how to say what they are, with a place for
    ``{alpha}``. ``stored`` (256,) is the file's level of each level of sRGB, for alpha was multiplied there, and
    ``encoded`` (256,) the other way round.
    """
    said = None
    if given is None and (behind := _background(images)) is not None:
        mixed = np.sum([_counted(image, _distances(stored, stored[behind])) for image in images], axis=0)
        if _found(mixed)[0] == "premultiplied":  # colours grow with alpha from that of the background
            colour = "#" + "".join(f"{level:02x}" for level in behind.tolist())
            said = MIXED.format(colour=colour, how=how.format(alpha="straight"))
            return _divided(images, stored, encoded, stored[behind]), said
    if given is None:
        given, said = _found(np.sum([_counted(image, stored) for image in images], axis=0))
        other = "straight" if given == "premultiplied" else "premultiplied"
        said = None if said is None else said.format(how=how.format(alpha=other))
    if given == "premultiplied":
        images = _divided(images, stored, encoded, np.zeros(3, np.uint8))
    return list(images), said


def _divided(
    images: Sequence[Images], stored: NDArray[np.uint8], encoded: NDArray[np.uint8], behind: NDArray[np.uint8]
) -> list[Images]:
    """Return images without the background, of these levels in the file, that was mixed into them as alpha says."""
    alpha = np.maximum(np.arange(256), 1)[:, None]
    images = [image if image.flags.writeable else image.copy() for image in images]
    for channel, level in enumerate(behind.astype(int).tolist()):
        unmixed = level + (255 * (np.arange(256) - level) + alpha // 2) // alpha
        table = encoded[np.clip(unmixed, 0, 255)]  # (alpha, level)
        for image in images:
            image[..., channel] = table[image[..., 3], stored[image[..., channel]]]
    return images


def _background(images: Sequence[Images]) -> NDArray[np.uint8] | None:
    """Return the colour that all transparent pixels have; None if they differ, are black, or are none. (3,)"""
    behind, alike, number = None, 0, 0
    for image in images:
        whole = _whole(image)
        clear = whole < LEAST_ALPHA
        if behind is None and clear.any():
            behind = np.median(image[clear][:, :3], axis=0).astype(np.uint8)
        if behind is not None:
            same = whole == int.from_bytes(behind.tobytes(), "little")
            alike, number = alike + int(np.count_nonzero(same)), number + int(np.count_nonzero(clear))
    return behind if behind is not None and behind.any() and alike >= (1.0 - EXCEPTIONS) * number else None


def _distances(stored: NDArray[np.uint8], behind: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return how far each level of each channel is from a background, 255 for as far as it can be. (3, 256)"""
    away = stored.astype(float) - behind[:, None]
    return np.rint(
        255.0 * np.where(away < 0, -away / np.maximum(behind[:, None], 1), away / np.maximum(255 - behind[:, None], 1))
    ).astype(np.uint8)


def _counted(image: Images, stored: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return how many translucent pixels have each alpha and brightest channel, by tables (256,) or (3, 256).

    (256, 256)
    """
    whole, tables = _whole(image), np.broadcast_to(stored, (3, 256))
    seen = image[(whole >= LEAST_ALPHA) & (whole < 255 * LEAST_ALPHA)]
    brightest = np.maximum.reduce([tables[channel][seen[:, channel]] for channel in range(3)])
    return np.bincount(256 * seen[:, 3].astype(np.int32) + brightest, minlength=65536).reshape(256, 256)


def _whole(image: Images) -> NDArray[np.uint32]:
    """Return pixels as numbers of four bytes, alpha the highest: one comparison of a pixel, not of its channels."""
    return np.ascontiguousarray(image).view("<u4")[..., 0]


def _found(counts: NDArray[np.int64]) -> tuple[AlphaName, str | None]:
    """Judge translucent pixels by how many have each alpha and brightness. (256, 256)"""
    alpha, level, translucent = np.arange(256)[:, None], np.arange(256), counts
    number = int(translucent.sum())
    exceeding = int((translucent * (level > alpha + 1)).sum())
    if number < FEW or exceeding > EXCEPTIONS * number or not translucent[:, 1:].any():
        return "straight", None
    # The brightest tenth of each alpha: how does its logarithm grow with that of alpha?
    each = translucent.sum(axis=1)
    at = np.flatnonzero(each)
    brightest = (translucent[at].cumsum(axis=1) < 0.9 * each[at, None]).sum(axis=1)
    x, y, weight = np.log(at), np.log(brightest + 0.5), each[at] / number
    x, y = x - weight @ x, y - weight @ y
    if np.sqrt(weight @ x**2) >= SPREAD and weight @ (x * y) >= GROWS * (weight @ x**2):
        return "premultiplied", DIVIDED
    return "straight", KEPT
