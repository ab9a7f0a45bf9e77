"""Stage 3, second half: every region takes on the manner of its style picture (StyleRF-VolVis, section NPSE).

From each of 42 views around the scene one image a region is rendered from the UCN's diffuse colours and drawn towards
its style by nearest-neighbour feature matching. The images are cropped to what is visible. Back-propagation is
deferred (Zhang et al. 2022, ARF): the image is rendered without a graph, the loss gives a gradient a pixel, and only
then are the samples evaluated again, piece by piece, with a graph.

Density and regions do not change here, so the samples of the views, their weights in the pixels and their regions are
computed once.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from svv.core.cameras import Camera
from svv.errors import BadInput, Progress
from svv.fields.encodings import LatticeAdam
from svv.fields.networks import UnrestrictedField
from svv.fields.rendering import RayCaster, composite, march
from svv.fields.scene import Scene
from svv.kernels.dispatch import kernels_of
from svv.train.config import StylizeSettings
from svv.train.loop import falling, network_adam
from svv.train.style_loss import StyleTarget

LEAST_WEIGHT = 4e-3
"""Samples that weigh less are left out of the images: about one step of 8 bits."""

RIM = 16
"""Pixels around what is visible that belong to the crop: what the features see beyond the outline."""

LEAST_PIXELS = 64
"""A region that covers fewer pixels of a view has no place for a stroke in it and is passed over there."""


UNSEEN = "None of the regions to be styled is visible; choose other regions with --map."

REFINED = 0.1
"""Part of the anchor's weight that regions keep which were styled before: what holds them is the style they had."""


DAMPING = 2.0
"""Of colours that are stored as they are: Adam's epsilon, in units of the first step's gradients."""


@dataclass(frozen=True)
class StyledView:
    """What is seen from one stylization view, cropped to ``height`` x ``width`` pixels.

    ``position`` (S, 3), ``weight`` (S,) in the pixel, ``pixel`` (S,) flat index in the crop, ``region`` (S,).
    """

    position: Tensor
    weight: Tensor
    pixel: Tensor
    region: Tensor
    height: int
    width: int

    def image(self, colours: Tensor, region: int, background: float) -> tuple[Tensor, Tensor]:
        """Render of one region, behind what hides it: (3, H, W), and its opacity (H, W).

        Samples of other regions keep their extinction, so they hide what lies behind them; where they are seen, the
        background is.
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
        settings: StylizeSettings,
        progress: Progress,
        refined: Collection[int] = (),
        whole: bool = False,
    ) -> None:
        """Prepare the views.

        Args:
            scene: With a palette colour network.
            field: The colours to begin with, painted or distilled.
            targets: Style of each region that gets one.
            settings: Of stage 3.
            progress: Called after every view.
            refined: Regions that were styled before and go on: they are less bound to where they begin.
            whole: Whether the scene counts as one region, number 0, whatever its palette says.

        Raises:
            BadInput: the regions to be styled are hardly seen from anywhere.
        """
        self.field, self.targets, self.settings = field, targets, settings
        self.anchors = {k: t.settings.anchor * (REFINED if k in refined else 1.0) for k, t in targets.items()}
        self.piece = kernels_of(scene.device.type).SAMPLES
        self.views = visible_from(scene, stylization_cameras(scene, settings), progress, whole)
        self.views = [v for v in self.views if any(self._covers(v, r) for r in targets)]
        if not self.views:
            raise BadInput(UNSEEN)
        with torch.no_grad():  # half precision: these are as many numbers as the samples' positions
            self.starts = [torch.cat([field(p).half() for p in v.position.split(self.piece)]) for v in self.views]
        networks = [] if field.colour_mlp is None else list(field.colour_mlp.parameters())
        self.networks = network_adam(networks, settings.style_network_rate) if networks else None
        self.tables = LatticeAdam([field.encoding])
        rates = [target.settings.rate for target in targets.values()]
        self.rate = min(rates) if field.direct else settings.style_feature_rate

    def step(self, number: int, fraction: float) -> Tensor:
        """One view: all its regions; returns the style loss. A network's rates are fixed, as in the paper."""
        # A stride that shares no factor with the number of views jumps around the scene, so no side falls behind.
        index = number * _coprime(len(self.views)) % len(self.views)
        view = self.views[index]
        with torch.no_grad():
            colours = torch.cat([self.field(p) for p in view.position.split(self.piece)])
        colours.requires_grad_()
        gradient, values = torch.zeros_like(colours), []
        for loss in self.losses(index, colours):  # one graph at a time: each holds the features of an image
            gradient += torch.autograd.grad(loss, colours)[0]
            values.append(loss.detach())
        if self.networks is not None:
            self.networks.zero_grad(set_to_none=True)
        for first in range(0, len(colours), self.piece):
            piece = slice(first, first + self.piece)
            self.field(view.position[piece]).backward(gradient[piece])
        if self.networks is not None:
            self.networks.step()
        if self.field.direct and number == 0:
            self._damp()
        self.tables.step([self.rate * falling(fraction, 0.1) if self.field.direct else self.rate])
        if self.field.direct:
            with torch.no_grad():  # only what was looked up has moved
                self.field.encoding.table.clamp_(0.0, 1.0)
        return torch.stack(values).mean()

    def _damp(self) -> None:
        """Let colours move as far as their gradients say.

        Adam moves every number alike, however little is asked of it. Features under a network do not mind; colours
        that are shown as they are get specks where the paint was right already.
        """
        gradient, used = self.field.encoding.buffers_for_gradient()
        typical = float(gradient[used > 0].square().mean().sqrt())
        beta1, beta2, _ = self.tables.constants
        self.tables.constants = beta1, beta2, max(DAMPING * typical, 1e-12)

    def losses(self, index: int, colours: Tensor) -> Iterator[Tensor]:
        """What is to fall in one view, a scalar a region that is seen in it, for its samples' colours (S, 3)."""
        view, start = self.views[index], self.starts[index]
        for region, target in self.targets.items():
            if self._covers(view, region):
                image, mask = view.image(colours, region, target.background)
                own = (view.region == region).nonzero()[:, 0]
                away = ((colours[own] - start[own]).square().sum(1) * view.weight[own]).sum() / view.weight[own].sum()
                loss = target.loss(image, mask) + self.anchors[region] * away
                if target.settings.along_rays:
                    loss = loss + target.settings.along_rays * spread_along_rays(view, own, colours[own])
                yield loss

    @staticmethod
    def _covers(view: StyledView, region: int) -> bool:
        return float(view.weight[view.region == region].sum()) >= LEAST_PIXELS


def spread_along_rays(view: StyledView, own: Tensor, colours: Tensor) -> Tensor:
    """How much the colours of some samples differ along their rays: the weighted mean of |c - mean in the pixel|^2.

    Paint that changes through the thickness of a translucent region shows another mixture from every side, and where
    strokes lie behind each other they average to nothing. Paint that is the same along each ray does neither.

    Args:
        view: What is seen.
        own: Indices of the samples, (N,).
        colours: Theirs, (N, 3).

    Returns:
        A scalar; 0 where each pixel sees one colour.
    """
    weight, pixel = view.weight[own], view.pixel[own]
    with torch.no_grad():  # the part of the gradient that goes through the mean is zero
        sums = colours.new_zeros(view.height * view.width, 4)
        sums.index_add_(0, pixel, torch.cat([colours * weight[:, None], weight[:, None]], dim=1))
        mean = sums[:, :3] / sums[:, 3:].clamp_min(1e-6)
    return ((colours - mean[pixel]).square().sum(1) * weight).sum() / weight.sum()


def stylization_cameras(scene: Scene, settings: StylizeSettings) -> Sequence[Camera]:
    """The evenly spread views that see the strokes being made."""
    return scene.rig.sphere(settings.style_views, settings.style_size)


@torch.no_grad()
def visible_from(scene: Scene, cameras: Sequence[Camera], progress: Progress, whole: bool = False) -> list[StyledView]:
    """Samples, weights and regions of views, or one region 0 (``whole``); views that show nothing are left out."""
    assert whole or scene.palette_network is not None
    views, piece = [], kernels_of(scene.device.type).SAMPLES
    for number, camera in enumerate(cameras):
        progress(number / len(cameras), "stylization views")
        rays = RayCaster([camera], scene.occupancy.box, scene.device).view(0)
        samples = march(rays, scene.occupancy, scene.base.density, scene.marching_for_images)
        sigma = scene.base.extinction(samples)
        _, _, weight = composite(samples, sigma, sigma[:, None])
        seen = weight > LEAST_WEIGHT
        if not bool(seen.any()):
            continue
        position, weight, ray = samples.position[seen], weight[seen], samples.ray[seen].long()
        region = torch.zeros_like(ray, dtype=torch.int16)
        if scene.palette_network is not None and not whole:
            region = torch.cat([scene.palette_network.material(p)[1].argmax(1).short() for p in position.split(piece)])
        row, column = ray // camera.width, ray % camera.width
        top, left = max(0, int(row.min()) - RIM), max(0, int(column.min()) - RIM)
        bottom = min(camera.height, int(row.max()) + RIM + 1)
        right = min(camera.width, int(column.max()) + RIM + 1)
        width = right - left
        # All views are kept at a time: three quarters of a gigabyte for fog, with numbers no longer than they must be.
        pixel = ((row - top) * width + column - left).int()
        views.append(StyledView(position, weight, pixel, region, bottom - top, width))
    progress(1.0, "stylization views")
    return views


def _coprime(count: int) -> int:
    """A stride of about the golden section of ``count`` that visits every number before it repeats one."""
    stride = max(1, round(count * 0.618))
    while math.gcd(stride, count) != 1:
        stride += 1
    return stride
