"""Loads torch and triton into ParaView such that each uses its own symbols, not those of the libraries already there.

The dynamic linker gives a library that is loaded late the symbols of what came before it, and ParaView brings two
libraries of which torch and triton carry copies of their own:

- *BLAS.* A ParaView that is linked with one of the system (Debian's is, with OpenBLAS) has its ``sgemm`` in the global
  scope, and torch would be given that one. Two libraries with threads of their own then wait for each other: matrix
  products of our sizes took 2.6 to 7.5 times as long.
- *LLVM.* Mesa loads it when ParaView first renders. ``libtriton.so`` carries another version; mixed with Mesa's, the
  process ends with SIGSEGV as soon as triton is imported, which ``torch.optim`` does where triton is installed. It is
  with every torch that was built with CUDA.
"""

from __future__ import annotations

import importlib.abc
import os
import sys
from importlib.machinery import ExtensionFileLoader, ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

DEEPBIND = getattr(os, "RTLD_DEEPBIND", 0)
"""A library's own symbols before those of the program (glibc; other systems keep libraries apart by themselves)."""

LIBRARIES = ("torch._C", "triton._C.libtriton")
"""The extension modules that bring the libraries in."""


class _OwnSymbols(ExtensionFileLoader):
    """Loads an extension module as Python does, with the flag set meanwhile."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        flags = sys.getdlopenflags()
        sys.setdlopenflags(flags | DEEPBIND)
        try:
            return super().create_module(spec)
        finally:
            sys.setdlopenflags(flags)


class _Finder(importlib.abc.MetaPathFinder):
    """Finds the libraries where Python would, and hands them to the loader above."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if fullname not in LIBRARIES:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, ExtensionFileLoader):
            spec.loader = _OwnSymbols(spec.loader.name, spec.loader.path)
        return spec


def prefer_own_symbols() -> None:
    """Prepare for the first import of torch or triton; imports nothing itself, and may be called again."""
    if DEEPBIND and not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
