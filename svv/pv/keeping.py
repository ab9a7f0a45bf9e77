"""Filters that keep results in files, so that a saved state shows tomorrow what it shows today.

The files lie in the cache (:class:`svv.io.cache.Cache`) under names that say what they depend on
(:mod:`svv.pv.identity`). A state carries the names, in the property *Kept As*: where the file of a name is gone, the
filter says so and waits for a button, for nobody who opens a state asks for minutes of work by that.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svv.errors import BadInput, part, silent
from svv.io.cache import Cache
from svv.pv.filters import Filter
from svv.pv.identity import key_in, name_of, settings_in, source_of
from svv.pv.steps import Moment, Steps

if TYPE_CHECKING:
    from svv.fields.scene import Scene
    from svv.io.viewset import ViewSet

Views = tuple["ViewSet", "ViewSet | None"]

MADE = {"views": "drawn", "scene": "learned", "palette": "learned", "painting": "painted"}
"""Kinds of results, and what is done to have them."""

FOUND = " It was found where it is kept."


class Keeping(Filter):
    """A filter whose long work is done once for all processes."""

    button = "Take As Edited"
    """What starts the work where a saved state's result is gone."""

    def __init__(self, inputs: int, outputs: int, kind: str) -> None:
        super().__init__(inputs, outputs, kind)
        self._names: dict[str, str] = {}
        """Slot -> name under which the result that is given out is kept."""
        self._asked = self._anew = False
        self.note = ""
        """One more sentence for Status."""

    def begin_with(self, slot: str, kind: str, now: Moment) -> None:
        """Take up what a state was saved with, if the panel is still as it was; the data may have gone on since."""
        name = self.stated().get(slot, "")
        if self.steps.results or settings_in(name, kind) != now.settings:
            return
        found = self.kept_as(name, kind)
        if found is not None and _told(found):
            self.steps.put(_moment_of(found, now), (found, name))
            self.gives(**{slot: name})
            self.note = FOUND

    def begin_with_painting(self, now: Moment, settings: str, paintings: Steps[Any]) -> None:
        """Take up the painting that a state was saved with, and what was painted on: its file holds both."""
        name = self.stated().get("painted", "")
        if self.steps.results or paintings.results or settings_in(name, "painting") != settings:
            return
        found = self.kept_as(name, "painting")
        if found is not None and _told(found):
            below = name_of("scene", *found.made["key"].split("-"))
            self.steps.put(_moment_of(found, now), (found.without_variant(found.variant), below))
            paintings.put(Moment(settings, "", key_in(below)), (found, name))
            self.gives(scene=below, painted=name)
            self.note = FOUND

    def found_or_made(
        self, slot: str, kind: str, now: Moment, make: Callable[[], Any], own: Callable[[], Any] | None = None
    ) -> tuple[Any, str]:
        """A result, the one that was kept, or else made now and kept; and its name.

        Args:
            slot: What the filter calls it in the property Kept As.
            kind: One of :data:`MADE`.
            now: What it depends on.
            make: Makes it.
            own: Gives the one in a file of the user's own, None where that is not it.

        Raises:
            BadInput: a state was opened whose result is gone; any reason of ``make`` and ``own``.
        """
        name, stated = name_of(kind, source_of(now), now.settings), self.stated().get(slot, "")
        self.note = ""
        if not self._anew:
            found = None if own is None else own()
            if found is None:
                found = self.kept_as(name, kind)
            if found is not None:
                self.note = FOUND
                return found, name
            if slot not in self._names and settings_in(stated, kind) == now.settings and not self._asked:
                raise BadInput(self._gone(stated, kind))
        result = self._kept_and_read(name, kind, make())
        self._anew = False
        return result, name

    def gives(self, **names: str) -> None:
        """Say under which names is kept what the filter gives out, by slot."""
        self._names |= names

    def kept_as(self, name: str, kind: str) -> Any:
        """What is kept under a name, None where nothing is."""
        if kind == "views":
            return Cache.of_user().read(name, read_views)
        from svv.fields.scene import Scene
        from svv.kernels.dispatch import device_named

        found = Cache.of_user().read(name, Scene.load)
        return None if found is None else found.on(device_named(self.values["Device"]))

    def stated(self) -> dict[str, str]:
        """The names that the state carries, by slot."""
        try:
            names = json.loads(self.values.get("KeptAs") or "{}")
        except ValueError:
            return {}
        return {str(k): str(v) for k, v in names.items()} if isinstance(names, dict) else {}

    def GetKept(self) -> str:
        """The names under which results are kept, for the state."""
        return json.dumps({**self.stated(), **self._names}) if self._names else ""

    def TakeAsEdited(self) -> None:
        """Look at the transfer function again, and make what a saved state misses."""
        self._asked = True
        super().TakeAsEdited()

    def make_anew(self) -> None:
        """Do the work next time, whatever is kept."""
        self._anew = True
        self.Modified()

    def _kept_and_read(self, name: str, kind: str, result: Any) -> Any:
        """A result as every later process will have it: scenes lose a little in their files."""
        self.note = Cache.of_user().write(name, lambda path: _write(result, path))
        if kind == "views":
            return result
        kept = None if self.note else self.kept_as(name, kind)
        if kept is None:
            kept = type(result).from_bytes(result.to_bytes())
        self.note = self.note and f" {self.note}"
        return kept.on(result.device)

    def _gone(self, name: str, kind: str) -> str:
        place = Cache.of_user()
        again = f"press {self.button}, and {'they are' if kind == 'views' else 'it is'} {MADE[kind]} anew"
        if place.holds(name):
            return f"The input is not what it was when this state was saved; to go on with it, {again}."
        verb = "are" if kind == "views" else "is"
        return f"The {kind} that this state was saved with {verb} gone from {place.folder}: {again}."


def read_views(folder: Path, progress: Any = silent) -> Views:
    """Training views, and test views where there are any; raises BadInput where they cannot be read."""
    from svv.io.viewset import ViewSet

    train = ViewSet.read(folder, "train", part(progress, 0.0, 0.8))
    there = (folder / "transforms_test.json").exists()
    return train, ViewSet.read(folder, "test", part(progress, 0.8, 1.0)) if there else None


def views_in(folder: Path, key: str, progress: Any = silent) -> Views | None:
    """The views in the user's folder, None where they are of something else, or not whole."""
    try:
        told = json.loads((folder / "transforms_train.json").read_text(encoding="utf-8"))["svv"]["key"]
        return read_views(folder, progress) if told == key else None
    except (BadInput, OSError, ValueError, KeyError, TypeError):
        return None


def write_views(views: Views, folder: Path, progress: Any = silent) -> None:
    """Write them to a folder; raises BadInput where that fails."""
    train, test = views
    train.write(folder, "train", part(progress, 0.0, 0.8))
    if test is not None:
        test.write(folder, "test", part(progress, 0.8, 1.0))


def _told(result: Views | Scene) -> dict[str, Any]:
    """What a result says about what it was made of; empty where it is none of a filter's."""
    told = result[0].meta.to_json() if isinstance(result, tuple) else result.made
    return told if all(name in told for name in ("key", "look", "data", "time")) else {}


def _moment_of(result: Views | Scene, now: Moment) -> Moment:
    """What a kept result was made of, with the settings that are now."""
    told = _told(result)
    return replace(now, look=told["look"], data=told["data"], time=told["time"], asked=None)


def _write(result: Views | Scene, path: Path) -> None:
    if isinstance(result, tuple):
        write_views(result, path)
    else:
        result.save(path)
