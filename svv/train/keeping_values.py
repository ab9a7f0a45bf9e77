"""The values of the volume that a trained scene keeps, to be read off (:mod:`svv.fields.scene.probing`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from svv.errors import BadInput
from svv.fields.radiance.kept_values import KeptValues
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet


def check_keeps(views: ViewSet, views_only: bool) -> None:
    """Raise BadInput if views do not come with the values of their volume, or are not to be learned with it."""
    if views_only:
        raise BadInput("Give --keep-values or --views-only, not both: the values are those of the volume.")
    if views.classified is None or views.classified.values is None:
        raise BadInput(
            "--keep-values needs the values of the volume, which these views do not come with: draw views of the "
            "volume with `svv views`, or leave it out."
        )


def keeping_values(scene: Scene, views: ViewSet) -> tuple[Scene, str]:
    """Return a scene with its volume's values, unless it is a function of them, and what they take in its file."""
    volume = views.classified
    assert volume is not None and volume.values is not None
    if scene.steps is not None:
        return scene, "the volume's values are kept anyway, because the scene is a function of them"
    grid = views.meta.grid
    whole = grid is not None and np.issubdtype(np.dtype(grid.type), np.integer)
    kept = KeptValues.of(volume.values, volume.box, scene.occupancy, whole)
    count = max(kept.count, 1)
    said = f"the volume's values are kept: {kept.bytes / 1e6:.2f} MB, {kept.bytes / count:.2f} bytes at each point"
    return replace(scene, kept=kept), f"{said} of a grid of {kept.cells} cells that the scene shows"
