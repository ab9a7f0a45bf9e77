"""Work in stages that need not be done twice.

A job writes what each stage made, under which settings and at what cost, into ``stages.json`` beside its results. The
same command again skips every stage whose settings, inputs and files are still those; a changed setting redoes the
stages that depend on it and no other.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

from svv.errors import Progress, silent
from svv.io.atomic import make_folder, write_json
from svv.io.made import key_of
from svv.measure import give_memory_back, measured

Show = Callable[[str], AbstractContextManager[Progress]]
"""Shows the progress of one stage under its title, like :func:`svv.progress.shown`."""


@contextmanager
def unseen(title: str) -> Iterator[Progress]:
    """Show the progress to nobody."""
    yield silent


class Stages:
    """The stages of one job in one folder.

    Args:
        folder: Where the results go; made where it is missing.
        show: How the progress of a stage is shown.

    Raises:
        BadInput: the folder cannot be made.
    """

    def __init__(self, folder: Path, show: Show = unseen) -> None:
        self.folder = make_folder(folder)
        self.show = show
        self.costs: dict[str, dict[str, Any]] = {}
        self._keys: dict[str, str] = {}
        self._redone: set[str] = set()
        self._record = _read(self.folder / "stages.json")

    def do(
        self,
        name: str,
        title: str,
        settings: Mapping[str, Any],
        outputs: Sequence[Path],
        work: Callable[[Progress], object],
        after: Sequence[str] = (),
    ) -> bool:
        """Do a stage, unless it was done before.

        Args:
            name: Its name in ``stages.json``.
            title: What the user reads.
            settings: All that its results depend on besides the stages in ``after`` (JSON).
            outputs: Files that are there once it is done.
            work: Called with ``progress``; writes the outputs.
            after: Names of the stages whose results it uses; they were done before.

        Returns:
            Whether it was done now.
        """
        key = self._key(settings, after)
        self._keys[name] = key
        done = self._record.get(name)
        fresh = not self._redone.intersection(after)
        if done and fresh and done["key"] == key and all(path.exists() for path in outputs):
            self.costs[name] = done
            return False
        try:
            with self.show(title) as progress, measured() as cost:
                work(progress)
        except BaseException:
            with suppress(OSError):  # it holds what earlier stages made, and stays
                self.folder.rmdir()
            raise
        give_memory_back()  # what one stage freed shall not count in the next one's peak
        self._redone.add(name)
        self.costs[name] = self._record[name] = {
            "key": key,
            "title": title,
            "seconds": round(cost.seconds, 2),
            "peak_rss_bytes": cost.peak_rss_bytes,
        }
        write_json(self.folder / "stages.json", self._record)
        return True

    def key(self, name: str) -> str:
        """The hash of the settings of a stage that was done, and of all that it depends on."""
        return self._keys[name]

    def _key(self, settings: Mapping[str, Any], after: Sequence[str]) -> str:
        return key_of(settings, [self._keys[name] for name in after])


def fingerprint(path: Path) -> dict[str, Any]:
    """What tells whether a file is still the one that it was: its name, which results show, and its content."""
    return {"name": path.name, "content": path}


def _read(path: Path) -> dict[str, dict[str, Any]]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}  # nothing was done here, or nothing that we can rely on
    return record if isinstance(record, dict) else {}
