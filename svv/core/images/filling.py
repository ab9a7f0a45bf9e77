"""Texture filling: cover everything outside a mask with pieces of the picture from inside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

CANDIDATE_PIECES = 24
"""Number of pieces tried at each place; one of the three that best fit the existing pixels is used."""

SMALLEST_HALF_SIDE = 3
"""Half side of a piece in pixels below which the nearest pixel inside the mask is repeated instead."""


def filled(picture: NDArray[np.float32], mask: NDArray[np.bool_], seed: int = 0) -> NDArray[np.float32]:
    """Replace everything outside a mask (h, w), true for at least one pixel, by texture from inside it. (h, w, 3)

    Square pieces from inside the mask are laid row by row over the area outside, with soft edges. Each is one of the
    three of :data:`CANDIDATE_PIECES`, chosen by ``seed``, that best match the pixels they overlap (after Efros and
    Freeman 2001). If the mask is too thin for pieces, each pixel outside gets the value of the nearest pixel inside.
    """
    if mask.all():
        return picture
    # There is no texture beyond the picture's border either.
    room = np.asarray(distance_transform_edt(np.pad(mask, 1)))[1:-1, 1:-1]
    # Smaller than the widest place of the mask: with few different pieces the repetition would show.
    half = int(min(max(np.quantile(room[mask], 0.85), 0.6 * room.max()) / 1.5, max(mask.shape) / 12))
    rows, columns = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    nearest = picture[rows, columns]
    if half < SMALLEST_HALF_SIDE:
        return np.asarray(nearest, dtype=np.float32)
    rng = np.random.default_rng(seed)
    # A square of half side s fits where the nearest pixel outside is more than s sqrt(2) away; a bit less is enough.
    centres = np.argwhere(room > 1.4 * half)
    if len(centres) == 0:
        centres = np.argwhere(room >= room.max())
    return _covered(picture, nearest, mask, centres, half, rng)


def _covered(
    picture: NDArray[np.generic],
    nearest: NDArray[np.generic],
    mask: NDArray[np.bool_],
    centres: NDArray[np.generic],
    half: int,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    height, width = mask.shape
    reach = np.arange(-half, half + 1)
    ramp = np.clip((half + 1 - np.abs(reach)) / max(1.0, 0.4 * half), 0, 1)
    soft = np.minimum.outer(ramp, ramp)
    out, done = np.where(mask[..., None], picture, nearest).astype(np.float32), mask.astype(np.float32)
    pitch = max(1, round(1.3 * half))
    for y in range(0, height + pitch, pitch):
        for x in range(0, width + pitch, pitch):
            ys, xs = y + reach, x + reach
            ys, xs = ys[(ys >= 0) & (ys < height)], xs[(xs >= 0) & (xs < width)]
            here = np.ix_(ys, xs)
            if not len(ys) or not len(xs) or mask[here].all():
                continue
            picks = centres[rng.integers(0, len(centres), CANDIDATE_PIECES)]
            rows = np.clip(picks[:, :1] + ys - y, 0, height - 1)
            columns = np.clip(picks[:, 1:] + xs - x, 0, width - 1)
            pieces = nearest[rows[:, :, None], columns[:, None, :]]
            misfit = (((pieces - out[here]) ** 2).sum(-1) * done[here]).sum((1, 2))
            alpha = soft[np.ix_(ys - y + half, xs - x + half)]
            alpha = np.where(done[here] > 0, alpha * (1 - mask[here]), 1.0)
            # Not always the best one: it would often be the same.
            piece = pieces[np.argsort(misfit)[rng.integers(0, 3)]]
            out[here] += alpha[..., None] * (piece - out[here])
            done[here] = 1.0
    return np.where(mask[..., None], picture, out).astype(np.float32)
