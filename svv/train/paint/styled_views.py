"""The views in which styles are matched and judged: what is visible there, as samples with weights and regions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from svv.core.geometry.cameras import Camera
from svv.errors import Progress
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.scene import Scene
from svv.kernels.dispatch import kernels_of
from svv.train.run.config import StylizeSettings

LEAST_WEIGHT = 4e-3
"""Weight in a pixel below which samples are omitted from the images: about one 8-bit level."""

RIM = 16
"""Margin in pixels of the crop around what is visible: features see that far beyond the outline."""

UNSEEN = "None of the regions to be styled is visible; choose other regions with --map."


@dataclass(frozen=True)
class StyledView:
    """Visible samples of one stylization view, cropped to ``height`` x ``width`` pixels.

    ``position`` (S, 3), ``weight`` (S,) in the pixel, ``pixel`` (S,) flat index in the crop, ``region`` (S,).
    """

    position: Tensor
    weight: Tensor
    pixel: Tensor
    region: Tensor
    height: int
    width: int

    def image(self, colours: Tensor, region: int, background: float) -> tuple[Tensor, Tensor]:
        """Render one region, with what hides it: colours (3, H, W) and its opacity (H, W).

        Samples of other regions keep their extinction, so they hide what lies behind them; where they are visible, the
        background is shown.
        """
        own = self.region == region
        weight, pixel = self.weight[own], self.pixel[own]
        out = colours.new_zeros(self.height * self.width, 4)
        out.index_add_(0, pixel, torch.cat([colours[own] * weight[:, None], weight[:, None]], dim=1))
        mask = out[:, 3].clamp(max=1.0)
        image = out[:, :3] + background * (1.0 - mask)[:, None]
        return image.T.reshape(3, self.height, self.width), mask.reshape(self.height, self.width)


def stylization_cameras(scene: Scene, settings: StylizeSettings) -> Sequence[Camera]:
    """Return the evenly spread cameras of the stylization views."""
    return scene.rig.sphere(settings.style_views, settings.style_size)


@torch.no_grad()
def visible_from(scene: Scene, cameras: Sequence[Camera], progress: Progress, whole: bool = False) -> list[StyledView]:
    """Return samples, weights and regions of views (``whole``: one region 0); views that show nothing are omitted."""
    assert whole or scene.palette_network is not None
    views, piece = [], kernels_of(scene.device.type).SAMPLES
    for number, camera in enumerate(cameras):
        progress(number / len(cameras), "stylization views")
        rays = scene.caster([camera]).view(0)
        samples = march(rays, scene.occupancy, scene.base.density, scene.marching_for_images)
        sigma = scene.base.extinction(samples)
        _, _, weight = composite(samples, sigma, sigma[:, None])
        seen = weight > LEAST_WEIGHT
        if not bool(seen.any()):
            continue
        position, weight, ray = samples.position[seen], weight[seen], samples.ray[seen].long()
        region = torch.zeros_like(ray, dtype=torch.int16)
        if scene.palette_network is not None and not whole:
            material = scene.palette_network.material
            region = torch.cat([scene.region_of(p, material(p)[1]).short() for p in position.split(piece)])
        row, column = ray // camera.width, ray % camera.width
        top, left = max(0, int(row.min()) - RIM), max(0, int(column.min()) - RIM)
        bottom = min(camera.height, int(row.max()) + RIM + 1)
        right = min(camera.width, int(column.max()) + RIM + 1)
        width = right - left
        # All views are in memory at once: three quarters of a gigabyte for fog, even with the shortest number types.
        pixel = ((row - top) * width + column - left).int()
        views.append(StyledView(position, weight, pixel, region, bottom - top, width))
    progress(1.0, "stylization views")
    return views
