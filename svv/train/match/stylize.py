"""Stage 3 as in the paper, second half: every region takes on the look of its style (StyleRF-VolVis, section NPSE).

From 42 views around the scene, an image per region of the UCN's diffuse colours is pulled towards its style. Density
and regions stay, so samples and weights are computed once. Back-propagation is deferred (Zhang et al. 2022, ARF): the
loss gives a gradient per pixel, and only then are samples evaluated again, piece by piece, with a graph.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from svv.errors import BadInput, Progress
from svv.fields.radiance.encodings import LatticeAdam
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.scene import Scene
from svv.kernels.dispatch import kernels_of
from svv.train.match.style_loss import StyleTarget
from svv.train.paint.styled_views import UNSEEN, StyledView, stylization_cameras, visible_from
from svv.train.run.config import MatchSettings
from svv.train.run.loop import network_adam

LEAST_PIXELS = 64
"""Pixels of a view that a region must cover not to be skipped there: fewer have no room for a stroke."""


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
        """Prepare the views; raises BadInput if the regions are barely visible. ``whole``: all is one region, 0."""
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


def _coprime(count: int) -> int:
    """Return a stride near the golden section of ``count`` that visits every number before it repeats one."""
    stride = max(1, round(count * 0.618))
    while math.gcd(stride, count) != 1:
        stride += 1
    return stride
