"""What is kept for VTK objects goes when they go; each of their events is observed once."""

from __future__ import annotations

import weakref

from vtkmodules.vtkCommonCore import vtkObject

from svv.pv.observers import Watched, WeakReference, observe, with_data


class Thing:
    """Something to keep."""


def test_what_is_kept_for_an_object_goes_with_it() -> None:
    watched: Watched[Thing] = Watched()
    first, second = vtkObject(), vtkObject()
    watched.put(first, Thing())
    watched.put(second, Thing())
    kept = watched.get(first)
    assert kept is not None and kept is not watched.get(second)
    gone = weakref.ref(kept)
    del first, kept
    assert second in watched and vtkObject() not in watched
    assert gone() is None


def test_one_thing_is_kept_for_an_object() -> None:
    watched: Watched[int] = Watched()
    one = vtkObject()
    assert one not in watched and watched.get(one) is None
    watched.put(one, 1)
    watched.put(one, 2)
    assert watched.get(one) == 2


def test_a_weak_reference_does_not_keep_an_object() -> None:
    one = vtkObject()
    reference = WeakReference(one)
    assert reference.Get() is one
    del one
    assert reference.Get() is None


def test_an_event_is_observed_once_however_often_this_is_asked_for() -> None:
    seen: list[str] = []
    one, other = vtkObject(), vtkObject()

    def note(thing: vtkObject, event: str) -> None:
        seen.append(event)

    for _ in range(3):
        observe(one, "ModifiedEvent", note)
    observe(one, "UserEvent", note)
    observe(other, "ModifiedEvent", note)
    one.Modified()
    assert seen == ["ModifiedEvent"]
    one.InvokeEvent("UserEvent")
    other.Modified()
    assert seen == ["ModifiedEvent", "UserEvent", "ModifiedEvent"]


def test_an_observer_gets_the_data_that_it_asks_for() -> None:
    class Panel:
        def __init__(self) -> None:
            self.names: list[str] = []

        @with_data("string0")
        def pressed(self, thing: vtkObject, event: str, name: str) -> None:
            self.names.append(name)

    filter, panel = vtkObject(), Panel()
    observe(filter, "UserEvent", panel.pressed)
    filter.InvokeEvent("UserEvent", "ClickPart")
    assert panel.names == ["ClickPart"]
