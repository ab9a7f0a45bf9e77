"""Pictures of a painting while it is made: when one is due, so that they cost next to nothing."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from svv.fields.networks import UnrestrictedField
from svv.fields.scene import Scene

Show = Callable[[Scene], None]
"""Takes the painted scene as it is at this moment: a copy that stays as it is while the training goes on."""

FIRST = 4.0
"""Seconds of steps before the first preview: less of a distillation shows a fog, more keeps people waiting."""

EVERY = 10.0
"""Seconds between two previews at least."""

SHARE = 0.01
"""Part of the time that previews after the first may take: a slow one is followed by a longer wait."""


@dataclass
class Previews:
    """Hands out a painting from time to time while its colours are learned."""

    show: Show
    painting: Callable[[UnrestrictedField], Scene]
    """The painted scene with these colours."""
    clock: Callable[[], float] = time.monotonic
    seconds: list[float] = field(default_factory=list)
    """When each preview was there, since this was made."""

    def __post_init__(self) -> None:
        self._begin = self.clock()
        self._due: float | None = None

    def look(self, colours: UnrestrictedField, at_once: bool = False) -> None:
        """Show what there is, if it is time or it is worth it at once; called after every step."""
        now = self.clock()
        if self._due is None:
            self._due = now + FIRST
        if now < self._due and not at_once:
            return
        self.show(self.painting(copy.deepcopy(colours).requires_grad_(False)))
        after = self.clock()
        self.seconds.append(after - self._begin)
        self._due = after + max(EVERY, (after - now) / SHARE)
