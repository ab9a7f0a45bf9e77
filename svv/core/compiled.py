"""numba's compiler for our kernels; what it has kept of them is loaded without it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core.caching import FunctionCache
from numba.core.runtime import rtsys


class _Kept(FunctionCache):
    """Machine code of a function in numba's files.

    numba's own class first loads everything that the compiler knows of Python, NumPy and SciPy (a hundred modules, a
    quarter of a second in each process), of which kept code needs only what counts references to arrays.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code for a signature; None if it is not kept, after the compiler was prepared."""
        rtsys.initialize(target_context)
        kept = None
        with self._guard_against_spurious_io_errors():  # on Windows, another process may be writing the file
            kept = self._load_overload(sig, target_context)
        return kept or super().load_overload(sig, target_context)


def njit(*function: Callable[..., Any], cache: bool = False, **options: Any) -> Any:
    """Compile a function as ``numba.njit`` does, with the same options, and keep the code with ``cache=True``.

    Kept code must not hash, as sets and dictionaries do: numba finds out the process's secret for that with the rest.
    """
    compiled = numba.njit(*function, **options)
    if not cache:
        return compiled

    def kept(function: Callable[..., Any]) -> Any:
        kernel = compiled(function)
        if kernel is not function:  # NUMBA_DISABLE_JIT leaves it as it is
            kernel._cache = _Kept(function)
        return kernel

    return kept
