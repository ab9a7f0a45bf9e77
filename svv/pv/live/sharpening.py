"""Show what filters learn beside ParaView's window as it becomes better: a timer asks them for news.

Client code. Filters that a script makes, or a state that a script loads, are not told that there is a window: they are
finished when they return.
"""

from __future__ import annotations

from typing import Any

from svv.pv.connection import server_gone
from svv.pv.display.linked_camera import busy, follower_of, may_be_late, shows, upstream
from svv.pv.observers import Watched, python_proxy, with_data
from svv.pv.timers import Alarm, by_window

BESIDE = ("StyleRFStylizedView", "StyleRFTrain", "StyleRFStylize", "StyleRFPalette")
"""Filters that learn beside the window (:class:`svv.pv.live.beside.Beside`)."""

BUTTONS = ("Pause", "GoOn", "StopHere")
"""Buttons after which there is news."""

SAVING = ("SaveScene", "SaveFigure")
"""Buttons after which the panel says what was saved, or why not."""

_watched: Watched[list[str]] = Watched()
"""The filters, each with what it last told."""


def watch_learning(filter: Any, loading: bool = False) -> None:
    """Tell a filter of BESIDE, new or of a state that loads, if the window has made it; keep it up to date."""
    proxy = filter.SMProxy
    if proxy in _watched:
        return
    _watched.put(proxy, [""])
    if by_window():
        in_window(filter, soon=not loading)
    proxy.AddObserver("UpdateDataEvent", _updated)
    proxy.AddObserver("UpdatePropertyEvent", _pressed)


def in_window(filter: Any, soon: bool = True) -> None:
    """Tell a filter that the window has made it, so that Live counts, and that it will soon be applied first."""
    _tell(filter.SMProxy, "InWindow", 2 if soon else 1)
    filter.SMProxy.UpdatePropertyInformation(filter.SMProxy.GetProperty("Status"))


def _tell(proxy: Any, name: str, value: Any) -> None:
    """Set an internal property, of which neither states nor traces nor Python know."""
    proxy.GetProperty(name).SetElement(0, value)
    proxy.UpdateProperty(name)


def _updated(proxy: Any, event: str) -> None:
    if not _in_window(proxy) or server_gone(proxy):
        return
    if _news_of(proxy).endswith("*"):
        _later.set()
    proxy.UpdatePropertyInformation(proxy.GetProperty("Status"))


@with_data("string0")
def _pressed(proxy: Any, event: str, name: str) -> None:
    if name in SAVING:
        proxy.UpdatePropertyInformation(proxy.GetProperty("Status"))
    if name in BUTTONS and _in_window(proxy):
        _later.set()


def _in_window(proxy: Any) -> bool:
    return bool(proxy.GetProperty("InWindow").GetElement(0))


def _news_of(proxy: Any) -> str:
    """Return what a filter tells of its learning (:meth:`svv.pv.live.beside.Beside.GetLearned`)."""
    told = proxy.GetProperty("Learned")
    proxy.UpdatePropertyInformation(told)
    return str(told.GetElement(0) or "")


def _look() -> None:
    """Ask all filters that learn, and update those with news."""
    if busy():
        _later.set()
        return
    for proxy, last in _watched.items():
        if server_gone(proxy) or not _in_window(proxy):
            continue
        news = _news_of(proxy)
        if news != last[0]:
            last[0] = news
            _show(proxy, news)
        if news.endswith("*"):
            proxy.UpdatePropertyInformation(proxy.GetProperty("Status"))
            _later.set()


def _show(proxy: Any, news: str) -> None:
    """Update a filter that has something new, and draw the views that show it."""
    from paraview import simple

    filter = python_proxy(proxy)
    _tell(proxy, "LiveState", news)
    may_be_late(proxy)
    if news.endswith(" none"):
        return  # it has not been applied
    filter.UpdatePipeline()
    proxy.UpdatePropertyInformation(proxy.GetProperty("Status"))
    follower = follower_of(filter)
    if follower is not None:
        follower.update(False)
    behind = [source for source in simple.GetSources().values() if filter in list(upstream(source))]
    for view in simple.GetViews():
        if shows(view, [filter, *behind]):
            simple.Render(view)


_later = Alarm(250, _look)
"""The window's timer while something is learning."""
