"""The first extinction on a GPU: :class:`svv.train.base.tomography.Tomography`, whose steps never leave it."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import avg_pool2d, max_pool2d

from svv.core.rays.extinction import LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import RayCaster
from svv.io.views.viewset import ViewSet
from svv.kernels.types import TomographyKernels
from svv.train.base.tomography import LARGEST_CHANGE, LEAST_DEPTH, LEAST_WEIGHT, OPAQUE, STOP, Tomography
from svv.train.run.views_there import views_on


class TomographyThere(Tomography):
    """Reconstructs the log extinction by kernels of a device."""

    def __init__(
        self, views: ViewSet, occupancy: Occupancy, seed: int, kernels: TomographyKernels, device: torch.device
    ) -> None:
        """Start from a fog; ``kernels`` are those of the ``device``."""
        self.kernels, self.device = kernels, device
        super().__init__(views, occupancy, seed)
        known = views_on(views, device)
        self._alpha = torch.from_numpy(views.images[..., 3]).to(device) if known is None else known.alpha

    def _reduced(self, which: NDArray[np.int64], factor: int) -> Any:
        own = self._alpha if len(which) == len(self._alpha) else self._alpha[torch.from_numpy(which).to(self.device)]
        parts = [avg_pool2d(piece[:, None].float(), factor)[:, 0] for piece in own.split(8)]
        return torch.cat(parts) / 255.0

    def _vertices(self) -> Any:
        return torch.from_numpy(np.ascontiguousarray(super()._vertices())).to(self.device)

    def _step(self, caster: RayCaster, alpha: Any, vertices: Any) -> None:
        near = max_pool2d((alpha > 0).float()[:, None], 3, 1, 1)
        rows = near.flatten().nonzero()[:, 0]
        seen, told = self._seen(caster, rows), alpha.reshape(-1)[rows]
        depth = -(1.0 - told).clamp(min=LEAST_DEPTH).log()
        weight = (1.0 - told).square() + LEAST_WEIGHT
        weight = torch.where((told >= OPAQUE) & (seen > depth), 0.0, weight)  # more than opaque is not wrong
        images = torch.zeros(alpha.numel(), 2, device=self.device)
        images[rows] = torch.stack([weight * depth, weight * seen], dim=1)
        sums = self.kernels.back_project(
            vertices, float(self.lattice.resolutions[0]), caster.cameras, images.view(*alpha.shape, 2)
        )
        change = ((sums[:, 0] + LEAST_WEIGHT) / (sums[:, 1] + LEAST_WEIGHT)).log()
        table = self.lattice.table[:, 0]
        table += change.clamp(-LARGEST_CHANGE, LARGEST_CHANGE)
        table.clamp_(LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION)

    def _seen(self, caster: RayCaster, pixels: Tensor) -> Tensor:
        """Return the optical depth of pixels (R,) of the caster's views."""
        rays, occupancy = caster.rays(pixels), self.occupancy
        return self.kernels.optical_depths(
            (rays.origins, rays.directions), occupancy.distance_on(self.device), occupancy.cells,
            occupancy.box.extent, 1.0 / self.lattice.resolutions[0], self._random.random(), self.lattice.layout,
            self.lattice.table, STOP,
        )  # fmt: skip

    def _error(self, caster: RayCaster, alpha: Any) -> float:
        seen = self._seen(caster, torch.arange(alpha.numel(), device=self.device))
        return float((1.0 - (-seen).exp() - alpha.reshape(-1)).square().mean())
