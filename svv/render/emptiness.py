"""Pictures that show nothing, and why: people are told, as an empty picture looks like one that failed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

HIDDEN = "all regions of the scene are hidden or fully transparent"
PAST = "the camera sees nothing of the scene"

SHOW = "show regions with `svv edit --show`, or make them more opaque"
"""What to do about it in the command."""


def hides_all(scene: Scene) -> bool:
    """Return whether all regions of a scene are hidden or fully transparent; a scene without regions hides nothing."""
    return bool(scene.regions) and all(region.hidden or region.opacity == 0.0 for region in scene.regions)


def why_empty(scene: Scene, depth: NDArray[np.floating]) -> str:
    """Return why a picture whose depth (h, w) is all NaN shows nothing, without a full stop; '' for others."""
    if np.isfinite(depth).any():
        return ""
    return HIDDEN if hides_all(scene) else PAST + ", or its cuts take away all that is there" * bool(scene.cuts)
