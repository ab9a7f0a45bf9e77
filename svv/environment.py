"""Environment variables that torch and numba read when they are loaded; the user's own settings are kept."""

from __future__ import annotations

from collections.abc import MutableMapping

LAYERS = "omp tbb workqueue"
"""Numba's threading layers in the order in which they are tried."""


def share_cores(environ: MutableMapping[str, str]) -> None:
    """Let threads that wait for each other sleep. Call it before torch is loaded.

    By default, OpenMP's threads spin on the very cores that our kernels' threads, ParaView's window or other programs
    need. Alone on two cores, a short training takes 10 % less time without, and beside other work a third of it.
    """
    if "GOMP_SPINCOUNT" not in environ:
        environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def use_huge_pages(environ: MutableMapping[str, str]) -> None:
    """Let torch ask for pages of 2 MiB for its large tensors. Call it before torch is loaded.

    Samples are looked up all over tables of many megabytes, so with pages of 4 KiB most look-ups also miss the
    processor's table of pages. Linux gives huge pages to those that ask (``madvise``, as in Ubuntu) or to all programs
    (``always``); NumPy asks without being told.
    """
    environ.setdefault("THP_MEM_ALLOC_ENABLE", "1")


def prefer_openmp(environ: MutableMapping[str, str]) -> None:
    """Let numba use OpenMP, as torch does, where it is there. Call it before numba is loaded.

    ParaView 6.1 brings TBB, which numba would prefer, and with which the first of several ranks never ends.
    """
    environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", LAYERS)
