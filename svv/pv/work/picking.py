"""What filters answer to clicks into views, which :mod:`svv.pv.client.part_picking` passes on to them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from svv.core.json_values import parsed
from svv.errors import BadInput
from svv.options.making import NetworkName, RenderOptions
from svv.pv.panel.option_panel import options_in
from svv.pv.panel_values import Values
from svv.pv.work.base import Filter
from svv.pv.work.vtk_data import scene_of

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene


class Click(Values, total=False):
    """What was clicked on: the camera as values of StyleRF Render, and these."""

    pixel: tuple[int, int]
    button: str
    region: str
    place: str
    """What the picture that was clicked on shows there, as x,y,z; without it, the filter's own scene counts."""
    said: str
    """Why the picture that was clicked on shows nothing there."""


class Picking(Filter):
    """A filter that answers clicks: in most, buttons let them add to a property of its panel."""

    _picked = ""

    def pick(self, where: str) -> None:
        """Answer a click, given as JSON, for :meth:`GetPicked`; an empty text means that there was none."""
        self._picked = ""
        if where:
            try:
                self._picked = self.answer(parsed(where))
            except BadInput as error:
                self.say(str(error))

    def GetPicked(self) -> str:
        """Return the answer to the last click; empty if there is none."""
        return self._picked

    def answer(self, seen: Click) -> str:
        """Return what a click adds to the property of its button; raise BadInput if nothing is visible, or fits."""
        raise NotImplementedError


class Clickable(Picking):
    """A filter whose picture of a scene can be clicked on: it tells others which place a pixel of it shows."""

    def answer(self, seen: Click) -> str:
        """Return what a :class:`Click` takes over: the place that is visible there, or why there is none."""
        try:
            return json.dumps({"place": self._place(seen)})
        except BadInput as error:
            return json.dumps({"said": str(error)})

    def _place(self, seen: Click) -> str:
        if self.values.get("Cut"):
            raise BadInput("Clicks do not see where a volume is cut open: turn Cut off, or click on an image.")
        scene, options = self.shown_scene()
        return point_seen(scene, seen, options.network)

    def shown_scene(self) -> tuple[Scene, RenderOptions]:
        """Return the scene with the painting that is shown, and how; raises BadInput if there is none."""
        scene, options = scene_of(self.GetInputDataObject(0, 0)), options_in(RenderOptions, self.values)
        return scene if options.variant is None else scene.with_variant(options.variant), options


class Telling(Clickable):
    """A filter whose panel says what is where a click of its button was, with the volume's value there."""

    _places: tuple[tuple[float, float, float], ...] = ()
    """The last places, at most three."""

    def ClickValue(self) -> None:
        """Forget earlier places: the client, which handles this button, has started or stopped clicks."""
        self._places = ()

    def answer(self, seen: Click) -> str:
        """Say in the panel what is there, and how far it is from the last place; other clicks are answered as ever."""
        if seen.get("button") != "ClickValue":
            return super().answer(seen)
        from svv.fields.scene.probing import describe_measures
        from svv.pv.work.engine import camera_for

        scene, options = self.shown_scene()
        found = scene.probe(camera_for(scene.rig, seen), seen["pixel"], options.network)
        if found is None:
            self._status = "Nothing is visible there."
            return ""
        self._places = (*self._places[-2:], found.point)
        self._status = "; ".join(filter(None, [found.describe(), describe_measures(self._places)])) + "."
        return ""


def point_seen(scene: Scene, seen: Click, network: NetworkName | None = None) -> str:
    """Return the point that is visible at a pixel, as the properties Parts and Points hold it, or raise BadInput.

    The scene counts if the click was on no picture; the network is as in :meth:`svv.Scene.render`.
    """
    from svv.pv.work.engine import camera_for

    if "said" in seen:
        raise BadInput(seen["said"])
    return seen.get("place") or ",".join(
        f"{value:.7g}" for value in scene.point_at(camera_for(scene.rig, seen), seen["pixel"], network)
    )


class Pointing(Picking):
    """A filter whose clicks say of which region places are; it keeps the scene as it came under the name "before"."""

    _first = ""
    """The first of two places that are one region."""

    def ClickSame(self) -> None:
        """Forget the first of two clicks: the client, which handles this button, has started or stopped clicks."""
        self._first = ""

    ClickRegion = ClickSame

    def answer(self, seen: Click) -> str:
        from svv.pv.work.editing import check_pointed

        scene = self.last("before")
        if scene is None:
            return ""
        place = point_seen(self.last("given") or scene, seen)
        if seen["button"] == "ClickSame" and not self._first:
            check_pointed(scene, f"{place}=0")
            self._first = place
            self._status = f"{place}: now click on another place of the same region."
            return ""
        first, self._first = self._first, ""
        said = f"{first}={place}" if first else f"{place}={seen['region']}"
        check_pointed(scene, "; ".join(filter(str.strip, (self.values["Points"], said))))
        return said
