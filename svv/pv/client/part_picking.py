"""Places in a scene, chosen by clicks into views: buttons of the panels of StyleRF Edit, Palette and Render.

Client code. The filter whose picture was clicked on says which point is visible there; the panel's filter is told, and
its answer appended to a property. Points mean the same after the camera has moved and other regions were hidden.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial

from svv.pv.client.clicks import pixel_at, place_under, press
from svv.pv.display.linked_camera import PLACED, camera_numbers, displays_in, parallel_scale_of, upstream
from svv.pv.observers import python_proxy, with_data
from svv.pv.paraview_types import Property, Proxy, SMProxy, View

ROWS = {"ClickPart": "Parts", "ClickRegion": "Points", "ClickSame": "Points"}
"""Button -> the property to which its clicks add."""

TELLS = "ClickValue"
"""The button of StyleRF Render after which it says what is where clicks were."""

IMAGE, VOLUME = "StyleRFRender", "StyleRFVolume"
"""The filters whose pictures of the scene can be clicked on; an image may be placed in the 3D view."""


@with_data("string0")
def pressed(proxy: SMProxy, event: str, name: str) -> None:
    """Start handling clicks; if the button is pressed again, stop. An observer of the filters with such a button."""
    if name not in ROWS and name != TELLS:
        return
    from paraview import simple

    filter, act = python_proxy(proxy), tell if name == TELLS else partial(pick, button=name)
    press(filter, name, simple.GetRenderViews(), act, f"{proxy.GetXMLName()}: There is no view to click into.\n")


def pick(edit: Proxy, view: View, at: Sequence[int], button: str = "ClickPart") -> None:
    """Add the place at a pixel, from the lower left, of a view to the property of a button, and show the result."""
    seen = seen_at(edit, view, at)
    if seen is None:
        return
    from paraview import simple

    if ROWS[button] == "Points":
        seen |= {"button": button, "region": _in_panel(edit.GetProperty("PointRegion"))}
    point = _asked(edit, seen)
    if not point:
        return  # the filter has said why
    row = edit.GetProperty(ROWS[button])
    row.SetData("; ".join(filter(str.strip, [_in_panel(row), point])))
    edit.SMProxy.UpdateVTKObjects()
    simple.RenderAllViews()


def tell(image: Proxy, view: View, at: Sequence[int]) -> None:
    """Let an image's filter say in its panel what it, or the 3D view, shows at a pixel, from the lower left."""
    flat = any(display.Input.SMProxy == image.SMProxy for display in displays_in(view))
    seen = _camera_at(image if flat else None, view, at)
    if seen is not None:
        _asked(image, seen | {"button": TELLS})


def _in_panel(row: Property) -> str:
    """Return the value that a panel shows for a property, whether it was applied or not."""
    return str(row.SMProperty.GetUncheckedElement(0))


def _asked(filter: Proxy, seen: Mapping[str, object]) -> str:
    """Return what a filter answers to a click."""
    filter.GetProperty("Pick").SetData(json.dumps(seen))
    filter.SMProxy.UpdateVTKObjects()
    filter.UpdatePropertyInformation()
    answer = filter.GetProperty("Picked").GetData() or ""
    filter.GetProperty("Pick").SetData("")  # so that another click on the same pixel is a change, too
    filter.SMProxy.UpdateVTKObjects()
    return answer


def seen_at(edit: Proxy, view: View, at: Sequence[int]) -> dict[str, object] | None:
    """Return the camera and the pixel that a click means, as values of StyleRF Render; None beside an image.

    In a view of an image of the filter's scene, the camera is the image's, otherwise the view's own. If the view shows
    a picture of the scene, the place that is visible in it is there as well, or why there is none.
    """
    picture, flat = _picture_in(view, edit)
    seen = _camera_at(picture if flat else None, view, at)
    return seen if picture is None or seen is None else seen | json.loads(_asked(picture, seen))


def _camera_at(image: Proxy | None, view: View, at: Sequence[int]) -> dict[str, object] | None:
    """Return the camera and the pixel that a click means: those of an image that the view shows, or the view's own."""
    if image is None:
        width, height = view.ViewSize
        return {
            "Camera": camera_numbers(view), "ParallelScale": parallel_scale_of(view), "Frame": 0,
            "ImageSize": [width, height], "pixel": [at[0], height - 1 - at[1]],
        }  # fmt: skip
    width, height = image.ImageSize
    pixel = pixel_at(place_under(view, at), (width, height, width, height))
    if pixel is None:
        return None
    return {
        "Camera": list(image.Camera), "ParallelScale": image.ParallelScale, "Frame": image.Frame,
        "ImageSize": [width, height], "pixel": list(pixel),
    }  # fmt: skip


def _picture_in(view: View, edit: Proxy) -> tuple[Proxy | None, bool]:
    """Return the filter whose picture of the filter's scene, before it or after it, a view shows, and if it is flat."""
    for given in (display.Input for display in displays_in(view)):
        flat = given.SMProxy.GetXMLName() == IMAGE
        shown = given.Input if given.SMProxy.GetXMLName() == PLACED else given
        if shown is None or shown.SMProxy.GetXMLName() not in (IMAGE, VOLUME):
            continue
        picture = python_proxy(shown.SMProxy)
        own = picture.Input
        if any(source.SMProxy == edit.SMProxy for source in upstream(picture)):
            return picture, flat
        if own is not None and any(source.SMProxy == own.SMProxy for source in upstream(edit)):
            return picture, flat
    return None, False
