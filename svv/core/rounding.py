"""Rounding: how far two computations of the same number may differ on any processor.

CPUs add in different orders and lane widths, and may or may not round a product before adding it. None of them is
wrong, so a test that compares two orders of arithmetic requires only what holds for all of them.
"""

from __future__ import annotations

import torch

ROUNDOFF = {torch.float64: 2.0**-53, torch.float32: 2.0**-24, torch.float16: 2.0**-11, torch.bfloat16: 2.0**-8}
"""Largest relative error of one operation, u."""


def sums_apart(count: int, dtype: torch.dtype = torch.float32) -> float:
    """Largest relative difference of two sums of the same ``count`` numbers of one sign, each in an order of its own.

    Means and inner products too. Either is at most gamma_n = n u / (1 - n u) from the truth (Higham 2002, Accuracy and
    Stability of Numerical Algorithms, sections 3.1 and 4.2); where signs differ, it is a part of the sum of magnitudes.
    Raises ValueError if so many numbers keep no digit.
    """
    lost = count * ROUNDOFF[dtype]
    if lost >= 0.5:
        raise ValueError(f"A sum of {count} numbers in {dtype} may be anything; compare in a wider type.")
    return 2 * lost / (1 - lost)


KERNELS = {"value": 1e-5, "gradient": 2e-5, "sigma": 2e-5}
"""Kernels in float32 against their references: numbers about 1, made of up to a hundred products and sums. ``value``
and ``gradient`` absolute; ``sigma`` relative, since an exponential makes the absolute error of its exponent that."""

NETWORKS = {torch.float32: 1e-4, torch.float16: 4e-3, torch.bfloat16: 2e-2}
"""Networks of up to three layers, as a part of the result (root of the mean square).

In half precision 5 to 8 u, since every layer rounds. In float32 only sums differ, but what they give is rounded to
float16 between layers, and a difference in the last digit may fall to either side.
"""
