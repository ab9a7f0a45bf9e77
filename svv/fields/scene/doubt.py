"""How far a picture of a scene can be trusted: the error that its pixels are expected to have, learned from its views.

Every sample has an expected error, from a coarse grid; a pixel has the sum of its samples' by their weights in it, and
more where its colour changes from pixel to pixel. :mod:`svv.train.expected_errors` learns both. Letters: R rays, S
samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.geometry.cameras import Camera, CameraRig
from svv.core.geometry.given_cameras import GivenCamera, camera_of
from svv.core.rays.compositing import LEAST_ALPHA
from svv.errors import BadInput, Progress, silent
from svv.fields.devices.gpu import gpu_errors
from svv.fields.radiance.rendering import Rays, composite
from svv.fields.scene.expected import ExpectedErrors
from svv.fields.scene.images import shade, visible_samples
from svv.fields.scene.model import Model
from svv.fields.scene.region import label_of
from svv.fields.scene.sections import is_sectioned
from svv.io.pictures.output import darkest_from
from svv.kernels.dispatch import kernels_of
from svv.kernels.types import Samples
from svv.options.editing import LEARNED

MOST_RATIO = 8.0
"""Largest ratio of pixels of views and of an image that is looked at: beyond, edges are sharp or smooth in both."""


def expected_of(scene: Model) -> ExpectedErrors:
    """Return what a scene knows of its errors; raises BadInput if it does not know it, saying why."""
    scene.check_alone("The expected error of pictures")
    if scene.layers:
        raise BadInput("The expected error of pictures works with scenes of one transfer function.")
    if scene.expected is None:
        raise BadInput(
            "The scene does not say how far its pictures can be trusted: it shows another volume, time step or "
            "opacities than those that it was trained on, or was trained by an older version of svv; train it again."
        )
    return scene.expected


@torch.no_grad()
def doubt(scene: Model, camera: GivenCamera, progress: Progress = silent) -> NDArray[np.float32]:
    """Return the error that the pixels of an image are expected to have compared with the volume rendering.

    It is the mean absolute difference of RGB on white, in [0, 1]; NaN where nothing is visible. Opacities and cuts that
    were edited count. That of a painting, or of faces of cuts drawn flat or hatched, is that of the scene as it was
    learned: of drawings, there is no truth.

    Args:
        scene: A scene of one transfer function, at the time step that it was trained on.
        camera: As for :func:`svv.fields.scene.images.render`.
        progress: Called before every chunk of rays and at the end.

    Returns:
        The errors, float32. (H, W)

    Raises:
        BadInput: The scene does not know its errors (:func:`expected_of`), or the camera is none.
    """
    expected, camera = expected_of(scene), camera_of(camera, scene)
    if is_sectioned(scene):
        scene = replace(scene, regions=tuple(replace(region, section=LEARNED) for region in scene.regions))
    with gpu_errors(scene.device):
        caster, pixels = scene.caster([camera]), camera.width * camera.height
        shown = torch.zeros(pixels, 5, device=scene.device)
        chunk = kernels_of(scene.device.type).RAYS
        for first in range(0, pixels, chunk):
            progress(first / pixels, "rendering")
            own = torch.arange(first, min(first + chunk, pixels), device=scene.device)
            out, alpha, _ = seen_along_rays(scene, caster.rays(own), expected)
            shown[own] = torch.cat([out[:, :3] - alpha[:, None], out[:, 3:], alpha[:, None]], dim=1)
        colour, error, alpha = shown.view(camera.height, camera.width, 5).split([3, 1, 1], dim=2)
        right = torch.cat([colour[:, 1:], colour[:, -1:]], dim=1)
        below = torch.cat([colour[1:], colour[-1:]], dim=0)
        error = error[..., 0] + expected.edge * pixel_ratio(scene, camera) * change(colour, right, below)
        found = torch.where(alpha[..., 0] > LEAST_ALPHA, error.clamp(0.0, 1.0), torch.nan).cpu().numpy()
    progress(1.0, "rendering")
    return np.asarray(found, np.float32)


def seen_along_rays(
    scene: Model, rays: Rays, expected: ExpectedErrors | None = None
) -> tuple[Tensor, Tensor, tuple[Samples, Tensor]]:
    """Return what rays show without paint and moved light, alpha (R,), and samples with their weights (S,).

    The first are colours over black (R, 3), and with ``expected`` errors in a fourth channel.
    """
    network = "pcn" if "pcn" in scene.networks else "base"
    samples = visible_samples(scene, rays, network)
    colour, _, sigma = shade(scene, samples, rays, network)
    values = [colour] if expected is None else [colour, expected.of(samples.position)[:, None]]
    out, transmittance, weight = composite(samples, sigma, torch.cat(values, dim=1))
    return out, 1.0 - transmittance, (samples, weight)


def change(own: Tensor, right: Tensor, below: Tensor) -> Tensor:
    """Return how much the colours of pixels (..., 3) differ from those of their neighbours, the mean of RGB. (...)"""
    return ((right - own).abs() + (below - own).abs()).mean(dim=-1)


def pixel_ratio(scene: Model, camera: Camera) -> float:
    """Return the width of a training view's pixel, relative to that of a camera, in the middle of the scene."""
    rig = scene.rig
    own = width_of_pixels(rig)
    if own is None:
        return 1.0
    away = max(float(np.linalg.norm(camera.position - np.asarray(rig.centre))), 1e-9)
    return float(np.clip(own / max(float(camera.pixel_at(away)), 1e-12), 1.0 / MOST_RATIO, MOST_RATIO))


def width_of_pixels(rig: CameraRig) -> float | None:
    """Return the width of a training view's pixel in the middle of the scene in world units; None if not known."""
    if rig.size is None:
        return None
    across = 2.0 * rig.radius * np.tan(0.5 * rig.fov_x) if rig.span_x is None else rig.span_x
    return float(across / rig.size[0])


def darkest_error(scene: Model, cameras: Sequence[Camera]) -> float:
    """Return the expected error that is darkest in pictures of several cameras: a colour means the same in all."""
    return max(darkest_from(doubt(scene, camera)) for camera in cameras)


def told_in_words(scene: Model) -> str | None:
    """Return the expected errors of a scene in a sentence, and where they are largest; None if they are not known."""
    if scene.expected is None or scene.layers:
        return None
    known = scene.expected
    x, y, z = known.place
    where = f"x {x:.4g}, y {y:.4g}, z {z:.4g}"
    if scene.palette_network is not None:
        at = torch.as_tensor(scene.occupancy.box.to_box([known.place]), dtype=torch.float32, device=scene.device)
        region = int(scene.region_of(at, scene.palette_network.material(at)[1]))
        where = f"{where} in {label_of(scene.regions, region)}"
    return (
        f"pixels are about {known.mean:.1%} off on average, and {known.worst:.1%} around {where}, where it is most; "
        "svv render --what doubt shows it"
    )
