"""Lets torch calculate with its own linear algebra inside ParaView.

A ParaView that is linked with a BLAS of the system (Debian's is, with OpenBLAS) has that library's ``sgemm`` in the
global scope, and the dynamic linker gives it to torch in place of the one that torch brings along. Two libraries with
threads of their own then wait for each other: matrix products of our sizes took 2.6 to 7.5 times as long. So torch is
loaded such that its own symbols come first.
"""

from __future__ import annotations

import importlib.abc
import importlib.util
import os
import sys
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

DEEPBIND = getattr(os, "RTLD_DEEPBIND", 0)
"""Symbols of a library before those of the program (glibc)."""


class _Loading(importlib.abc.MetaPathFinder):
    """Finds torch as Python does, and sets the flag while it is loaded."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if fullname != "torch":
            return None
        sys.meta_path.remove(self)  # once is enough, and the next line searches again
        spec = importlib.util.find_spec(fullname)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def with_flag(module: ModuleType) -> None:
                flags = sys.getdlopenflags()
                sys.setdlopenflags(flags | DEEPBIND)
                try:
                    execute(module)
                finally:
                    sys.setdlopenflags(flags)

            spec.loader.exec_module = with_flag  # type: ignore[method-assign]
        return spec


def prefer_its_own_symbols() -> None:
    """Prepare for the first ``import torch``; imports nothing itself."""
    if "torch" not in sys.modules and DEEPBIND:
        sys.meta_path.insert(0, _Loading())
