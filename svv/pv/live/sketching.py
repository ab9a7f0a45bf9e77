"""What the process beside ParaView's window shows first: sketches that are learned in seconds, and painted.

One sketch follows another (:mod:`svv.train.run.sketches`); the last one gets the shape of the volume itself
(:mod:`svv.train.sketch_shape`), and strokes as they are asked for if that is quick.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
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
    from svv.io.views.viewset import ViewSet

BROAD = "The scene is shown in broad strokes."
"""What the user is told of a trained scene before it is painted as asked."""

SHAPED = "A sketch in the shape of the volume is shown."
"""What the user is told of a sketch in that shape."""

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
        self._views: ViewSet | None = None
        self._shape: Scene | None = None

    def take(self, scene: Scene, told: str = BROAD) -> None:
        """Take a trained scene instead of a sketch."""
        self.scene, self.told, self.as_asked = scene, told, False
        self._views = self._shape = None

    def learn(self, sketch: Sketch, volume: vtkImageData, values: Values, progress: Progress) -> None:
        """Learn a scene from few small views."""
        from svv.dvr.draw.views import make_views
        from svv.pv.display.shown import volume_shown
        from svv.pv.filters.engine import shading_of, transfer_function_of
        from svv.train.pipeline import train_scene

        asked = options_in(ViewOptions, values)
        views, _ = make_views(
            volume_shown(volume, values), transfer_function_of(values),
            ViewOptions(
                n=min(sketch.views, asked.n), test=0, size=min(sketch.size, asked.size), step=1.0, mapper=asked.mapper
            ),
            shading=shading_of(values), rescale=False, name="sketch", progress=part(progress, 0.0, 0.3),
        )  # fmt: skip
        options = sketch.options(options_in(TrainOptions, values))
        self.take(train_scene(views, options, part(progress, 0.3, 1.0))[0], sketch.told)
        self._broad, self._views = sketch, views

    def broaden(self) -> None:
        """Take the strokes of the finest sketch."""
        self._broad = SKETCHES[-1]

    def refine(self, painted: Scene, values: Values) -> bool:
        """Give a sketch the shape of its volume, and strokes as asked if that is quick; return whether it is better.

        Args:
            painted: The sketch as it is shown now.
            values: The panel's values.
        """
        from svv.train.config import settings_of
        from svv.train.sketch_shape import with_shape_of

        size, options = options_in(ViewOptions, values).size, options_in(TrainOptions, values)
        if self.scene is None or self._views is None or options.preset == "draft":
            return False
        if self._shape is None:
            shape = with_shape_of(self.scene, self._views, size, settings_of(options))
            self._shape = None if shape is self.scene else shape
        manners = painted.made.get("stylized", {}).get("manner", {})
        self.as_asked = bool(manners) and set(manners.values()) == {STROKES} and options.preset != "paper"
        self.told = SHAPED if self._shape is not None else self.told
        return self._shape is not None or self.as_asked

    def painted(self, values: Values, progress: Progress) -> Scene:
        """Return the sketch with paint, in broad strokes or as asked."""
        from svv.pv.filters.styling import stylize

        assert self.scene is not None
        how: Values = {"PreviewFile": ""}
        if not self.as_asked:
            asked = options_in(PaintOptions, values).stroke_size
            strokes = min(self._broad.broader * asked, max(self._broad.broadest, asked))
            how = {**SKETCH_PAINT, "StrokeSize": strokes}
        return self.shaped(stylize(self.scene, {**values, **how}, progress))

    def shaped(self, scene: Scene) -> Scene:
        """Return the sketch, painted or not, in the shape of its volume, if it has been given that.

        It is painted before: whether a faint shell gets strokes is decided as it will be in the end, when its opacity
        has been trained.
        """
        shape = self._shape
        return scene if shape is None else replace(scene, base=shape.base, marching=shape.marching)


def measure_pictures(values: Values) -> None:
    """Measure how the style pictures are painted, while views are drawn."""
    from svv.train.paint.ink import Ink, style_named
    from svv.train.paint.plan import hand_of

    with suppress(BadInput):  # the painting itself will say why
        for source in values.get("StyleFiles", ()):
            style = style_named(source)[1]
            if not isinstance(style, Ink):
                hand_of(np.asarray(style, np.float32), None)
