"""The property Follow Camera, by which images start and stop to follow; those of the window's new filters do.

Client code. Views and layouts must not be changed while ParaView draws them or loads a state: a timer in the window
does it later, and in a script the next rendering.
"""

from __future__ import annotations

from vtkmodules.vtkCommonCore import VTK_INT

from svv.pv.display import linked_camera
from svv.pv.observers import Watched, WeakReference, python_proxy, with_data
from svv.pv.paraview_types import Proxy, SMProxy, SMViewProxy
from svv.pv.timers import Alarm, by_window

PROPERTY = "FollowCamera"

_waiting: list[WeakReference[SMProxy]] = []
"""Weak references to the filters with a new image or a newly set property."""

_beginning: list[bool] = []
"""Non-empty while views are being arranged."""

_known: Watched[list[bool]] = Watched()
"""The filters, each with whether its first image is still to be shown."""


def begin(filter: Proxy, loading: bool) -> None:
    """Let the image of a new filter of the window follow, and show it anyway; a loaded state says itself what to do."""
    if filter.SMProxy in _known:
        return
    ours = by_window() and not loading
    _known.put(filter.SMProxy, [ours])
    if ours:
        filter.FollowCamera = 1


def _is_new(proxy: SMProxy) -> bool:
    return (_known.get(proxy) or [False])[0]


def _wait_for(proxy: SMProxy) -> None:
    if all(known.Get() is not proxy for known in _waiting):
        _waiting.append(WeakReference(proxy))


@with_data("string0")
def property_set(proxy: SMProxy, event: str, name: str) -> None:
    """Start or stop following if the property has been set; an observer of the image filters."""
    if name != PROPERTY:
        return
    filter = python_proxy(proxy)
    if not filter.FollowCamera:
        linked_camera.stop_following(filter)
        filter.Moving = 0
    elif linked_camera.follower_of(filter) is None and filter.GetDataInformation().GetNumberOfPoints():
        linked_camera.forget_closed(filter)
        _wait_for(proxy)
        if not _later.set():
            _begin()


def image_updated(proxy: SMProxy, event: str) -> None:
    """Remember that a filter has a new image; an observer of the image filters."""
    filter = python_proxy(proxy)
    follower = linked_camera.follower_of(filter)
    if (filter.FollowCamera or _is_new(proxy)) and not (follower is not None and follower.drawing):
        _wait_for(proxy)
        _later.set()


@with_data(VTK_INT)
def view_drawn(proxy: SMViewProxy, event: str, interactive: int) -> None:
    """Process the waiting filters; an observer of the 3D views."""
    for follower in linked_camera.followers():
        # Cameras are moved by buttons, links and scripts, too; while the mouse moves one, the follower hears of it.
        late = follower.behind or (not interactive and follower.strayed(proxy))
        if late and not follower.drawing:
            _wait_for(follower.filter.SMProxy)
    if _waiting and (linked_camera.saving_animation() or not _later.set()):  # no timer goes off while frames are saved
        _begin()


def _begin() -> None:
    """Start following, or update the follower, for each waiting filter that has an image."""
    from paraview import servermanager

    if _beginning:  # showing an image draws a view, which would call this again
        return
    busy = linked_camera.busy() and not linked_camera.saving_animation()
    if busy or servermanager.ProxyManager().GetInLoadXMLState():
        _later.set()
        return
    waiting = [reference.Get() for reference in _waiting]
    _waiting.clear()
    _beginning.append(True)
    try:
        _follow(waiting)
    finally:
        _beginning.clear()
        _waiting.clear()


def _follow(waiting: list[SMProxy]) -> None:
    from paraview import simple

    for proxy in waiting:
        filter = python_proxy(proxy)
        if filter is None or not filter.GetDataInformation().GetNumberOfPoints():
            continue
        new, follower, view = _is_new(proxy), linked_camera.follower_of(filter), linked_camera.view_to_follow(filter)
        _known.put(proxy, [False])
        if follower is not None:
            follower.update(False)
        elif linked_camera.placed(filter) or view is None:  # a picture needs no view of its own
            continue
        elif filter.FollowCamera and linked_camera.view_closed(filter):
            linked_camera.stop_following(filter)
        elif filter.FollowCamera:
            linked_camera.follow(filter)
        elif new and not any(linked_camera.shows(other, [filter]) for other in simple.GetRenderViews()):
            simple.Render(linked_camera.show_beside(filter, view))


_later = Alarm(50, _begin)
"""The window's timer for the waiting filters."""
