"""How few samples the images of a scene need: as few as the pictures allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from svv.core.cameras import Camera
from svv.fields.model import JOINED_WEIGHT
from svv.fields.scene import Scene

CHOICES = ((2.0, 1 / 32), (2.0, 1 / 64), (1.5, 1 / 32), (1.5, 1 / 64))
"""Sample distances in steps of the training's, and weights until which samples are joined; the cheapest first."""

GOOD_ENOUGH = 48.13
"""PSNR in dB of pictures against those with all samples: an error of one of 255 levels (root of the mean square)."""

SIZE = 128
"""Width of the pictures that decide, pixels."""


def with_fewest_samples(scene: Scene, cameras: Sequence[Camera]) -> tuple[Scene, str]:
    """The scene with the first of ``CHOICES`` that is good enough, if one is, and why.

    Images of a translucent scene take half the time so, while the surfaces of an opaque one need every step.

    Args:
        scene: Trained, unedited.
        cameras: Of the training views; three of them, small, decide.
    """
    finest = replace(scene, stride=1.0, joined=JOINED_WEIGHT)
    if scene.base.density is None:
        # Every sample goes through the networks: samples are not joined, and the pictures would take half a minute.
        return finest, "images take all samples, as the density is a network's"
    seen = [cameras[k * len(cameras) // 3] for k in range(3)]
    seen = [camera.resized(SIZE, max(1, round(SIZE * camera.height / camera.width))) for camera in seen]

    def draw(scene: Scene) -> NDArray[np.float32]:
        images = np.stack([scene.render(camera).rgba for camera in seen])
        return (images[..., :3] - 1.0) * images[..., 3:]  # on white, which is 0

    fine, found = draw(finest), ""
    for stride, joined in CHOICES:
        coarse = replace(scene, stride=stride, joined=joined)
        error = float(np.square(draw(coarse) - fine).mean())
        psnr = -10.0 * np.log10(max(error, 1e-12))
        found = f"a sample every {stride:g} steps, joined up to 1/{1 / joined:g} of a pixel"
        if psnr >= GOOD_ENOUGH:
            return coarse, f"images take {found}: that stays within {psnr:.1f} dB of those with all samples"
    return finest, f"images take all samples: {found} would stay within {psnr:.1f} dB of them only"
