"""What the networks say of a view's samples, kept while a scene is edited: an edit changes neither rays nor networks.

Whoever edits a scene draws the same view again and again, and most of the time goes into rays and networks. From the
third image of a view on, both are therefore those of the second. The image is the same, bit by bit.
"""

from __future__ import annotations

import itertools
import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Protocol, TypeVar, cast

from torch import Tensor

from svv.core.geometry.cameras import Camera
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.model import Model
from svv.fields.scene.open_cells import key_of_open_cells
from svv.kernels.types import Samples

MOST_BYTES = 256 << 20
"""Most memory of all kept views together; 800 x 800 pixels of the head take 60 MB."""

REMEMBERED = 16
"""Views of which it is known that they have been drawn; only those are kept that are drawn again."""


@dataclass(frozen=True)
class Look:
    """Samples of some rays, and what the networks say of them."""

    samples: Samples
    raw: Tensor
    """Output of the palette MLP. (S, 1 + 4 P)"""
    light: Tensor | None
    """Output of the lighting MLP (S, 1 or 2); None where the light is explicit, or there is none."""
    paint: dict[Hashable, Tensor] = field(default_factory=dict)
    """The paint that was last seen (S, 3), by what it depends on: at most one."""

    def painted(self, key: Hashable | None, make: Callable[[], Tensor | None]) -> Tensor | None:
        """Return the paint of the samples, made if it is not known; ``key`` is from :func:`key_of_paint`."""
        found = None if key is None else self.paint.get(key)
        if found is None:
            found = make()
            self.paint.clear()
            if key is not None and found is not None:
                self.paint[key] = found
        return found

    @property
    def bytes(self) -> int:
        """Memory that it takes."""
        tensors = [
            self.raw,
            self.light,
            *list(self.paint.values()),
            *(v for v in vars(self.samples).values() if isinstance(v, Tensor)),
        ]
        return sum(t.numel() * t.element_size() for t in tensors if t is not None)


class Kept(Protocol):
    """What is kept of some rays: a look, or several."""

    @property
    def bytes(self) -> int:
        """Memory that it takes."""


Looks = dict[int, Kept | None]
"""First pixel of a chunk of rays -> what is kept of it, None if nothing is visible."""

L = TypeVar("L", bound=Kept | None)


class ViewCache:
    """The views that are kept; the oldest make room for new ones.

    Images may be drawn in several threads. A view is stored when it is complete, so none is ever seen half done.
    Networks may be collected, and their views forgotten, in the middle of any loop here: each goes over a copy.
    """

    def __init__(self, most: int = MOST_BYTES) -> None:
        self.most = most
        self._views: OrderedDict[Hashable, Looks] = OrderedDict()
        self._drawn: OrderedDict[Hashable, None] = OrderedDict()
        self._lock = threading.RLock()

    @property
    def bytes(self) -> int:
        """Memory that all of them take."""
        return sum(map(bytes_of, list(self._views.values())))

    def look(self, key: Hashable) -> Looks | None:
        """Return the looks of a view, empty if it should be kept this time, None if it need not be."""
        with self._lock:
            if key in self._views:
                self._views.move_to_end(key)
                return self._views[key]
            again = key in self._drawn
            self._drawn[key] = None
            self._drawn.move_to_end(key)
            while len(self._drawn) > REMEMBERED:
                self._drawn.popitem(last=False)
            return {} if again else None

    def keep(self, key: Hashable, looks: Looks) -> None:
        """Keep a complete view, unless it is too large."""
        with self._lock:
            if bytes_of(looks) > self.most:
                return
            self._views[key] = looks
            while self._views and self.bytes > self.most:
                self._views.popitem(last=False)

    def drop(self, key: Hashable) -> None:
        """Forget one view."""
        with self._lock:
            self._views.pop(key, None)

    def forget(self, holder: int) -> None:
        """Forget all views of something that no longer exists; ``holder`` is its number in the keys."""
        with self._lock:
            for views in (self._views, self._drawn):
                for key in list(views):
                    if isinstance(key, tuple) and holder in key[0]:
                        views.pop(key, None)


KEPT = ViewCache()
"""Those of this process."""

_ALL_ANEW: ContextVar[bool] = ContextVar("_ALL_ANEW", default=False)


@contextmanager
def disable_view_cache() -> Iterator[None]:
    """Draw every image anew, for whoever measures what an image costs; also a decorator."""
    before = _ALL_ANEW.set(True)
    try:
        yield
    finally:
        _ALL_ANEW.reset(before)


_AT_ONCE: ContextVar[list[Hashable] | None] = ContextVar("_AT_ONCE", default=None)


@contextmanager
def cache_every_view() -> Iterator[None]:
    """Keep every view from its first image on, until the end: for whoever draws several edits of a scene in turn."""
    keys: list[Hashable] = []
    before = _AT_ONCE.set(keys)
    try:
        yield
    finally:
        _AT_ONCE.reset(before)
        for key in keys:
            KEPT.drop(key)


_numbers: dict[int, tuple[weakref.ref[object], int]] = {}
_COUNT = itertools.count()


class View:
    """A view while it is drawn: its looks are taken from those that are kept, or made, and kept if it is worth it.

    ``key``: what the looks depend on, from :func:`key_of`; None if none may be kept.
    """

    def __init__(self, key: Hashable | None) -> None:
        self._key, self._bytes = key, 0
        self._looks = None if key is None else KEPT.look(key)
        if key is not None and self._looks is None and _AT_ONCE.get() is not None:
            self._looks = {}
        self._complete = bool(self._looks)

    def look(self, first: int, make: Callable[[], L]) -> L:
        """Return the look of the chunk that begins with a pixel, made if it is not known."""
        if self._looks is None:
            return make()
        if first not in self._looks:
            look = self._looks[first] = make()
            self._bytes += 0 if look is None else look.bytes
            if self._bytes > KEPT.most:
                self._looks = None
            return look
        return cast(L, self._looks[first])

    def drawn(self) -> None:
        """Keep the view, which is complete."""
        if self._looks and not self._complete:
            assert self._key is not None
            KEPT.keep(self._key, self._looks)
            at_once = _AT_ONCE.get()
            if at_once is not None:
                at_once.append(self._key)


def bytes_of(looks: Looks) -> int:
    """Return the memory that a view takes."""
    return sum(look.bytes for look in looks.values() if look is not None)


def key_of(scene: Model, camera: Camera, how: Marching, drawn_from: Hashable = None) -> Hashable | None:
    """Return what the samples and the networks' outputs of a view depend on; None if they must not be kept.

    That is the networks' tensors with their versions, the occupied cells, the camera, how rays are marched, what is cut
    off or hidden, and what it is ``drawn_from``. It is not the other edits. Nothing of a network that is being trained
    is kept.
    """
    parts = (scene.base, scene.palette_network)
    tensors = [t for part in parts if part is not None for t in part.parameters()]
    if _ALL_ANEW.get() or any(t.requires_grad or t.is_inference() for t in tensors):
        return None
    holders, versions = (scene.occupancy, *tensors), tuple(t._version for t in tensors)
    place = camera.camera_to_world.tobytes(), camera.fov_x, camera.width, camera.height, camera.span_x, camera.centre
    whole = tuple(cut for cut in scene.cuts if not cut.regions), key_of_open_cells(scene)
    return tuple(map(_number_of, holders)), versions, place, how, scene.settings.headlight, whole, drawn_from


def key_of_paint(scene: Model, network: str) -> Hashable | None:
    """Return what the paint of a view's samples depends on besides :func:`key_of`; None if it must not be kept."""
    shown = scene.paint_shown if network == "styled" else None
    tensors = [] if shown is None else list(shown.parameters())
    if shown is None or any(t.requires_grad or t.is_inference() for t in tensors):
        return None
    parts = None if scene.parts is None else (scene.parts.digest, scene.parts.active)
    strokes = tuple(sorted(scene.stroked.items())), tuple(scene.roots), scene.resolved
    return _number_of(shown), tuple(t._version for t in tensors), parts, strokes


def _number_of(holder: object) -> int:
    """Return a number that no other object has or will have; all its views are forgotten together with the object."""
    known, number = _numbers.get(id(holder), (None, 0))
    if known is None or known() is not holder:
        number = next(_COUNT)
        _numbers[id(holder)] = weakref.ref(holder), number
        weakref.finalize(holder, _forget, id(holder), number).atexit = False
    return number


def _forget(place: int, number: int) -> None:
    if _numbers.get(place, (None, -1))[1] == number:
        del _numbers[place]
    KEPT.forget(number)
