"""Position encodings behind one interface: a sparse vertex lattice (default) and a hash grid (the paper's).

An encoding maps box coordinates (S, 3) to features (S, width). Its backward pass adds to ``gradient`` and marks the
vertices it touched in ``used``; :class:`LatticeAdam` steps only those.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.core.rays.encodings import VERTICES_A_WORD
from svv.fields.radiance.layout_kernels import (
    coarser,
    into_cells,
    largest_in_cells,
    lay_out,
    rows_left,
    sum_levels,
    vertices_in,
)
from svv.kernels.dispatch import CPU, kernels_for
from svv.kernels.types import Context, Lattice

VERTICES_AT_A_TIME = 1 << 18
"""Vertices processed together, because millions at once would take hundreds of megabytes."""

ROWS_AT_A_TIME = 1 << 14
"""Rows of a table that are unpacked together, which stay in the cache."""


class _Asked(Context):
    x: Tensor
    encoding: Encoding


class _Lookup(torch.autograd.Function):
    """Features at positions; its backward pass fills the encoding's own gradient buffer."""

    @staticmethod
    def forward(ctx: _Asked, x: Tensor, table: Tensor, encoding: Encoding) -> Tensor:
        ctx.x, ctx.encoding = x, encoding
        return encoding.look_up(x)

    @staticmethod
    def backward(ctx: _Asked, gradient: Tensor) -> tuple[None, None, None]:
        ctx.encoding.add_gradient(ctx.x, gradient.contiguous())
        return None, None, None


class Encoding(nn.Module):
    """A table of features and the rule by which positions look them up."""

    table: nn.Parameter

    def __init__(self, rows: int, features: int, levels: int, device: torch.device = CPU) -> None:
        super().__init__()
        self.table = nn.Parameter(torch.zeros(rows, features, device=device))
        self.features, self.levels = features, levels
        self.gradient: Tensor | None = None
        self.used: Tensor | None = None

    @property
    def width(self) -> int:
        """Number of features of a position: levels x features per level."""
        return self.levels * self.features

    def packed(self) -> dict[str, NDArray[np.generic]]:
        """Return the table as files keep it: name -> array; here in half precision, under the empty name."""
        return {"": self.table.detach().cpu().numpy().astype(np.float16)}

    def unpacked(self, arrays: Mapping[str, NDArray[np.generic]]) -> Tensor:
        """Return the table from the result of :meth:`packed`, or from the full-precision numbers of a file. (V, F)

        Raises ValueError if the arrays do not have the table's shape.
        """
        return torch.from_numpy(arrays[""].astype(np.float32))

    def randomize(self, scale: float, generator: torch.Generator) -> None:
        """Fill the table with uniform numbers in [-scale, scale]."""
        with torch.no_grad():
            for rows in self.table.split(ROWS_AT_A_TIME):
                rows.copy_((torch.rand(rows.shape, generator=generator) * 2.0 - 1.0) * scale)

    def forward(self, x: Tensor) -> Tensor:
        """Return features (S, width) at box coordinates (S, 3), both float32."""
        if torch.is_grad_enabled() and self.table.requires_grad:
            return _Lookup.apply(x, self.table, self)
        return self.look_up(x)

    def buffers_for_gradient(self) -> tuple[Tensor, Tensor]:
        """Return the gradient (V, F) and the marks of used rows (V,) uint8, allocated when first needed on a device."""
        if self.gradient is None or self.used is None or self.gradient.device != self.table.device:
            self.gradient = torch.zeros_like(self.table, requires_grad=False)
            self.used = self.table.new_zeros(len(self.table), dtype=torch.uint8)
        return self.gradient, self.used

    def look_up(self, x: Tensor) -> Tensor:
        """Return features without a graph. (S, width)"""
        raise NotImplementedError

    def add_gradient(self, x: Tensor, gradient: Tensor) -> None:
        """Add the table's gradient for ``gradient`` (S, width) at ``x`` (S, 3) to the buffers."""
        raise NotImplementedError


class SparseLattice(Encoding):
    """Features on the vertices of occupied cells at several resolutions, interpolated trilinearly.

    Nothing is stored where nothing is visible, so positions must lie in occupied cells: elsewhere the kernels may read
    past the table. Vertices are numbered in raster order, so the kernels find the neighbour in z without a look-up.
    """

    shapes: Tensor
    bases: Tensor
    scales: Tensor
    index: Tensor

    def __init__(
        self,
        occupied: NDArray[np.uint8],
        cells: int,
        resolutions: Sequence[int],
        features: int,
        device: torch.device = CPU,
    ) -> None:
        """Lay out the vertices of cells that hold something visible (X, Y, Z), with ``features`` per level.

        ``cells``: those of ``occupied`` per box unit; ``resolutions``: those of each level, divisors or multiples.
        """
        levels = [_parts_of(occupied, cells, resolution) for resolution in resolutions]
        shapes = [_vertices_along(*level) for level in levels]
        bases = [0, *itertools.accumulate(x * y * _words_along(z) for x, y, z in shapes)]
        index, ends, rows = np.zeros(bases[-1], np.int64), [], 0
        for level, (x, y, _), base, end in zip(levels, shapes, bases, bases[1:], strict=False):
            rows += lay_out(*level, rows, index[base:end].reshape(x, y, -1))
            ends.append(rows)
        bases[-1] = max(rows - 2, 0)
        super().__init__(rows, features, len(resolutions), device)
        self.resolutions = tuple(int(r) for r in resolutions)
        self._ends = ends
        self.register_buffer("shapes", torch.tensor(shapes, device=device), persistent=False)
        self.register_buffer("bases", torch.tensor(bases, device=device), persistent=False)
        self.register_buffer("scales", torch.tensor(resolutions, dtype=torch.float32, device=device), persistent=False)
        self.register_buffer("index", torch.from_numpy(index).to(device), persistent=False)

    @property
    def layout(self) -> Lattice:
        """Layout of the features in the form that the kernels take."""
        return Lattice(self.shapes, self.scales, self.bases, self.index)

    def rows_of_level(self, level: int) -> slice:
        """Return the rows of the table that belong to a level."""
        return slice(self._ends[level - 1] if level else 0, self._ends[level])

    def vertices_of_level(self, level: int, occupied: NDArray[np.uint8], cells: int) -> NDArray[np.int64]:
        """Return integer coordinates of a level's vertices, in the order of its rows, for the lattice's cells."""
        return vertices_of(occupied, cells, self.resolutions[level])

    def pieces_of_level(
        self, level: int, occupied: NDArray[np.uint8], cells: int
    ) -> Iterator[tuple[slice, NDArray[np.int64]]]:
        """Yield rows of a level and the coordinates of their vertices, some at a time: millions take much memory."""
        (words, count), first = _words_of(occupied, cells, self.resolutions[level]), self.rows_of_level(level).start
        for start in range(0, count, VERTICES_AT_A_TIME):
            some = np.empty((min(VERTICES_AT_A_TIME, count - start), 3), np.int64)
            vertices_in(words, start, some)
            yield slice(first + start, first + start + len(some)), some

    def places_of_level(self, level: int, occupied: NDArray[np.uint8], cells: int) -> NDArray[np.float32]:
        """Return box coordinates for looking up a level's vertices, in the order of its rows. (V, 3)

        By its coordinates, a vertex on the far side of every occupied cell it belongs to lies in a cell that is not
        stored. Each vertex is therefore moved by one float32 step towards the middle of an occupied cell.
        """
        return places_of(occupied, cells, self.resolutions[level])

    def largest_in_cells(self, corner: Tensor, cells: int) -> Tensor | None:
        """Return the largest value in occupied cells with these indices. (C, 3) int64 -> (C,)

        Between vertices, no value is larger than at one of them. None if the vertices do not tell: of several levels or
        features, of cells finer than the lattice's, ``cells`` per box unit, and on a GPU.
        """
        if self.table.shape[1] * self.levels != 1 or self.resolutions[0] < cells or self.table.is_cuda:
            return None
        out, where, shape = torch.empty(len(corner)), self.layout, self.shapes[0].numpy()
        for some, largest in zip(corner.split(VERTICES_AT_A_TIME), out.split(VERTICES_AT_A_TIME), strict=True):
            largest_in_cells(
                some.contiguous().numpy(), self.resolutions[0] // cells, shape, where.index.numpy(),
                self.table.detach().numpy(), largest.numpy(),
            )  # fmt: skip
        return out

    def packed(self) -> dict[str, NDArray[np.generic]]:
        """Return the table as bytes: codes (V, F), and ``ends``, the range of each level's features (L, 2, F)."""
        table = self.table.detach().cpu()
        codes, ends = torch.empty(table.shape, dtype=torch.uint8), torch.zeros(self.levels, 2, self.features)
        for level in range(self.levels):
            rows = self.rows_of_level(level)
            if rows.start < rows.stop:
                low, high = ends[level] = torch.stack(torch.aminmax(table[rows], dim=0))
                codes[rows] = ((table[rows] - low) * (255.0 / (high - low).clamp(min=1e-12))).round().byte()
        return {"": codes.numpy(), ".ends": ends.numpy()}

    def unpacked(self, arrays: Mapping[str, NDArray[np.generic]]) -> Tensor:
        """Return the table before :meth:`packed`, to within half a 255th of a feature's range. (V, F)

        Raises ValueError if the arrays do not have this lattice's shape.
        """
        codes = arrays[""]
        if codes.dtype != np.uint8:
            return super().unpacked(arrays)
        ends = arrays[".ends"].astype(np.float32)
        if codes.shape != tuple(self.table.shape) or ends.shape != (self.levels, 2, self.features):
            raise ValueError(f"a table of {codes.shape} and {ends.shape} does not fit this lattice")
        table = torch.empty(codes.shape)
        for level, (low, high) in enumerate(torch.from_numpy(ends)):
            rows = self.rows_of_level(level)
            for start in range(rows.start, rows.stop, ROWS_AT_A_TIME):
                some = slice(start, min(start + ROWS_AT_A_TIME, rows.stop))
                part = torch.from_numpy(codes[some].astype(np.float32)).div_(255.0)
                torch.add(low * (1.0 - part), high * part, out=table[some])  # reproduces both ends exactly
        return table

    def look_up(self, x: Tensor) -> Tensor:
        return kernels_for(x).lattice_encode(x, self.layout, self.table)

    def add_gradient(self, x: Tensor, gradient: Tensor) -> None:
        kernels_for(x).lattice_backward(x, gradient, self.layout, *self.buffers_for_gradient())

    def restricted(self, occupied: NDArray[np.uint8], cells: int, finer: Sequence[int] = ()) -> SparseLattice:
        """Return the same features on fewer cells, followed by ``finer`` levels of zeros.

        ``occupied`` must be a subset of the cells this lattice was made for.
        """
        device, count = self.table.device, self.index.numel()
        result = SparseLattice(occupied, cells, (*self.resolutions, *finer), self.features, device)
        rows = np.empty(result.rows_of_level(self.levels - 1).stop, np.int64)
        if rows_left(self.index.cpu().numpy(), result.index[:count].cpu().numpy(), rows):
            raise ValueError("some of the cells are not those of this lattice")
        with torch.no_grad():
            torch.index_select(self.table, 0, torch.from_numpy(rows).to(device), out=result.table[: len(rows)])
        return result

    def summed(self, occupied: NDArray[np.uint8], cells: int) -> SparseLattice:
        """Return a lattice of only the finest level that gives exactly the sum of all levels' features.

        Resolutions are nested, so within a fine cell every coarser level is itself trilinear: its values at the fine
        vertices determine it. ``occupied`` must be a subset of the cells this lattice was made for.
        """
        if self.levels == 1:
            return self.restricted(occupied, cells)
        finest, device = self.resolutions[-1], self.table.device
        result = SparseLattice(occupied, cells, (finest,), self.features, device)
        total, (words, _) = np.zeros(result.table.shape, np.float32), _words_of(occupied, cells, finest)
        steps = np.array([finest // resolution for resolution in self.resolutions])
        layout = self.shapes, torch.from_numpy(steps), self.bases, self.index, self.table.detach()
        sum_levels(words, *(tensor.cpu().numpy() for tensor in layout), total)
        with torch.no_grad():
            result.table.copy_(torch.from_numpy(total))
        return result


class HashGrid(Encoding):
    """Multiresolution hash encoding (Müller et al. 2022), the encoding of the preset ``paper``."""

    resolutions: Tensor
    offsets: Tensor

    def __init__(self, levels: int = 16, features: int = 2, log2_entries: int = 19, coarsest: int = 16,
                 finest: int = 4096) -> None:  # fmt: skip
        growth = (finest / coarsest) ** (1.0 / max(levels - 1, 1))
        resolutions = [int(np.floor(coarsest * growth**k + 1e-6)) for k in range(levels)]
        entries = [min((r + 1) ** 3, 2**log2_entries) for r in resolutions]
        super().__init__(sum(entries), features, levels)
        self.register_buffer("resolutions", torch.tensor(resolutions), persistent=False)
        self.register_buffer("offsets", torch.tensor([0, *itertools.accumulate(entries)]), persistent=False)

    def look_up(self, x: Tensor) -> Tensor:
        return kernels_for(x).hash_encode(x, self.resolutions, self.offsets, self.table)

    def add_gradient(self, x: Tensor, gradient: Tensor) -> None:
        # Most samples of an opaque scene are hidden, and scattering zeros would take as long as scattering numbers.
        rows = gradient.any(dim=1).nonzero()[:, 0]
        buffers = self.buffers_for_gradient()
        kernels_for(x).hash_backward(x[rows], gradient[rows], self.resolutions, self.offsets, *buffers)


class LatticeAdam:
    """Adam (Kingma & Ba 2015) that steps only the rows that the last backward pass used."""

    def __init__(self, encodings: Iterable[Encoding], beta1: float = 0.9, beta2: float = 0.99,
                 epsilon: float = 1e-12) -> None:  # fmt: skip
        self.constants = beta1, beta2, epsilon
        self.moments: list[Tensor] = []
        self.age: list[Tensor] = []
        self.restart(encodings)

    def restart(self, encodings: Iterable[Encoding]) -> None:
        """Optimise these encodings from now on, from a fresh state; a checkpoint that holds the optimiser follows."""
        self.encodings = list(encodings)
        self.finer = [e.rows_of_level(0).stop if isinstance(e, SparseLattice) else 0 for e in self.encodings]
        self.forget()
        self.moments = [e.table.new_zeros(2, *e.table.shape) for e in self.encodings]
        self.age = [e.table.new_zeros(len(e.table), dtype=torch.int32) for e in self.encodings]

    def forget(self) -> None:
        """Free the state of the tables that were optimised, which have been replaced or are as they should be."""
        self.moments, self.age = [], []
        for encoding in self.encodings:
            encoding.gradient = encoding.used = None

    def step(self, rates: Sequence[float | Tensor], pulls: Sequence[float | Tensor] | None = None) -> None:
        """Take one step with a learning rate for each encoding, and clear the gradients it used.

        ``pulls``: weight in the loss of half the squared values of finer levels, by default 0; numbers, or tensors
        (1,).
        """
        pulls = [0.0] * len(self.encodings) if pulls is None else pulls
        for k, (encoding, rate) in enumerate(zip(self.encodings, rates, strict=True)):
            table = encoding.table.detach()
            kernels_for(table).adam(table, *encoding.buffers_for_gradient(), self.moments[k], self.age[k], rate,
                                    self.constants, pulls[k], self.finer[k])  # fmt: skip

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return moments, ages and constants, for a checkpoint."""
        moments = {f"{k}.moments": v.cpu().numpy() for k, v in enumerate(self.moments)}
        ages = {f"{k}.age": v.cpu().numpy() for k, v in enumerate(self.age)}
        return {"constants": np.array(self.constants), **moments, **ages}

    def load(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Restore the state returned by an earlier :meth:`state`."""
        if "constants" in state:
            self.constants = tuple(state["constants"].tolist())
        for k in range(len(self.encodings)):
            self.moments[k].copy_(torch.from_numpy(state[f"{k}.moments"].copy()))
            self.age[k].copy_(torch.from_numpy(state[f"{k}.age"].copy()))


def _parts_of(occupied: NDArray[np.uint8], cells: int, resolution: int) -> tuple[NDArray[np.uint8], int]:
    """Return the occupied cells of a level, or of a coarser one, and into how many parts these are to be divided.

    A cell that is coarser than those given is occupied if any of its parts is.
    """
    given = np.ascontiguousarray(occupied, np.uint8)
    if resolution >= cells:
        if resolution % cells:
            raise ValueError(f"resolution {resolution} is not a multiple of {cells}")
        return given, resolution // cells
    if cells % resolution:
        raise ValueError(f"resolution {resolution} does not divide {cells}")
    side = cells // resolution
    out = np.zeros([-(-n // side) for n in given.shape], np.uint8)
    coarser(given, side, out)
    return out, 1


def _vertices_along(cells: NDArray[np.uint8], parts: int) -> tuple[int, ...]:
    """Return the number of vertices along each axis; see :func:`_parts_of`."""
    return tuple(parts * n + 1 for n in cells.shape)


def _words_along(vertices: int) -> int:
    return -(-vertices // VERTICES_A_WORD)


def _words_of(occupied: NDArray[np.uint8], cells: int, resolution: int) -> tuple[NDArray[np.int64], int]:
    """Return the words of a level's index, as if it were the only level, (X, Y, W), and the number of its vertices."""
    level = _parts_of(occupied, cells, resolution)
    x, y, z = _vertices_along(*level)
    words = np.zeros((x, y, _words_along(z)), np.int64)
    return words, lay_out(*level, 0, words)


def vertices_of(occupied: NDArray[np.uint8], cells: int, resolution: int) -> NDArray[np.int64]:
    """Return integer coordinates of the vertices that a lattice of this resolution has, in raster order. (V, 3)"""
    words, count = _words_of(occupied, cells, resolution)
    out = np.empty((count, 3), np.int64)
    vertices_in(words, 0, out)
    return out


def places_of(
    occupied: NDArray[np.uint8], cells: int, resolution: int, vertices: NDArray[np.int64] | None = None
) -> NDArray[np.float32]:
    """Return box coordinates for looking up vertices of a resolution. (V, 3)

    They are moved as by ``SparseLattice.places_of_level``. ``vertices`` (V, 3): integer coordinates, by default all
    from :func:`vertices_of`.
    """
    chosen = vertices_of(occupied, cells, resolution) if vertices is None else vertices
    level = _parts_of(occupied, cells, resolution)
    at = np.arange(max(_vertices_along(*level)))
    own, *beside = ((at + part) / resolution for part in (0.0, 0.5, -0.5))
    ahead, behind = (np.nextafter(own.astype(np.float32), middle.astype(np.float32)) for middle in beside)
    out = np.empty((len(chosen), 3), np.float32)
    into_cells(*level, chosen, ahead, behind, out)
    return out
