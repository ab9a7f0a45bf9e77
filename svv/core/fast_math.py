"""Options of numba's compiler that kernels share."""

from __future__ import annotations

FAST_MATH = {"contract", "ninf", "nnan", "nsz"}
"""What the compiler may do with floating-point operations: fuse a product and a sum, and take numbers to be finite.

It may not reorder sums. A kernel from numba's cache has been optimised more often than in the process that compiled it,
and with sums in another order, a machine's first run would differ from all later ones in the last bits.
"""
