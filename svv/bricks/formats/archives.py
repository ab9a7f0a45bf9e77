"""Zip archives that hold a store of Zarr, looked at as if they were folders."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from zipfile import BadZipFile, ZipFile

from svv.errors import BadInput


@dataclass(frozen=True)
class ArchivePath:
    """A path within an archive, with the methods of :class:`pathlib.Path` that readers of stores use."""

    archive: Path
    names: frozenset[str]
    """All files in the archive."""
    at: PurePosixPath

    @staticmethod
    def root(archive: Path) -> ArchivePath:
        """Return the place in an archive at which a Zarr store begins: its root, or its only folder.

        Raises BadInput if it is damaged, or holds no such store.
        """
        try:
            with ZipFile(archive) as opened:
                names = frozenset(name for name in opened.namelist() if not name.endswith("/"))
        except BadZipFile as error:
            raise BadInput(f"Cannot read {archive}: it is damaged, incomplete, or no zip archive.") from error
        root = ArchivePath(archive, names, PurePosixPath())
        folders = {name.partition("/")[0] for name in names}
        for place in (root, root / next(iter(folders)) if len(folders) == 1 else root):
            if any((place / name).is_file() for name in ("zarr.json", ".zarray", ".zgroup")):
                return place
        raise BadInput(f"{archive} holds no Zarr array or group at its root: unpack it, and name what is to be read.")

    def __truediv__(self, name: str) -> ArchivePath:
        return ArchivePath(self.archive, self.names, self.at / name)

    def __str__(self) -> str:
        return f"{self.archive}/{self.at}"

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self.at.name

    @property
    def parents(self) -> list[ArchivePath]:
        """The folders above, the nearest first."""
        return [ArchivePath(self.archive, self.names, above) for above in self.at.parents]

    def is_file(self) -> bool:
        """Return whether there is a file of this name."""
        return self.at.as_posix() in self.names

    def is_dir(self) -> bool:
        """Return whether there are files below."""
        return any(True for _ in self.rglob("*"))

    def read_bytes(self) -> bytes:
        """Return what the file holds."""
        with ZipFile(self.archive) as opened:
            return opened.read(self.at.as_posix())

    def rglob(self, pattern: str) -> Iterator[ArchivePath]:
        """Return all files below; the pattern is that of all."""
        for name in self.names:
            path = PurePosixPath(name)
            if path != self.at and path.is_relative_to(self.at):
                yield ArchivePath(self.archive, self.names, path)

    def relative_to(self, other: ArchivePath) -> PurePosixPath:
        """Return the path from another one to this."""
        return self.at.relative_to(other.at)
