"""Filters that keep their results in files, so that a saved state shows the same results when it is opened again.

The files are in the cache under names of what they depend on (:mod:`svv.pv.results.keys`), which states carry in the
property *Kept As*. If one is missing, the filter says so and waits for a button: opening a state starts no long work.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from svv.core.json_values import parsed
from svv.errors import BadInput, Progress, part, silent
from svv.io.files.cache import Cache
from svv.pv.failed import pressing
from svv.pv.results.keys import key_in, name_of, settings_in, source_of
from svv.pv.results.stored import Stored
from svv.pv.results.time_steps import Moment, Steps
from svv.pv.vtk_types import Data
from svv.pv.work.base import Filter
from svv.pv.work.vtk_data import put_scene

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.io.views.viewset import ViewSet

Result = TypeVar("Result")
Views = tuple["ViewSet", "ViewSet | None"]

MADE = {"views": "drawn", "scene": "trained", "palette": "trained", "painting": "painted"}
"""Kinds of results, and the participle that says how each is made."""

FILE = "file:"
"""Beginning of what Kept As calls a file with which a result was made; it holds the file's hash."""

LOST = " {lost} Until then, the painting that was made with it is shown: it is still in the cache."

FOUND = " The result was found in the cache."


class Keeping(Filter):
    """A filter that keeps the results of its long work for all later processes."""

    button = "Take What Is Shown Now"
    """Label of the button that starts the work if a saved state's result is missing."""

    def __init__(self) -> None:
        super().__init__()
        self._names: dict[str, str] = {}
        """Slot -> name under which the current result is kept."""
        self._asked = self._anew = False
        self.note = self.lost = ""
        """An additional sentence for Status, and one on a file without which nothing can be made."""

    def begin_with(self, slot: str, kind: str, now: Moment) -> None:
        """Restore the result that a state was saved with if the panel is unchanged; the data may have changed since."""
        name = self.stated().get(slot, "")
        if self.steps.results or settings_in(name, kind) != now.settings:
            return
        found = self.load_cached(name, kind)
        if found is not None and _provenance_of(found):
            self.steps.put(_moment_of(found, now), (found, name))
            self.gives(**{slot: name})
            self.note = FOUND

    def begin_with_painting(self, now: Moment, settings: str, paintings: Steps[tuple[Scene | Stored, str]]) -> None:
        """Restore the painting that a state was saved with, and the scene below it: the painting's file holds both."""
        name = self.stated().get("painted", "")
        if self.steps.results or paintings.results or settings_in(name, "painting") != settings:
            return
        found = self.load_cached(name, "painting")
        if found is not None and _provenance_of(found):
            below = name_of("scene", *found.made["key"].split("-"))
            scene = found if isinstance(found, Stored) else found.without_variant(found.variant)
            self.steps.put(_moment_of(found, now), (scene, below))
            paintings.put(Moment(settings, "", key_in(below)), (found, name))
            self.gives(scene=below, painted=name)
            self.note = FOUND

    def found_or_made(
        self,
        slot: str,
        kind: str,
        now: Moment,
        make: Callable[[], Result],
        own: Callable[[], Result | None] | None = None,
    ) -> tuple[Result, str]:
        """Return a result and its name: the one in the user's own file, the kept one, or one that is made now and kept.

        ``slot`` is its key in Kept As, ``kind`` one of MADE, and ``own`` returns None if the user's file holds
        something else. Raises BadInput if the result of an opened state is missing, or as ``make`` and ``own``.
        """
        name, stated = name_of(kind, source_of(now), now.settings), self.stated().get(slot, "")
        self.note = ""
        if not self._anew:
            found = None if own is None else own()
            if found is None:
                found = self.load_cached(name, kind)
            if found is not None:
                self.note = FOUND
                return found, name
            if slot not in self._names and settings_in(stated, kind) == now.settings and not self._asked:
                raise BadInput(self._gone(stated, kind))
        result = self._save_and_reload(name, kind, make())
        self._anew = False
        return result, name

    def gives(self, **names: str) -> None:
        """Record the names under which the filter's current results are kept, by slot."""
        self._names |= names
        self.values["KeptAs"] = self.GetKept()

    def load_cached(self, name: str, kind: str) -> Any:
        """Return the result that is kept under a name, or None."""
        if kind == "views":
            return Cache.of_user().read(name, read_views)
        if not Cache.of_user().holds(name):  # what follows imports torch, which takes seconds
            return None
        from svv.fields.devices.gpu import device_named
        from svv.fields.scene.scene import Scene

        found = Cache.of_user().read(name, Scene.load)
        return None if found is None else found.on(device_named(self.values["Device"]))

    def stated(self) -> dict[str, str]:
        """Return the names that the state carries, by slot."""
        try:
            names = parsed(self.values.get("KeptAs") or "{}")
        except ValueError:
            return {}
        return {str(k): str(v) for k, v in names.items()} if isinstance(names, dict) else {}

    def known_files(self) -> dict[str, str]:
        """Return the hashes of the files with which kept results were made, by the files' names."""
        named = {**self.stated(), **self._names}
        return {name.removeprefix(FILE): value for name, value in named.items() if name.startswith(FILE)}

    def GetKept(self) -> str:
        """Return the names under which results are kept, as JSON for the state."""
        return json.dumps({**self.stated(), **self._names}) if self._names else ""

    def TakeAsEdited(self) -> None:
        """Update the result to the current transfer function, and make results that a saved state lacks."""
        self._asked = True
        super().TakeAsEdited()

    def make_anew(self) -> None:
        """Do the work next time even if a result is kept."""
        self._anew = True
        self.Modified()

    def _save_and_reload(self, name: str, kind: str, result: Any) -> Any:
        """Keep a result, and return it as later processes will read it: scenes lose a little precision in files."""
        self.note = Cache.of_user().write(name, lambda path: _write(result, path))
        if kind == "views":
            return result
        reloaded = None if self.note else self.load_cached(name, kind)
        if reloaded is None:
            reloaded = type(result).from_bytes(result.to_bytes())
        self.note = self.note and f" {self.note}"
        return reloaded.on(result.device)

    def _gone(self, name: str, kind: str) -> str:
        place = Cache.of_user()
        again = f"{pressing(self.button)}, and {'they are' if kind == 'views' else 'it is'} {MADE[kind]} again"
        if self.lost:
            return f"{self.lost} What was made with it is missing from {place.folder}, too."
        if place.holds(name):
            return f"The input has changed since this state was saved; to use the new input, {again}."
        verb = "are" if kind == "views" else "is"
        return f"The {kind} that this state was saved with {verb} missing from {place.folder}: {again}."


class SceneOutput(Keeping):
    """A filter whose output is a scene, which it can also save."""

    def give(self, scene: Scene, table: Data) -> None:
        """Put a scene into an output table, and remember it for Save Scene."""
        self.get_or_make("given", object(), lambda: scene)
        put_scene(scene, table)

    def SaveScene(self) -> None:
        """Write the scene to a file."""

        def write(file: Path) -> None:
            if self.unfinished:
                raise BadInput("The scene is still being learned: save it when it is there.")
            self.last("given").save(file)

        self.save("given", "SaveFile", write)

    def before(self, outputs: list[Data]) -> None:
        if self.last("given") is not None:
            put_scene(self.last("given"), outputs[0])


def read_views(folder: Path, progress: Progress = silent) -> Views:
    """Read training views, and test views if there are any; raise BadInput if they cannot be read."""
    from svv.io.views.transforms import transforms_file
    from svv.io.views.viewset import ViewSet

    train = ViewSet.read(folder, "train", part(progress, 0.0, 0.8))
    there = transforms_file(folder, "test") is not None
    return train, ViewSet.read(folder, "test", part(progress, 0.8, 1.0)) if there else None


def views_in(folder: Path, key: str, progress: Progress = silent) -> Views | None:
    """Return the views in the user's folder; None if they are of something else or incomplete."""
    try:
        told = parsed((folder / "transforms_train.json").read_text(encoding="utf-8"))["svv"]["key"]
        return read_views(folder, progress) if told == key else None
    except (BadInput, OSError, ValueError, KeyError, TypeError):
        return None


def _provenance_of(result: Views | Scene | Stored) -> dict[str, Any]:
    """Return a result's record of what it was made from; empty if no filter made it."""
    record = result[0].meta.to_json() if isinstance(result, tuple) else result.made
    return record if all(name in record for name in ("key", "look", "data", "time")) else {}


def _moment_of(result: Views | Scene | Stored, now: Moment) -> Moment:
    """Return what a kept result was made from, with the current settings."""
    made_from = _provenance_of(result)
    return replace(now, look=made_from["look"], data=made_from["data"], time=made_from["time"], asked=None)


def _write(result: Views | Scene, path: Path) -> None:
    if isinstance(result, tuple):
        from svv.io.views.viewset import write_splits

        write_splits(path, *result)
    else:
        result.save(path)
