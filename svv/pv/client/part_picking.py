"""Places in a scene, chosen by clicks into views: buttons of the panels of StyleRF Edit and StyleRF Palette.

Client code. A click sends the camera and the pixel to the filter, which looks up the point in space that is visible
there; the client appends the filter's answer to a property. Points, unlike pixels, mean the same after the camera has
moved and other regions were hidden.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial

from svv.pv.client.clicks import pixel_at, place_under, press
from svv.pv.client.linked_camera import camera_numbers, parallel_scale_of, upstream
from svv.pv.client.observers import python_proxy, with_data
from svv.pv.paraview_types import Property, Proxy, SMProxy, View

ROWS = {"ClickPart": "Parts", "ClickRegion": "Points", "ClickSame": "Points"}
"""Button -> the property to which its clicks add."""

IMAGE = "StyleRFRender"
"""The filter whose image of the scene can be clicked into."""


@with_data("string0")
def pressed(proxy: SMProxy, event: str, name: str) -> None:
    """Start handling clicks; if the button is pressed again, stop. An observer of StyleRF Edit and StyleRF Palette."""
    if name not in ROWS:
        return
    from paraview import simple

    filter, act = python_proxy(proxy), partial(pick, button=name)
    press(filter, name, simple.GetRenderViews(), act, f"{proxy.GetXMLName()}: There is no view to click into.\n")


def pick(edit: Proxy, view: View, at: Sequence[int], button: str = "ClickPart") -> None:
    """Add the place that is visible at a pixel of a view to a property, and show the result.

    Args:
        edit: Proxy of StyleRF Edit or StyleRF Palette.
        view: A 3D view with a camera, or one that shows the image of StyleRF Render.
        at: Pixel from the lower left of the view.
        button: One of :data:`ROWS`: what the click means.
    """
    seen = seen_at(edit, view, at)
    if seen is None:
        return
    from paraview import simple

    if ROWS[button] == "Points":
        seen |= {"button": button, "region": _in_panel(edit.GetProperty("PointRegion"))}
    edit.GetProperty("Pick").SetData(json.dumps(seen))
    edit.SMProxy.UpdateVTKObjects()
    edit.UpdatePropertyInformation()
    point = edit.GetProperty("Picked").GetData() or ""
    edit.GetProperty("Pick").SetData("")  # so that another click on the same pixel is a change, too
    edit.SMProxy.UpdateVTKObjects()
    if not point:
        return  # the filter has said why
    row = edit.GetProperty(ROWS[button])
    row.SetData("; ".join(filter(str.strip, [_in_panel(row), point])))
    edit.SMProxy.UpdateVTKObjects()
    simple.RenderAllViews()


def _in_panel(row: Property) -> str:
    """Return the value that a panel shows for a property, whether it was applied or not."""
    return str(row.SMProperty.GetUncheckedElement(0))


def seen_at(edit: Proxy, view: View, at: Sequence[int]) -> dict[str, object] | None:
    """Return the camera and the pixel that a click means, as values of StyleRF Render; None beside an image.

    In a view that shows an image of the filter's scene, the camera is that of the image, otherwise the view's own.
    """
    image = _image_in(view, edit)
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


def _image_in(view: View, edit: Proxy) -> Proxy | None:
    """Return the filter whose image of the filter's scene, before it or after it, a view shows; None if none is."""
    for display in view.Representations:
        given = getattr(display, "Input", None)
        if given is None or not display.Visibility or given.SMProxy.GetXMLName() != IMAGE:
            continue
        image = python_proxy(given.SMProxy)
        shown = image.Input
        if any(source.SMProxy == edit.SMProxy for source in upstream(image)):
            return image
        if shown is not None and any(source.SMProxy == shown.SMProxy for source in upstream(edit)):
            return image
    return None
