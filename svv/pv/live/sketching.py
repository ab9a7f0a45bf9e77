"""What the process beside ParaView's window shows first: sketches that are learned in seconds, and painted.

If the volume may be learned from, there is one sketch, in its own shape and light (:mod:`svv.train.value_sketch`);
otherwise one follows another (:mod:`svv.train.run.sketches`). The last one gets strokes as they are asked for if that
is quick.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.errors import BadInput, Progress, part
from svv.options.making import PaintOptions, TrainOptions, ViewOptions
from svv.pv.panel.option_panel import options_in
from svv.pv.panel_values import Values
from svv.train.run.sketches import SKETCHES, Sketch

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

BROAD = "The scene is shown in broad strokes."
"""What the user is told of a trained scene before it is painted as asked."""

SHAPED = "A sketch is shown, in the volume's own shape and light: what follows makes it exact; Stop Here keeps it."
"""What the user is told of a sketch that needs no finer one: what still runs, and that it need not be waited for."""

STROKES = "strokes"
"""The manner that is quick."""

SKETCH_PAINT: Values = {
    "Preset": "draft",
    "Settings": "stylize.style_views=8; stylize.style_size=100",
    "PreviewFile": "",
}
"""Properties of a sketch's painting."""


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

    def learn(self, sketch: Sketch, volume: vtkImageData, values: Values, progress: Progress) -> bool:
        """Learn a scene from few small views; return whether there can be a better one."""
        from svv.dvr.draw.views import make_views
        from svv.pv.display.shown import volume_shown
        from svv.pv.filters.engine import shading_of, transfer_function_of
        from svv.train.pipeline import train_scene
        from svv.train.value_sketch import sketch_from_values

        asked = options_in(ViewOptions, values)
        views, _ = make_views(
            volume_shown(volume, values), transfer_function_of(values),
            ViewOptions(
                n=min(sketch.views, asked.n), test=0, size=min(sketch.size, asked.size), step=1.0, mapper=asked.mapper
            ),
            shading=shading_of(values), rescale=False, name="sketch", progress=part(progress, 0.0, 0.3),
        )  # fmt: skip
        options, told = options_in(TrainOptions, values), part(progress, 0.3, 1.0)
        self._broad = sketch
        known = sketch_from_values(views, asked.size, options, told)
        if known is not None:
            self.take(known, SHAPED)
            return False
        self.take(train_scene(views, sketch.options(options), told)[0], sketch.told)
        return True

    def broaden(self) -> None:
        """Take the strokes of the finest sketch."""
        self._broad = SKETCHES[-1]

    def refine(self, painted: Scene, values: Values) -> bool:
        """Take strokes as asked if that is quick, or those of the finest sketch; return whether they are others.

        Args:
            painted: The sketch as it is shown now.
            values: The panel's values.
        """
        preset = options_in(TrainOptions, values).preset
        if self.scene is None or preset == "draft":
            return False
        manners = painted.made.get("stylized", {}).get("manner", {})
        before = self.as_asked, self._broad
        self.as_asked = bool(manners) and set(manners.values()) == {STROKES} and preset != "paper"
        self.broaden()
        return (self.as_asked, self._broad) != before

    def painted(self, values: Values, progress: Progress) -> Scene:
        """Return the sketch with paint, in broad strokes or as asked."""
        from svv.pv.filters.styling import stylize

        assert self.scene is not None
        how: Values = {"PreviewFile": ""}
        if not self.as_asked:
            asked = options_in(PaintOptions, values).stroke_size
            strokes = min(self._broad.broader * asked, max(self._broad.broadest, asked))
            how = {**SKETCH_PAINT, "StrokeSize": strokes}
        return stylize(self.scene, {**values, **how}, progress)


def measure_pictures(values: Values) -> None:
    """Measure how the style pictures are painted, while views are drawn."""
    from svv.train.paint.ink import Ink, style_named
    from svv.train.paint.plan import hand_of

    with suppress(BadInput):  # the painting itself will say why
        for source in values.get("StyleFiles", ()):
            style = style_named(source)[1]
            if not isinstance(style, Ink):
                hand_of(np.asarray(style, np.float32), None)
