"""A hard case: a ring, thin field lines and a shell, stirred by a turbulent flow and seen through fog.

A passive scalar is advected by a random divergence-free flow with a Kolmogorov spectrum (energy ~ k^(-5/3)), as smoke
is by wind. Before the stirring, it is a torus (values near 1) threaded by the field lines of a dipole (near 0.6)
inside a sphere (near 0.3). The volume is generated from scratch, so no licence applies to it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, zoom
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.errors import BadInput

Array = NDArray[np.float64]

COARSE = 48
"""Points along each axis of the grid on which the flow is traced back; it suffices because the flow is smooth."""

STEPS = 12
"""Number of steps in which the flow is traced back."""

SLAB = 8
"""Number of layers of voxels that are computed together."""

LINES = 7
"""Number of field lines."""


def stirred_volume(resolution: int = 128, seed: int = 7, levels: int | None = None) -> vtkImageData:
    """Return the volume, with values in [0, 1], in the cube [-1, 1]^3: the same field at every resolution.

    Args:
        resolution: Voxels along each axis, >= 16.
        seed: Seed of the flow.
        levels: 255 for whole numbers from 0 to 255, one byte each, as from a scanner; by default float32 values.

    Raises:
        BadInput: The resolution is below 16.
    """
    if resolution < 16:
        raise BadInput(f"The stirred volume needs at least 16 voxels along each axis, not {resolution}.")
    rng = np.random.default_rng(seed)
    before = _carried_back(_flow(rng))
    coarse = np.concatenate([before, _noise(rng, 1.2)[None]])  # (4; n, n, n)
    # A spline is linear in its values: one matrix (resolution, n) for each axis. A large volume is made slab by slab.
    finer = zoom(np.eye(COARSE), (resolution / COARSE, 1.0), order=3, grid_mode=False)
    planes = finer @ (coarse @ finer.T)  # (4; n, resolution, resolution)
    volume = np.empty((resolution,) * 3, np.float32 if levels is None else np.uint8)
    for first in range(0, resolution, SLAB):
        slab = slice(first, first + SLAB)
        *points, patches = np.tensordot(finer[slab], planes, axes=(1, 1)).swapaxes(0, 1)
        values = _scalar(np.stack(points), patches)
        volume[slab] = values if levels is None else np.rint(levels * values)
    return from_array(volume, (2.0 / (resolution - 1),) * 3, (-1.0,) * 3, "concentration")


def stirred_transfer_function(shell: float = 0.08, lines: float = 0.6, ring: float = 0.95) -> TransferFunction:
    """Return three visible ranges of distinct hues: a translucent blue shell, crimson field lines, a golden ring.

    Args:
        shell: The shell's largest opacity, in [0, 1].
        lines: The field lines' largest opacity, in [0, 1].
        ring: The ring's largest opacity, in [0, 1].
    """
    return TransferFunction(
        colours=(
            (0.0, 0.1, 0.4, 0.95), (0.4, 0.15, 0.55, 1.0),
            (0.46, 0.9, 0.1, 0.35), (0.68, 1.0, 0.2, 0.4),
            (0.74, 1.0, 0.72, 0.1), (1.0, 1.0, 0.85, 0.3),
        ),
        opacities=(
            (0.0, 0.0, 0.5, 0.0), (0.17, 0.0, 0.5, 0.0), (0.27, shell, 0.5, 0.0), (0.36, 0.0, 0.5, 0.0),
            (0.46, 0.0, 0.5, 0.0), (0.56, lines, 0.5, 0.0), (0.66, 0.0, 0.5, 0.0),
            (0.74, 0.0, 0.5, 0.0), (0.84, ring - 0.05, 0.5, 0.0), (1.0, ring, 0.5, 0.0),
        ),
        name="stirred",
    )  # fmt: skip


def _grid() -> Array:
    """Return the points of the coarse grid in [-1, 1]^3. (3: z, y, x; n, n, n)"""
    axis = np.linspace(-1.0, 1.0, COARSE)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"))


def _noise(rng: np.random.Generator, slope: float) -> Array:
    """Return a random periodic field of mean 0 and variance 1 with amplitudes ~ k^-slope, k up to n / 4. (n, n, n)"""
    waves = np.fft.fftfreq(COARSE, 1 / COARSE)
    k = np.sqrt(sum(w * w for w in np.meshgrid(waves, waves, waves, indexing="ij")))
    spectrum = np.fft.fftn(rng.standard_normal((COARSE,) * 3))
    shaped = np.where((k > 0) & (k < COARSE / 4), np.maximum(k, 1.0) ** -slope, 0.0)
    field = np.fft.ifftn(spectrum * shaped).real
    return field / field.std()


def _flow(rng: np.random.Generator) -> Array:
    """Return a divergence-free velocity (3: z, y, x; n, n, n) of variance 1.

    E(k) ~ k^(-5/3), so the amplitudes are ~ k^(-11/6).
    """
    waves = np.fft.fftfreq(COARSE, 1 / COARSE)
    k = np.stack(np.meshgrid(waves, waves, waves, indexing="ij"))
    spectrum = np.stack([np.fft.fftn(_noise(rng, 11 / 6)) for _ in range(3)])
    along = (k * spectrum).sum(axis=0) / np.maximum((k * k).sum(axis=0), 1.0)
    velocity = np.fft.ifftn(spectrum - k * along, axes=(1, 2, 3)).real
    return velocity / velocity.std()


def _carried_back(flow: Array) -> Array:
    """Return where the fluid at each grid point was before it was stirred. (3: z, y, x; n, n, n)"""
    point = _grid()
    for _ in range(STEPS):
        index = (point + 1.0) * 0.5 * COARSE
        speed = np.stack([map_coordinates(axis, index, order=1, mode="grid-wrap") for axis in flow])
        _, y, x = point
        turn = 1.6 * np.exp(-3.0 * (x * x + y * y))  # a vortex about z, faster near the axis
        point = point - 0.09 / STEPS * speed - turn / STEPS * np.stack([0 * x, x, -y])
    return point


def _scalar(point: Array, patches: Array) -> Array:
    """Return the concentration before the stirring at points (3: z, y, x; ...)."""
    z, y, x = point
    across = np.maximum(np.hypot(x, y), 1e-3)
    radius = np.sqrt(across**2 + z * z)
    ring = np.hypot(across - 0.36, z)
    # Lines of a dipole: r = L sin^2(polar angle) = L (across / r)^2, at LINES azimuths.
    number = radius**3 / across**2
    steepness = np.hypot(3 * radius * z / across**2, 3 * radius / across - 2 * radius**3 / across**3)
    turn = np.mod(np.arctan2(y, x) * LINES / (2 * np.pi), 1.0) - 0.5
    line = np.hypot((number - 0.74) / steepness, turn * 2 * np.pi / LINES * across)
    line = np.hypot(line, np.maximum(radius - 0.72, 0.0))  # the lines stay inside the shell
    shell = radius - 0.8
    parts = (
        _tube(ring, 0.12),
        0.62 * _tube(line, 0.065),
        0.3 * _tube(shell, 0.05) * (0.8 + 0.2 * np.tanh(1.5 * patches)),
    )
    return np.clip(np.maximum.reduce(parts), 0.0, 1.0)


def _tube(distance: Array, width: float) -> Array:
    """Return a profile that is 1 at distance 0 and steep at ``width``, so other ranges appear only as a thin skin."""
    return np.exp(-np.log(2.0) * (distance / width) ** 4)
