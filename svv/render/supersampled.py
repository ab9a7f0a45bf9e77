"""Images averaged over several rays per pixel: edges of brush strokes are smooth where one sees them at a slant.

A stroke's edge is as soft as a pixel is wide. At a slant, the place that a ray shows changes by more than that from
pixel to pixel, so edges become stairs and thin strokes dots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import over
from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress, silent

if TYPE_CHECKING:
    from svv.fields.scene.scene import Rendering, Scene

Number = TypeVar("Number", bound=np.generic)

MOST = 4
"""Largest number of samples along a pixel's side."""

USUAL, LARGE = 2, 1 << 22
"""Samples along a pixel's side of images of strokes, and number of pixels above which images have one: on larger ones,
a pixel is a small part of a stroke."""


def samples_for(scene: Scene, camera: Camera, network: str | None = None) -> int:
    """Return how many samples along a pixel's side an image of a scene should have: moving ones have one."""
    shown = scene.still and (network or scene.networks[-1]) == "styled" and shows_strokes(scene)
    return USUAL if shown and camera.width * camera.height <= LARGE else 1


def shows_strokes(scene: Scene) -> bool:
    """Return whether the painting that a scene shows has brush strokes."""
    return bool(scene.regions_with_strokes)


def supersampled(
    scene: Scene,
    camera: Camera,
    network: str | None = None,
    background: Sequence[float] | None = None,
    progress: Progress = silent,
    samples: int | None = None,
) -> Rendering:
    """Render one image with several rays per pixel; arguments and errors as in :meth:`Scene.render`.

    ``samples`` are rays along a pixel's side, from 1 to :data:`MOST`; by default :func:`samples_for`.
    """
    n = samples_for(scene, camera, network) if samples is None else samples
    if not 1 <= n <= MOST:
        raise BadInput(f"--supersample must lie between 1 and {MOST}, not {n}.")
    if n == 1:
        return scene.render(camera, network, background, progress)
    fine = scene.render(camera.resized(n * camera.width, n * camera.height), network, None, progress)
    found = averaged(fine, n)
    if background is None:
        return found
    opaque = np.ones((*found.depth.shape, 1), np.float32)
    return replace(found, rgba=np.concatenate([over(found.rgba, background), opaque], 2, dtype=np.float32))


def averaged(fine: Rendering, n: int) -> Rendering:
    """Return an image whose pixels are squares of ``n`` x ``n`` pixels of another.

    Colours count as much as they are opaque. A pixel belongs to the region with the most opacity, and has the depth of
    that region's most opaque ray: a mean would lie between a silhouette and what is behind it, where nothing is.

    >>> from svv.fields.scene.scene import Rendering
    >>> red = np.array([[[1, 0, 0, 1], [0, 0, 0, 0]]] * 2, np.float32)
    >>> averaged(Rendering(red, red[..., 0], np.zeros((2, 2), np.int16)), 2).rgba.tolist()
    [[[1.0, 0.0, 0.0, 0.5]]]
    """
    alpha = _squares(fine.rgba[..., 3], n)
    total = alpha.sum(2)
    share = alpha / np.maximum(total, 1e-12)[..., None]
    colour = np.stack([(share * _squares(fine.rgba[..., c], n)).sum(2) for c in range(3)], 2)
    number = _squares(fine.region, n)
    seen = np.stack([(alpha * (number == k)).sum(2) for k in range(int(number.max(initial=-1)) + 1)] or [total], 2)
    there, region = (number >= 0).any(2), seen.argmax(2)
    ray = np.where(number == region[..., None], alpha, -1.0).argmax(2)
    depth = np.take_along_axis(_squares(fine.depth, n), ray[..., None], 2)[..., 0]
    return replace(
        fine,
        rgba=np.concatenate([colour, total[..., None] / n**2], 2, dtype=np.float32),
        depth=np.where(there, depth, np.nan).astype(np.float32),
        region=np.where(there, region, -1).astype(np.int16),
    )


def _squares(values: NDArray[Number], n: int) -> NDArray[Number]:
    """Return the values of each square of an image (H n, W n). (H, W, n n)"""
    height, width = values.shape[0] // n, values.shape[1] // n
    return values.reshape(height, n, width, n).swapaxes(1, 2).reshape(height, width, n * n)
