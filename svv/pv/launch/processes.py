"""Choose how Python starts processes inside ParaView.

Since version 3.14 Python first starts a fork server with ``sys.executable``. In ParaView's programs that is the program
itself, which takes the server's arguments for its own and exits. numba then cannot create its lock, and a warning opens
ParaView's Output Messages.
"""

from __future__ import annotations

import sys
from pathlib import Path


def start_processes_by_fork() -> None:
    """Choose ``fork`` if a ParaView program runs Python, the default is another method, and none was chosen yet."""
    if sys.version_info < (3, 14) or not sys.platform.startswith("linux"):
        return
    if Path(sys.executable or "").name.startswith("python"):
        return
    import multiprocessing

    if multiprocessing.get_start_method(allow_none=True) is None:
        multiprocessing.set_start_method("fork")
