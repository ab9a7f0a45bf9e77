"""Work in stages, none of which is repeated unnecessarily: ``stages.json`` records settings, outputs and costs.

The same command skips every stage whose settings, inputs and files are unchanged. Results of stages that depended on
what is no longer there are removed: the results in the folder always belong together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

from svv.core.json_values import parsed
from svv.errors import Progress, silent
from svv.io.files.atomic import make_folder, write_json
from svv.io.files.keyed_results import key_of
from svv.measure import give_memory_back, let_go_of_libraries, measured

READ_WHOLE = 1 << 30
"""Maximum bytes of an input file that is read to identify it."""

COST = (("key", (str,)), ("title", (str,)), ("seconds", (int, float)), ("peak_rss_bytes", (int,)),
        ("files", (list,)), ("after", (list,)))  # fmt: skip
"""What the record tells about a stage, and of which types."""

Show = Callable[[str], AbstractContextManager[Progress]]
"""Shows the progress of one stage under its title, like :func:`svv.progress.shown`."""


@contextmanager
def unseen(title: str) -> Iterator[Progress]:
    """Hide the progress."""
    yield silent


class Stages:
    """The stages of one job in one folder, which is created if missing; raises BadInput if it cannot be."""

    def __init__(self, folder: Path, show: Show = unseen) -> None:
        self.folder = make_folder(folder)
        self.show = show
        self.page: Path | None = None
        """Page of the results of all stages, which is removed when one of them has been done again."""
        self.costs: dict[str, dict[str, object]] = {}
        self._keys: dict[str, str] = {}
        self._redone: set[str] = set()
        self._record = _read(self.folder / "stages.json")

    def do(
        self,
        name: str,
        title: str,
        settings: Mapping[str, object],
        outputs: Sequence[Path],
        work: Callable[[Progress], object],
        after: Sequence[str] = (),
    ) -> bool:
        """Do a stage, unless it was done before; return whether it was done in this call.

        ``name`` is that in ``stages.json``. ``settings`` (JSON) are all that the results depend on besides the stages
        ``after`` which it comes, which must be done already. The ``outputs`` exist once ``work``, called with a
        progress, is done; all other files in the folder that the stage wrote when it was done before are removed.
        """
        key = self._keys[name] = key_of(settings, [self._keys[stage] for stage in after])
        done = self._record.get(name)
        fresh = not self._redone.intersection(after)
        if done and fresh and done["key"] == key and all(path.exists() for path in outputs):
            self.costs[name] = done
            return False
        files = [str(path.relative_to(self.folder)) for path in outputs if path.is_relative_to(self.folder)]
        same = [other for other, told in self._record.items() if other != name and set(told["files"]) & set(files)]
        if done or same:  # a killed stage may leave the results of two settings
            for stage in filter(self._record.get, (name, *same)):
                self._record[stage] = {**self._record[stage], "key": ""}
            write_json(self.folder / "stages.json", self._record)
        try:
            with self.show(title) as progress, measured() as cost:
                work(progress)
        except BaseException:
            with suppress(OSError):  # a folder with results of earlier stages is kept
                self.folder.rmdir()
            raise
        give_memory_back()  # memory freed by one stage must not count towards the next one's peak
        let_go_of_libraries()
        self._redone.add(name)
        for stage in (name, *same):
            self._drop(stage, files)
        if self.page is not None:
            self.page.unlink(missing_ok=True)
        self.costs[name] = self._record[name] = {
            "key": key,
            "title": title,
            "seconds": round(cost.seconds, 2),
            "peak_rss_bytes": cost.peak_rss_bytes,
            "files": files,
            "after": list(after),
        }
        write_json(self.folder / "stages.json", self._record)
        return True

    def _drop(self, name: str, keep: Sequence[str]) -> None:
        """Remove what a stage wrote and what all stages wrote that depend on it, but for the files to keep."""
        for file in self._record.pop(name, {"files": ()})["files"]:
            path = self.folder / str(file)
            if file not in keep and self.folder.resolve() in path.resolve().parents:
                with suppress(OSError):
                    path.unlink()
        for later in [later for later, told in self._record.items() if name in told["after"]]:
            self._drop(later, keep)

    def key(self, name: str) -> str:
        """Return the hash of a finished stage's settings and of everything that it depends on."""
        return self._keys[name]


def fingerprint(path: Path) -> dict[str, object]:
    """Identify a file, to detect changes: by its name, which appears in results, and its content.

    A folder, such as one with the chunks of a Zarr array, and a file above :data:`READ_WHOLE` are identified by the
    sizes and times of files instead.
    """
    if path.is_file() and path.stat().st_size <= READ_WHOLE:
        return {"name": path.name, "content": path}
    files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    return {
        "name": path.name,
        "files": [[str(f.relative_to(path.parent)), f.stat().st_size, f.stat().st_mtime_ns] for f in files],
    }


def _read(path: Path) -> dict[str, dict[str, Any]]:
    try:
        record = parsed(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}  # no record, or none that can be relied on
    stages = record.items() if isinstance(record, dict) else ()
    return {name: told for name, told in stages if isinstance(told, dict) and all(_fits(told, *key) for key in COST)}


def _fits(told: Mapping[str, object], key: str, kinds: tuple[type, ...]) -> bool:
    return isinstance(told.get(key), kinds) and not isinstance(told[key], bool)
