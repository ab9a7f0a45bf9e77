"""Sketches: scenes that are learned in seconds from few small views, to be shown until there is a better one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from svv.io.views.viewset import ViewSet
from svv.options.making import TrainOptions


@dataclass(frozen=True)
class Sketch:
    """How a sketch is made."""

    views: int
    """Number of views of which it is learned."""
    size: int
    """Longer side of the views, pixels."""
    seconds: float
    """Time limit of its training."""
    broader: float
    """Size of its strokes relative to those that are asked for."""
    broadest: float
    """The largest size of its strokes, unless larger ones are asked for."""
    told: str
    """What the user is told of it."""

    def options(self, asked: TrainOptions) -> TrainOptions:
        """Return the options with which it is trained instead of those that are asked for."""
        # To try out which light is better takes a quarter of the time.
        lighting = asked.lighting or "phong"
        return replace(asked, preset="draft", time_limit=self.seconds, lighting=lighting, change=())

    def few(self, views: ViewSet) -> ViewSet:
        """Return few of the views, from all sides, with every so manyth pixel."""
        count = min(self.views, len(views))
        some = views.take(np.linspace(0, len(views) - 1, count).round().astype(int).tolist())
        stride = max(1, round(max(some.images.shape[1:3]) / self.size))
        images = np.ascontiguousarray(some.images[:, ::stride, ::stride])
        height, width = images.shape[1:3]
        return replace(some, images=images, cameras=tuple(c.resized(width, height) for c in some.cameras))


SKETCHES = (
    Sketch(12, 128, 1.5, 2.0, 4.0, "A sketch is shown."),
    Sketch(24, 256, 6.0, 1.5, 2.0, "A finer sketch is shown."),
)
"""The sketches, one after another. Draft, which is fast itself, has only the first."""


def sketches_for(preset: str) -> tuple[Sketch, ...]:
    """Return the sketches that are worth while before a training with this preset."""
    return SKETCHES[:1] if preset == "draft" else SKETCHES
