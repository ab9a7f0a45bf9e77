"""What client code keeps for proxies, for as long as these exist: a long session deletes thousands of them."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from vtkmodules.vtkCommonCore import vtkWeakReference

Kept = TypeVar("Kept")


class Watched(Generic[Kept]):
    """Proxies, each with something that is kept for it. Both are forgotten once the proxy has been deleted.

    The address of a session and the ID of a proxy would not do as a key, because later ones are given the same.
    """

    def __init__(self) -> None:
        self._known: list[tuple[vtkWeakReference, Kept]] = []

    def __contains__(self, proxy: object) -> bool:
        """Return whether something is kept for a proxy."""
        self._known[:] = [known for known in self._known if known[0].Get() is not None]
        return any(known[0].Get() is proxy for known in self._known)

    def get(self, proxy: Any) -> Kept | None:
        """Return what is kept for a proxy; None if it is not known."""
        return next((kept for reference, kept in self._known if reference.Get() is proxy), None)

    def items(self) -> list[tuple[Any, Kept]]:
        """Return the proxies that still exist, each with what is kept for it."""
        pairs = [(reference.Get(), kept) for reference, kept in self._known]
        return [(proxy, kept) for proxy, kept in pairs if proxy is not None]

    def put(self, proxy: Any, kept: Kept) -> None:
        """Keep something for a proxy, instead of what was kept for it before."""
        self._known[:] = [known for known in self._known if known[0].Get() not in (None, proxy)]
        reference = vtkWeakReference()
        reference.Set(proxy)
        self._known.append((reference, kept))
