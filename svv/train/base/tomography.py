"""Extinction from the alpha of views, by transmission tomography: the start of training without a volume.

The optical depth of a pixel, -ln(1 - alpha), is the integral of the extinction along its ray (Max 1995): a linear
system, whatever the colours are. A step multiplies the extinction at each vertex by (A^T W y) / (A^T W A sigma): the
image space reconstruction algorithm (Daube-Witherspoon & Muehllehner 1986), which keeps it positive, with ordered
subsets of the views (Hudson & Larkin 1994). A integrates along rays, y are optical depths, W = (1 - alpha)^2 turns
their errors into those of alpha, and A^T interpolates the images where they show the vertex. It goes from coarse to
fine, with pixels about as large as the cells. Letters: N views, R rays, V vertices.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import avg_pool2d, max_pool2d

from svv.core.geometry.cameras import Camera
from svv.core.rays.extinction import (
    EMPTY_LOG_EXTINCTION,
    LEAST_LOG_EXTINCTION,
    MOST_LOG_EXTINCTION,
    OPAQUE_LOG_EXTINCTION,
)
from svv.errors import Progress
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import RayCaster
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU
from svv.kernels.numba.bricks import MOST_ROOM, made
from svv.kernels.types import TomographyKernels
from svv.measure import usable_cpus
from svv.train.base.tomography_kernels import back_project, beside_visible, mean_of_squares, optical_depths
from svv.train.run.views_there import views_on

Array = NDArray[np.float32]

COARSEST = 32
"""Cells per box unit of the first lattice."""

ROUNDS = (3, 3, 2)
"""How often all views are used with the first, the second, and each finer lattice."""

OPAQUE_ROUNDS = (2, 2, 1)
"""The same for views of mostly opaque scenes, whose finest lattice is interpolated: training refines it in any case."""

MOSTLY = 0.5
"""Part of the visible pixels that must be opaque for a tomography to count as a guess."""

VIEWS_A_STEP, OPAQUE_VIEWS_A_STEP = 4, 8
"""Number of views in one subset, and in one of mostly opaque views, of whose pixels few tell."""

COMPARED = 8
"""Number of views whose alpha is compared in the end."""

LARGEST_CHANGE = 1.5
"""Largest change of a log extinction in one step."""

LEAST_DEPTH = 0.5 / 255.0
"""Transmittance that an opaque pixel is taken to have: half a level, so its optical depth is finite."""

OPAQUE = 254.0 / 255.0
"""Alpha from which a pixel only says that its ray is at least that opaque."""

LEAST_WEIGHT = 1e-5
"""Smallest weight of a pixel."""

START = 1.0
"""Log extinction of the fog from which the reconstruction starts."""

STOP = 9.0
"""Optical depth at which rays end."""


class Tomography:
    """Reconstructs the log extinction on the vertices of a lattice, level by level."""

    device = CPU
    """Where the lattice and the rays lie."""

    def __init__(self, views: ViewSet, occupancy: Occupancy, seed: int) -> None:
        """Start from a fog in the occupied cells; ``seed`` is that of the subsets and of the samples' shifts."""
        self.occupancy = occupancy
        self._views, self._random = views, np.random.default_rng(seed)
        self._half = not mostly_opaque(views)  # an opaque pixel tells little, so that those that tell more are needed
        self.lattice = self._fog(COARSEST)

    def _fog(self, resolution: int) -> SparseLattice:
        lattice = SparseLattice(self.occupancy.occupied, self.occupancy.cells, (resolution,), 1, self.device)
        lattice.requires_grad_(False).table.fill_(START)
        return lattice

    def refine(self, occupancy: Occupancy, resolution: int) -> None:
        """Continue with a finer lattice on fewer cells."""
        coarse, self.occupancy = self.lattice, occupancy
        self.lattice = self._fog(resolution)
        places = self.lattice.places_of_level(0, occupancy.occupied, occupancy.cells)
        self.lattice.table.copy_(coarse(torch.from_numpy(places).to(self.device)))

    def rounds(self, count: int, step_done: Callable[[], bool]) -> None:
        """Use all views ``count`` times; ``step_done`` is called after each step, and False ends the rounds."""
        views, occupancy = self._views, self.occupancy
        factor = pixels_a_cell(views.cameras, occupancy, self.lattice.resolutions[0])
        vertices = self._vertices()
        cameras = [smaller(camera, factor) for camera in views.cameras]
        subsets = subsets_of(len(cameras), not self._half)
        for _ in range(count):
            for subset in np.array_split(self._random.permutation(len(cameras)), subsets):
                caster = RayCaster([cameras[n] for n in subset], occupancy.box, self.device)
                # Of all views at once, it would be as large as the pictures themselves.
                self._step(caster, self._reduced(subset, factor), vertices)
                if not step_done():
                    return

    def _reduced(self, which: NDArray[np.int64], factor: int) -> Any:
        """Return the alpha of some views, averaged over squares of pixels (:func:`reduced`)."""
        return reduced(self._views.images[which, ..., 3], factor)

    def _vertices(self) -> Any:
        """Return integer coordinates of the lattice's vertices, int32. (V, 3)"""
        return self.lattice.vertices_of_level(0, self.occupancy.occupied, self.occupancy.cells).astype(np.int32)

    def _step(self, caster: RayCaster, alpha: Array, vertices: NDArray[np.int32]) -> None:
        """Multiply the extinction by what the alpha (N, H, W) of a subset of views suggests."""
        # Like the squares of one colour on a chessboard: wherever a vertex is seen, two of the four pixels around it
        # are among them, and the sums only count these.
        near, odd = np.empty(alpha.shape, np.uint8), int(self._random.integers(2)) if self._half else -1
        beside_visible(alpha, odd, near)
        rows = np.flatnonzero(near)
        seen = self._optical_depths(caster, torch.from_numpy(rows))
        told = alpha.reshape(-1)[rows]
        depth = -np.log(np.maximum(1.0 - told, LEAST_DEPTH, dtype=np.float32))
        weight = np.square(1.0 - told) + np.float32(LEAST_WEIGHT)
        weight[(told >= OPAQUE) & (seen > depth)] = 0.0  # more than opaque is not wrong
        images = np.zeros((alpha.size, 2), np.float32)
        images[rows] = np.stack([weight * depth, weight * seen], axis=1)
        sums, lattice = np.empty((len(vertices), 2), np.float32), self.lattice
        geometry = (t.numpy() for t in caster.cameras)
        scale = np.float32(lattice.resolutions[0])
        back_project(vertices, scale, *geometry, images.reshape(*alpha.shape, 2), sums)
        change = np.log((sums[:, 0] + LEAST_WEIGHT) / (sums[:, 1] + LEAST_WEIGHT))
        table = lattice.table[:, 0]
        table += torch.from_numpy(change.clip(-LARGEST_CHANGE, LARGEST_CHANGE))
        table.clamp_(LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION)

    def _optical_depths(self, caster: RayCaster, pixels: Tensor) -> Array:
        """Return the optical depth of pixels (R,) of the caster's views."""
        rays, occupancy, layout = caster.rays(pixels), self.occupancy, self.lattice.layout
        out, table = np.empty(len(pixels), np.float32), self.lattice.table[:, 0].numpy()
        optical_depths(
            rays.origins.numpy(), rays.directions.numpy(), occupancy.distance_on(CPU).numpy(),
            np.float32(occupancy.cells), np.asarray(occupancy.box.extent, np.float32),
            np.float32(1.0 / self.lattice.resolutions[0]), np.float32(self._random.random()),
            layout.shapes.numpy(), layout.scales.numpy(), layout.bases.numpy(), layout.index.numpy(),
            table, np.float32(STOP), out, made(layout, table, MOST_ROOM),
        )  # fmt: skip
        return out

    def agreement(self) -> float:
        """Return the PSNR in dB of the alpha of some views, as large as used last, from a quarter of their pixels."""
        views, resolution = self._views, self.lattice.resolutions[0]
        factor = pixels_a_cell(views.cameras, self.occupancy, resolution)
        some = np.arange(0, len(views), max(1, len(views) // COMPARED))
        alpha = self._reduced(some, factor)
        caster = RayCaster([smaller(views.cameras[n], factor) for n in some], self.occupancy.box, self.device)
        return -10.0 * float(np.log10(max(self._error(caster, alpha), 1e-12)))

    def _error(self, caster: RayCaster, alpha: Any) -> float:
        """Return the mean squared error of the alpha of the caster's views, from a quarter of their pixels."""
        pixels = np.arange(alpha.size).reshape(alpha.shape)[:, ::2, ::2].ravel()
        seen = self._optical_depths(caster, torch.from_numpy(pixels))
        return float(np.square(1.0 - np.exp(-seen) - alpha.reshape(-1)[pixels]).mean())


def planned(levels: int, opaque: bool) -> list[int]:
    """Return how often all views are used with each of some lattices, from the coarsest to the finest."""
    rounds = OPAQUE_ROUNDS if opaque else ROUNDS
    plan = [rounds[min(k, len(rounds) - 1)] for k in range(levels)]
    return [*plan[:-1], 0] if opaque and levels > 1 else plan


def subsets_of(views: int, opaque: bool) -> int:
    """Return the number of subsets in which all views are used once."""
    return max(1, round(views / (OPAQUE_VIEWS_A_STEP if opaque else VIEWS_A_STEP)))


_MOSTLY_OPAQUE: WeakKeyDictionary[ViewSet, bool] = WeakKeyDictionary()


def mostly_opaque(views: ViewSet) -> bool:
    """Return whether so many visible pixels are opaque that a tomography is only a guess; pixels are counted once."""
    if views not in _MOSTLY_OPAQUE:
        _MOSTLY_OPAQUE[views] = opaque_part(views.images[..., 3]) > MOSTLY
    return _MOSTLY_OPAQUE[views]


def opaque_part(alpha: NDArray[np.uint8]) -> float:
    """Return which part of the visible pixels is opaque, from the alpha of views, 0 to 255. (N, height, width)"""

    def counted(image: NDArray[np.uint8]) -> tuple[int, int]:
        return int(np.count_nonzero(image >= round(255 * OPAQUE))), int(np.count_nonzero(image))

    with ThreadPoolExecutor(usable_cpus()) as pool:
        opaque, visible = np.sum(list(pool.map(counted, alpha)), axis=0).tolist()
    return float(opaque / max(visible, 1))


def extinction_from(
    views: ViewSet,
    occupancy: Occupancy,
    finest: int,
    pruned: Callable[[SparseLattice, Occupancy, bool], Occupancy],
    seed: int,
    progress: Progress,
    limit: float | None = None,
    work: Tomography | None = None,
) -> tuple[SparseLattice, Occupancy, str]:
    """Return the log extinction that has the views' alpha, its occupied cells, and how well they agree with the views.

    ``finest`` is its cells per box unit, a power of two. ``pruned`` returns the occupancy without the cells in which a
    log extinction is nowhere visible; its last argument says whether to keep their neighbours. After ``limit`` seconds
    no more steps are taken, and after twice as many, cells are not refined any further. ``work`` takes the steps, by
    default on the CPU.
    """
    levels = [COARSEST]
    while levels[-1] < finest:
        levels.append(2 * levels[-1])
    opaque = mostly_opaque(views)
    work, end = work or Tomography(views, occupancy, seed), None if limit is None else time.monotonic() + limit
    plan = planned(len(levels), opaque)
    # A round costs about eight times as much with cells half as large; the last ones are nearly all of the time.
    shares = np.cumsum([0.0, *(count * 4.0**k for k, count in enumerate(plan))])
    for k, (resolution, count) in enumerate(zip(levels, plan, strict=True)):
        if k and limit is not None and end is not None and time.monotonic() > end + limit:
            break  # finer cells of a scene that fills its box would take many times the limit
        if k:
            work.refine(pruned(work.lattice, work.occupancy, True), resolution)
        steps = count * subsets_of(len(views), opaque)
        done = 0

        def step_done(first: float = shares[k], last: float = shares[k + 1], steps: int = steps) -> bool:
            nonlocal done
            done += 1
            progress((first + (last - first) * done / steps) / shares[-1], "extinction from the views' alpha")
            return end is None or time.monotonic() < end

        if count:
            work.rounds(count, step_done)
    agreement = work.agreement()
    last = pruned(work.lattice, work.occupancy, False)
    lattice = work.lattice.restricted(last.occupied, last.cells).requires_grad_(False).to(CPU)
    lattice.table.clamp_(EMPTY_LOG_EXTINCTION, OPAQUE_LOG_EXTINCTION)
    return lattice, last, f"tomography finds an extinction that has the alpha of the views to {agreement:.1f} dB"


def pixels_a_cell(cameras: Sequence[Camera], occupancy: Occupancy, resolution: int) -> int:
    """Return how many pixels a cell of a lattice measures in the views, at least 1 and at most an eighth of a view."""
    centre = occupancy.box.bounds.mean(axis=0)
    away = [float(np.linalg.norm(camera.position - centre)) for camera in cameras]
    pixel = float(np.median([c.pixel_at(d) for c, d in zip(cameras, away, strict=True)])) / occupancy.box.size
    return int(np.clip(round(1.0 / (resolution * pixel)), 1, max(1, min(cameras[0].width, cameras[0].height) // 8)))


def reduced(alpha: NDArray[np.uint8], factor: int) -> Array:
    """Return alpha in [0, 1], averaged over squares of pixels: (N, H, W) -> (N, H // factor, W // factor)."""
    n, height, width = len(alpha), alpha.shape[1] // factor, alpha.shape[2] // factor
    out = np.empty((n, height, width), np.float32)
    mean_of_squares(alpha, factor, out)
    return out


def smaller(camera: Camera, factor: int) -> Camera:
    """Return a camera whose pixels are squares of ``factor`` pixels of another camera (:func:`reduced`)."""
    width, height = camera.width // factor, camera.height // factor
    column, row = camera.principal_point
    part = width * factor / camera.width
    return replace(
        camera, width=width, height=height, centre=(column / factor, row / factor),
        fov_x=2.0 * float(np.arctan(part * np.tan(0.5 * camera.fov_x))),
        span_x=None if camera.span_x is None else part * camera.span_x,
    )  # fmt: skip


class TomographyThere(Tomography):
    """Reconstructs the log extinction by kernels of a device."""

    def __init__(
        self, views: ViewSet, occupancy: Occupancy, seed: int, kernels: TomographyKernels, device: torch.device
    ) -> None:
        """Start from a fog; ``kernels`` are those of the ``device``."""
        self.kernels, self.device = kernels, device
        super().__init__(views, occupancy, seed)
        known = views_on(views, device)
        self._alpha = torch.from_numpy(views.images[..., 3]).to(device) if known is None else known.alpha

    def _reduced(self, which: NDArray[np.int64], factor: int) -> Any:
        own = self._alpha[torch.from_numpy(which).to(self.device)]
        parts = [avg_pool2d(piece[:, None].float(), factor)[:, 0] for piece in own.split(8)]
        return torch.cat(parts) / 255.0

    def _vertices(self) -> Any:
        return torch.from_numpy(np.ascontiguousarray(super()._vertices())).to(self.device)

    def _step(self, caster: RayCaster, alpha: Any, vertices: Any) -> None:
        near = max_pool2d((alpha > 0).float()[:, None], 3, 1, 1)
        rows = near.flatten().nonzero()[:, 0]
        seen, told = self._seen(caster, rows), alpha.reshape(-1)[rows]
        depth = -(1.0 - told).clamp(min=LEAST_DEPTH).log()
        weight = (1.0 - told).square() + LEAST_WEIGHT
        weight = torch.where((told >= OPAQUE) & (seen > depth), 0.0, weight)  # more than opaque is not wrong
        images = torch.zeros(alpha.numel(), 2, device=self.device)
        images[rows] = torch.stack([weight * depth, weight * seen], dim=1)
        sums = self.kernels.back_project(
            vertices, float(self.lattice.resolutions[0]), caster.cameras, images.view(*alpha.shape, 2)
        )
        change = ((sums[:, 0] + LEAST_WEIGHT) / (sums[:, 1] + LEAST_WEIGHT)).log()
        table = self.lattice.table[:, 0]
        table += change.clamp(-LARGEST_CHANGE, LARGEST_CHANGE)
        table.clamp_(LEAST_LOG_EXTINCTION, MOST_LOG_EXTINCTION)

    def _seen(self, caster: RayCaster, pixels: Tensor) -> Tensor:
        """Return the optical depth of pixels (R,) of the caster's views."""
        rays, occupancy = caster.rays(pixels), self.occupancy
        return self.kernels.optical_depths(
            (rays.origins, rays.directions), occupancy.distance_on(self.device), occupancy.cells,
            occupancy.box.extent, 1.0 / self.lattice.resolutions[0], self._random.random(), self.lattice.layout,
            self.lattice.table, STOP,
        )  # fmt: skip

    def _error(self, caster: RayCaster, alpha: Any) -> float:
        seen = self._seen(caster, torch.arange(alpha.numel(), device=self.device))
        return float((1.0 - (-seen).exp() - alpha.reshape(-1)).square().mean())
