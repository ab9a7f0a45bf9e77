"""Libraries that torch and numba import if they find them, and that our commands never use."""

from __future__ import annotations

import importlib.abc
import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

IDLE = {"cuda.bindings": "torch", "coverage": "numba", "yaml": "numba"}
"""Module -> the library that imports it, and does without where it is not installed.

They are for notes in recordings of a GPU's work, for lines that a compiler has covered, and for :data:`SETTINGS`.
"""

SETTINGS = ".numba_config.yaml"
"""File in the current folder that numba reads with yaml."""

DRIVERS = ("/proc/driver/nvidia", "/dev/nvidiactl", "/dev/dxg")
"""Where there is one of these, there may be a GPU."""


class _Idle(importlib.abc.MetaPathFinder):
    """Says of an idle module that it is not there, as long as its library is being imported."""

    def __init__(self, idle: dict[str, str]) -> None:
        self.idle = idle

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        library = sys.modules.get(self.idle.get(fullname, ""))
        if library is not None and getattr(library.__spec__, "_initializing", False):
            raise ModuleNotFoundError(f"{fullname} is left out here", name=fullname)
        return None


def leave_out_idle_imports() -> None:
    """Prepare for the first import of torch and numba, in a process that is only ours: 70 ms less."""
    kept = {"yaml": os.path.exists(SETTINGS), "cuda.bindings": any(map(os.path.exists, DRIVERS))}
    sys.meta_path.insert(0, _Idle({name: library for name, library in IDLE.items() if not kept.get(name)}))
