"""The demo's volume: a trefoil knot of a vortex in a ball of superfluid.

Along a vortex line, a superfluid's wave function is zero; around it, the phase turns once. So every surface of equal
phase ends at the line, and for a closed vortex it is a sheet that spans it: a Seifert surface of the knot. The wave
function with a trefoil for its vortex is Brauner's polynomial in Milnor's map: on the sphere |u|^2 + |v|^2 = 1, its
argument fibres what the knot leaves over into such sheets. The sphere is projected to space stereographically,

    u = 2 (x + i y) / (r^2 + 1),  v = (2 z + i (r^2 - 1)) / (r^2 + 1),  psi = u^3 - v^2.

Milnor, Singular Points of Complex Hypersurfaces (1968); the same map knots light (Dennis et al., Isolated optical
vortex knots, Nature Physics 6, 2010) and starts simulations of condensates (Proment, Onorato and Barenghi, Vortex knots
in a Bose-Einstein condensate, Physical Review E 85, 2012). The volume is generated, so no licence applies to it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.errors import BadInput

Array = NDArray[np.float64]

SIZE = 2.75
"""Half the side of the cube that is shown, in units of the stereographic projection; the knot reaches to 2.46."""

PHASE = 0.6 * np.pi
"""Phase of the sheet. At 0 it would reach infinity, at pi it is smallest; in between it is a broad bowl."""

CORE, SHEET = 0.27, 0.12
"""Radius of the vortex' core and half the thickness of the sheet, in the same units."""

EDGE, RIM = 0.94, 0.03
"""Radius of the ball in half sides of the cube, and half the thickness of its edge."""

SLAB = 8
"""Number of layers of voxels that are computed together."""


def demo_volume(resolution: int = 128, levels: int | None = None) -> vtkImageData:
    """Return the volume in the cube [-1, 1]^3, at least 16 voxels along each axis: the same field at every resolution.

    Values are 0.5 in the fluid and outside of it, rise to 0.65 at the ball's edge and to 1 in the vortex' core, and
    fall to 0 in the sheet; with ``levels`` 255, they are whole numbers up to that, one byte each. The knot's threefold
    axis is the volume's y axis.
    """
    if resolution < 16:
        raise BadInput(f"The demo's volume needs at least 16 voxels along each axis, not {resolution}.")
    axis = np.linspace(-1.0, 1.0, resolution)
    volume = np.empty((resolution,) * 3, np.float32 if levels is None else np.uint8)
    for first in range(0, resolution, SLAB):
        slab = slice(first, first + SLAB)
        values = _values(axis[None, None, :], axis[None, :, None], axis[slab, None, None])
        volume[slab] = values if levels is None else np.rint(levels * values)
    return from_array(volume, (2.0 / (resolution - 1),) * 3, (-1.0,) * 3, "wave")


def demo_transfer_function() -> TransferFunction:
    """Return three visible ranges of distinct hues: a golden core, a crimson sheet, and a translucent blue shell."""
    return TransferFunction(
        colours=(
            (0.0, 1.0, 0.2, 0.4), (0.4, 0.9, 0.1, 0.35),
            (0.57, 0.1, 0.4, 0.95), (0.67, 0.15, 0.55, 1.0),
            (0.72, 1.0, 0.72, 0.1), (1.0, 1.0, 0.85, 0.3),
        ),
        opacities=(
            (0.0, 0.97, 0.5, 0.0), (0.34, 0.97, 0.5, 0.0), (0.4, 0.0, 0.5, 0.0),
            (0.57, 0.0, 0.5, 0.0), (0.61, 0.015, 0.5, 0.0), (0.64, 0.015, 0.5, 0.0), (0.67, 0.0, 0.5, 0.0),
            (0.72, 0.0, 0.5, 0.0), (0.78, 0.97, 0.5, 0.0), (1.0, 0.97, 0.5, 0.0),
        ),
        name="demo",
    )  # fmt: skip


def _values(x: Array, y: Array, z: Array) -> Array:
    """Return the values at points in [-1, 1]^3, whose coordinates are broadcast; the knot's axis is the second."""
    radius = np.sqrt(x * x + y * y + z * z)
    real, imaginary, steepness, turning = _wave(SIZE * x, SIZE * z, SIZE * y)
    # To first order, |psi| / |grad psi| is the distance from the line, and Im / |grad Im| that from the sheet.
    core = _plateau(np.hypot(real, imaginary) / steepness, CORE)
    sheet = np.where(real > 0.0, _plateau(imaginary / turning, SHEET), 0.0) * (1.0 - core)
    edge = 0.3 * _plateau(radius - EDGE, RIM)
    return 0.5 + 0.5 * (np.maximum(core, edge) - sheet)


def _wave(x: Array, y: Array, z: Array) -> tuple[Array, Array, Array, Array]:
    """Return psi, turned by the sheet's phase (real and imaginary part), and how steep it is.

    That is the root mean square of the two parts' slopes, equal around the line, and the imaginary part's slope.
    """
    axes = (x, y, z)
    denominator = sum(a * a for a in axes) + 1.0
    u = 2.0 * (x + 1j * y) / denominator
    v = (2.0 * z + 1j * (denominator - 2.0)) / denominator
    turned = np.exp(-1j * PHASE)
    psi = turned * (u**3 - v**2)
    both, imaginary = np.zeros(psi.shape), np.zeros(psi.shape)
    for a, du, dv in zip(axes, (1.0, 1j, 0.0), (0.0, 0.0, 1.0), strict=True):
        along_u = 2.0 * (du - a * u) / denominator
        along_v = 2.0 * (dv + 1j * a - a * v) / denominator
        slope = turned * (3.0 * u**2 * along_u - 2.0 * v * along_v)
        both += slope.real**2 + slope.imag**2
        imaginary += slope.imag**2
    return psi.real, psi.imag, np.sqrt(both / 2.0) + 1e-9, np.sqrt(imaginary) + 1e-9


def _plateau(distance: Array, width: float) -> Array:
    """Return a profile that is 1 at distance 0 and 1/2 at ``width``, where it falls steeply."""
    return np.exp(-np.log(2.0) * (distance / width) ** 4)
