"""Sort-last compositing: images of the parts of a volume become the image of the whole (Molnar et al. 1994).

The N parts are boxes of the volume's grid that touch but do not overlap. A ray passes through one after the other, so
the images are composited in that order with the operator *over* (Porter and Duff 1984).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput

Array = NDArray[np.float64]

CYCLE = (
    "The parts of the volume on the ranks hide each other in a circle, so there is no order in which to draw them: "
    "save the volume as a .vti file, which ParaView divides itself."
)


def front_to_back(low: Array, high: Array, eye: Array, parallel: bool) -> list[int]:
    """Return the order in which rays from a camera pass through boxes with lower and upper corners (N, 3).

    A plane between two boxes decides: the box on the camera's side may hide the other one, but not vice versa. ``eye``:
    position of the camera, or direction of parallel rays. (3,) BadInput if boxes overlap, or hide each other in a
    circle.
    """
    upward, downward = ((eye > 0) & (low < high), (eye < 0) & (low < high)) if parallel else (eye < high, eye > low)
    # If a box lies below another, it hides that one only from rays that go upward, and vice versa.
    below = high[:, None] <= low[None]  # (N, N, 3)
    hides = ~((below & ~upward[:, None]) | (below.swapaxes(0, 1) & ~downward[:, None])).any(axis=2)
    hides &= ~np.eye(len(low), dtype=bool)
    order, left = [], np.ones(len(low), bool)
    while left.any():
        free = np.flatnonzero(left & ~(hides & left[:, None]).any(0))
        if not free.size:
            raise BadInput(CYCLE)
        order += free.tolist()
        left[free] = False
    return order


def over(layers: NDArray[np.uint16], full: int) -> NDArray[np.uint16]:
    """Composite premultiplied images, front to back: C = sum_i c_i prod_{j<i} (1 - a_j), and likewise for alpha.

    (N, ..., 4) -> (..., 4). ``full``: the value that stands for 1, in the layers and in the image.
    """
    total = np.zeros(layers.shape[1:], np.float32)
    behind = np.ones((*layers.shape[1:-1], 1), np.float32)
    for layer in layers:
        total += behind * layer
        behind *= 1.0 - layer[..., 3:] / np.float32(full)
    return np.rint(total).astype(np.uint16)
