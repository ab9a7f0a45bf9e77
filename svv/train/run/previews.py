"""Previews of a painting while it is made, scheduled to cost next to nothing."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.scene import Scene

Show = Callable[[Scene], None]
"""Function that receives the painted scene in its current state: a copy that the training no longer changes."""

FIRST = 4.0
"""Seconds of steps before the first preview: an earlier distillation shows only fog, and a later one is a long wait."""

EVERY = 10.0
"""Minimum number of seconds between two previews."""

SHARE = 0.01
"""Maximum fraction of the time for previews after the first: a slow one is followed by a longer wait."""


@dataclass
class Previews:
    """Shows a painting from time to time while its colours are learned."""

    show: Show
    """Called with each preview."""
    painting: Callable[[UnrestrictedField], Scene]
    """Returns the painted scene with these colours."""
    clock: Callable[[], float] = time.monotonic
    """Returns the time in seconds."""
    seconds: list[float] = field(default_factory=list)
    """Time at which each preview was ready, in seconds since this object was created."""

    def __post_init__(self) -> None:
        self._begin = self.clock()
        self._due: float | None = None

    def look(self, colours: UnrestrictedField, at_once: bool = False) -> None:
        """Show the current colours if a preview is due or ``at_once`` is set; called after every step."""
        now = self.clock()
        if self._due is None:
            self._due = now + FIRST
        if now < self._due and not at_once:
            return
        self.show(self.painting(copy.deepcopy(colours).requires_grad_(False)))
        after = self.clock()
        self.seconds.append(after - self._begin)
        self._due = after + max(EVERY, (after - now) / SHARE)
