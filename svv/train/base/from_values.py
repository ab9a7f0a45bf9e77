"""Stages 1 and 2 of a scene that is a function of its volume's values: a table of extinctions, and given features.

A lattice of values and normals replaces the learned features, and an explicit light the lighting network.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.core.volumes.classified import ValueGrid
from svv.fields.radiance.networks import CONSTANT_HARMONIC, BaseField, FieldSettings, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.of_values import Places, features_at, fill_palette
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU
from svv.train.base.extinction_table import ExtinctionTable
from svv.train.base.first_extinction import Beginning
from svv.train.base.reconstruct import Reconstruction
from svv.train.run.config import ReconstructSettings

FEATURES = 4
"""Features of a vertex: for the base network value and normal; for the palette network two of the value, and zeros."""

STEEPNESS = 8.0
"""Factor on the first layer of the palette MLP: how fast it can change with the value when training begins."""


def field_of(field: FieldSettings, grid: ValueGrid) -> FieldSettings:
    """Return the shape of the networks over the values of a grid."""
    return replace(field, encoding="lattice", resolutions=(grid.cells,), features=FEATURES, finer=(), facing=True)


class ValueReconstruction(Reconstruction):
    """Stage 1: learns the extinction as a function of value and slope, and the base colours of values and normals."""

    def __init__(
        self, views: ViewSet, beginning: Beginning, field: FieldSettings, settings: ReconstructSettings, seed: int = 0,
        device: torch.device = CPU,
    ) -> None:  # fmt: skip
        super().__init__(views, beginning, field, settings, seed, device)
        assert beginning.values is not None and self.field.density is not None
        self.grid = beginning.values
        self.extinction = ExtinctionTable(self.grid, device)
        self.laid = self.occupancy
        value, normal = features_at(self.grid, self.field.encoding, self.laid)
        with torch.no_grad():
            self.field.encoding.table.copy_(torch.cat([value[:, None], normal], dim=1))
        self.field.encoding.requires_grad_(False)
        first = self.field.colour_mlp[0]
        assert isinstance(first, nn.Linear)
        with torch.no_grad():  # half of the units
            side, start = _thresholds(len(first.weight) // 2, self.device)
            first.weight[: len(side), 0] = side
            first.weight[: len(side), FEATURES] = -side * start / CONSTANT_HARMONIC
        self._place()

    def _place(self) -> None:
        density = self.field.density
        assert density is not None
        where = self.laid.occupied, self.laid.cells
        vertices = density.vertices_of_level(density.levels - 1, *where)
        self.places = Places(self.grid, vertices, density.resolutions[-1], self.device)
        self._fill()

    def _fill(self) -> None:
        assert self.field.density is not None
        with torch.no_grad():
            self.field.density.table[:, 0] = self.extinction.at(self.places)

    def _rates(self, rate: float) -> list[float]:
        return [self.settings.network_rate * rate, self.settings.known_density_rate * rate]

    def _update(self) -> None:
        assert self.field.density is not None
        network, known = (self.numbers.other(k) for k in range(2))
        for group in self.networks.param_groups:
            group["lr"] = network
        self.networks.step()
        gradient, used = self.field.density.buffers_for_gradient()
        self.extinction.step(gradient[:, 0], self.places, float(known))
        gradient.zero_()
        used.zero_()
        self._fill()

    def refine(self) -> None:
        """Halve the step, and keep only the vertices in cells that pruning left."""
        super().refine()
        self.field.encoding.requires_grad_(False)
        self.laid = self.occupancy
        self._place()

    def finish(self) -> tuple[BaseField, Occupancy]:
        """Return the trained field, frozen, and the occupancy; the field keeps the table of the extinction."""
        base, occupancy = super().finish()
        base.extinction_table = self.extinction.table.detach().clone()
        return base, occupancy

    def layout(self) -> dict[str, NDArray[np.generic]]:
        """Return what a checkpoint needs besides the parameters: their layout, and the table of the extinction."""
        own = self.extinction
        return super().layout() | {
            "extinction": own.table.cpu().numpy(), "moments": own.moments.cpu().numpy(), "age": np.array(own.age)
        }  # fmt: skip

    def go_on_from(self, layout: dict[str, NDArray[np.generic]] | None) -> None:
        """Restore the layout and the table of an interrupted run, if there is one."""
        super().go_on_from(layout)
        if layout is not None:
            own = self.extinction
            own.table = torch.from_numpy(layout["extinction"].copy()).to(self.device)
            own.moments = torch.from_numpy(layout["moments"].copy()).to(self.device)
            own.age = int(layout["age"])
            self._fill()


def palette_given(network: PaletteField, base: BaseField) -> None:
    """Give an untrained palette network its base field's values, and its light their normals; both stay so."""
    fill_palette(network, base)
    first = network.palette_mlp[0]
    assert isinstance(first, nn.Linear)
    with torch.no_grad():
        side, start = _thresholds(len(first.weight), first.weight.device)
        first.weight.zero_()
        first.weight[:, 0], first.weight[:, 1] = -side * start, side * (1.0 - start)  # side (v - start)
    if network.phong is not None:
        network.phong.normals.requires_grad_(False)
    network.encoding.requires_grad_(False)


def _thresholds(count: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """Return slopes and thresholds of units that begin as slope (v - threshold) of a value v. (count,) each"""
    start = torch.linspace(0.0, 1.0, count, device=device)
    return STEEPNESS * torch.where(torch.arange(count, device=device) % 2 == 0, 1.0, -1.0), start


def sample_transfer_function(grid: ValueGrid, device: torch.device) -> tuple[Tensor, Tensor] | None:
    """Return visible values in [0, 1] (K,) and the transfer function's colours there (K, 3), or None if unknown."""
    if grid.colours is None or grid.integral is None:
        return None
    value = np.linspace(0.0, 1.0, len(grid.colours))
    known = np.linspace(0.0, 1.0, len(grid.integral))
    low, high = grid.visible
    beside = 0.5 / (len(grid.colours) - 1)
    rises = np.interp(value + beside, known, grid.integral) > np.interp(value - beside, known, grid.integral)
    seen = (value >= low) & (value <= high) & rises
    own = torch.from_numpy(((value[seen] - low) / max(high - low, 1e-6)).astype(np.float32)).to(device)
    return own, torch.from_numpy(grid.colours[seen]).to(device)
