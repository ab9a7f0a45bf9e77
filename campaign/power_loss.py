"""What a power failure would leave at every moment of a command: ``python -m campaign.power_loss``.

A disk may lose all that was not synced: the content of a file until ``fsync`` of the file, and its name (or a new, or
a missing one) until ``fsync`` of its folder. Before each call of the file system, two disks are put together from what
has happened so far, and everything on them has to open: one that lost all that it may lose, and one that kept all names
and lost all content. After the command, its results must be on both.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from campaign import small
from campaign.calls import watched

Content = dict[str, bytes]
"""Files by their path in the folder."""


class Disk:
    """A folder, and what is certain to be on disk of it."""

    def __init__(self, root: Path, scratch: Path) -> None:
        self.root, self.scratch = Path(os.path.realpath(root)), scratch
        self.wrong: list[str] = []
        self.states = 0
        self._count = 0
        self._numbers: dict[int, int] = {}  # by inode, which the next file gets when one is removed
        self._data: dict[int, bytes] = {}
        self._names: dict[int, dict[str, int]] = {}
        self._checked: set[int] = set()
        for path in [self.root, *self.root.rglob("*")]:  # what is there has been there for long
            self._synced(path)

    def seen(self, kind: str, path: str) -> None:
        """Check the disk before a call, and note what the call makes certain."""
        self.check(f"{kind} {path.removeprefix(str(self.root))}")
        if kind == "fsync":
            self._synced(Path(path))
        elif kind in ("unlink", "rmdir", "rename") and os.path.lexists(path):
            self._numbers.pop(os.lstat(path).st_ino, None)

    def check(self, when: str) -> None:
        """Open all files of both disks."""
        for name, content in (("all", self.least()), ("content", self.empty())):
            state = hash(tuple(sorted(content.items())))
            if state in self._checked:
                continue
            self._checked.add(state)
            self.states += 1
            shutil.rmtree(self.scratch, ignore_errors=True)
            for file, data in content.items():
                place = self.scratch / file
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(data)
            self.wrong += [f"before {when}, without {name} that is not synced: {e}" for e in opened(self.scratch)]

    def least(self) -> Content:
        """Return the files with a final name of which content and name are certain."""
        return dict(self._below(self._number(self.root), ""))

    def empty(self) -> Content:
        """Return all files with a final name, without content that is not certain."""
        files = (path for path in self.root.rglob("*") if path.is_file())
        return {
            str(name): self._data.get(self._number(path), b"")
            for path in files
            if not is_hidden(name := path.relative_to(self.root))
        }

    def _below(self, folder: int, place: str) -> Iterator[tuple[str, bytes]]:
        for name, number in self._names.get(folder, {}).items():
            if name.startswith("."):
                continue
            if number in self._names:
                yield from self._below(number, f"{place}{name}/")
            else:
                yield f"{place}{name}", self._data.get(number, b"")

    def _synced(self, path: Path) -> None:
        number = self._number(path)
        if path.is_dir():
            self._names[number] = {inside.name: self._number(inside) for inside in path.iterdir()}
        else:
            self._data[number] = path.read_bytes()

    def _number(self, path: Path) -> int:
        inode = path.lstat().st_ino
        if inode not in self._numbers:
            self._count += 1
            self._numbers[inode] = self._count
            if path.is_dir():
                self._names.setdefault(self._count, {})
        return self._numbers[inode]


def is_hidden(name: Path) -> bool:
    """Whether a path is not a final one."""
    return any(part.startswith(".") for part in name.parts)


def opened(folder: Path) -> list[str]:
    """Return what does not open; a checkpoint that is damaged does no harm."""
    return small.cannot_open(folder) if folder.is_dir() else []


def lossy(name: str, inputs: Path, folder: Path, again: bool = False) -> Disk:
    """Run a command on a disk that may lose power at any moment; with ``again``, on top of its own results."""
    small.fresh(inputs, folder)
    if again:
        small.here(small.COMMANDS[name], folder)
        for record in folder.glob("out/stages.json"):
            record.write_text("{}")  # do it all again
    before = set(small.files_in(folder))
    disk = Disk(folder, folder.with_name("crashed"))
    with watched(str(folder), disk.seen):
        small.here(small.COMMANDS[name], folder)
    disk.check("the end")
    made = {file for file in small.files_in(folder) if not is_hidden(Path(file))}
    for what, kept in (("name", set(disk.least())), ("content", {f for f, data in disk.empty().items() if data})):
        disk.wrong += [f"after the end, {file} can lose its {what}" for file in sorted(made - kept)]
    assert made - before or again, "the command wrote nothing"
    return disk


def main() -> None:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--command", default=",".join(small.COMMANDS))
    names = parser.parse_args().command.split(",")
    bad = 0
    with tempfile.TemporaryDirectory() as place:
        small.be_small()
        inputs = small.prepare(Path(place) / "inputs", names)
        for name in names:
            for again in (False, True):
                disk = lossy(name, inputs, Path(place) / "w", again)
                bad += bool(disk.wrong)
                print(f"{name}{' again' * again}: {disk.states} states, {len(disk.wrong)} wrong", flush=True)
                for line in disk.wrong[:12]:
                    print(line, flush=True)
    sys.exit(bool(bad))


if __name__ == "__main__":
    small.in_one_thread("campaign.power_loss")
    main()
