"""Loads torch and triton such that each uses its own symbols rather than those of libraries loaded before.

The dynamic linker resolves the symbols of a library that is loaded late in the libraries that came before it, and two
of those carry copies of what torch and triton bring along:

- *LLVM.* Mesa loads it when VTK first renders without a GPU. ``libtriton.so`` carries another version; mixed with
  Mesa's, the process ends with SIGSEGV as soon as triton is imported, which ``torch.optim`` does if triton is
  installed, as it is with every torch that was built with CUDA.
- *BLAS.* A ParaView that is linked with the system's (Debian's is, with OpenBLAS) has its ``sgemm`` in the global
  scope, and torch would use that one. Two libraries with threads of their own then wait for each other: matrix products
  of our sizes took 2.6 to 7.5 times as long.
"""

from __future__ import annotations

import importlib.abc
import os
import sys
from collections.abc import Sequence
from importlib.machinery import ExtensionFileLoader, ModuleSpec, PathFinder
from types import ModuleType

DEEPBIND = getattr(os, "RTLD_DEEPBIND", 0)
"""Flag that prefers a library's own symbols to the program's (glibc; other systems separate libraries anyway)."""

TRITON = "triton._C.libtriton"
TORCH = "torch._C"


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
    """Finds an extension module where Python would, and passes it to the loader above."""

    def __init__(self, library: str) -> None:
        self.library = library

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self.library:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, ExtensionFileLoader):
            spec.loader = _OwnSymbols(spec.loader.name, spec.loader.path)
        return spec


def prefer_own_symbols(library: str) -> None:
    """Prepare for the first import of :data:`TRITON` or :data:`TORCH`; imports nothing, and may be called again."""
    prepared = any(isinstance(finder, _Finder) and finder.library == library for finder in sys.meta_path)
    if DEEPBIND and not prepared:
        sys.meta_path.insert(0, _Finder(library))
