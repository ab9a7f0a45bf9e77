"""Choice of the smallest number of samples with which a scene's images stay the same to the eye."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.fields.scene.model import JOINED_WEIGHT
from svv.fields.scene.scene import Scene

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
