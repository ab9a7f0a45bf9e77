"""Choice of the smallest number of samples, and of colours, with which a scene's images stay the same to the eye."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.colour.colour import WHITE, over
from svv.core.geometry.cameras import Camera
from svv.core.images.metrics import on_white
from svv.fields.scene.images import render_pixels
from svv.fields.scene.model import JOINED_WEIGHT
from svv.fields.scene.scene import Scene
from svv.fields.scene.vertices import vertex_kernels_of
from svv.io.views.viewset import ViewSet
from svv.train.base.resolutions import USUAL, pixel_in

GOOD_ENOUGH = 48.13
"""Required PSNR in dB relative to images with all samples: a root-mean-square error of one of 255 levels."""

BETTER = 51.14
"""The same where samples are merged most: half the squared error, because smooth shading then shows steps."""

CHOICES = (
    (2.0, 1 / 32, GOOD_ENOUGH),
    (1.0, 1 / 16, BETTER),
    (2.0, 1 / 64, GOOD_ENOUGH),
    (1.5, 1 / 32, GOOD_ENOUGH),
    (1.5, 1 / 64, GOOD_ENOUGH),
    (1.0, 1 / 32, GOOD_ENOUGH),
)
"""Sample distances in training steps, weights up to which samples are merged, and required PSNR; the cheapest first."""

SIZE = 128
"""Width in pixels of the test images."""

TRIED = (1, 2)
"""Vertices along each cell of the finest features that are tried in turn."""

LOST = 1.05
"""Squared error of images whose colours are interpolated, relative to that of others, up to which they are good enough:
0.2 dB on views that were learned from, at most 0.1 on others."""

LOST_IN_NARROW = 1.2
"""The same where cells are narrower than pixels alone would allow (:mod:`svv.train.base.finer_features`): large
images are .5 to 1.1 dB better than with wider cells even so, and take .6 of the time that they take otherwise."""

COMPARED, SIDE = 3, 64
"""Views in which that is tried, and pixels along a side of the raster of those that are."""


def with_fewest_samples(scene: Scene, cameras: Sequence[Camera]) -> tuple[Scene, str]:
    """Return the scene with the first of ``CHOICES`` that is good enough in three small images, and the reason.

    It halves the rendering time: a smooth scene needs fewer steps, and a surface every step but fewer colours.
    """
    finest = replace(scene, stride=1.0, joined=JOINED_WEIGHT)
    if scene.base.density is None:
        # Every sample goes through the networks: samples are not merged, and the test would take half a minute.
        return finest, "images use all samples, because the density is a network"
    seen = [cameras[k * len(cameras) // 3] for k in range(3)]
    seen = [camera.resized(SIZE, max(1, round(SIZE * camera.height / camera.width))) for camera in seen]

    def draw(scene: Scene) -> NDArray[np.float32]:
        images = np.stack([scene.render(camera).rgba for camera in seen])
        return (images[..., :3] - 1.0) * images[..., 3:]  # on white, which is 0

    fine, found = draw(finest), ""
    for stride, joined, needed in CHOICES:
        coarse = replace(scene, stride=stride, joined=joined)
        error = float(np.square(draw(coarse) - fine).mean())
        psnr = -10.0 * np.log10(max(error, 1e-12))
        every = "step" if stride == 1.0 else f"{stride:g} steps"
        found = f"one sample every {every}, merged up to 1/{1 / joined:g} of a pixel"
        if psnr >= needed:
            return coarse, f"images use {found}: {psnr:.1f} dB relative to images with all samples"
    return finest, f"images use all samples: {found}, would give only {psnr:.1f} dB relative to these"


def with_fewest(scene: Scene, views: ViewSet) -> tuple[Scene, str]:
    """Return the scene with the fewest samples and colours with which its images stay the same, and the reason."""
    found, samples = with_fewest_samples(replace(scene, vertices_a_cell=0), views.cameras)
    found = with_vertices(found, views)
    count = found.vertices_a_cell
    along = "a vertex" if count == 1 else f"{count} vertices"
    return found, samples + (f"; they may interpolate colours between {along} a cell of the features" if count else "")


def with_vertices(scene: Scene, views: ViewSet) -> Scene:
    """Return the scene with the fewest vertices from which images interpolate colours and lose no more than ``LOST``.

    In narrow cells, ``LOST_IN_NARROW``. Views tell that, at pixels of a raster. Without such vertices, the colours of
    samples are not interpolated.
    """
    chosen = [k * len(views) // COMPARED for k in range(COMPARED)]
    height, width = views.images.shape[1:3]
    rows, columns = (
        np.unique(np.linspace(0, side - 1, min(side, SIDE)).round().astype(int)) for side in (height, width)
    )
    pixels = (rows[:, None] * width + columns).ravel()
    seen = np.stack([views.images[k].reshape(-1, 4)[pixels] for k in chosen])

    def error(scene: Scene) -> float:
        drawn = [render_pixels(scene, views.cameras[k], torch.from_numpy(pixels), "pcn") for k in chosen]
        return float(np.square(over(np.stack(drawn), WHITE) - on_white(seen)).mean())

    def is_drawn(scene: Scene) -> bool:
        return any(vertex_kernels_of(scene, "pcn", views.cameras[k]) is not None for k in chosen)

    drawn_from = [found for tried in TRIED if is_drawn(found := replace(scene, vertices_a_cell=tried))]
    if not drawn_from:
        return scene
    cells = scene.settings.resolutions[-1] * pixel_in(views.cameras, scene.occupancy.box)
    most = (LOST_IN_NARROW if cells * USUAL.pixels_a_cell > 1.0 else LOST) * error(scene)
    return next((found for found in drawn_from if error(found) <= most), scene)
