"""Sketches of a known volume: its own extinction and light, and colours that are learned as functions of its values.

They take two seconds and are as smooth as the volume's rendering; of few views, a network learns blotches and dents.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from svv.core.geometry.cameras import CameraRig
from svv.core.volumes.classified import ValueGrid
from svv.errors import Progress, part, silent
from svv.fields.devices.gpu import device_named
from svv.fields.radiance.networks import BaseField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.of_values import fill_features
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.options.making import TrainOptions
from svv.train.base.first_extinction import begin, first_occupancy, known_volume
from svv.train.base.from_values import field_of
from svv.train.base.resolutions import affordable_field, fitted_field
from svv.train.palette.lighting import headlight_of
from svv.train.palette.ranges import regions_for, regions_of
from svv.train.palette.recolour import recolour
from svv.train.pipeline import train_scene
from svv.train.run.config import preset, settings_of
from svv.train.run.loop import Running
from svv.train.run.sketches import sketches_for

STEPS, RAYS, SAMPLES = 200, 128, 4096
"""Steps of the optimiser, and rays and samples of each: few, because all points of a value learn together."""

MOST_VERTICES = 2_000_000
"""Most vertices that get a value and a normal; a fog that fills its box gets coarser ones."""


def sketch_from_values(
    views: ViewSet, longest: int, options: TrainOptions, progress: Progress = silent
) -> Scene | None:
    """Return a sketch with the extinction and normals of the views' volume; None if the volume is not to be used.

    ``longest`` is the longer side, in pixels, of the views of which the scene itself is learned, not these small ones.
    """
    chosen, draft = settings_of(options), preset("draft")
    volume = known_volume(views, chosen.reconstruct, draft.field)
    if volume is None or volume.values is None or options.views_only:
        return None
    device = device_named(options.device)
    occupancy, _ = first_occupancy(views, draft.reconstruct, draft.field, silent)
    larger = longest / max(views.images.shape[1:3])
    cameras = [c.resized(round(larger * c.width), round(larger * c.height)) for c in views.cameras]
    fine, _ = fitted_field(draft.field, cameras, occupancy.box, chosen.reconstruct)
    fine, _ = affordable_field(fine, occupancy, chosen.reconstruct)
    density = begin(views, occupancy, fine, chosen.reconstruct, options.seed, silent)[0].density
    shaded = views.meta.shading is None or views.meta.shading.seen
    field = replace(
        field_of(draft.field, volume.values),
        resolutions=(_cells(volume.values, occupancy),),
        lighting="phong" if shaded else "none",
        headlight=headlight_of(views),
    )
    base = BaseField(field, occupancy)
    fill_features(base, volume.values, occupancy)
    base._modules["density"] = density
    base.requires_grad_(False).to(device)
    marching = Marching(1.0 / fine.resolutions[-1])
    scene = Scene(field, occupancy, marching, base, camera_rig=CameraRig.of(views.cameras))
    known = regions_of(volume, views, scene, options.seed)
    network, shares, _ = recolour(
        views, scene, known.palette.colours, replace(draft.recolour, iterations=STEPS, rays=RAYS, samples=SAMPLES),
        Running(options.seed, progress=progress), known.owners, values=volume.values,
    )  # fmt: skip
    made = {"preset": draft.name, "learned_from": "volume and views", "source": views.meta.to_json()}
    return replace(scene, palette_network=network, regions=regions_for(network, shares, known.ranges), made=made)


def sketches_of(views: ViewSet, options: TrainOptions, progress: Progress) -> Iterator[Scene]:
    """Yield sketches of the scene of these views, each better than the one before; raises BadInput if one fails."""
    every = sketches_for(options.preset)
    for number, sketch in enumerate(every):
        told = part(progress, number / len(every), (number + 1) / len(every))
        few = sketch.few(views)
        known = sketch_from_values(few, max(views.images.shape[1:3]), options, told)
        if known is not None:
            yield known
            return
        yield train_scene(few, sketch.options(options), told)[0]


def _cells(grid: ValueGrid, occupancy: Occupancy) -> int:
    """Return the number of cells per box unit of a lattice with at most :data:`MOST_VERTICES` vertices."""
    cells, occupied = grid.cells, int(occupancy.occupied.sum())
    while cells > 1 and occupied * (cells / occupancy.cells) ** 3 > MOST_VERTICES:
        cells //= 2
    return cells
