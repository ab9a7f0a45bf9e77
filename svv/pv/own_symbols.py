"""Make torch and triton, when loaded into ParaView, use their own symbols instead of those of libraries loaded before.

The dynamic linker resolves the symbols of a library in the libraries that were loaded before it, and ParaView loads two
libraries of which torch and triton contain their own copies:

- *BLAS.* A ParaView that is linked with the system's BLAS (Debian's is, with OpenBLAS) has ``sgemm`` in the global
  scope, and torch would use that one. Two libraries with separate threads then wait for each other: matrix products of
  the sizes used here took 2.6 to 7.5 times as long.
- *LLVM.* Mesa loads it when ParaView first renders. ``libtriton.so`` contains another version; mixed with Mesa's, the
  process ends with SIGSEGV as soon as triton is imported, which ``torch.optim`` does if triton is installed. It is
  installed with every torch that was built with CUDA.
"""

from __future__ import annotations

import importlib.abc
import os
import sys
from importlib.machinery import ExtensionFileLoader, ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

DEEPBIND = getattr(os, "RTLD_DEEPBIND", 0)
"""Flag that prefers a library's own symbols to the program's (glibc; other systems separate libraries anyway)."""

LIBRARIES = ("torch._C", "triton._C.libtriton")
"""The extension modules that load these libraries."""


class _OwnSymbols(ExtensionFileLoader):
    """Loads an extension module as Python does, but with the flag set."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        flags = sys.getdlopenflags()
        sys.setdlopenflags(flags | DEEPBIND)
        try:
            return super().create_module(spec)
        finally:
            sys.setdlopenflags(flags)


class _Finder(importlib.abc.MetaPathFinder):
    """Finds the libraries where Python would, and passes them to the loader above."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if fullname not in LIBRARIES:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, ExtensionFileLoader):
            spec.loader = _OwnSymbols(spec.loader.name, spec.loader.path)
        return spec


def prefer_own_symbols() -> None:
    """Prepare for the first import of torch or triton; import nothing. Calling it again has no effect."""
    if DEEPBIND and not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
