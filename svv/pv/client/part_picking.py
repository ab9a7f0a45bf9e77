"""Parts of regions, chosen by clicks into views: the button Click Part of StyleRF Edit's panel.

Client code. A click sends the camera and the pixel to the filter, which looks up the point in space that is visible
there; the client appends the point to the property Parts. Points, unlike pixels, mean the same after the camera has
moved and other regions were hidden.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

from svv.pv.client.clicks import pixel_at, place_under, press
from svv.pv.client.linked_camera import camera_numbers, parallel_scale_of, upstream
from svv.pv.client.observers import python_proxy, with_data
from svv.pv.paraview_types import Proxy, SMProxy, View

BUTTON = "ClickPart"
IMAGE = "StyleRFRender"
"""The filter whose image of the scene can be clicked into."""


@with_data("string0")
def pressed(proxy: SMProxy, event: str, name: str) -> None:
    """Start handling clicks; if the button is pressed again, stop. An observer of StyleRF Edit."""
    if name != BUTTON:
        return
    from paraview import simple

    press(python_proxy(proxy), BUTTON, simple.GetRenderViews(), pick, "StyleRFEdit: There is no view to click into.\n")


def pick(edit: Proxy, view: View, at: Sequence[int]) -> None:
    """Split off the part of a region that is visible at a pixel of a view, and show the result.

    Args:
        edit: Proxy of StyleRF Edit.
        view: A 3D view with a camera, or one that shows the image of StyleRF Render.
        at: Pixel from the lower left of the view.
    """
    seen = seen_at(edit, view, at)
    if seen is None:
        return
    from paraview import simple

    edit.GetProperty("Pick").SetData(json.dumps(seen))
    edit.SMProxy.UpdateVTKObjects()
    edit.UpdatePropertyInformation()
    point = edit.GetProperty("Picked").GetData() or ""
    if not point:
        return  # the filter has said why
    parts = edit.GetProperty("Parts")
    parts.SetData("; ".join(filter(str.strip, [parts.GetData() or "", point])))
    edit.SMProxy.UpdateVTKObjects()
    simple.RenderAllViews()


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
    """Return the filter whose image of the edited scene a view shows; None if it shows none."""
    for display in view.Representations:
        given = getattr(display, "Input", None)
        if given is None or not display.Visibility or given.SMProxy.GetXMLName() != IMAGE:
            continue
        image = python_proxy(given.SMProxy)
        if any(source.SMProxy == edit.SMProxy for source in upstream(image)):
            return image
    return None
