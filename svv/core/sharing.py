"""How several processes share the making of many things, such as views; alone, one process makes them all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Sharing:
    """This process among those that share a work; all of them see the same folders."""

    rank: int = 0
    """Number of this process; the first one, 0, does what must be done once."""
    count: int = 1
    """Number of processes."""
    once: Callable[[Callable[[], Any]], Any] = lambda work: work()
    """Returns the result of work that the first process does, in every process."""
    wait: Callable[[], object] = lambda: None
    """Waits until every process has come here."""

    @property
    def is_first(self) -> bool:
        """Whether this is the process that does what must be done once."""
        return self.rank == 0

    def mine(self, number: int) -> range:
        """Return which of ``number`` things this process makes; together, the processes make all of them."""
        return range(self.rank, number, self.count)


ALONE = Sharing()
"""One process that makes everything."""
