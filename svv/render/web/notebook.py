"""A scene as a widget in a notebook: its page for browsers below a cell, which tells Python what is set in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar
from uuid import uuid4

import anywidget
import numpy as np
import traitlets
from IPython.display import display

from svv.core.colour.colour import WHITE
from svv.core.colour.light import Lamp
from svv.core.geometry.cameras import Camera
from svv.core.geometry.cuts import Cut
from svv.errors import BadInput, Cancelled, Progress, silent
from svv.fields.scene.model import in_words
from svv.fields.scene.scene import Scene
from svv.render.web.html import filled, viewer_file
from svv.render.web.page import html_of, numbers_of, paintings_of
from svv.train.run.learning import Learning

FRAME = (
    '<div data-svv="{{ name }}"><iframe title="{{ title }}" srcdoc="{{ page }}" '
    'style="width: 100%; height: {{ height }}px; border: 0"></iframe></div>'
)
"""HTML that shows a page without Python, network, and the widget's own program, which removes it: exported notebooks
contain it."""


class SceneWidget(anywidget.AnyWidget):
    """The page of a scene in a notebook, in a frame of its own; :func:`svv.widget` makes one.

    ``view`` (how the scene is turned) and ``edits`` (what is set beside the picture) are traits, which change with the
    page, and change it: ``traitlets.link((one, "view"), (other, "view"))`` turns two scenes together. ``height`` is
    that of the frame in pixels. While a scene is trained in the background, ``fraction`` and ``told`` are its progress.
    """

    _esm: ClassVar[str] = viewer_file("notebook.js")
    page = traitlets.Unicode().tag(sync=True)
    height = traitlets.Int(600, min=100).tag(sync=True)
    view = traitlets.Dict().tag(sync=True)
    edits = traitlets.Dict().tag(sync=True)
    fraction = traitlets.Float(1.0).tag(sync=True)
    told = traitlets.Unicode().tag(sync=True)
    _camera = traitlets.Dict().tag(sync=True)
    _name = traitlets.Unicode().tag(sync=True)
    _said = traitlets.Unicode().tag(sync=True)

    def __init__(
        self,
        scene: Scene | Learning,
        title: str = "scene",
        height: int = 600,
        background: Sequence[float] = WHITE,
        progress: Progress = silent,
    ) -> None:
        """Write the page of a scene; see :func:`svv.widget`."""
        if isinstance(scene, Learning) and scene.done:
            scene = scene.wait()[0]
        if isinstance(scene, Learning):
            super().__init__(page="", height=height, fraction=0.0, _name=uuid4().hex, _said=title)
            self._scene: Scene | None = None
            self._number = 0
            scene.watch(partial(self._sharpen, title=title, background=background))
            return
        page = html_of(scene, title, title, background, progress).decode()
        super().__init__(page=page, height=height, _name=uuid4().hex, _said=_describe_frame(title, scene))
        self._scene = scene

    def _sharpen(self, learning: Learning, title: str, background: Sequence[float]) -> None:
        """Show what a training in the background has; called by a thread, which draws nothing."""
        found = learning.page(title, background)
        if found is not None and found[0] != self._number:
            self._number, self._scene = found[0], learning.scene
            with self.hold_sync():
                self.edits = {}  # they were of another scene
                self._said = _describe_frame(title, self._scene)
                self.page = found[1]
        self.fraction, self.told = learning.progress
        if learning.done:
            self.fraction = 1.0
            try:
                scene, _ = learning.wait()
                if self._number != learning.number:  # it was done before its process heard that pages are wanted
                    self._scene, self._number, self._said = scene, learning.number, _describe_frame(title, scene)
                    self.page = html_of(scene, title, title, background).decode()
            except BadInput as error:
                self.told = str(error)
            except Cancelled:
                self.told = "Stopped."

    @property
    def camera(self) -> Camera | None:
        """Camera of the picture in the page, with the picture's size; None until a browser has shown it."""
        if not self._camera:
            return None
        told = dict(self._camera)
        return Camera(np.reshape(told.pop("camera_to_world"), (4, 4)), **told)

    @property
    def scene(self) -> Scene:
        """The scene with what was set in the page, as one step of its history that can be undone.

        Where the page shows no painting, the styles' strength is 0. The background is not part of a scene.

        Raises:
            BadInput: The trait ``edits`` was given something that does not fit the scene, or there is no scene yet.
        """
        if self._scene is None:
            raise BadInput("There is no scene yet: it is still being learned.")
        try:
            return _edited(self._scene, self.edits) if self.edits else self._scene
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise BadInput(f"These edits are not those of this scene's page ({error}).") from error

    def _repr_html_(self) -> str:
        """Return the page itself, for where widgets are not shown."""
        return filled(FRAME, page=self.page, height=self.height, name=self._name, title=self._said)

    def _ipython_display_(self) -> None:
        """Display the page, and then the widget, which takes its place.

        They are two outputs: of one with both, a notebook that was exported with the widgets' state shows the widget
        alone, whose program comes from the network.
        """
        display({"text/html": self._repr_html_()}, raw=True)
        display(*(self._repr_mimebundle_() or ({},))[:1], raw=True)


def _describe_frame(title: str, scene: Scene | None) -> str:
    """Return the title of a frame, by which those who do not see it tell what it shows."""
    return title if scene is None else f"{title}. {in_words(scene)}"


def _colour(told: Sequence[float] | None) -> tuple[float, float, float] | None:
    if told is None:
        return None
    r, g, b = (float(c) for c in told)
    return r, g, b


def _edited(scene: Scene, told: dict[str, Any]) -> Scene:
    """Return a scene as a page shows it after edits (``state.js``)."""
    painting = told["painting"]
    if painting is not None:
        name = paintings_of(scene)[painting]
        scene = scene if scene.layers else scene.with_variant(name)  # a joined scene has no other painting
    strength = 0.0 if painting is None else told["strength"]
    listed = dict(zip(numbers_of(scene), told["regions"], strict=True))
    regions = tuple(
        replace(
            region,
            edited_colour=_colour(own["edited"]),
            opacity=float(own["opacity"]),
            hidden=bool(own["hidden"]),
            strength=region.strength * strength if region.style is not None else region.strength,
            lighting=region.lighting * told["light"],
        )
        for region, own in ((r, listed[number]) for number, r in enumerate(scene.regions))
    )
    # Pages of older versions have no cuts.
    lamp, cuts, plane = Lamp(**told["lamp"]), scene.cuts if told.get("cuts", True) else (), told.get("cut", {})
    if plane.get("axis") is not None:
        cuts = replace(scene, cuts=cuts).cut(_cut_of(scene, **plane)).cuts
    if (regions, lamp, cuts) == (scene.regions, scene.lamp, scene.cuts):
        return scene
    history = scene.history.after(scene.as_step("edits in the notebook"))
    return replace(scene, regions=regions, lamp=lamp, cuts=cuts, history=history)


def _cut_of(scene: Scene, axis: int, at: float, below: bool) -> Cut:
    """Return the cut by the plane that was dragged on a page (``cuts.js``)."""
    return Cut.parse(f"{'xyz'[axis]}{'<' if below else '>'}{100.0 * float(at)!r}%", scene.bounds)
