"""What is kept for VTK objects goes when they go."""

from __future__ import annotations

import weakref

from vtkmodules.vtkCommonCore import vtkObject

from svv.pv.client.observers import Watched


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
