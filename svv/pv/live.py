"""The property Follow Camera: watches the image filters, and begins and ends the live camera as they say.

Client code. Views and layouts must not be changed while ParaView draws them or loads a state, so what is to be done
waits: in the window for a timer, in a script for the next picture.
"""

from __future__ import annotations

from typing import Any

from vtkmodules.vtkCommonCore import vtkWeakReference

from svv.pv.follow import busy, follow, follower_of, followers, stop_following, view_to_follow

PROPERTY = "FollowCamera"

PAUSE = 50
"""Milliseconds until the window's timer looks again."""

_watched: list[Any] = []
"""Weak references to the filters and views that are observed."""

_waiting: list[Any] = []
"""Weak references to the filters whose image is new, or whose property was set."""

_beginning: list[bool] = []
"""Not empty while views are being arranged."""

_timers: list[Timer] = []
"""At most one, held here: VTK alone would let Python collect it."""


class Timer:
    """Looks again soon, from the event loop of a window."""

    def __init__(self, interactor: Any) -> None:
        self._interactor = vtkWeakReference()
        self._interactor.Set(interactor)
        self._do = self._tick
        self._tag = interactor.AddObserver("TimerEvent", self._do)
        self._id = interactor.CreateOneShotTimer(PAUSE)

    @property
    def alive(self) -> bool:
        """Whether the window is still there."""
        return self._interactor.Get() is not None

    def _tick(self, *_: Any) -> None:
        interactor: Any = self._interactor.Get()
        interactor.RemoveObserver(self._tag)
        interactor.DestroyTimer(self._id)
        _timers.remove(self)
        _begin()


def watch_camera(filter: Any) -> None:
    """Let a filter's property Follow Camera work, from now on.

    Args:
        filter: StyleRF Render or StyleRF Stylized View, as ParaView's Python has it.
    """
    if _new(filter.SMProxy):
        filter.SMProxy.AddObserver("UpdatePropertyEvent", _pushed)
        filter.SMProxy.AddObserver("UpdateDataEvent", _updated)


def watch_view(view: Any) -> None:
    """Look at what waits when a view has been drawn.

    Args:
        view: A 3D view, as ParaView's Python has it.
    """
    if _new(view.SMProxy):
        view.SMProxy.AddObserver("EndEvent", _drawn)


def _new(proxy: Any) -> bool:
    """Whether a proxy is not yet observed; from now on it is."""
    _watched[:] = [known for known in _watched if known.Get() is not None]
    if any(known.Get() is proxy for known in _watched):
        return False
    _add(_watched, proxy)
    return True


def _add(references: list[Any], proxy: Any) -> None:
    if all(known.Get() is not proxy for known in references):
        references.append(vtkWeakReference())
        references[-1].Set(proxy)


def _pushed(proxy: Any, event: str, name: str) -> None:
    if name != PROPERTY:
        return
    filter = _python(proxy)
    if not filter.FollowCamera:
        stop_following(filter)
    elif follower_of(filter) is None and filter.GetDataInformation().GetNumberOfPoints():
        _add(_waiting, proxy)
        if not _soon():
            _begin()


_pushed.CallDataType = "string0"  # type: ignore[attr-defined]


def _updated(proxy: Any, event: str) -> None:
    filter = _python(proxy)
    follower = follower_of(filter)
    if filter.FollowCamera and not (follower is not None and follower.drawing):
        _add(_waiting, proxy)
        _soon()


def _drawn(proxy: Any, event: str) -> None:
    for follower in followers():
        if follower.behind and not follower.drawing:
            _add(_waiting, follower.filter.SMProxy)
    if _waiting and not _soon():
        _begin()


def _soon() -> bool:
    """Let the window's timer look at what waits; False where there is no window, whose script does it itself."""
    from paraview import simple

    _timers[:] = [timer for timer in _timers if timer.alive]
    if _timers:
        return True
    for view in simple.GetRenderViews():
        interactor = view.GetInteractor()
        if interactor is not None and interactor.GetClassName().startswith("QVTK"):  # only that has an event loop
            _timers.append(Timer(interactor))
            return True
    return False


def _begin() -> None:
    """Begin to follow for all that wait and have an image, or bring what follows up to date."""
    from paraview import servermanager

    if _beginning:  # what is shown now is drawn, and that would begin it again
        return
    if busy() or servermanager.ProxyManager().GetInLoadXMLState():
        _soon()
        return
    waiting = [reference.Get() for reference in _waiting]
    _waiting.clear()
    _beginning.append(True)
    try:
        _follow(waiting)
    finally:
        _beginning.clear()
        _waiting.clear()


def _follow(waiting: list[Any]) -> None:
    for proxy in waiting:
        filter = None if proxy is None else _python(proxy)
        if filter is None or not filter.FollowCamera or not filter.GetDataInformation().GetNumberOfPoints():
            continue
        follower = follower_of(filter)
        if follower is not None:
            follower.update(1.0)
        elif view_to_follow(filter) is not None:
            follow(filter)


def _python(proxy: Any) -> Any:
    from paraview import servermanager

    return servermanager._getPyProxy(proxy)
