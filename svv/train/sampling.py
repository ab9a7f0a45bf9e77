"""How far apart the samples of a scene's images may lie: as far as the pictures allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from svv.core.cameras import Camera
from svv.fields.scene import Scene

STRIDES = (2.0, 1.5)
"""Sample distances of images in steps of the training's, the longest first."""

GOOD_ENOUGH = 50.0
"""PSNR in dB of pictures against those with the training's step: an error of 0.8 of 255 levels."""

SIZE = 128
"""Width of the pictures that decide, pixels."""


def with_longest_stride(scene: Scene, cameras: Sequence[Camera]) -> tuple[Scene, str]:
    """The scene with the longest of ``STRIDES`` that is good enough, else 1, and why.

    A translucent scene takes 0.7 of the time an image so, while the surfaces of an opaque one need every step.

    Args:
        scene: Trained, unedited.
        cameras: Of the training views; three of them, small, decide.
    """
    seen = [cameras[k * len(cameras) // 3] for k in range(3)]
    seen = [camera.resized(SIZE, max(1, round(SIZE * camera.height / camera.width))) for camera in seen]

    def draw(stride: float) -> NDArray[np.float32]:
        images = np.stack([replace(scene, stride=stride).render(camera).rgba for camera in seen])
        return (images[..., :3] - 1.0) * images[..., 3:]  # on white, which is 0

    fine, found = draw(1.0), ""
    for stride in STRIDES:
        error = float(np.square(draw(stride) - fine).mean())
        psnr = -10.0 * np.log10(max(error, 1e-12))
        found = f"a sample every {stride:g} steps of the training would stay within {psnr:.1f} dB of its images"
        if psnr >= GOOD_ENOUGH:
            return replace(scene, stride=stride), f"images take {found.replace('would stay', 'and stay')}"
    return replace(scene, stride=1.0), f"images are sampled as in training: {found}"
