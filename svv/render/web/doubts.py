"""How far a page's pictures can be trusted: the scene's expected errors, as the page shows them.

They have the colours that movies of ``svv render --what doubt`` have (:func:`svv.fields.scene.doubt.darkest_error`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from svv.fields.scene.doubt import MOST_RATIO, darkest_error, width_of_pixels
from svv.fields.scene.expected import CELLS
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import HEAT

VIEWS, VIEW_SIZE = 5, 96
"""Views, and their side in pixels, in which the error that is darkest on a page is measured."""


def doubt_of(scene: Scene) -> tuple[dict[str, object] | None, list[NDArray[np.uint8]]]:
    """Return what a page is told of a scene's expected errors, and their grid; None and nothing if it has none."""
    known = scene.expected
    if known is None or scene.layers:
        return None, []
    told: dict[str, object] = {
        "shape": known.level.shape,
        "cells": CELLS,
        "most": known.most,
        "edge": known.edge,
        "darkest": darkest_error(scene, scene.rig.orbit(VIEWS, VIEW_SIZE)),
        "heat": HEAT.tolist(),
        "centre": scene.rig.centre,
        "pixel": width_of_pixels(scene.rig),
        "most_ratio": MOST_RATIO,
    }
    return told, [np.ascontiguousarray(known.level)]
