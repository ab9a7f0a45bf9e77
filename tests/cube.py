"""A scene that was not trained, for tests of operations on scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, CameraRig
from svv.core.rounding import NETWORKS
from svv.fields.radiance.networks import BaseField, FieldSettings, PaletteField, UnrestrictedField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.fields.scene.splitting import regions_in_cells


def cube_scene(seed: int = 0) -> Scene:
    """A scene that nobody trained: a translucent cube, in which three regions lie about at random."""
    torch.manual_seed(seed)
    field = FieldSettings(resolutions=(4, 8), width=16)
    occupancy = Occupancy(Box((-0.5,) * 3, 1.0, (1.0,) * 3), 4, np.ones((4, 4, 4), np.uint8))
    base = BaseField(field, occupancy)
    assert base.density is not None
    for encoding in base.encodings:
        encoding.randomize(1.0, torch.Generator().manual_seed(3))
    with torch.no_grad():
        base.density.table.add_(0.5)
    colours = ((0.9, 0.2, 0.1), (0.1, 0.3, 0.9), (0.2, 0.8, 0.3))
    palette = PaletteField(field, occupancy, base.geometry_width, torch.tensor(colours))
    palette.encoding.randomize(3.0, torch.Generator().manual_seed(4))
    rig = CameraRig((0.0, 0.0, 0.0), 3.0, 0.5, (24, 24))
    regions = tuple(Region(colour, 1 / 3) for colour in colours)
    networks = base.requires_grad_(False), palette.requires_grad_(False)
    scene = Scene(field, occupancy, Marching(1 / 16), *networks, regions=regions, camera_rig=rig)
    return Scene.from_bytes(scene.to_bytes())  # as a file holds it


def hash_cube_scene() -> Scene:
    """The cube with the paper's hash grid."""
    cube = cube_scene()
    torch.manual_seed(0)
    settings = FieldSettings("hash", (4, 16), features=2, levels=3, log2_entries=8, width=16)
    base = BaseField(settings, cube.occupancy)
    palette = PaletteField(settings, cube.occupancy, base.geometry_width, torch.rand(3, 3))
    for network in (base, palette):
        network.encoding.randomize(1.0, torch.Generator().manual_seed(1))
    fields = base.requires_grad_(False), palette.requires_grad_(False)
    return replace(cube, settings=settings, base=fields[0], palette_network=fields[1])


def lit_cube_scene() -> Scene:
    """The cube under an explicit light, its normals the gradient of its extinction."""
    cube = cube_scene()
    assert cube.palette_network is not None and cube.base.density is not None
    field = replace(cube.settings, lighting="phong", headlight="axis")
    palette = PaletteField(field, cube.occupancy, cube.base.geometry_width, cube.palette_network.colours.detach())
    for name in ("encoding", "palette_mlp"):
        getattr(palette, name).load_state_dict(getattr(cube.palette_network, name).state_dict())
    assert palette.phong is not None
    palette.phong.start(cube.base.density, cube.occupancy, None, 0)
    with torch.no_grad():
        palette.phong.raw.add_(torch.tensor([[0.0], [0.5], [-0.5]]))  # regions that differ
    return replace(cube, settings=field, palette_network=palette.requires_grad_(False))


def cube_paint(scene: Scene, seed: int, finer: tuple[int, ...] = ()) -> UnrestrictedField:
    """A painting of the cube in colours that come as they may, with ``finer`` levels beyond the scene's."""
    torch.manual_seed(seed)
    levels = (*scene.settings.resolutions, *finer)
    network = UnrestrictedField(scene.settings, scene.occupancy, levels).requires_grad_(False)
    network.encoding.randomize(2.0, torch.Generator().manual_seed(seed))
    return network


def cube_camera(size: int = 24) -> Camera:
    """The cube from the front."""
    pose = np.eye(4)
    pose[2, 3] = 3.0
    return Camera(pose, 0.5, size, size)


def clear_place(scene: Scene, region: int) -> tuple[float, float, float]:
    """The centre of the cell that is most clearly a region's, in world coordinates: those of the box less .5.

    The regions of the cube lie about at random, many by a margin that half precision does not see. There, a test would
    depend on the processor.
    """
    assert scene.palette_network is not None
    cells, found, _ = regions_in_cells(scene)
    centres = (np.argwhere(found == region) + 0.5) / cells
    with torch.no_grad():
        weights = scene.palette_network.material(torch.from_numpy(centres.astype(np.float32)))[1].numpy()
    others = np.delete(weights, region, axis=1).max(axis=1)
    margin = weights[:, region] - others
    assert margin.max() > NETWORKS[torch.bfloat16]
    x, y, z = (centres[margin.argmax()] - 0.5).tolist()
    return x, y, z


def faint(scene: Scene, factor: float = 0.3) -> Scene:
    """The scene with all regions more transparent, so that what lies behind can be seen."""
    for region in range(len(scene.regions)):
        scene = scene.edited(region, opacity=factor)
    return scene
