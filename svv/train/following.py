"""A scene at another time step of its volume, without views and without training.

In a scene of the encoding ``values``, extinction, colour and light are functions of the volume's values
(:mod:`svv.train.from_values`), and a transfer function shows other values in the same way. At another time step, only
the values are new.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from scipy.spatial import cKDTree

from svv.core.classified import ClassifiedVolume, ValueGrid
from svv.core.extinction import LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.errors import BadInput
from svv.fields.encodings import SparseLattice
from svv.fields.networks import BaseField, PaletteField, UnrestrictedField
from svv.fields.occupancy import Occupancy
from svv.fields.scene import Scene
from svv.fields.value_function import ValueFunction
from svv.kernels.dispatch import CPU
from svv.train.beginning import largest_extinction, least_extinction
from svv.train.config import ReconstructSettings
from svv.train.extinction_table import Places, looked_up
from svv.train.from_values import features_at, palette_given

LEAST_VISIBLE = 0.1
"""Extinction in 1 / box unit below which a whole volume shows nothing: a ray through it all loses a tenth."""


@torch.no_grad()
def at_volume(scene: Scene, volume: ClassifiedVolume) -> Scene:
    """Return the scene as another volume's values make it, with the same palette, edits and paint.

    Paint stays where it is in space; where the scene was empty before, it is that of the nearest place.

    Args:
        scene: A scene of the encoding ``values``, with a palette network and without regions that were split off.
        volume: The other volume, classified by the scene's transfer function.

    Raises:
        BadInput: The scene is not one of these, the volume comes without its values, or nothing of it is visible.
    """
    function, palette = check_follows(scene)
    if volume.values is None:
        raise BadInput("The volume comes without its values: classify it again.")
    if not volume.exponent.astype(np.float32).max() > np.log(LEAST_VISIBLE):
        raise BadInput("The transfer function of the scene shows nothing of this volume.")
    device, grid = scene.device, volume.values.over(function.interval, function.visible)
    base, occupancy = _base(scene, function, grid, volume)
    normals = None if palette.phong is None else palette.phong.normals.resolutions
    moved = PaletteField(scene.settings, occupancy, base.geometry_width, palette.colours.detach().cpu(), normals)
    palette_given(moved, grid, occupancy)
    learned = {name: value for name, value in palette.state_dict().items() if not name.endswith("table")}
    moved.load_state_dict(learned, strict=False)

    def painted(network: UnrestrictedField) -> UnrestrictedField:
        return _carried(network, scene, occupancy).to(device)

    return replace(
        scene, occupancy=occupancy, base=base.to(device), palette_network=moved.requires_grad_(False).to(device),
        styled=None if scene.styled is None else painted(scene.styled), parts=None,
        others=tuple(replace(other, network=painted(other.network)) for other in scene.others),
    )  # fmt: skip


def check_follows(scene: Scene) -> tuple[ValueFunction, PaletteField]:
    """Return what a scene needs to follow its volume; raises BadInput if it lacks it, see :func:`at_volume`."""
    if scene.values is None or scene.palette_network is None:
        raise BadInput(
            "The scene does not know its volume's values, so it cannot follow them: train it with --encoding values."
        )
    if scene.parts is not None and scene.parts.active:
        raise BadInput("Parts that were split off cannot follow a volume: undo the splits first.")
    for network in (scene.styled, *(other.network for other in scene.others)):
        if network is not None and not network.direct:
            raise BadInput("Only paint on a lattice can follow a volume: remove this painting first.")
    return scene.values, scene.palette_network


def _base(
    scene: Scene, function: ValueFunction, grid: ValueGrid, volume: ClassifiedVolume
) -> tuple[BaseField, Occupancy]:
    """Return the base field over a grid of values, on the CPU, and the cells in which something is visible."""
    settings, old = ReconstructSettings(), scene.base.density
    assert old is not None
    cells, largest = scene.occupancy.cells, float(np.exp(np.float64(volume.exponent.max())))
    there = volume.occupied(cells, least_extinction(settings.prune_least * volume.cells, largest))
    occupancy = Occupancy(volume.box, cells, there)
    longer = float(np.log(volume.box.size / function.size))
    table = function.table.cpu()

    def density_in(where: Occupancy) -> SparseLattice:
        density = SparseLattice(where.occupied, where.cells, old.resolutions, 1).requires_grad_(False)
        vertices = density.vertices_of_level(0, where.occupied, where.cells)
        exponent = looked_up(table, Places(grid, vertices, density.resolutions[0], CPU)) + longer
        density.table.copy_(exponent.clamp(LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION)[:, None])
        return density

    density = density_in(occupancy)
    depth = largest_extinction(lambda points: density(points)[:, 0], occupancy, CPU) * scene.marching.step
    left = occupancy.pruned(depth, settings.prune_least, grow=False)
    occupancy = left if left.occupied.any() else occupancy
    base = BaseField(scene.settings, occupancy, old.resolutions)
    base.colour_mlp.load_state_dict(scene.base.colour_mlp.state_dict())
    base.density = density.restricted(occupancy.occupied, occupancy.cells)
    value, normal = features_at(grid, base.encoding, occupancy)
    base.encoding.table.copy_(torch.cat([value[:, None], normal], dim=1))
    return base.requires_grad_(False), occupancy


def _carried(network: UnrestrictedField, scene: Scene, occupancy: Occupancy) -> UnrestrictedField:
    """Return paint on the vertices of other cells, each with the paint of the nearest vertex, on the CPU."""
    old = network.encoding
    result = UnrestrictedField(scene.settings, occupancy, network.resolutions, direct=True)
    new = result.encoding
    assert isinstance(old, SparseLattice) and isinstance(new, SparseLattice)

    def places(lattice: SparseLattice, where: Occupancy) -> np.ndarray:
        vertices = lattice.vertices_of_level(0, where.occupied, where.cells)
        return where.box.to_world(vertices / lattice.resolutions[0])

    _, nearest = cKDTree(places(old, scene.occupancy)).query(places(new, occupancy), workers=-1)
    new.table.copy_(old.table.detach().cpu()[torch.from_numpy(nearest)])
    return result.requires_grad_(False)
