"""What the networks say of vertices whatever the view, kept from image to image: light is all that a new view adds.

Neighbouring views see mostly the same vertices, so their features are looked up and their palette network runs once.

Letters: V vertices that a view needs, K vertices that are known.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from svv.fields.radiance.encodings import SparseLattice

MOST = 1 << 19
"""Most vertices that are known at a time, of about 90 bytes each; a view that needs more does without."""

Unlit = Callable[[Tensor], tuple[Tensor, Tensor]]
"""Returns features and outputs of the palette MLP at positions."""


class KnownVertices:
    """The vertices of a grid that a scene's networks were asked about.

    Images may be drawn in several threads: whoever has taken rows of the tables keeps the tables that they belong to.
    """

    def __init__(self, shape: Sequence[int]) -> None:
        self._shape, self._lock = tuple(shape), threading.Lock()
        self._forget()

    def _forget(self) -> None:
        self._row = torch.full((math.prod(self._shape),), -1, dtype=torch.int32)
        self._count = 0
        self._tables: tuple[Tensor, Tensor] = torch.empty(0, 0), torch.empty(0, 0)

    @property
    def shape(self) -> tuple[int, ...]:
        """Vertices of the grid along x, y and z."""
        return self._shape

    def rows_of(self, places: Tensor, position: Tensor, unlit: Unlit) -> tuple[Tensor, Tensor, Tensor]:
        """Return the rows (V,), int32, of vertices in a table of features, that table, and one of palette outputs.

        ``places`` (V,) in the grid, at most :data:`MOST`; ``position`` (V, 3); ``unlit`` is asked about new ones.
        """
        with self._lock:
            rows = self._row.index_select(0, places)
            new = torch.nonzero(rows < 0)[:, 0]
            if self._count + len(new) > MOST:  # forget those of other views
                self._forget()
                new = torch.arange(len(places))
            if len(new):
                self._add(places[new], unlit(position[new]))
                rows = self._row.index_select(0, places)
            return rows, *self._tables

    def _add(self, places: Tensor, said: tuple[Tensor, Tensor]) -> None:
        """Append rows to both tables, whose room doubles when it is full."""
        after = self._count + len(places)
        if after > len(self._tables[0]):
            room = min(max(after, 2 * self._count), MOST)
            known = (
                own[:0] if self._count == 0 else old[: self._count] for own, old in zip(said, self._tables, strict=True)
            )
            features, raw = (torch.cat([old, old.new_empty(room - len(old), old.shape[1])]) for old in known)
            self._tables = features, raw
        for table, own in zip(self._tables, said, strict=True):
            table[self._count : after] = own
        self._row[places] = torch.arange(self._count, after, dtype=torch.int32)
        self._count = after


_KNOWN: WeakKeyDictionary[SparseLattice, tuple[list[tuple[Tensor, int]], KnownVertices]] = WeakKeyDictionary()


def known_vertices(material: SparseLattice, tensors: Sequence[Tensor], shape: Sequence[int]) -> KnownVertices | None:
    """Return what is known of a grid's vertices, for the palette's lattice and all tensors that it depends on.

    None while one of them learns.
    """
    if any(t.requires_grad or t.is_inference() for t in tensors):
        return None
    known = _KNOWN.get(material)
    same = known is not None and all(
        t is old and t._version == v for t, (old, v) in zip(tensors, known[0], strict=True)
    )
    if known is None or not same or known[1].shape != tuple(shape):
        known = _KNOWN[material] = [(t, t._version) for t in tensors], KnownVertices(shape)
    return known[1]
