"""Position encodings behind one interface: a sparse vertex lattice (default) and a hash grid (the paper's).

An encoding is a module that maps box coordinates (S, 3) to features (S, width). The kernels of its device read and
write its table: the backward pass adds to ``gradient`` and marks the vertices it touched in ``used``, and
:class:`LatticeAdam` then steps only those. Plain references are in :mod:`svv.core.rays.encodings`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.core.rays.encodings import VERTICES_A_WORD, stored_rows
from svv.kernels.dispatch import kernels_for
from svv.kernels.types import Context, Lattice

VERTICES_AT_A_TIME = 1 << 18
"""Vertices processed together, because millions at once would take hundreds of megabytes."""


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

    def __init__(self, rows: int, features: int, levels: int) -> None:
        super().__init__()
        self.table = nn.Parameter(torch.zeros(rows, features))
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

        Raises:
            ValueError: The arrays do not have the table's shape.
        """
        return torch.from_numpy(arrays[""].astype(np.float32))

    def randomize(self, scale: float, generator: torch.Generator) -> None:
        """Fill the table with uniform numbers in [-scale, scale]."""
        with torch.no_grad():
            self.table.copy_((torch.rand(self.table.shape, generator=generator) * 2.0 - 1.0) * scale)

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

    def __init__(self, occupied: NDArray[np.uint8], cells: int, resolutions: Sequence[int], features: int) -> None:
        """Lay out the lattice.

        Args:
            occupied: Cells that hold something visible. (X, Y, Z)
            cells: Cells per box unit of ``occupied``.
            resolutions: Cells per box unit of each level; each divides ``cells`` or is a multiple of it.
            features: Features per level.
        """
        shapes, bases, ends, rows = [], [], [], 0
        index: list[NDArray[np.int64]] = []
        for resolution in resolutions:
            vertices = _vertices(_resample(occupied, cells, resolution))
            words, count = _index_of(vertices, rows)
            shapes.append(vertices.shape)
            bases.append(sum(len(level) for level in index))
            index.append(words)
            rows += count
            ends.append(rows)
        bases.append(max(rows - 2, 0))
        super().__init__(rows, features, len(resolutions))
        self.resolutions = tuple(int(r) for r in resolutions)
        self._ends = ends
        self.register_buffer("shapes", torch.tensor(shapes), persistent=False)
        self.register_buffer("bases", torch.tensor(bases), persistent=False)
        self.register_buffer("scales", torch.tensor(resolutions, dtype=torch.float32), persistent=False)
        self.register_buffer("index", torch.from_numpy(np.concatenate(index)), persistent=False)

    @property
    def layout(self) -> Lattice:
        """Layout of the features in the form that the kernels take."""
        return Lattice(self.shapes, self.scales, self.bases, self.index)

    def rows_of_level(self, level: int) -> slice:
        """Return the rows of the table that belong to a level."""
        return slice(self._ends[level - 1] if level else 0, self._ends[level])

    def vertices_of_level(self, level: int, occupied: NDArray[np.uint8], cells: int) -> NDArray[np.int64]:
        """Return integer coordinates of a level's vertices, in the order of its rows, for the lattice's cells."""
        return np.argwhere(_vertices(_resample(occupied, cells, self.resolutions[level])))

    def pieces_of_level(
        self, level: int, occupied: NDArray[np.uint8], cells: int
    ) -> Iterator[tuple[slice, NDArray[np.int64]]]:
        """Yield rows of a level and the coordinates of their vertices, some at a time: millions take much memory."""
        vertices = _vertices(_resample(occupied, cells, self.resolutions[level]))
        there, first = np.flatnonzero(vertices), self.rows_of_level(level).start
        for start in range(0, len(there), VERTICES_AT_A_TIME):
            some = there[start : start + VERTICES_AT_A_TIME]
            rows = slice(first + start, first + start + len(some))
            yield rows, np.stack(np.unravel_index(some, vertices.shape), axis=1)

    def places_of_level(self, level: int, occupied: NDArray[np.uint8], cells: int) -> NDArray[np.float32]:
        """Return box coordinates for looking up a level's vertices, in the order of its rows. (V, 3)

        By its coordinates, a vertex on the far side of every occupied cell it belongs to lies in a cell that is not
        stored. Each vertex is therefore moved by one float32 step towards the middle of an occupied cell.
        """
        return places_of(occupied, cells, self.resolutions[level])

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

        Raises:
            ValueError: The arrays do not have this lattice's shape.
        """
        codes = arrays[""]
        if codes.dtype != np.uint8:
            return super().unpacked(arrays)
        ends = arrays[".ends"].astype(np.float32)
        if codes.shape != tuple(self.table.shape) or ends.shape != (self.levels, 2, self.features):
            raise ValueError(f"a table of {codes.shape} and {ends.shape} does not fit this lattice")
        part = torch.from_numpy(codes.astype(np.float32)) / 255.0
        for level, (low, high) in enumerate(torch.from_numpy(ends)):
            rows = self.rows_of_level(level)
            part[rows] = low * (1.0 - part[rows]) + high * part[rows]  # reproduces both ends exactly
        return part

    def look_up(self, x: Tensor) -> Tensor:
        return kernels_for(x).lattice_encode(x, self.layout, self.table)

    def add_gradient(self, x: Tensor, gradient: Tensor) -> None:
        kernels_for(x).lattice_backward(x, gradient, self.layout, *self.buffers_for_gradient())

    def restricted(self, occupied: NDArray[np.uint8], cells: int, finer: Sequence[int] = ()) -> SparseLattice:
        """Return the same features on fewer cells, followed by ``finer`` levels of zeros.

        ``occupied`` must be a subset of the cells this lattice was made for.
        """
        result = SparseLattice(occupied, cells, (*self.resolutions, *finer), self.features).to(self.table.device)
        with torch.no_grad():
            for level in range(self.levels):
                left = _vertices(_resample(occupied, cells, self.resolutions[level]))[self._stored(level)]
                old = self.table[self.rows_of_level(level)]
                result.table[result.rows_of_level(level)] = old[torch.from_numpy(left).to(old.device)]
        return result

    def _stored(self, level: int) -> NDArray[np.bool_]:
        """Return which vertices of a level are stored, as the index has it. (X, Y, Z)"""
        x, y, z = self.shapes[level].tolist()
        words, base = -(-z // VERTICES_A_WORD), int(self.bases[level])
        bits = self.index[base : base + x * y * words].cpu().numpy().astype("<u8").view("<u4")[::2]  # the lower halves
        whole = np.unpackbits(np.ascontiguousarray(bits).view(np.uint8), bitorder="little")
        return whole.reshape(x, y, words * VERTICES_A_WORD)[:, :, :z] > 0

    def summed(self, occupied: NDArray[np.uint8], cells: int) -> SparseLattice:
        """Return a lattice of only the finest level that gives exactly the sum of all levels' features.

        Resolutions are nested, so within a fine cell every coarser level is itself trilinear: its values at the fine
        vertices determine it. ``occupied`` must be a subset of the cells this lattice was made for.
        """
        if self.levels == 1:
            return self.restricted(occupied, cells)
        finest = self.resolutions[-1]
        result = SparseLattice(occupied, cells, (finest,), self.features)
        table, index = self.table.detach().cpu().numpy(), self.index.cpu()
        shapes, bases = self.shapes.cpu(), self.bases.tolist()
        total, pieces = np.zeros(result.table.shape, np.float32), result.pieces_of_level(0, occupied, cells)
        for (piece, vertices), (level, resolution) in itertools.product(pieces, enumerate(self.resolutions)):
            low, rest = np.divmod(vertices, finest // resolution)
            part = (rest * (resolution / finest)).astype(np.float32)
            for corner in itertools.product((0, 1), repeat=3):
                weight = np.where(corner, part, 1.0 - part).prod(axis=1, dtype=np.float32)
                inside = torch.minimum(torch.from_numpy(low + corner), shapes[level] - 1)  # beyond it, weights are 0
                row = stored_rows(inside, shapes[level], bases[level], index).clamp(max=len(table) - 1).numpy()
                total[piece] += np.where(weight > 0, weight, 0.0)[:, None] * table[row]
        with torch.no_grad():
            result.table.copy_(torch.from_numpy(total))
        return result.to(self.table.device)


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
        self.restart(encodings)

    def restart(self, encodings: Iterable[Encoding]) -> None:
        """Optimise these encodings from now on, from a fresh state; a checkpoint that holds the optimiser follows."""
        self.encodings = list(encodings)
        self.finer = [e.rows_of_level(0).stop if isinstance(e, SparseLattice) else 0 for e in self.encodings]
        self.moments = [e.table.new_zeros(2, *e.table.shape) for e in self.encodings]
        self.age = [e.table.new_zeros(len(e.table), dtype=torch.int32) for e in self.encodings]

    def step(self, rates: Sequence[float | Tensor], pulls: Sequence[float | Tensor] | None = None) -> None:
        """Take one step, and clear the gradients it used.

        Args:
            rates: Learning rate of each encoding: a number, or a tensor (1,) on its device.
            pulls: Weight in the loss of half the squared values of each encoding's finer levels, likewise; by default
                0.
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


def _resample(occupied: NDArray[np.uint8], cells: int, resolution: int) -> NDArray[np.bool_]:
    """Return occupancy at another resolution: a coarser cell is occupied if any of its parts is."""
    o = occupied > 0
    if resolution >= cells:
        if resolution % cells:
            raise ValueError(f"resolution {resolution} is not a multiple of {cells}")
        k = resolution // cells
        return o.repeat(k, 0).repeat(k, 1).repeat(k, 2)
    if cells % resolution:
        raise ValueError(f"resolution {resolution} does not divide {cells}")
    k = cells // resolution
    o = np.pad(o, [(0, -n % k) for n in o.shape])
    x, y, z = (n // k for n in o.shape)
    return np.asarray(o.reshape(x, k, y, k, z, k).any(axis=(1, 3, 5)))


def _index_of(vertices: NDArray[np.bool_], rows: int) -> tuple[NDArray[np.int64], int]:
    """Return the words of a level's index (:func:`svv.core.rays.encodings.stored_rows`), and the number of its rows.

    ``vertices`` (X, Y, Z) are those that are stored; ``rows`` is the first one's row.
    """
    padded = np.pad(vertices, ((0, 0), (0, 0), (0, -vertices.shape[2] % VERTICES_A_WORD))).reshape(-1, VERTICES_A_WORD)
    stored = np.packbits(padded, axis=1, bitorder="little").view("<u4")[:, 0].astype(np.int64)
    behind = np.cumsum(padded.sum(axis=1, dtype=np.int64))
    first = rows + np.concatenate([[0], behind[:-1]])
    return first << 32 | stored, int(behind[-1])


def vertices_of(occupied: NDArray[np.uint8], cells: int, resolution: int) -> NDArray[np.int64]:
    """Return integer coordinates of the vertices that a lattice of this resolution has, in raster order. (V, 3)

    The result is a view of an array (3, V), whose rows are faster to read than its columns.
    """
    vertices = _vertices(_resample(occupied, cells, resolution))
    return np.stack(np.unravel_index(np.flatnonzero(vertices), vertices.shape)).T


def places_of(
    occupied: NDArray[np.uint8], cells: int, resolution: int, vertices: NDArray[np.int64] | None = None
) -> NDArray[np.float32]:
    """Return box coordinates for looking up vertices of a resolution, moved as by ``SparseLattice.places_of_level``.

    Args:
        occupied: Cells that hold something visible. (X, Y, Z)
        cells: Cells per box unit of ``occupied``.
        resolution: Cells per box unit of the vertices.
        vertices: Integer coordinates (V, 3), by default of all from :func:`vertices_of`.

    Returns:
        (V, 3)
    """
    chosen = vertices_of(occupied, cells, resolution) if vertices is None else vertices
    filled = np.pad(_resample(occupied, cells, resolution), 1)
    plane, row = filled.shape[1] * filled.shape[2], filled.shape[2]
    full = filled.ravel()
    x, y, z = chosen.T
    first = (x + 1) * plane + (y + 1) * row + z + 1
    away, left = np.zeros(len(chosen), np.uint8), np.arange(len(chosen))
    for number, (i, j, k) in enumerate(itertools.product((0, 1), repeat=3)):
        hit = full[first[left] - i * plane - j * row - k]
        away[left[hit]] = number
        left = left[~hit]
    out = np.empty((len(chosen), 3), np.float32)
    for axis, (at, bit) in enumerate(zip((x, y, z), (4, 2, 1), strict=True)):
        middle = at + np.where(away & bit, -0.5, 0.5)
        out[:, axis] = np.nextafter((at / resolution).astype(np.float32), (middle / resolution).astype(np.float32))
    return out


def _vertices(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark the corners of occupied cells. (X, Y, Z) -> (X + 1, Y + 1, Z + 1)"""
    out = np.zeros([n + 1 for n in cells.shape], bool)
    x, y, z = cells.shape
    for i in (0, 1):
        for j in (0, 1):
            for k in (0, 1):
                out[i : i + x, j : j + y, k : k + z] |= cells
    return out
