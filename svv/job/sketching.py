"""What is shown first of a request: sketches that are learned in seconds, and painted.

If the volume may be learned from, there is one, in its own shape and light (:mod:`svv.train.value_sketch`); otherwise
one follows another (:mod:`svv.train.run.sketches`). The last one gets strokes as asked for if that is quick.
"""

from __future__ import annotations

from dataclasses import replace

from svv.errors import Progress, part
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.job.request import Request, learn, paint
from svv.train.pipeline import train_scene
from svv.train.run.sketches import SKETCHES, Sketch
from svv.train.value_sketch import sketch_from_values

BROAD = "The scene is shown in broad strokes."
"""What the user is told of a trained scene before it is painted as asked."""

SHAPED = "A sketch is shown, in the volume's own shape and light: what follows makes it exact."
"""What the user is told of a sketch that needs no finer one: what still runs, and that it need not be waited for."""

REGIONS = "The new regions are shown as a sketch."
"""What the user is told of a corrected palette before its regions are trained as asked."""

REGIONS_IN = 2.0
"""Time limit of such a sketch, seconds."""

STROKES = "strokes"
"""The manner that is quick."""

FEW = ("stylize.style_views=8", "stylize.style_size=100")
"""Settings of a sketch's painting."""


class Sketching:
    """A sketch of one scene, and how it is painted."""

    def __init__(self) -> None:
        self.scene: Scene | None = None
        """The sketch, or the trained scene that is to be painted; None before the first."""
        self.told = SKETCHES[0].told
        """What the user is told of it."""
        self.as_asked = False
        """Whether its strokes are those that are asked for."""
        self._broad = SKETCHES[0]

    def take(self, scene: Scene, told: str = BROAD) -> None:
        """Take a trained scene instead of a sketch."""
        self.scene, self.told, self.as_asked = scene, told, False

    def learn(self, sketch: Sketch, request: Request, progress: Progress) -> bool:
        """Learn a scene from few small views; return whether there can be a better one."""
        views, longest = _few(sketch, request, part(progress, 0.0, 0.3))
        options, told = request.train, part(progress, 0.3, 1.0)
        self._broad = sketch
        known = sketch_from_values(views, longest, options, told)
        if known is not None:
            self.take(known, SHAPED)
            return False
        self.take(train_scene(views, sketch.options(options), told)[0], sketch.told)
        return True

    def broaden(self) -> None:
        """Take the strokes of the finest sketch."""
        self._broad = SKETCHES[-1]

    def refine(self, painted: Scene, request: Request) -> bool:
        """Take strokes as asked if that is quick, or the finest sketch's; return whether ``painted`` has others now."""
        if self.scene is None or request.paint is None or request.paint.options.preset == "draft":
            return False
        manners = painted.made.get("stylized", {}).get("manner", {})
        before = self.as_asked, self._broad
        self.as_asked = bool(manners) and set(manners.values()) == {STROKES} and request.paint.options.preset != "paper"
        self.broaden()
        return (self.as_asked, self._broad) != before

    def painted(self, request: Request, progress: Progress) -> Scene:
        """Return the sketch with paint, in broad strokes or as asked."""
        assert self.scene is not None and request.paint is not None
        asked = request.paint.options
        if not self.as_asked:
            strokes = min(self._broad.broader * asked.stroke_size, max(self._broad.broadest, asked.stroke_size))
            asked = replace(asked, preset="draft", change=FEW, stroke_size=strokes)
        how = replace(request.paint, options=asked, preview=None)
        return paint(replace(request, paint=how), self.scene, progress)[0]


def corrected_sketch(request: Request, progress: Progress) -> Scene:
    """Return the scene of a request to correct its palette with regions trained in seconds, on few small views."""
    asked = request.correct
    assert asked is not None
    options = replace(asked.options, preset="draft", time_limit=REGIONS_IN)
    few = replace(asked, views=lambda told: SKETCHES[-1].few(asked.views(told)), options=options)
    return learn(replace(request, correct=few), progress)[0]


def _few(sketch: Sketch, request: Request, progress: Progress) -> tuple[ViewSet, int]:
    """Return few small views of what a request begins with, and the longer side of those that it asks for, pixels."""
    asked, given = request.views, request.input
    assert not isinstance(given, Scene)
    if isinstance(given, ViewSet):
        return sketch.few(given), max(given.images.shape[1:3])
    small = replace(asked, n=min(sketch.views, asked.n), test=0, size=min(sketch.size, asked.size), step=1.0)
    return given(small, progress), asked.size
