"""Colour bars, axes, logos and text in the pictures of a view set: noticed, named, and left out on request."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from svv.core.geometry.cameras import Camera
from svv.core.view_checks.agreement import some_of, step_of
from svv.core.view_checks.fixed_pixels import VISIBLE, fixed_pixels, places_of
from svv.core.view_checks.silhouettes import Views
from svv.errors import BadInput
from svv.io.views.viewset import MIN_TRAIN_VIEWS, ViewSet

Images = NDArray[np.uint8]
Mask = NDArray[np.bool_]

RIM = 2
"""Pixels around what stands still that are left out with it, because its edges are blurred."""

MOST_LEFT_OUT = 0.5
"""Fraction of the views that are left out at most because the scene reaches what stands still."""


def fixed_in(cameras: Sequence[Camera], images: Images) -> Mask | None:
    """Return the pixels (height, width) that stand still in images (n, height, width, 4), with a rim, if any do."""
    chosen, step = some_of(len(images)).tolist(), step_of(images)
    thin = [images[k, step // 2 :: step, step // 2 :: step] for k in chosen]
    found = fixed_pixels(thin, Views.of([cameras[k] for k in chosen]), step)
    if not found.any():
        return None
    height, width = images.shape[1:3]
    whole = np.zeros((height, width), bool)
    large = np.repeat(np.repeat(found, step, 0), step, 1)[:height, :width]
    whole[: large.shape[0], : large.shape[1]] = large
    return np.asarray(binary_dilation(whole, np.ones((3, 3)), RIM + step - 1))


def noticed(fixed: Mask) -> str:
    """Say in a sentence what stands still on the screen, and what to do."""
    return (
        f"Something {places_of(fixed)} stands still on the screen in all views ({int(fixed.sum())} pixels), such as a "
        "colour bar, axes, a logo or text, and no object of the scene does: leave it out with --ignore-fixed, "
        "or write the pictures without it."
    )


def without(images: Images, fixed: Mask) -> Images:
    """Return the images with these pixels empty."""
    cleared = images.copy()
    cleared[:, fixed] = 0
    return cleared


def ignoring_fixed(views: ViewSet) -> tuple[ViewSet, str]:
    """Return views without what stands still on the screen, and what was done, as a sentence.

    Views in which the scene reaches it are left out, because what it covers there is unknown; BadInput if these are too
    many.
    """
    fixed = fixed_in(views.cameras, views.images)
    if fixed is None:
        return views, "Nothing stands still on the screen, so --ignore-fixed changes nothing."
    around = binary_dilation(fixed, np.ones((3, 3)), RIM) & ~fixed
    reached = (views.images[:, around, 3] > VISIBLE).any(axis=1)
    kept = np.flatnonzero(~reached).tolist()
    if len(kept) < max(MIN_TRAIN_VIEWS, (1.0 - MOST_LEFT_OUT) * len(views)):
        raise BadInput(
            f"In {int(reached.sum())} of {len(views)} views, the scene reaches what stands still on the screen "
            f"({places_of(fixed)}), and nothing says what it covers: write the pictures without it."
        )
    said = f"What stands still on the screen {places_of(fixed)} ({int(fixed.sum())} pixels) is left out"
    if reached.any():
        said += f", and so are {int(reached.sum())} of {len(views)} views in which the scene reaches it"
    taken = views.take(kept) if reached.any() else views
    return ViewSet(taken.cameras, without(taken.images, fixed), taken.names, taken.meta, taken.classified), f"{said}."
