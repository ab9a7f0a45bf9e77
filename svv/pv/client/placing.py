"""Pictures in the 3D view: StyleRF Place In View, whose image is rendered for the camera of the view that shows it.

Client code. Before a view is drawn, the images in it that follow a camera are given the view's: so scripts, links
between cameras, and buttons that turn a view work like the mouse. While that moves, images are small.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from vtkmodules.vtkCommonCore import VTK_INT

from svv.pv.display.linked_camera import IMAGES, PLACED, busy, displays_in, look_through, timed
from svv.pv.observers import python_proxy, with_data
from svv.pv.paraview_types import Display, Proxy, SMViewProxy, View

DISPLAY = "GeometryRepresentation"
"""XML name of the representation with which ParaView shows a surface in a 3D view."""


def as_placed(display: Display) -> bool:
    """Show a picture in its own colours, unlit, and let its image follow; return False if it is something else."""
    if display.Input.SMProxy.GetXMLName() != PLACED:
        return False
    display.Representation = "Surface"
    display.ColorArrayName = ["POINTS", "RGBA"]
    display.MapScalars = 0
    display.Ambient, display.Diffuse, display.Specular = 1.0, 0.0, 0.0
    image = _image_of(display)
    if image is not None and not image.FollowCamera:
        image.FollowCamera = 1
    return True


def pictures_in(view: View) -> Iterator[tuple[Proxy, Proxy]]:
    """Yield the pictures that a view shows, with the filters of their images."""
    for display in displays_in(view):
        image = _image_of(display) if display.Input.SMProxy.GetXMLName() == PLACED else None
        if image is not None:
            yield display.Input, image


def _image_of(display: Display) -> Proxy | None:
    """Return the filter whose image a picture shows; None if it is no image of a scene."""
    given = display.Input.Input
    known = given is not None and given.SMProxy.GetXMLName() in IMAGES
    return python_proxy(given.SMProxy) if known else None


@with_data(VTK_INT)
def render_pictures(proxy: SMViewProxy, event: str, interactive: int) -> None:
    """Render the images of a 3D view's pictures for its camera before it is drawn; an observer of the views."""
    view = python_proxy(proxy)
    turned = False
    for picture, image in list(pictures_in(view)):
        if image.FollowCamera and not busy() and look_through(image, view, bool(interactive)):
            timed(image, partial(picture.UpdatePipeline, view.ViewTime))
            turned = True
    if turned and interactive:
        proxy.Update()  # ParaView updates views before still images only
