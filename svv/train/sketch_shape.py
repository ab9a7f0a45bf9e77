"""The shape of a sketch: its extinction as fine as the volume tells it, which takes no training.

A sketch is learned from small views, so its surfaces are coarse (:mod:`svv.train.run.sketches`). If the volume is
known, its extinction is computed on a lattice as fine as the training itself begins with. In the drawn views of a
volume of 256 points, that takes 0.7 seconds of the processor, and the silhouettes are those of the finished scene.
"""

from __future__ import annotations

import copy
from dataclasses import replace

from svv.errors import silent
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train.base.first_extinction import begin
from svv.train.base.resolutions import fitted_field
from svv.train.config import Preset


def with_shape_of(scene: Scene, views: ViewSet, longest: int, chosen: Preset) -> Scene:
    """Return a sketch with the extinction of its volume; the sketch itself if the volume is not known.

    Colours, regions and paint stay as they are.

    Args:
        scene: A sketch.
        views: The views of which it was learned, with the volume.
        longest: Longer side of the views of which the scene itself will be learned, pixels: they tell how fine it is.
        chosen: Settings with which it will be.
    """
    known = views.classified is not None and chosen.reconstruct.use_volume and chosen.fitted
    if not known or scene.base.density is None or scene.values is not None:
        return scene
    larger = longest / max(views.images.shape[1:3])
    cameras = [c.resized(round(larger * c.width), round(larger * c.height)) for c in views.cameras]
    field, _ = fitted_field(chosen.field, cameras, scene.occupancy.box, chosen.reconstruct)
    beginning = begin(views, scene.occupancy, field, chosen.reconstruct, 0, silent, None, scene.device)
    density = beginning[0].density
    if density is None or density.resolutions[-1] <= scene.base.density.resolutions[-1]:
        return scene
    base = copy.copy(scene.base)
    base._modules = {**base._modules, "density": density.requires_grad_(False).to(scene.device)}
    return replace(scene, base=base, marching=Marching(1.0 / field.resolutions[-1]))
