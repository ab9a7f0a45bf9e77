"""How large pictures may be while a camera moves, so that they keep up with it."""

from __future__ import annotations

AIM = 1.0 / 15.0
"""Time for one picture of a moving camera, in seconds: fifteen a second are movement, not a row of pictures."""

SMALLEST = 0.2
"""Smallest size of such a picture, as a fraction of the sharp one's."""

STEADY = 0.15
"""Change of size, as a fraction, that is not worth it: a picture whose size changes all the time flickers."""


class Pace:
    """Size of the next picture of a moving camera, as found from how long the last ones took."""

    def __init__(self) -> None:
        self.part = 0.4
        """Width and height as a fraction of the sharp picture's, in [:data:`SMALLEST`, 1]."""

    def took(self, seconds: float) -> None:
        """Learn how long a picture of this size took: its time is taken to grow with its pixels."""
        wanted = min(max(self.part * (AIM / max(seconds, 1e-6)) ** 0.5, SMALLEST), 1.0)
        if wanted == 1.0 or abs(wanted / self.part - 1.0) > STEADY:
            self.part = wanted
