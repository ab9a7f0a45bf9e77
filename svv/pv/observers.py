"""What client code observes and keeps, for as long as the proxies exist: a long session deletes thousands of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

from vtkmodules.vtkCommonCore import vtkWeakReference

from svv.pv.paraview_types import Observed, Observer, Proxy, SMProxy, SMViewProxy, View

Kept = TypeVar("Kept")
Thing = TypeVar("Thing")
Do = TypeVar("Do", bound=Observer)


_new_reference: Callable[[], Any] = vtkWeakReference
"""Its types do not tell of which class the object is."""


class WeakReference(Generic[Thing]):
    """Refers to one of VTK's objects without keeping it alive, and to None once that has been deleted."""

    def __init__(self, thing: Thing) -> None:
        self._reference = _new_reference()
        self._reference.Set(thing)

    def Get(self) -> Thing:
        """Return the object; None if it has been deleted."""
        found: Thing = self._reference.Get()
        return found


class Watched(Generic[Kept]):
    """Proxies, each with something that is kept for it. Both are forgotten once the proxy has been deleted.

    The address of a session and the ID of a proxy would not do as a key, because later ones are given the same.
    """

    def __init__(self) -> None:
        self._known: list[tuple[WeakReference[Any], Kept]] = []

    def __contains__(self, proxy: object) -> bool:
        """Return whether something is kept for a proxy."""
        self._known[:] = [known for known in self._known if known[0].Get() is not None]
        return any(known[0].Get() is proxy for known in self._known)

    def get(self, proxy: Observed) -> Kept | None:
        """Return what is kept for a proxy; None if it is not known."""
        return next((kept for reference, kept in self._known if reference.Get() is proxy), None)

    def items(self) -> list[tuple[SMProxy, Kept]]:
        """Return the proxies that still exist, each with what is kept for it."""
        pairs = [(reference.Get(), kept) for reference, kept in self._known]
        return [(proxy, kept) for proxy, kept in pairs if proxy is not None]

    def put(self, proxy: Observed, kept: Kept) -> None:
        """Keep something for a proxy, instead of what was kept for it before."""
        self._known[:] = [known for known in self._known if known[0].Get() not in (None, proxy)]
        self._known.append((WeakReference(proxy), kept))


_observers: Watched[list[tuple[str, Observer]]] = Watched()
"""What observes each proxy, by event; VTK holds no references to observers."""


def observe(proxy: Observed, event: str, do: Observer) -> None:
    """Call a function at an event of a proxy, from now on, once each time however often this is asked for."""
    known = _observers.get(proxy) or []
    if (event, do) not in known:
        _observers.put(proxy, [*known, (event, do)])
        proxy.AddObserver(event, do)


def with_data(kind: int | str) -> Callable[[Do], Do]:
    """Return a decorator by which VTK passes an event's data (``VTK_INT`` or ``string0``) on to its observer."""

    def decorate(do: Do) -> Do:
        vars(do)["CallDataType"] = kind
        return do

    return decorate


@overload
def python_proxy(proxy: SMViewProxy) -> View: ...
@overload
def python_proxy(proxy: SMProxy) -> Proxy: ...
def python_proxy(proxy: SMProxy) -> Proxy:
    """Return the object by which Python knows a proxy; None for None."""
    from paraview import servermanager

    return servermanager._getPyProxy(proxy)
