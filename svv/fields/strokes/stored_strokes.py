"""Strokes that a scene keeps: its lattice of paint follows from them, and large images show them at any size.

Letters: V vertices of the paint's lattice, S samples, R regions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.strokes.strokes import Brush, Floats, Strokes
from svv.errors import Progress, silent
from svv.fields.strokes.lives import Lives
from svv.fields.strokes.stroke_paint import StrokePaint
from svv.kernels.constants import on_device
from svv.kernels.dispatch import kernels_for
from svv.kernels.numba import sheets as numba_sheets
from svv.kernels.types import Samples, StrokeKernels

NOBODY = 255
"""Owner of vertices that no painted region has."""

AT_A_TIME = 1 << 17
"""Vertices that are painted between two reports of progress."""

GAP, STEPS = 0.35, 1.5
"""Distance of two samples along a ray that separates sheets: in widths of a stroke, and at least in sample steps."""


@dataclass(eq=False)
class Brushed:
    """What is known about a painting by strokes."""

    regions: Mapping[int, tuple[Strokes, Brush]]
    """Strokes of regions."""
    owners: Callable[[], NDArray[np.uint8]] | NDArray[np.uint8] | None = None
    """Region of each vertex, :data:`NOBODY` for none, (V,), or a function that finds them when they are first needed:
    images do without. None if the lattice also has other paint."""
    flats: Floats = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    """Colour of each region where no stroke reaches, RGB. (R, 3)"""
    glazes: Mapping[int, float] = field(default_factory=dict)
    """How much the opacity of translucent regions is to follow their strokes. Only known when they are laid: the scene
    keeps it as an edit of the region (:mod:`svv.fields.scene.stroke_opacity`)."""
    lives: Mapping[int, Lives] = field(default_factory=dict)
    """When the strokes of regions live, in a scene with time steps that was followed."""
    _paints: dict[int, StrokePaint] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether the lattice follows from the strokes."""
        return self.owners is not None

    @property
    def owner(self) -> NDArray[np.uint8] | None:
        """Region of each vertex, :data:`NOBODY` for none; None if the lattice also has other paint. (V,)"""
        if callable(self.owners):
            self.owners = self.owners()
        return self.owners

    def paint(self, region: int, soft: float) -> StrokePaint:
        """Return the paint of a region for cells or pixels of a size, in box units; the last one is remembered."""
        known = self._paints.get(region)
        if known is None or abs(known.soft - soft) > 1e-3 * soft:
            self._paints[region] = known = StrokePaint(*self.regions[region], soft, known)
        return known

    def baked(
        self, place: Floats, cell: float, progress: Progress = silent, known: tuple[Brushed, Floats] | None = None
    ) -> Floats:
        """Return the colours of vertices at box coordinates (V, 3) of a lattice with cells of a side. (V, 3)

        ``progress`` is called several times a second; ``known``: another painting and its colours (V, 3), from which
        regions with the same strokes are copied.
        """
        owner = self.owner
        assert owner is not None
        grey = np.full((NOBODY + 1 - len(self.flats), 3), 0.5, np.float32)
        colours = np.concatenate([self.flats, grey])[owner]
        for number, region in enumerate(self.regions):
            mine = owner == region
            if known is not None and known[0].regions.get(region) is self.regions[region]:
                colours[mine] = known[1][mine]
                continue
            paint = self.paint(region, cell)
            own = np.flatnonzero(mine & paint.is_near(place))
            for first in range(0, len(own), AT_A_TIME):
                progress((number + first / len(own)) / len(self.regions), "painting")
                piece = own[first : first + AT_A_TIME]
                colours[piece] = paint(place[piece]).clip(0.0, 1.0)
        return np.asarray(colours, np.float32)

    def over(
        self, colours: Tensor | None, samples: Samples, region: Tensor, roots: Mapping[int, int],
        wholes: Sequence[int], pixel: float,
    ) -> Tensor:  # fmt: skip
        """Return colours (S, 3) of samples with the strokes over them; a sheet of samples has one colour.

        ``colours``: those of the lattice, where no stroke reaches; None if all paint is strokes, so that it is not
        needed; ``region`` of each sample (S,); ``roots``: region with strokes -> region whose strokes it has: parts
        that were split off have the whole's; ``wholes``: for each region of the scene, the region of which it is a
        part, or itself; ``pixel``: its width in box units.
        """
        kernels = kernels_for(region).STROKES
        if kernels is not None:
            return self.over_there(kernels, colours, samples, region, roots, wholes, pixel)
        numbers = region.cpu().numpy()
        sheet, where = sheets_of(samples, numbers, self._gaps(roots, wholes, samples.step))
        of_sheet = np.empty(len(where), np.int64)
        of_sheet[sheet[sheet >= 0]] = numbers[sheet >= 0]
        covered = np.zeros((len(where), 4), np.float32)
        for own, root in roots.items():
            theirs = np.flatnonzero(of_sheet == own)
            covered[theirs] = self.paint(root, pixel).over_ground(where[theirs])
        out = self._flats(wholes)[numbers] if colours is None else np.array(colours.cpu().numpy())
        numba_sheets.cover(sheet, covered, out)
        return torch.from_numpy(out).to(region.device)

    def over_there(
        self, kernels: StrokeKernels, colours: Tensor | None, samples: Samples, region: Tensor,
        roots: Mapping[int, int], wholes: Sequence[int], pixel: float,
    ) -> Tensor:  # fmt: skip
        """Do what :meth:`over` does, by the kernels of the samples' device, to which only small tables are copied."""
        device, flat = region.device, colours is None
        below = on_device(self._flats(wholes), device) if colours is None else colours.contiguous()
        chosen, gaps = np.array(list(roots), np.int64), self._gaps(roots, wholes, samples.step)
        tables = [self.paint(root, pixel).on(device) for root in roots.values()]
        apart = on_device(gaps[chosen], device)
        return kernels.over(samples, region, on_device(chosen, device), apart, tables, below, flat)

    def _gaps(self, roots: Mapping[int, int], wholes: Sequence[int], step: float) -> NDArray[np.float64]:
        """Return the gap that separates sheets of each region, 0 for a region without strokes."""
        apart = np.zeros(len(wholes))
        for own, root in roots.items():
            apart[own] = max(GAP * self.width(root), STEPS * step)
        return apart

    def _flats(self, wholes: Sequence[int]) -> Floats:
        """Return the colour of each region, of which some are parts of others, where no stroke reaches. (regions, 3)"""
        return np.stack([self.flats[k if k < len(self.flats) else whole] for k, whole in enumerate(wholes)])

    def width(self, region: int) -> float:
        """Return the usual width of a region's strokes, in box units."""
        return 2.0 * float(np.median(self.regions[region][0].radius))

    def to_file(self, name: str) -> tuple[dict[str, Any], dict[str, NDArray[np.generic]]]:
        """Return plain values and arrays of a file, for a network of this name."""
        told = {
            "regions": {str(k): vars(brush) for k, (_, brush) in self.regions.items()},
            "flats": self.flats.tolist(),
            "complete": self.complete,
        }
        arrays = {
            f"brushed.{name}.{k}.{key}": array
            for k, (strokes, _) in self.regions.items()
            for key, array in strokes.packed().items()
        }
        for k, lives in self.lives.items():
            arrays |= {f"brushed.{name}.{k}.{key}": array for key, array in lives.to_arrays().items()}
        if (owner := self.owner) is not None:
            arrays[f"brushed.{name}.owner"] = owner[:, None]
        return told, arrays

    @classmethod
    def from_file(
        cls, name: str, told: Mapping[str, Any], tensors: Mapping[str, NDArray[np.generic]], vertices: int
    ) -> Brushed:
        """Invert :meth:`to_file`; raises KeyError, TypeError or ValueError if the content does not fit."""
        regions, every = {}, {}
        for key, brush in told["regions"].items():
            start = f"brushed.{name}.{int(key)}."
            own = {k.removeprefix(start): v for k, v in tensors.items() if k.startswith(start)}
            regions[int(key)] = Strokes.unpacked(own), Brush.from_json(brush)
            if (lives := Lives.from_arrays(own, len(regions[int(key)][0]))) is not None:
                every[int(key)] = lives
        flats = np.asarray(told["flats"], np.float32).reshape(-1, 3)
        owner: NDArray[np.uint8] | None = None
        if told["complete"]:
            there = tensors[f"brushed.{name}.owner"].reshape(-1)
            if there.dtype != np.uint8 or len(there) != vertices:
                raise ValueError("the owners of paint do not fit the lattice")
            owner = there.astype(np.uint8, copy=False)
        if not all(0 <= k < NOBODY for k in regions) or len(flats) > NOBODY:
            raise ValueError("strokes belong to regions that cannot be")
        return cls(regions, owner, flats, lives=every)


def sheets_of(
    samples: Samples, region: NDArray[np.int64], apart: NDArray[np.float64]
) -> tuple[NDArray[np.int64], Floats]:
    """Return each sample's sheet, -1 for none (S,), and mean positions (K, 3); see :mod:`svv.core.rays.sheets`."""
    position, sigma, skipped, start, count = (
        getattr(samples, name).cpu().numpy() for name in ("position", "sigma", "skipped", "start", "count")
    )
    number = np.empty(len(start), np.int64)
    numba_sheets.count_sheets(position, start, count, region, apart, number)
    own, where = np.empty(len(position), np.int64), np.empty((int(number.sum()), 4))
    first = np.cumsum(number) - number
    numba_sheets.sheets(position, sigma, skipped, samples.step, start, count, region, apart, first, own, where)
    return own, np.ascontiguousarray(where[:, :3], np.float32)
