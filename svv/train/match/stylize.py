"""Stage 3 as in the paper, second half: every region takes on the look of its style (StyleRF-VolVis, section NPSE).

From each of 42 views around the scene, one image per region is rendered from the UCN's diffuse colours and pulled
towards its style by nearest-neighbour feature matching. The images are cropped to what is visible. Back-propagation is
deferred (Zhang et al. 2022, ARF): the image is rendered without a graph, the loss gives a gradient per pixel, and only
then are the samples evaluated again, piece by piece, with a graph.

Density and regions do not change here, so the samples of the views, their weights in the pixels and their regions are
computed once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress
from svv.fields.radiance.encodings import LatticeAdam
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.scene import Scene
from svv.kernels.dispatch import kernels_of
from svv.train.config import MatchSettings, StylizeSettings
from svv.train.match.style_loss import StyleTarget
from svv.train.run.loop import network_adam

LEAST_WEIGHT = 4e-3
"""Weight in a pixel below which samples are omitted from the images: about one 8-bit level."""

RIM = 16
"""Margin in pixels of the crop around what is visible: features see that far beyond the outline."""

LEAST_PIXELS = 64
"""Pixels of a view that a region must cover not to be skipped there: fewer have no room for a stroke."""


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


class Stylization:
    """Trains a distilled UCN on style pictures."""

    def __init__(
        self,
        scene: Scene,
        field: UnrestrictedField,
        targets: dict[int, StyleTarget],
        settings: MatchSettings,
        progress: Progress,
        whole: bool = False,
    ) -> None:
        """Prepare the views.

        Args:
            scene: A scene with a palette colour network.
            field: Distilled colours.
            targets: Style of each region that gets one.
            settings: Settings of stage 3.
            progress: Called after every view.
            whole: Whether the scene counts as one region, number 0, regardless of its palette.

        Raises:
            BadInput: The regions to be styled are barely visible from all sides.
        """
        self.field, self.targets, self.settings = field, targets, settings
        self.piece = kernels_of(scene.device.type).SAMPLES
        self.views = visible_from(scene, stylization_cameras(scene, settings), progress, whole)
        self.views = [v for v in self.views if any(self._covers(v, r) for r in targets)]
        if not self.views:
            raise BadInput(UNSEEN)
        assert field.colour_mlp is not None
        self.networks = network_adam(list(field.colour_mlp.parameters()), settings.style_network_rate)
        self.tables = LatticeAdam([field.encoding])

    def step(self, number: int, fraction: float) -> Tensor:
        """Optimise all regions of one view; returns the style loss. The rates are fixed, as in the paper."""
        # A stride coprime to the number of views jumps around the scene, so no side falls behind.
        index = number * _coprime(len(self.views)) % len(self.views)
        view = self.views[index]
        with torch.no_grad():
            colours = torch.cat([self.field(p) for p in view.position.split(self.piece)])
        colours.requires_grad_()
        gradient, values = torch.zeros_like(colours), []
        for loss in self.losses(index, colours):  # one graph at a time: each holds the features of an image
            gradient += torch.autograd.grad(loss, colours)[0]
            values.append(loss.detach())
        self.networks.zero_grad(set_to_none=True)
        for first in range(0, len(colours), self.piece):
            piece = slice(first, first + self.piece)
            self.field(view.position[piece]).backward(gradient[piece])
        self.networks.step()
        self.tables.step([self.settings.style_feature_rate])
        return torch.stack(values).mean()

    def losses(self, index: int, colours: Tensor) -> Iterator[Tensor]:
        """Yield the loss of each region visible in one view, a scalar, for its samples' colours (S, 3)."""
        view = self.views[index]
        for region, target in self.targets.items():
            if self._covers(view, region):
                yield target.loss(*view.image(colours, region, target.background))

    @staticmethod
    def _covers(view: StyledView, region: int) -> bool:
        return float(view.weight[view.region == region].sum()) >= LEAST_PIXELS


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


def _coprime(count: int) -> int:
    """Return a stride near the golden section of ``count`` that visits every number before it repeats one."""
    stride = max(1, round(count * 0.618))
    while math.gcd(stride, count) != 1:
        stride += 1
    return stride
