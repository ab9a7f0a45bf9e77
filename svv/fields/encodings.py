"""Position encodings behind one interface: a sparse vertex lattice (default) and a hash grid (the paper's).

An encoding is a module that maps box coordinates (S, 3) to features (S, width). Its table is read and written by
compiled kernels: the backward pass adds to ``gradient`` and marks the vertices it touched in ``used``, and
:class:`LatticeAdam` then steps only those. Plain references are in :mod:`svv.core.encodings`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.kernels import hashing, lattice


class _Lookup(torch.autograd.Function):
    """Features at positions; its backward pass fills the encoding's own gradient buffer."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, table: Tensor, encoding: Encoding) -> Tensor:
        ctx.x, ctx.encoding = x, encoding
        return encoding.look_up(x)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[None, None, None]:  # type: ignore[override]
        ctx.encoding.add_gradient(ctx.x, gradient)
        return None, None, None


class Encoding(nn.Module):
    """A table of features and the way positions look them up."""

    table: nn.Parameter

    def __init__(self, rows: int, features: int, levels: int) -> None:
        super().__init__()
        self.table = nn.Parameter(torch.zeros(rows, features))
        self.features, self.levels = features, levels
        self.gradient: NDArray[np.float32] | None = None
        self.used: NDArray[np.uint8] | None = None

    @property
    def width(self) -> int:
        """Features of a position: levels x features a level."""
        return self.levels * self.features

    def randomize(self, scale: float, generator: torch.Generator) -> None:
        """Fill the table with uniform numbers in [-scale, scale]."""
        with torch.no_grad():
            self.table.copy_((torch.rand(self.table.shape, generator=generator) * 2.0 - 1.0) * scale)

    def forward(self, x: Tensor) -> Tensor:
        """Features (S, width) at box coordinates (S, 3), both float32."""
        if torch.is_grad_enabled() and self.table.requires_grad:
            return _Lookup.apply(x, self.table, self)  # type: ignore[no-any-return]
        return self.look_up(x)

    def buffers_for_gradient(self) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """The gradient (V, F) and the marks of used rows (V,), made when first needed."""
        if self.gradient is None or self.used is None:
            self.gradient = np.zeros(tuple(self.table.shape), np.float32)
            self.used = np.zeros(len(self.table), np.uint8)
        return self.gradient, self.used

    def look_up(self, x: Tensor) -> Tensor:
        """Features without a graph. (S, width)"""
        raise NotImplementedError

    def add_gradient(self, x: Tensor, gradient: Tensor) -> None:
        """Add the table's gradient for ``gradient`` (S, width) at ``x`` (S, 3) to the buffers."""
        raise NotImplementedError


class SparseLattice(Encoding):
    """Features on the vertices of occupied cells at several resolutions, interpolated trilinearly.

    Where nothing is visible nothing is stored. Vertices are numbered in raster order, so the kernels find the
    neighbour in z without a look-up.
    """

    def __init__(self, occupied: NDArray[np.uint8], cells: int, resolutions: Sequence[int], features: int) -> None:
        """Lay out the lattice.

        Args:
            occupied: Cells that hold something visible. (X, Y, Z)
            cells: Cells per box unit of ``occupied``.
            resolutions: Cells per box unit of each level; each divides ``cells`` or is a multiple of it.
            features: Features a level.
        """
        shapes, bases, index, base, rows = [], [], [], 0, 0
        for resolution in resolutions:
            vertices = _vertices(_resample(occupied, cells, resolution))
            number = np.zeros(vertices.shape, np.int32)
            count = int(vertices.sum())
            number[vertices] = np.arange(rows, rows + count, dtype=np.int32)
            shapes.append(vertices.shape)
            bases.append(base)
            index.append(number.ravel())
            base, rows = base + vertices.size, rows + count
        super().__init__(rows, features, len(resolutions))
        self.resolutions = tuple(int(r) for r in resolutions)
        self.shapes = np.array(shapes, np.int64)
        self.bases = np.array(bases, np.int64)
        self.scales = np.array(resolutions, np.float32)
        self.index = np.concatenate(index)

    @property
    def layout(self) -> tuple[NDArray[Any], ...]:
        """Shapes, scales, bases and index, as the kernels take them."""
        return self.shapes, self.scales, self.bases, self.index

    def rows_of_level(self, level: int) -> slice:
        """The table's rows that belong to a level."""
        ends = [*self.bases.tolist(), len(self.index)]
        first = [int(self.index[a:b].max(initial=-1)) + 1 for a, b in itertools.pairwise(ends)]
        return slice(first[level - 1] if level else 0, first[level])

    def look_up(self, x: Tensor) -> Tensor:
        out = np.empty((len(x), self.width), np.float32)
        lattice.encode(x.numpy(), *self.layout, self.table.detach().numpy(), out)
        return torch.from_numpy(out)

    def add_gradient(self, x: Tensor, gradient: Tensor) -> None:
        lattice.encode_backward(x.numpy(), gradient.contiguous().numpy(), *self.layout, *self.buffers_for_gradient())

    def restricted(self, occupied: NDArray[np.uint8], cells: int, finer: Sequence[int] = ()) -> SparseLattice:
        """The same features on fewer cells, with ``finer`` levels of zeros behind those there are.

        ``occupied`` must be a subset of the cells this lattice was made for.
        """
        result = SparseLattice(occupied, cells, (*self.resolutions, *finer), self.features)
        with torch.no_grad():
            for level in range(self.levels):
                shape = tuple(self.shapes[level].tolist())
                base, size = int(self.bases[level]), int(np.prod(shape))
                vertices = _vertices(_resample(occupied, cells, self.resolutions[level]))
                old = torch.from_numpy(self.index[base : base + size].reshape(shape)[vertices]).long()
                result.table[result.rows_of_level(level)] = self.table[old]
        return result

    def summed(self, occupied: NDArray[np.uint8], cells: int) -> SparseLattice:
        """A lattice of the finest level alone that gives the sum of all levels' features, exactly.

        Resolutions are nested, so within a fine cell every coarser level is itself trilinear: its values at the fine
        vertices say all. ``occupied`` must be a subset of the cells this lattice was made for.
        """
        finest = self.resolutions[-1]
        result = SparseLattice(occupied, cells, (finest,), self.features)
        vertices = np.argwhere(_vertices(_resample(occupied, cells, finest)))
        table = self.table.detach().numpy()
        total = np.zeros((len(vertices), self.features), np.float32)
        for level, resolution in enumerate(self.resolutions):
            low, rest = np.divmod(vertices, finest // resolution)
            part = (rest * (resolution / finest)).astype(np.float32)
            shape = self.shapes[level]
            for corner in itertools.product((0, 1), repeat=3):
                weight = np.where(corner, part, 1.0 - part).prod(axis=1, dtype=np.float32)
                x, y, z = np.minimum(low + corner, shape - 1).T  # a corner beyond the edge has weight 0
                row = self.index[self.bases[level] + (x * shape[1] + y) * shape[2] + z]
                total += np.where(weight > 0, weight, 0.0)[:, None] * table[row]
        with torch.no_grad():
            result.table.copy_(torch.from_numpy(total))
        return result


class HashGrid(Encoding):
    """Multiresolution hash encoding (Müller et al. 2022), the encoding of the preset ``paper``."""

    def __init__(self, levels: int = 16, features: int = 2, log2_entries: int = 19, coarsest: int = 16,
                 finest: int = 4096) -> None:  # fmt: skip
        growth = (finest / coarsest) ** (1.0 / max(levels - 1, 1))
        resolutions = [int(np.floor(coarsest * growth**k + 1e-6)) for k in range(levels)]
        entries = [min((r + 1) ** 3, 2**log2_entries) for r in resolutions]
        super().__init__(sum(entries), features, levels)
        self.resolutions = np.array(resolutions, np.int64)
        self.offsets = np.concatenate([[0], np.cumsum(entries)]).astype(np.int64)

    def look_up(self, x: Tensor) -> Tensor:
        out = np.empty((len(x), self.width), np.float32)
        hashing.encode(x.numpy(), self.resolutions, self.offsets, self.table.detach().numpy(), out)
        return torch.from_numpy(out)

    def add_gradient(self, x: Tensor, gradient: Tensor) -> None:
        g = gradient.contiguous().numpy()
        hashing.encode_backward(x.numpy(), g, self.resolutions, self.offsets, *self.buffers_for_gradient())


class LatticeAdam:
    """Adam (Kingma & Ba 2015) that steps only the rows which the last backward pass used."""

    def __init__(self, encodings: Iterable[Encoding], beta1: float = 0.9, beta2: float = 0.99,
                 epsilon: float = 1e-12) -> None:  # fmt: skip
        self.encodings = list(encodings)
        self.finer = [e.rows_of_level(0).stop if isinstance(e, SparseLattice) else 0 for e in self.encodings]
        self.constants = np.float32(beta1), np.float32(beta2), np.float32(epsilon)
        self.moments = [np.zeros((2, *e.table.shape), np.float32) for e in self.encodings]
        self.age = [np.zeros(len(e.table), np.int32) for e in self.encodings]

    def step(self, rates: Sequence[float], pulls: Sequence[float] | None = None) -> None:
        """One step; clears the gradients it used.

        Args:
            rates: Learning rate of each encoding.
            pulls: Weight of half the squared values of each encoding's finer levels in the loss; by default 0.
        """
        pulls = [0.0] * len(self.encodings) if pulls is None else pulls
        for k, (encoding, rate) in enumerate(zip(self.encodings, rates, strict=True)):
            moments = self.moments[k]
            table = encoding.table.detach().numpy()
            gradient, used = encoding.buffers_for_gradient()
            lattice.adam(table, gradient, used, moments[0], moments[1], self.age[k], np.float32(rate), *self.constants,
                         np.float32(pulls[k]), self.finer[k])  # fmt: skip

    def state(self) -> dict[str, NDArray[Any]]:
        """Moments and ages, for a checkpoint."""
        state: dict[str, NDArray[Any]] = {f"{k}.moments": v for k, v in enumerate(self.moments)}
        return state | {f"{k}.age": v for k, v in enumerate(self.age)}

    def load(self, state: dict[str, NDArray[Any]]) -> None:
        """Take the state of an earlier :meth:`state`."""
        for k in range(len(self.encodings)):
            self.moments[k][...] = state[f"{k}.moments"]
            self.age[k][...] = state[f"{k}.age"]


def _resample(occupied: NDArray[np.uint8], cells: int, resolution: int) -> NDArray[np.bool_]:
    """Occupancy at another resolution: a coarser cell is occupied if any of its parts is."""
    o = occupied > 0
    if resolution >= cells:
        if resolution % cells:
            raise ValueError(f"resolution {resolution} is no multiple of {cells}")
        k = resolution // cells
        return o.repeat(k, 0).repeat(k, 1).repeat(k, 2)
    if cells % resolution:
        raise ValueError(f"resolution {resolution} does not divide {cells}")
    k = cells // resolution
    o = np.pad(o, [(0, -n % k) for n in o.shape])
    x, y, z = (n // k for n in o.shape)
    return np.asarray(o.reshape(x, k, y, k, z, k).any(axis=(1, 3, 5)))


def _vertices(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Corners of occupied cells. (X, Y, Z) -> (X + 1, Y + 1, Z + 1)"""
    out = np.zeros([n + 1 for n in cells.shape], bool)
    x, y, z = cells.shape
    for i in (0, 1):
        for j in (0, 1):
            for k in (0, 1):
                out[i : i + x, j : j + y, k : k + z] |= cells
    return out
