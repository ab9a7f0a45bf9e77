"""Tables of colours and opacities, in which our own ray caster looks values up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from svv.dvr.functions.transfer_functions import TransferFunction

ENTRIES = 1 << 14
"""Number of entries of the table of colours and opacities."""

MOST_ENTRIES, TRIED, UNRESOLVED = 1 << 20, 4096, 0.01
"""Most entries; number of voxels whose colours and opacities decide how many are needed; and the error, as a fraction
of the opacity, above which there are too few."""


def entries_for(tf: TransferFunction, low: float, high: float, voxels: NDArray[np.number]) -> int:
    """Return how many entries a table from ``low`` to ``high`` needs to show voxels as the function does.

    More are needed if the function varies at both ends of a wide range, such as on a logarithmic scale.
    """
    entries, span = ENTRIES, high - low
    tried = voxels.ravel()[:: max(1, voxels.size // TRIED)].astype(np.float64)
    tried = tried[(tried >= low) & (tried <= high)]

    def light(values: NDArray[np.float64]) -> NDArray[np.float64]:
        opacity = tf.opacity_at(values)[:, None]
        return np.concatenate([tf.colour_at(values) * opacity, opacity], axis=1)

    exact = light(tried)
    while span > 0.0 and exact.any() and entries < MOST_ENTRIES:
        step = span / (entries - 1)
        error = np.abs(light(low + np.rint((tried - low) / step) * step) - exact)
        if error.mean() <= UNRESOLVED * exact[:, 3].mean():
            break
        entries *= 4
    return entries
