"""Folders for temporary files that tell whether they are at work: what a killed process left can be removed.

They lie where the system has temporary files (``TMPDIR``), with names that no other program gives.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from svv.io.files.cache import LEFT_BEHIND
from svv.io.files.locks import hold_folder, removed_after
from svv.io.files.worker import PREFIX

WORK, VIEW = "svv-work-", "svv-view-"
"""Beginnings of names: of work in progress, and of pages that a browser shows. Workers' folders have their own."""

NAME = re.compile(f"({WORK}|{VIEW}|{PREFIX})[a-z0-9_]{{8}}")
"""Pattern of the names of these folders."""


@contextmanager
def work_folder() -> Iterator[Path]:
    """Yield a new folder that is held during the work, and removed after it.

    >>> with work_folder() as folder:
    ...     _ = (folder / "a.txt").write_text("work in progress")
    """
    folder = Path(tempfile.mkdtemp(prefix=WORK))
    with removed_after(folder, hold_folder(folder)):
        yield folder


def view_folder() -> Path:
    """Return a new folder for a page that a browser shows; those of yesterday and before are removed."""
    for path in temporary_folders():
        with suppress(OSError):  # another process has just removed it
            if path.name.startswith(VIEW) and path.stat().st_mtime < time.time() - LEFT_BEHIND:
                shutil.rmtree(path, ignore_errors=True)
    return Path(tempfile.mkdtemp(prefix=VIEW))


def temporary_folders() -> list[Path]:
    """Return the folders of all of the user's processes, also of those that were killed."""
    found = []
    for path in Path(tempfile.gettempdir()).glob("svv-*"):
        try:
            own = not hasattr(os, "getuid") or path.lstat().st_uid == os.getuid()
        except OSError:  # another process has just removed it
            continue
        if own and NAME.fullmatch(path.name) and path.is_dir() and not path.is_symlink():
            found.append(path)
    return found
