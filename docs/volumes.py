"""More generated volumes for the pictures of the documentation, beside the demo's; values in [0, 1].

Each function returns a volume in the cube [-1, 1]^3 and a transfer function with broad, opaque regions.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import Legendre
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree
from scipy.special import ellipe, ellipk, genlaguerre
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array

Array = NDArray[np.float64]
Colour = tuple[float, float, float]
Made = tuple[vtkImageData, TransferFunction]

BLUE: Colour = (0.12, 0.45, 0.95)
GOLD: Colour = (1.0, 0.78, 0.2)
CRIMSON: Colour = (0.95, 0.15, 0.38)
GREY: Colour = (0.55, 0.75, 0.75)


def gyroid(resolution: int = 112) -> Made:
    """A ball of a gyroid: two labyrinths that never touch, and the surface between them.

    Level sets of sin x cos y + sin y cos z + sin z cos x are within a few percent of Schoen's minimal surface (1970)
    and its parallels, as found in block copolymers (Lambert, Radzilowski and Thomas 1996).
    """
    z, y, x = _axes(resolution)
    level = _gyroid_level(1.35 * np.pi * x, 1.35 * np.pi * y, 1.35 * np.pi * z)
    inside = 1.0 / (1.0 + np.exp((np.sqrt(x * x + y * y + z * z) - 0.92) / 0.012))
    level = inside * level + (1.0 - inside) * 0.25  # outside, a value between the surface's and a labyrinth's
    return _image(0.5 + 0.5 * level), _function(
        (0.0, 0.25, 0.97, BLUE), (0.46, 0.54, 0.03, GREY), (0.75, 1.0, 0.97, GOLD)
    )


def glass(resolution: int = 112) -> Made:
    """The gyroid's surface alone, as a translucent sheet."""
    volume, _ = gyroid(resolution)
    return volume, _function((0.44, 0.56, 0.3, BLUE))


def nested(resolution: int = 112) -> Made:
    """Two translucent skins one in the other, a vessel that winds between them, and a core."""
    z, y, x = _axes(resolution)
    radius = np.sqrt(x * x + y * y + z * z)
    outer = 0.24 * np.clip((0.92 - radius) / 0.06, 0.0, 1.0)
    polar = np.arccos((z / np.maximum(radius, 1e-3)).clip(-1.0, 1.0))
    dented = radius * (1.0 + 0.07 * np.sin(4.0 * np.arctan2(y, x)) * np.sin(3.0 * polar))
    inner = 0.44 * np.clip((0.62 - dented) / 0.06, 0.0, 1.0)
    turn = np.linspace(0.0, 1.0, 160)
    height = 1.4 * turn - 0.7
    around = 0.75 * np.sqrt(1.0 - height * height)
    vessel = np.stack([around * np.cos(9.0 * turn), around * np.sin(9.0 * turn), 0.75 * height], 1)
    away = cKDTree(vessel).query(np.stack([x, y, z], -1).reshape(-1, 3))[0].reshape(x.shape)
    tube = 0.75 * np.exp(-np.square(away / 0.05))
    core = np.exp(-np.square(np.sqrt((x - 0.05) ** 2 + (y + 0.05) ** 2 + z * z) / 0.2))
    return _image(np.maximum.reduce([outer, inner, tube, core])), _function(
        (0.10, 0.26, 0.06, GREY), (0.36, 0.46, 0.15, BLUE), (0.62, 1.0, 0.95, CRIMSON)
    )


def _gyroid_level(x: Array, y: Array, z: Array) -> Array:
    return (np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)) / 1.5


def orbital(resolution: int = 112, n: int = 5, l: int = 2) -> Made:  # noqa: E741
    """The orbital 5d of z^2 of a hydrogen atom: its wave function is positive in gold and negative in blue.

    psi = exp(-rho / 2) rho^l L(rho) P(cos), rho = 2 r / n (any textbook, such as Bethe and Salpeter 1957). Values are
    1/2 + sign(psi) sqrt|psi| / 2 with the largest |psi| as unit, so that inner and outer lobes are both seen.
    """
    z, y, x = (54.0 * axis for axis in _axes(resolution))  # in Bohr radii; the atom's axis is y
    radius = np.sqrt(x * x + y * y + z * z) + 1e-9
    rho = 2.0 * radius / n
    radial = np.exp(-rho / 2.0) * rho**l * genlaguerre(n - l - 1, 2 * l + 1)(rho)
    psi = radial * Legendre.basis(l)(y / radius)
    psi /= np.abs(psi).max()
    return (
        _image(0.5 + 0.5 * np.sign(psi) * np.sqrt(np.abs(psi))),
        _function((0.0, 0.36, 0.97, BLUE), (0.64, 1.0, 0.97, GOLD)),
    )


def plume(resolution: int = 112) -> Made:
    """The head of a starting plume: two layers of dye, rolled up by a vortex ring with nine waves.

    The flow is that of a thin ring, psi = sqrt((rho + R)^2 + z^2) ((1 - m / 2) K(m) - E(m)) / (2 pi) (Lamb 1932, art.
    161) with a smoothed core, seen from the ring. The waves are those of Widnall, Bliss and Tsai (1974).
    """
    ring, core, waves, height = 0.5, 0.25, 9, 0.06
    along, across, start_z, start_rho = _carried_back(ring, core)
    z, y, x = (1.1 * axis for axis in _axes(resolution))  # the ring's axis is y
    rho, angle = np.hypot(x, z), np.arctan2(z, x)
    near = np.clip(rho / ring, 0.0, 1.0) ** 2
    places = np.stack([
        (y - 0.1 + height * ring * near * np.sin(waves * angle) - along[0]) / (along[1] - along[0]),
        rho / (1.0 + 0.1 * near * np.cos(waves * angle)) / (across[1] - across[0]),
    ])  # fmt: skip
    z0, rho0 = (map_coordinates(start, places, order=1, mode="nearest") for start in (start_z, start_rho))
    depth = np.hypot(rho0, np.maximum(z0 + 0.1, 0.0)) / 0.6
    values = sum(0.5 / (1.0 + np.exp((depth - layer) / 0.05)) for layer in (0.55, 1.0))
    return _image(values), _function((0.2, 0.45, 0.03, BLUE), (0.62, 1.0, 0.97, CRIMSON))


def _carried_back(ring: float, core: float, time: float = 2.0, steps: int = 48) -> tuple[Array, Array, Array, Array]:
    """Return the half plane's axes z and rho, and where the fluid at their points came from."""
    across, along = np.linspace(1e-4, 1.6, 300), np.linspace(-2.4, 2.4, 600)
    z, rho = np.meshgrid(along, across, indexing="ij")
    far = (rho + ring) ** 2 + z * z + core * core
    m = 4.0 * rho * ring / far
    stream = np.sqrt(far) * ((1.0 - m / 2.0) * ellipk(m) - ellipe(m)) / (2.0 * np.pi)
    flow = np.gradient(stream, across, axis=1) / rho, -np.gradient(stream, along, axis=0) / rho
    own = (np.log(8.0 * ring / core) - 0.25) / (4.0 * np.pi * ring)  # the ring's own speed (Kelvin)

    def speed(z: Array, rho: Array) -> tuple[Array, Array]:
        places = np.stack([(z - along[0]) / (along[1] - along[0]), rho / (across[1] - across[0])])
        up, out = (np.clip(map_coordinates(one, places, order=1, mode="nearest"), -3.0, 3.0) for one in flow)
        return up - own, out

    step = time / steps
    for _ in range(steps):  # the midpoint method
        up, out = speed(z, rho)
        up, out = speed(z - 0.5 * step * up, np.abs(rho - 0.5 * step * out))
        z, rho = z - step * up, np.abs(rho - step * out)
    return along, across, z, rho


def _axes(resolution: int) -> tuple[Array, ...]:
    """Return coordinates z, y, x in [-1, 1], each (n, n, n)."""
    axis = np.linspace(-1.0, 1.0, resolution)
    return np.meshgrid(axis, axis, axis, indexing="ij")


def _image(values: Array) -> vtkImageData:
    spacing = 2.0 / (len(values) - 1)
    return from_array(values.astype(np.float32), (spacing,) * 3, (-1.0,) * 3, "value")


def _function(*ranges: tuple[float, float, float, Colour]) -> TransferFunction:
    """Return a function of visible ranges (low, high, opacity, colour), which rise and fall over a fifth of them."""
    colours, opacities = [], []
    for low, high, opacity, colour in ranges:
        rise = min(0.2 * (high - low), 0.06)
        inner = low if low == 0.0 else low + rise, high if high == 1.0 else high - rise
        colours += [(low, *colour), (high, *colour)]
        points = {low: opacity * (low == 0.0), inner[0]: opacity, inner[1]: opacity, high: opacity * (high == 1.0)}
        opacities += [(value, a, 0.5, 0.0) for value, a in sorted(points.items())]
    return TransferFunction(colours=tuple(colours), opacities=tuple(opacities))
