"""Choose how Python starts processes inside ParaView.

Since 3.14 Python first starts a fork server with ``sys.executable``, in ParaView's programs the program itself, which
exits: numba then cannot create its lock, and a warning opens ParaView's Output Messages.
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
