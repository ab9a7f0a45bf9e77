"""Colours as people with a colour vision deficiency see them, and as a grey print shows them; RGB is sRGB in [0, 1].

Deficiencies are simulated for the complete loss of one kind of cone (Machado, Oliveira and Fernandes 2009), in linear
light. For tritanopia, which is rare, their model is the least certain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import colour_differences
from svv.core.colour.oklab import oklab_to_rgb, rgb_to_oklab
from svv.core.colour.srgb import encoded, linear

VisionName = Literal["normal", "protanopia", "deuteranopia", "tritanopia", "grey print"]
VISIONS: tuple[VisionName, ...] = get_args(VisionName)
"""Ways in which a picture may be seen."""

COLOUR_VISIONS = VISIONS[:4]
"""The ways of people."""

LEAST_DIFFERENCE = 12.0
"""CIEDE2000 from which colours are told apart across a picture, without comparing them side by side."""

MATRICES: dict[str, tuple[tuple[float, float, float], ...]] = {
    "protanopia": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
    "deuteranopia": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881)),
    "tritanopia": ((1.255528, -0.076749, -0.178779), (-0.078411, 0.930809, 0.147602), (0.004733, 0.691367, 0.303900)),
    "grey print": ((0.2126, 0.7152, 0.0722),) * 3,
}
"""Matrices on linear RGB: severity 1.0 of Machado et al. (2009), and the luminance of sRGB (IEC 61966-2-1)."""

Array = NDArray[np.float64]


def simulated(rgb: NDArray[np.floating], vision: VisionName) -> Array:
    """Return colours as they look in one of the :data:`VISIONS`. (..., 3)

    >>> simulated(np.array([1.0, 1.0, 1.0]), "protanopia").round(3).tolist()
    [1.0, 1.0, 1.0]
    """
    colours = np.clip(np.asarray(rgb, np.float64), 0.0, 1.0)
    if vision == "normal":
        return colours
    return encoded(np.clip(linear(colours) @ np.array(MATRICES[vision]).T, 0.0, 1.0))


def oklab(rgb: NDArray[np.floating]) -> Array:
    """Apply :func:`svv.core.colour.oklab.rgb_to_oklab` to an array. (..., 3)"""
    import torch

    return np.asarray(rgb_to_oklab(torch.from_numpy(np.array(rgb, np.float64))).numpy())


def from_oklab(lab: NDArray[np.floating]) -> Array:
    """Apply :func:`svv.core.colour.oklab.oklab_to_rgb` to an array. (..., 3)"""
    import torch

    return np.asarray(oklab_to_rgb(torch.from_numpy(np.array(lab, np.float64))).numpy())


def set_difference(a: Array, b: Array, weights_a: Array, weights_b: Array, vision: VisionName) -> float:
    """Return how far apart two sets of colours look: the CIEDE2000 by which one must be painted over to be the other.

    It is the mean over the best way to match the colours of one set (A, 3) with those of the other (B, 3) by their
    weights, which sum to 1: light is compared with light (the earth mover's distance, Rubner et al. 2000).
    """
    from scipy.optimize import linprog

    apart = colour_differences(simulated(a, vision), simulated(b, vision))
    rows, columns = apart.shape
    # How much of each colour is matched with each: it adds up to the weights. The last sum follows from the others.
    sums = np.concatenate([np.kron(np.eye(rows), np.ones(columns)), np.kron(np.ones(rows), np.eye(columns))])
    weights = np.concatenate([weights_a / weights_a.sum(), weights_b / weights_b.sum()])
    return float(linprog(apart.ravel(), A_eq=sums[:-1], b_eq=weights[:-1]).fun)


def smallest_differences(colours: NDArray[np.floating], visions: Sequence[VisionName]) -> Array:
    """Return the smallest CIEDE2000 of each pair of colours (N, 3) over some ways of seeing them. (N, N)"""
    smallest = np.full((len(colours),) * 2, np.inf)
    for vision in visions:
        seen = simulated(colours, vision)
        for first in range(0, len(seen), 256):
            rows = slice(first, first + 256)
            smallest[rows] = np.minimum(smallest[rows], colour_differences(seen[rows], seen))
    return smallest
